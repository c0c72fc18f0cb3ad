"""Single shooting: exact derivatives, order of accuracy, stability, walls and the series resistor."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.devices import LAWS, Measurement
from ohmloom.devices.fitting._checks import sizes
from ohmloom.devices.fitting._coordinates import choose
from ohmloom.devices.fitting._shooting import Shooting

AMPLITUDES = {"hp_joglekar": 0.3, "hp_prodromakis": 0.3, "hp_biolek": 0.4, "pickett": 0.6, "vteam": 0.3}


def shoot(law, sweep, *, substeps=4, follow=False, values=None):
    coordinates = choose(LAWS[law], {}, ())
    defaults = {p.name: p.default for p in LAWS[law].parameters}
    z = coordinates.of_values({**defaults, **(values or {})})
    return Shooting(coordinates, (sweep,), sizes((sweep,), "relative"), substeps=substeps, follow=follow), z


def drive(amplitude, *, points=40, period=1.0, resistance=0.0, current=1e-3):
    t = np.linspace(0.0, period, points)
    v = amplitude * np.sin(2 * np.pi * t / period + 0.1)
    return Measurement(name="drive", t=t, v=v, i=current * v, series_resistance=resistance)


# law -> values at which the state moves over a good part of its range in one second
VALUES = {
    "hp_linear": {"r_on": 400.0, "r_off": 1.6e3, "beta": 4.0},
    "hp_joglekar": {"r_on": 400.0, "r_off": 1.6e3, "beta": 4.0},
    "hp_biolek": {"r_on": 400.0, "r_off": 1.6e3, "beta": 4.0},
    "hp_prodromakis": {"r_on": 400.0, "r_off": 1.6e3, "beta": 4.0},
    "linear": {"r_on": 1e4, "r_off": 1e5, "q_d": 4e-5},
    "peo_pani_mirror": {"r_on": 1e4, "r_off": 1e5, "q_d": 4e-5},
    "tio2_threshold": {"r_on": 2e3, "r_off": 4e4, "v_set": 0.2, "v_reset": 0.15, "q_set": 3e-4, "q_reset": 2e-4},
    "mirror_threshold": {"r_on": 2e3, "r_off": 2e4, "v_set": 0.2, "v_reset": 0.15, "q_set": 3e-4, "q_reset": 2e-4},
    "peo_pani_redox": {"r_on": 1e4, "r_off": 5e5, "e0": 0.2, "slope": 0.2, "k0": 1.0},
    "vteam": {"r_off": 2e3, "k_set": 4.0, "k_reset": 2.0},
    "yakopcic": {},
    "pickett": {},
}


def central_differences(shooting, z, h=1e-5):
    columns = []
    for k in range(len(z)):
        step = np.zeros(len(z))
        step[k] = h
        columns.append((shooting.residual(z + step) - shooting.residual(z - step)) / (2 * h))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("resistance", [0.0, 1e3])
@pytest.mark.parametrize("law", LAWS)
def test_the_jacobian_is_the_derivative_of_the_residual(law, resistance):
    shooting, z = shoot(law, drive(0.45, points=12, period=0.3, resistance=resistance, current=1e-4), substeps=2,
                        values=VALUES[law])  # fmt: skip
    z = np.append(z, 0.41)
    exact, differences = shooting.jacobian(z), central_differences(shooting, z)
    assert np.abs(shooting.state(z, 0) - 0.5).max() < 0.499  # off the walls, where there are kinks
    # A central difference of 1e-5 is good to about 1e-10 over rounding; the norm of J bounds columns of size zero.
    scale = np.maximum(np.linalg.norm(exact, axis=0), 1e-6 * np.linalg.norm(exact))
    assert (np.linalg.norm(exact - differences, axis=0) < 1e-5 * scale).all()


@pytest.mark.parametrize("law", ["hp_linear", "peo_pani_mirror", "tio2_threshold", "peo_pani_redox"])
def test_current_is_that_of_simulate_and_errors_fall_with_the_square_of_the_step(law, device):
    sweep = drive(0.4, points=61)
    reference = device(law, **VALUES[law]).simulate(sweep.v, sweep.t, s0=0.41).i
    found = []
    for substeps in (2, 4, 8):
        shooting, z = shoot(law, sweep, substeps=substeps, values=VALUES[law])
        error = shooting.current(np.append(z, 0.41), 0) - reference
        found.append(np.linalg.norm(error) / np.linalg.norm(reference))
    assert found[0] < 1e-3
    # Second order: a factor of four; the sine's thresholds and simulate's own 1e-9 leave it within a third.
    assert 2.9 < found[0] / found[1] < 5.5
    assert 2.9 < found[1] / found[2] < 5.5


def test_a_relaxation_far_faster_than_the_step_stays_at_its_steady_state():
    shooting, z = shoot("peo_pani_redox", drive(0.5), substeps=1,
                        values={**VALUES["peo_pani_redox"], "k0": 1e6})  # fmt: skip
    s = shooting.state(np.append(z, 0.3), 0)
    t = shooting.sweeps[0].t
    steady = 1.0 / (1.0 + np.exp(-(0.5 * (shooting.sweeps[0].v[1:] + shooting.sweeps[0].v[:-1]) - 0.2) / 0.2))
    assert len(t) == len(s)
    np.testing.assert_allclose(s[1:], steady, rtol=1e-6)  # at the voltage of the middle of each step


def test_a_trapped_state_leaves_derivatives_finite():
    """At Joglekar's wall the state rests while the formula's derivative grows without end."""
    shooting, z = shoot("hp_joglekar", drive(1.0, points=200), substeps=2,
                        values={"r_on": 1.8e4, "r_off": 1.7e6, "beta": 1.1e4, "exponent": 0.1})  # fmt: skip
    z = np.append(z, 0.9)
    assert shooting.state(z, 0)[-1] == 1.0
    assert (shooting.jacobian(z)[-1, 2:] == 0.0).all()


@pytest.mark.parametrize("b", [2.0, 10.0, 30.0])
@pytest.mark.parametrize("resistance", [500.0, 5e4])
def test_device_and_series_resistor_share_the_source_voltage(b, resistance):
    sweep = drive(1.0, resistance=resistance, current=1e-7)
    shooting, z = shoot("tio2_threshold", sweep, values={**VALUES["tio2_threshold"], "b": b, "q_set": 1.0})
    z = np.append(z, 0.4)
    i, s = shooting.current(z, 0), shooting.state(z, 0)
    v = sweep.v - resistance * i
    # The device's own law at what the resistor leaves: G0 sinh(b v)/b.
    low_field = 1.0 / 4e4 + (1.0 / 2e3 - 1.0 / 4e4) * s
    np.testing.assert_allclose(low_field * np.sinh(b * v) / b, i, rtol=1e-9 * (1 + b * resistance * np.abs(i).max()))


def test_charge_regression_has_no_residual_at_the_truth(sweep):
    """The measured current moves the state: linear in time between samples, so it is the trapezoidal charge."""
    loop = sweep("linear", noise=0.0, points=2001, q_d=4e-5, s0=0.3)
    shooting, z = shoot("linear", loop, substeps=1, follow=True, values={"r_on": 1e4, "r_off": 1e5, "q_d": 4e-5})
    assert shooting.follows_current
    error = np.linalg.norm(shooting.residual(np.append(z, 0.3)))
    assert error < 1e-5  # trapezoids over 2000 steps


@pytest.mark.parametrize(("law", "follows"), [("hp_linear", True), ("tio2_threshold", True), ("pickett", True),
                                              ("peo_pani_redox", False), ("vteam", False)])  # fmt: skip
def test_which_laws_a_measured_current_can_move(law, follows):
    assert shoot(law, drive(0.3))[0].follows_current is follows
