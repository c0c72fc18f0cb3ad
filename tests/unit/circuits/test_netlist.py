"""Netlists against hand formulas, SciPy, and the device room's own integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ohmloom.circuits import (
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    Netlist,
    NetlistTrace,
    PiecewiseLinear,
    Pulse,
    Resistor,
    Sine,
    Subcircuit,
    TwoPartSpike,
    VoltageSource,
)
from ohmloom.devices import LAWS, CardValue, Device
from ohmloom.errors import FileFormatError, ParameterError, UnknownNameError

# States are integrated at a relative 1e-10 per step; some hundred steps, and interpolation between them.
INTEGRATED = 1e-8


def resistor(name, p, n, resistance):
    return Resistor(name=name, p=p, n=n, resistance=resistance)


def source(voltage, name="V1", p="in", n="0"):
    return VoltageSource(name=name, p=p, n=n, voltage=voltage)


def capacitor(name, p, n, capacitance, initial=0.0):
    return Capacitor(name=name, p=p, n=n, capacitance=capacitance, initial=initial)


def memristor(device, s0=0.3, name="M1", p="in", n="0"):
    return Memristor(name=name, p=p, n=n, device=Device.load(device), s0=s0)


def netlist(*elements, **fields):
    return Netlist(elements=elements, **fields)


def test_divider_has_the_voltages_and_currents_of_ohms_law():
    point = netlist(source(3.0), resistor("R1", "in", "out", 2e3), resistor("R2", "out", "0", 1e3)).dc()
    # A 3 x 3 solve: rounding.
    assert point.v["out"] == pytest.approx(1.0, rel=1e-13)
    assert point.i["R1"] == pytest.approx(1e-3, rel=1e-13)
    assert point.i["V1"] == pytest.approx(-1e-3, rel=1e-13)
    assert point.residual < 1e-13


def test_current_source_takes_from_p_and_gives_to_n():
    point = netlist(
        CurrentSource(name="I1", p="0", n="a", current=2e-3),
        resistor("R1", "a", "b", 1e3),
        resistor("R2", "b", "0", 0.0),
    ).dc()
    assert point.v["a"] == pytest.approx(2.0, rel=1e-13)
    assert point.v["b"] == 0.0
    assert point.i["I1"] == 2e-3
    assert point.i["R2"] == pytest.approx(2e-3, rel=1e-13)  # the current of a resistance of zero is known


def test_controlled_sources_follow_their_control():
    point = netlist(
        source(0.5),
        VCVS(name="E1", p="a", n="0", control_p="0", control_n="in", gain=4.0),
        resistor("R1", "a", "0", 1e3),
        VCCS(name="G1", p="0", n="b", control_p="in", control_n="0", transconductance=1e-3),
        resistor("R2", "b", "0", 2e3),
    ).dc()
    assert point.v["a"] == pytest.approx(-2.0, rel=1e-13)
    assert point.v["b"] == pytest.approx(1.0, rel=1e-13)  # out of ground, into b
    assert point.i["G1"] == pytest.approx(0.5e-3, rel=1e-13)
    assert point.i["E1"] == pytest.approx(2e-3, rel=1e-13)


def test_nonlinear_devices_share_a_voltage_by_newton():
    device = Device.load("hp_tio2")
    law = LAWS["tio2_threshold"]
    curved = Device(name="curved", law=law.name, source="test",
                    values=tuple(CardValue(value=p.default, source="default") for p in law.parameters))  # fmt: skip
    point = netlist(
        source(2.0),
        Memristor(name="M1", p="in", n="mid", device=curved, s0=0.4),
        Memristor(name="M2", p="mid", n="0", device=device, s0=0.5),
    ).dc()
    u = 2.0 - point.v["mid"]
    # Kirchhoff by the device's own conductance, which depends on the voltage.
    assert curved.conductance(0.4, u) != curved.conductance(0.4, 0.0)
    assert curved.conductance(0.4, u) * u == pytest.approx(device.conductance(0.5) * point.v["mid"], rel=1e-12)
    assert point.i["M1"] == pytest.approx(point.i["M2"], rel=1e-12)


def test_capacitor_charges_exponentially():
    trace = netlist(source(1.0), resistor("R1", "in", "out", 1e3), capacitor("C1", "out", "0", 1e-6, 0.25)).simulate(
        5e-3
    )
    wanted = 1.0 - 0.75 * np.exp(-trace.t / 1e-3)
    np.testing.assert_allclose(trace.v["out"], wanted, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trace.i["C1"], (1.0 - wanted) / 1e3, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(trace.i["V1"], -trace.i["R1"], rtol=1e-12)
    assert trace.residual < 1e-12


def test_capacitors_in_a_loop_share_the_current_by_capacitance():
    ramp = PiecewiseLinear(times=(0.0, 1e-3), values=(0.0, 2.0))
    trace = netlist(
        source(ramp), capacitor("C0", "in", "0", 3e-6), resistor("R1", "in", "a", 1e3),
        capacitor("C1", "a", "0", 1e-6), capacitor("C2", "0", "a", 2e-6),
    ).simulate(1e-3, points=11)  # fmt: skip
    tau = 3e-3
    wanted = 2e3 * (trace.t - tau * (1.0 - np.exp(-trace.t / tau)))
    np.testing.assert_allclose(trace.v["a"], wanted, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trace.i["C0"], 3e-6 * 2e3, rtol=1e-12)  # i = C dv/dt of the source
    np.testing.assert_allclose(trace.i["C2"], -2.0 * trace.i["C1"], rtol=1e-9, atol=1e-15)


def test_capacitors_agree_with_scipy_in_a_ladder():
    spike = TwoPartSpike(
        first=1.0, second=-1.0, first_width=1e-3, second_width=1e-3, edge=1e-5, delay=2e-4, period=4e-3
    )
    trace = netlist(
        source(spike), resistor("R1", "in", "a", 1e3), capacitor("C1", "a", "0", 1e-6),
        resistor("R2", "a", "b", 2e3), capacitor("C2", "b", "0", 1e-7),
        CurrentSource(name="I1", p="b", n="0", current=1e-4),
    ).simulate(6e-3, points=201)  # fmt: skip

    def slopes(t, y):
        a, b = y
        through = (a - b) / 2e3
        return [((spike.value(t) - a) / 1e3 - through) / 1e-6, (through - 1e-4) / 1e-7]

    other = solve_ivp(
        slopes, (0.0, 6e-3), [0.0, 0.0], method="Radau", t_eval=trace.t, rtol=1e-9, atol=1e-12, max_step=5e-6
    )
    np.testing.assert_allclose(trace.v["a"], other.y[0], rtol=0.0, atol=1e-7)  # that of the reference
    np.testing.assert_allclose(trace.v["b"], other.y[1], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("card", ["hp_tio2", "hp_tio2_10k", "linear", "peo_pani", "peo_pani_redox", "yakopcic_miao"])
def test_memristor_alone_is_device_simulate(card):
    device = Device.load(card)
    drive = Sine(amplitude=1.0, frequency=1.0)
    trace = netlist(source(drive), memristor(card)).simulate(1.5, points=301)
    alone = device.simulate(drive.value, trace.t, s0=0.3)
    # Two integrators; at a wall hp_tio2_10k runs away, which stretches their differences.
    np.testing.assert_allclose(trace.s["M1"], alone.s, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(trace.q["M1"], alone.q, rtol=0.0, atol=1e-7 * device.charge_scale)
    np.testing.assert_allclose(trace.i["M1"], alone.i, rtol=0.0, atol=1e-7 * np.abs(alone.i).max())
    assert np.ptp(alone.s) > 0.05


def test_state_stops_at_a_wall_and_leaves_it_when_the_drive_turns():
    device = Device.load("hp_tio2_10k")
    trace = netlist(source(Sine(amplitude=1.0, frequency=1.0)), memristor("hp_tio2_10k")).simulate(1.0, points=401)
    at_wall = trace.s["M1"] == 1.0
    assert at_wall.sum() > 10
    assert trace.t[at_wall].max() == pytest.approx(0.5, abs=1e-12)  # to the sample at which the voltage turns
    assert trace.s["M1"][-1] < 0.9
    assert trace.s["M1"].max() == 1.0
    np.testing.assert_allclose(trace.i["M1"][at_wall], trace.v["in"][at_wall] * device.conductance(1.0), rtol=1e-12)


def test_state_leaves_a_wall_between_corners():
    # With an offset the voltage turns where the source has no corner, so only the event can tell.
    device, drive = Device.load("hp_tio2_10k"), Sine(amplitude=1.0, frequency=1.0, offset=0.2)
    trace = netlist(source(drive), memristor("hp_tio2_10k")).simulate(1.5, points=301)
    alone = device.simulate(drive.value, trace.t, s0=0.3)
    np.testing.assert_allclose(trace.s["M1"], alone.s, rtol=0.0, atol=1e-7)
    assert (trace.s["M1"] == 1.0).sum() > 20
    assert alone.s[-1] == 1.0
    assert alone.s[200] < 0.95


def test_two_memristors_arrive_and_leave_together():
    pair = netlist(source(Sine(amplitude=2.0, frequency=1.0)), memristor("hp_tio2_10k", p="in", n="a"),
                   memristor("hp_tio2_10k", name="M2", p="a", n="0")).simulate(1.0, points=101)  # fmt: skip
    one = netlist(source(Sine(amplitude=1.0, frequency=1.0)), memristor("hp_tio2_10k")).simulate(1.0, points=101)
    for name in ("M1", "M2"):
        np.testing.assert_allclose(pair.s[name], one.s["M1"], rtol=0.0, atol=1e-7)
    assert (one.s["M1"] == 1.0).any()


def test_memristor_behind_a_resistor_agrees_with_an_independent_integration():
    device, series, drive = Device.load("hp_tio2"), 3e3, Sine(amplitude=1.0, frequency=2.0)
    trace = netlist(source(drive), resistor("R1", "in", "a", series), memristor("hp_tio2", p="a")).simulate(
        1.0, points=101
    )

    def slope(t, s):
        return [drive.value(t) / (series + 16e3 + (100.0 - 16e3) * s[0]) / device.charge_scale]

    other = solve_ivp(slope, (0.0, 1.0), [0.3], method="DOP853", t_eval=trace.t, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(trace.s["M1"], other.y[0], rtol=0.0, atol=INTEGRATED)
    assert np.ptp(other.y[0]) > 0.05


def test_subcircuit_equals_its_parts_and_names_them():
    half = netlist(resistor("R1", "a", "mid", 500.0), resistor("R2", "mid", "b", 500.0), ports=("a", "b"), name="half")
    pair = netlist(Subcircuit(name="X1", netlist=half, nodes={"a": "p", "b": "q"}),
                   Subcircuit(name="X2", netlist=half, nodes={"a": "q", "b": "0"}), ports=("p",), name="pair",
    )  # fmt: skip
    point = netlist(source(4.0), Subcircuit(name="Y", netlist=pair, nodes={"p": "in"})).dc()
    assert point.v["Y.X1.mid"] == pytest.approx(3.0, rel=1e-13)
    assert point.v["Y.q"] == pytest.approx(2.0, rel=1e-13)
    assert point.i["Y.X2.R2"] == pytest.approx(2e-3, rel=1e-13)


def test_trace_survives_a_file(tmp_path):
    trace = netlist(source(Sine(amplitude=1.0, frequency=1.0)), memristor("hp_tio2")).simulate(1.0, points=21)
    path = tmp_path / "trace.npz"
    trace.save(path)
    first = path.read_bytes()
    again = NetlistTrace.load(path)
    again.save(path)
    assert path.read_bytes() == first
    for part in ("v", "i", "s", "q"):
        assert list(getattr(again, part)) == list(getattr(trace, part))
        for name, values in getattr(trace, part).items():
            np.testing.assert_array_equal(getattr(again, part)[name], values)
    assert (again.provenance, again.residual) == (trace.provenance, trace.residual)
    assert not again.v["in"].flags.writeable
    path.write_bytes(first[: len(first) // 2])
    with pytest.raises(FileFormatError, match="expected an npz file of a netlist_trace"):
        NetlistTrace.load(path)


def test_trace_plots_voltages_with_units_and_knows_its_names():
    trace = netlist(source(1.0), resistor("R1", "in", "0", 1.0)).simulate(1.0, points=3)
    ax = trace.plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "voltage [V]")
    with pytest.raises(UnknownNameError, match=r"NetlistTrace\.v: expected one of in, got 'inn'\. Did you mean 'in'\?"):
        trace.v["inn"]
    with pytest.raises(ParameterError, match="expected times from 0 s to 1 s, got 2 s"):
        trace.at([2.0])


PULSE = Pulse(high=1.0, rise=1e-9, width=1e-6, fall=2e-9)
DIVIDER = (source(1.0), resistor("R1", "in", "0", 1.0))
ERRORS = {
    "negative resistance": (lambda: resistor("R1", "a", "0", -5.0), "R1.resistance: expected 0 Ohm or more, got -5"),
    "zero capacitance": (lambda: capacitor("C1", "a", "0", 0.0), "C1.capacitance: expected a number above 0 F"),
    "negative capacitance": (lambda: capacitor("C1", "a", "0", -1.0), "expected a number above 0 F, got -1 F"),
    "nan": (lambda: source(float("nan")), "V1.voltage: expected a waveform, or a finite number in V, got nan"),
    "state": (lambda: memristor("hp_tio2", 1.5), "M1.s0: expected a state, 0 <= s0 <= 1, got 1.5"),
    "one node twice": (lambda: resistor("R1", "a", "a", 1.0), "R1.n: expected another node than p, got 'a' for both"),
    "ground by another name": (lambda: resistor("R1", "a", "gnd", 1.0), "R1.n: expected '0' for ground, got 'gnd'"),
    "name": (lambda: resistor("R 1", "a", "0", 1.0), "Resistor.name: expected letters, digits and _, got 'R 1'"),
    "duplicate": (lambda: netlist(*DIVIDER, resistor("r1", "in", "0", 1.0)), "got 'r1' 2 times. Rename one"),
    "case of nodes": (lambda: netlist(*DIVIDER, resistor("R2", "IN", "0", 1.0)), "more than case, got IN and in"),
    "unknown port": (
        lambda: Subcircuit(name="X", netlist=netlist(*DIVIDER, ports=("in",)), nodes={"inn": "a"}),
        "X.nodes: expected one of in, got 'inn'. Did you mean 'in'?",
    ),
    "missing port": (
        lambda: Subcircuit(name="X", netlist=netlist(*DIVIDER, ports=("in",)), nodes={}),
        "X.nodes: expected a node for each port of netlist, got none for in",
    ),
    "port of no element": (lambda: netlist(*DIVIDER, ports=("out",)), "Netlist.ports: expected nodes of its elements"),
    "floating": (
        lambda: netlist(*DIVIDER, resistor("R2", "x", "y", 1.0)).dc(),
        "expected a path for direct current from every node to '0', got none from x, y",
    ),
    "floating behind a capacitor": (
        lambda: netlist(*DIVIDER, capacitor("C1", "in", "x", 1.0)).dc(), "to '0', got none from x. Connect it"
    ),
    "current source alone": (
        lambda: netlist(CurrentSource(name="I1", p="0", n="x", current=1.0)).simulate(1.0), "got none from x"
    ),
    "control of nothing": (
        lambda: netlist(
            *DIVIDER, VCCS(name="G", p="in", n="0", control_p="z", control_n="0", transconductance=1.0)
        ).dc(),
        "got none from z",
    ),
    "loop": (
        lambda: netlist(source(1.0), resistor("R1", "in", "b", 0.0), source(1.0, "V2", "b")).dc(),
        "expected no loop of voltage sources and zero resistances, got R1, V1, V2. Put a resistance into it.",
    ),
    "no solution": (
        lambda: netlist(
            source(1.0), resistor("R1", "a", "0", 1.0),
            VCCS(name="G", p="a", n="0", control_p="a", control_n="0", transconductance=-1.0),
        ).dc(),
        "expected equations with one solution, got none or many for node a",
    ),
    "capacitors disagree": (
        lambda: netlist(source(1.0), capacitor("C1", "in", "0", 1.0)).simulate(1.0),
        "C1.initial: expected 1 V, which V1 put on it at t = 0, got 0 V",
    ),
    "capacitor across a controlled source": (
        lambda: netlist(
            *DIVIDER, VCVS(name="E", p="e", n="0", control_p="in", control_n="0", gain=1.0),
            capacitor("C1", "e", "0", 1.0),
        ).simulate(1.0),
        "expected a resistance between C1 and the controlled source E",
    ),
    "empty": (lambda: netlist().dc(), "Netlist.elements: expected at least one element, got none"),
    "no duration": (lambda: netlist(*DIVIDER).simulate(), "t_end: expected a duration in s, got none"),
    "duration": (lambda: netlist(*DIVIDER).simulate(0.0), "t_end: expected a time above 0 s, got 0 s"),
    "times": (lambda: netlist(*DIVIDER).simulate(t=[0.0, 0.0]), "expected times in s from 0 or later on"),
    "both": (lambda: netlist(*DIVIDER).simulate(1.0, t=[0.0, 1.0]), "expected either t, or t_end and points, got both"),
    "coarse step": (
        lambda: netlist(source(PULSE), resistor("R1", "in", "0", 1.0)).simulate(1e-5, max_step=1e-8),
        "max_step: expected at most 1e-09 s, the shortest edge of V1, got 1e-08 s",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_bad_input_is_named(case):
    call, text = ERRORS[case]
    with pytest.raises(ParameterError) as caught:
        call()
    assert text in str(caught.value)


def test_max_step_bounds_the_step_and_changes_nothing_else():
    made = netlist(source(PULSE), memristor("hp_tio2"))
    coarse, fine = made.simulate(2e-6, points=5), made.simulate(2e-6, points=5, max_step=1e-9)
    np.testing.assert_allclose(fine.s["M1"], coarse.s["M1"], rtol=0.0, atol=1e-12)
