"""Hosted FMUs as devices: in a netlist beside the same device of our own, and beside a measurement."""

import json

import numpy as np
import pytest

from ohmloom.circuits import Capacitor, Memristor, Netlist, Resistor, Sine, VoltageSource
from ohmloom.cli import main
from ohmloom.devices import Device, Measurement
from ohmloom.errors import ParameterError
from ohmloom.fmu import Host, HostedDevice, export_device, reference_errors, simulate_hosted

HP = Device.load("hp_tio2_paper")
T_END = 1.0


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    with Host(export_device(HP, tmp_path_factory.mktemp("hp") / "hp.fmu", q0=0.3 * HP.charge_scale).path) as one:
        yield one


SOURCE = VoltageSource(name="V1", p="in", n="0", voltage=Sine(offset=0.0, amplitude=0.4, frequency=1.0))
AROUND = (SOURCE, Resistor(name="R1", p="in", n="out", resistance=0.2),
          Capacitor(name="C1", p="out", n="0", capacitance=0.1))  # fmt: skip


def test_a_hosted_device_is_our_own_but_for_the_step(host):
    own = Netlist(elements=(*AROUND, Memristor(name="X1", p="out", n="0", device=HP, s0=0.3)))
    wanted = own.simulate(T_END, points=101)
    device = HostedDevice(name="X1", p="out", n="0", host=host)
    errors = []
    for step in (1e-2, 5e-3):
        found = simulate_hosted(Netlist(elements=AROUND), [device], t_end=T_END, step=step)
        errors.append(np.abs(found.v["out"][:: round(1e-2 / step)] - wanted.v["out"]).max())
        assert found.residual < 1e-12
    assert errors[1] < 5e-3
    # Explicit and sampled: of first order.
    assert 1.7 < errors[0] / errors[1] < 2.3


def test_an_algebraic_loop_is_refused(host):
    device = HostedDevice(name="X1", p="out", n="0", host=host)
    with pytest.raises(
        ParameterError, match=r"^simulate_hosted: X1: expected capacitors .* between out and 0, got .*loop"
    ):
        simulate_hosted(Netlist(elements=AROUND[:2]), [device], t_end=T_END, step=1e-2)
    # Across the source there is none.
    direct = HostedDevice(name="X1", p="in", n="0", host=host)
    found = simulate_hosted(Netlist(elements=AROUND), [direct], t_end=T_END, step=1e-2)
    assert np.abs(found.i["X1"]).max() > 0.1


def test_bad_hosted_devices_are_refused(host):
    with pytest.raises(ParameterError, match=r"^X1.current: expected one of .*, got 'j'. Name it as the FMU does."):
        HostedDevice(name="X1", p="a", n="0", host=host, current="j")
    with pytest.raises(ParameterError, match=r"^simulate_hosted: step: expected 0 < step <= t_end = 1 s"):
        simulate_hosted(Netlist(elements=AROUND), [], t_end=1.0, step=2.0)


def sweep(**options):
    t = np.linspace(0.0, 1.0, 201)
    v = 0.4 * np.sin(2.0 * np.pi * t)
    own = HP.simulate(v, t, s0=0.3)
    return Measurement(name="own", t=t, v=v, i=own.i, **options)


def test_a_reference_of_the_same_device_misses_little(host):
    # What is left is a voltage held at its mean over each of 200 steps.
    assert reference_errors(host, [sweep()])["own"] < 1e-3
    with pytest.raises(
        ParameterError, match=r"^own: expected the device's own voltage, got that of a source behind 0.5 Ohm"
    ):
        reference_errors(host, [sweep(series_resistance=0.5)])


def test_compare_takes_an_fmu_as_reference(host, tmp_path, capsys):
    own = sweep()
    rows = "\n".join(
        f"{t!r},{v!r},{i!r}" for t, v, i in zip(own.t.tolist(), own.v.tolist(), own.i.tolist(), strict=True)
    )
    (tmp_path / "loop.csv").write_text(f"t,v,i\n{rows}\n")
    words = ["device", "compare", tmp_path / "loop.csv", "--laws", "linear", "--screen", "10", "--starts", "1",
             "--reference", host.path, "--json"]  # fmt: skip
    with pytest.raises(SystemExit) as caught:
        main([str(word) for word in words])
    assert caught.value.code == 0
    table = json.loads(capsys.readouterr().out)
    assert table["reference"]["relative_rms"]["loop"] < 1e-3
    assert table["reference"]["relative_rms"]["loop"] < table["ranking"][0]["relative_rms"]
