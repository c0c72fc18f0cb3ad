"""Netlists here and in ngspice: operating points, transients with capacitors and memristors, crossbars."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.circuits import (
    VCCS,
    VCVS,
    Capacitor,
    Crossbar,
    CurrentSource,
    Memristor,
    Netlist,
    Pulse,
    Resistor,
    Sine,
    Subcircuit,
    TwoPartSpike,
    VoltageSource,
    crossbar_netlist,
    run_ngspice,
)
from ohmloom.devices import Device
from ohmloom.errors import OperationError

# Of the largest value of each quantity: ngspice's own step control at relative tolerance 1e-6 and a thousand steps.
DEFAULT = 1e-4
# At 1e-8 and steps of 1e-5 of the duration.
TIGHT = 2e-6


@pytest.fixture(autouse=True)
def ngspice(need_tool):
    return need_tool("netlists are not compared here", "ngspice")


def mixed():
    half = Netlist(name="half", ports=("a", "b"), elements=(
        Resistor(name="R1", p="a", n="mid", resistance=500.0), Resistor(name="R2", p="mid", n="b", resistance=500.0),
    ))  # fmt: skip
    hp = Device.load("hp_tio2")
    return Netlist(t_end=2e-2, elements=(
        VoltageSource(name="V1", p="in", n="0",
                      voltage=Pulse(high=1.0, rise=1e-4, width=5e-3, fall=1e-4, period=1e-2, delay=1e-4)),
        Subcircuit(name="X1", netlist=half, nodes={"a": "in", "b": "out"}),
        Resistor(name="wire", p="out", n="top", resistance=0.0),
        Capacitor(name="C1", p="top", n="0", capacitance=1e-6, initial=0.2),
        Memristor(name="M1", p="top", n="low", device=hp, s0=0.3),
        Memristor(name="M2", p="low", n="0", device=hp.replace(r_off=8e3), s0=0.6),
        VCVS(name="amp", p="e", n="0", control_p="top", control_n="0", gain=2.0),
        Resistor(name="load", p="e", n="0", resistance=1e3),
        VCCS(name="gm", p="f", n="0", control_p="top", control_n="0", transconductance=1e-3),
        Resistor(name="load2", p="f", n="0", resistance=1e3),
        CurrentSource(name="I1", p="0", n="f", current=Sine(amplitude=1e-3, frequency=100.0, offset=1e-4)),
    ))  # fmt: skip


def spiking():
    spike = TwoPartSpike(first=1.0, second=-1.0, first_width=0.1, second_width=0.05, edge=1e-3, delay=0.05, period=0.25)
    return Netlist(t_end=0.5, elements=(
        VoltageSource(name="V1", p="in", n="0", voltage=spike),
        Resistor(name="R1", p="in", n="a", resistance=2e3),
        Memristor(name="M1", p="a", n="0", device=Device.load("hp_tio2_10k"), s0=0.3),
        Memristor(name="M2", p="a", n="0", device=Device.load("peo_pani"), s0=0.5),
    ))  # fmt: skip


def check(netlist, limit, **options):
    """Everything at ngspice's own times, each against its largest value."""
    theirs = run_ngspice(netlist, **options)
    ours = netlist.simulate(t=theirs.t)
    for part in ("v", "i", "s", "q"):
        assert set(getattr(theirs, part)) == set(getattr(ours, part))
        for name, values in getattr(ours, part).items():
            error = np.abs(getattr(theirs, part)[name] - values).max()
            assert error <= limit * np.abs(values).max(), (part, name)
    assert theirs.residual <= limit
    return ours


@pytest.mark.parametrize("make", [mixed, spiking])
def test_transient_equals_ngspice_at_default_options(make):
    trace = check(make(), DEFAULT)
    assert all(np.ptp(s) > 1e-4 for s in trace.s.values())


@pytest.mark.parametrize("make", [mixed, spiking])
def test_transient_equals_ngspice_at_tight_options(make):
    check(make(), TIGHT, relative_tolerance=1e-8, max_step=make().t_end * 1e-5)


def test_operating_point_equals_ngspice():
    held = VoltageSource(name="V1", p="in", n="0", voltage=0.7)
    netlist = Netlist(elements=(held, *mixed().elements[1:]))
    theirs, ours = run_ngspice(netlist), netlist.dc()
    scale = max(map(abs, ours.i.values()))
    for name, value in ours.v.items():
        assert theirs.v[name][0] == pytest.approx(value, rel=1e-9)  # both solve to rounding but for gmin
    for name, value in ours.i.items():
        assert theirs.i[name][0] == pytest.approx(value, abs=1e-9 * scale)


@pytest.mark.parametrize("ends", [("left", "bottom"), ("both", "both")])
@pytest.mark.parametrize(("r_row", "r_column"), [(1.0, 2.0), (0.0, 3.0), (10.0, 0.0)])
def test_crossbar_read_equals_its_netlist_and_ngspice(r_row, r_column, ends):
    rng = np.random.default_rng(7)
    g = rng.uniform(1e-6, 1e-3, (4, 4))
    g[1, 2] = 0.0
    drivers = [5.0, 0.0, 20.0, np.inf] if r_row else [5.0, 1.0, 20.0, np.inf]
    array = Crossbar(conductance=g, r_row=r_row, r_column=r_column, r_driver=drivers, r_sense=50.0, drive=ends[0],
                     sense=ends[1])  # fmt: skip
    v = rng.uniform(-1.0, 1.0, 4)
    read, netlist = array.read(v), crossbar_netlist(array, v)
    ours, theirs = netlist.dc(), run_ngspice(netlist)
    for values in (ours.i, {name: current[0] for name, current in theirs.i.items()}):
        current = [values[f"S_{j}"] + values.get(f"T_{j}", 0.0) for j in range(4)]
        np.testing.assert_allclose(current, read.current, rtol=0.0, atol=1e-9 * np.abs(read.current).max())


def test_failure_quotes_ngspice_and_keeps_the_deck():
    with pytest.raises(OperationError) as caught:
        run_ngspice("* bad\nV1 a 0 1\nX1 a 0 nothing\n.op\n.end\n")
    text = str(caught.value)
    deck = text.partition(": expected")[0]
    assert "nothing" in text
    assert text.endswith("Check the deck, which is kept.")
    with open(deck) as file:
        assert file.readline() == "* bad\n"


def test_time_out_is_an_error():
    # A hundred million steps.
    deck = "* long\nV1 a 0 SIN(0 1 1)\nR1 a b 1\nC1 b 0 1\n.tran 1e-6 100 0 1e-6\n.end\n"
    with pytest.raises(OperationError, match=r"deck\.cir: expected ngspice to finish within 0\.5 s, got no end"):
        run_ngspice(deck, timeout=0.5)


def test_deck_of_ones_own_gives_its_nodes_and_sources():
    trace = run_ngspice("* own\nV1 a 0 2\nR1 a mid 1k\nR2 mid 0 3k\n.op\n.end\n")
    assert trace.v["mid"].tolist() == pytest.approx([1.5], rel=1e-9)
    assert trace.i["v1"].tolist() == pytest.approx([-0.5e-3], rel=1e-9)
