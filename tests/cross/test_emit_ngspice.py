"""Emitted subcircuits in ngspice against `Device.simulate`: every law, every shipped card, with and without walls."""

import subprocess

import numpy as np
import pytest

from ohmloom.devices import LAWS, CardValue, Device

# ngspice's own time steps, at relative tolerance 1e-6 and 2000 to a period, are good to some 1e-5.
RELATIVE_RMS = 1e-3
STEPS, SAMPLES = 2000, 126
# Amplitudes in V at which a law's thresholds are passed and its range of validity is kept; 1 V for the others.
AMPLITUDES = {"pickett": 0.8, "peo_pani_redox": 0.7, "yakopcic": 1.2}

# Pickett's inner iteration does not settle near s = 1, where its gap is at the end of its range.
NO_WALLS = {"pickett"}


def default_device(law):
    entries = tuple(CardValue(value=parameter.default, source="default") for parameter in law.parameters)
    return Device(name=f"law_{law.name}", law=law.name, source="defaults", values=entries)


DEVICES = {device.name: device for device in map(default_device, LAWS.values())}
DEVICES.update({name: Device.load(name) for name in Device.names()})


def period_for(device, swing):
    """Period [s] of a sine whose stronger half would move s from 1/2 by `swing` at its first rate."""
    amplitude, law, p = AMPLITUDES.get(device.law, 1.0), LAWS[device.law], tuple(device.parameters.values())
    rates = []
    for sign in (1.0, -1.0):
        v = sign * amplitude * np.sin(np.pi * (np.arange(200) + 0.5) / 200)
        i = law.conductance(0.5, v, p) * v
        rates.append(float(np.mean(law.charge_rate(0.5, v, i, p) + 0.0 * v)) / device.charge_scale)
    return 2.0 * swing / max(map(abs, rates))


def run_ngspice(ngspice, folder, device, lines):
    (folder / "device.cir").write_text(device.emit("spice"))
    (folder / "deck.cir").write_text("\n".join(["* test", ".include device.cir", *lines, ".end", ""]))
    done = subprocess.run([ngspice, "-b", "deck.cir"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "aborted" not in done.stdout + done.stderr, done.stdout[-2000:] + done.stderr[-2000:]
    return np.loadtxt(folder / "out.txt", skiprows=1)


def transient(ngspice, folder, device, *, amplitude, period, duration, instance, uic=""):
    """Time, current, state and charge of a sine drive."""
    table = run_ngspice(ngspice, folder, device, [
        f"V1 a 0 SIN(0 {amplitude!r} {1.0 / period!r})",
        f"Xm a 0 {device.name} {instance}",
        ".options reltol=1e-6",
        ".control",
        "set numdgt=15",
        "set wr_singlescale",
        "set wr_vecnames",
        f"tran {period / STEPS!r} {duration!r} 0 {period / STEPS!r} {uic}",
        "wrdata out.txt i(v1) v(xm.x) v(xm.q)",
        "quit 0",
        ".endc",
    ])  # fmt: skip
    return table[:, 0], -table[:, 1], table[:, 2], table[:, 3]


def compare(ngspice, folder, device, *, swing, s0, uic=""):
    """Relative RMS of the current's difference, and the reference trace."""
    amplitude, period = AMPLITUDES.get(device.law, 1.0), period_for(device, swing)
    duration = 1.25 * period
    time, current, state, charge = transient(
        ngspice, folder, device, amplitude=amplitude, period=period, duration=duration, instance=f"s0={s0!r}", uic=uic
    )
    t = np.linspace(0.0, duration, SAMPLES)  # the drive's zeros are among them
    trace = device.simulate(lambda x: amplitude * np.sin(2.0 * np.pi * x / period), t, s0=s0)
    error = np.interp(t, time, current) - trace.i
    np.testing.assert_allclose(charge, np.clip(state, 0.0, 1.0) * device.charge_scale, atol=1e-5 * device.charge_scale)
    return float(np.sqrt(np.mean(error**2) / np.mean(trace.i**2))), trace


@pytest.fixture
def ngspice(need_tool):
    return need_tool("emitted subcircuits are not compared here", "ngspice")


@pytest.mark.parametrize("name", DEVICES)
def test_current_equals_that_of_simulate(name, ngspice, tmp_path):
    error, trace = compare(ngspice, tmp_path, DEVICES[name], swing=0.15, s0=0.4)
    assert error <= RELATIVE_RMS
    assert np.ptp(trace.s) > 0.015
    assert trace.s.min() > 0.0
    assert trace.s.max() < 1.0


def is_free(device):
    """Whether the state leaves either wall; where a window holds it there for good, its fate hangs on a last bit."""
    law, p = LAWS[device.law], tuple(device.parameters.values())
    rates = [law.charge_rate(wall, v, law.conductance(wall, v, p) * v, p) for wall, v in ((0.0, 1.0), (1.0, -1.0))]
    return all(abs(rate) > 1e-9 * device.charge_scale for rate in rates)


@pytest.mark.parametrize(
    "name", [name for name, device in DEVICES.items() if is_free(device) and device.law not in NO_WALLS]
)
def test_current_equals_that_of_simulate_at_the_walls(name, ngspice, tmp_path):
    device = DEVICES[name]
    error, trace = compare(ngspice, tmp_path, device, swing=1.5, s0=0.5, uic="uic")
    assert error <= RELATIVE_RMS
    assert np.ptp(trace.s) > 0.4
    if LAWS[device.law].is_ideal:
        assert trace.s.max() == 1.0


def test_parameters_and_state_are_set_on_the_instance(ngspice, tmp_path):
    device = Device.load("hp_tio2")
    time, current, state, _ = transient(
        ngspice, tmp_path, device, amplitude=1.0, period=1.0, duration=0.25, instance="r_off=32e3 s0=0.25"
    )
    assert state[0] == pytest.approx(0.25, rel=1e-6)
    t = np.linspace(0.0, 0.25, 26)
    trace = device.replace(r_off=32e3).simulate(lambda x: np.sin(2.0 * np.pi * x), t, s0=0.25)
    # As above, with the current's size for scale.
    np.testing.assert_allclose(np.interp(t, time, current), trace.i, atol=RELATIVE_RMS * np.abs(trace.i).max())
