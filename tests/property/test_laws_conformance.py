"""What every law must satisfy, over the table of laws: a new law is tested with no edit here."""

from __future__ import annotations

import inspect
import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from ohmloom.devices import LAWS, CardValue, Device
from ohmloom.devices import _kernels as kernels

SENSIBLE = 1.0  # V
# Exceptions, each with its reason.
TRAPPING = {
    "hp_joglekar": "its window is zero on both walls",
    "hp_prodromakis": "its window is zero on both walls",
}
# Not ideal, as dq/dt is not i, yet dq/dt is i times a function of the state and the current's sign: time and voltage
# trade.
INVARIANT = ("hp_joglekar", "hp_biolek", "hp_prodromakis")
VOLATILE = {"peo_pani_redox": "oxidation and reduction go on at v = 0"}
IDEAL = [name for name, law in LAWS.items() if law.is_ideal]
OTHERS = [name for name, law in LAWS.items() if not law.is_ideal]


def defaults(name):
    return tuple(parameter.default for parameter in LAWS[name].parameters)


def make(name):
    values = tuple(CardValue(value=value, source="default") for value in defaults(name))
    return Device(name=name, law=name, source="defaults", values=values)


def state_rate(name, s, v, p=None):
    law, p = LAWS[name], defaults(name) if p is None else p
    return law.charge_rate(s, v, law.conductance(s, v, p) * v, p) / law.charge_scale(p)


def seconds(name, volts=0.5):
    """A time in which 0.5 V moves the state by a good part, from the fastest rate at mid-range."""
    return 0.1 / max(abs(state_rate(name, s, sign * volts)) for s in (0.3, 0.5, 0.7) for sign in (-1.0, 1.0))


def sine(name, period, amplitude=SENSIBLE, points=65, s0=0.5, periods=1):
    t = np.linspace(0.0, periods * period, periods * (points - 1) + 1)
    return make(name).simulate(amplitude * np.sin(2 * np.pi * t / period), t, s0=s0)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_passive_at_every_state_and_voltage(name):
    s, v = np.meshgrid(np.linspace(0.0, 1.0, 41), np.linspace(-2.0 * SENSIBLE, 2.0 * SENSIBLE, 41))
    g = LAWS[name].conductance(s, v, defaults(name))
    assert np.isfinite(g).all()
    assert (g > 0.0).all()


@pytest.mark.parametrize("name", LAWS)
def test_conductance_rises_with_the_state_at_every_voltage(name):
    s, v = np.linspace(0.0, 1.0, 101)[:, None], np.linspace(-SENSIBLE, SENSIBLE, 11)
    assert (np.diff(LAWS[name].conductance(s, v, defaults(name)), axis=0) > 0.0).all()


@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=8, deadline=None)
@given(
    v=st.lists(st.floats(-2.0 * SENSIBLE, 2.0 * SENSIBLE), min_size=2, max_size=5),
    s0=st.floats(0.0, 1.0),
    gap=st.sampled_from([1e-3, 0.1, 3.0]),
    walls=st.sampled_from(["clip", "soft"]),
)
def test_under_any_drive_charge_stays_in_bounds_and_energy_is_absorbed(name, v, s0, gap, walls):
    device = make(name)
    trace = device.simulate(v, gap * np.arange(len(v)), s0=s0, walls=walls)
    assert (trace.s >= 0.0).all()
    assert (trace.s <= 1.0).all()
    assert (trace.q <= device.charge_scale).all()
    assert (trace.v * trace.i >= 0.0).all()
    assert trapezoid(trace.v * trace.i, trace.t) >= 0.0
    assert (trace.i[trace.v == 0.0] == 0.0).all()
    # Below it the product with G underflows.
    assert (trace.i[np.abs(trace.v) > 1e-290] != 0.0).all()


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("wall", [0.0, 1.0])
def test_no_wall_is_a_trap_except_where_the_law_says_so(name, wall):
    inward = SENSIBLE if wall == 0.0 else -SENSIBLE
    trace = make(name).simulate([inward] * 2, [0.0, 1.0], s0=wall)
    if name in TRAPPING:
        assert state_rate(name, wall, inward) == 0.0
        assert trace.s[-1] == wall
    else:
        assert abs(trace.s[-1] - wall) > 1e-6


@pytest.mark.parametrize("name", LAWS)
def test_only_a_volatile_law_moves_without_a_voltage(name):
    rates = np.abs([state_rate(name, s, 0.0) for s in (0.0, 0.3, 1.0)])
    assert (rates > 0.0).any() == (name in VOLATILE)


@pytest.mark.parametrize("name", IDEAL)
def test_lobe_area_falls_with_frequency_and_area_times_frequency_settles(name):
    unit = seconds(name)
    products, areas = [], []
    for speed in (4.0, 40.0, 400.0):
        trace = sine(name, unit / speed, points=801)
        half = slice(0, 401)
        area = abs(trapezoid(trace.i[half], trace.v[half]))
        areas.append(area)
        products.append(area * speed)
    assert areas[0] > areas[1] > areas[2]
    # The first correction is of the order of the state's swing, 1/speed.
    assert products[2] == pytest.approx(products[1], rel=0.1)
    assert abs(products[2] / products[1] - 1) < 0.3 * abs(products[1] / products[0] - 1)


@pytest.mark.parametrize("name", OTHERS)
def test_lobe_area_vanishes_with_frequency_for_the_other_laws_too(name):
    """The state cannot follow, so that only i(v) at a standing state is left, which has no area."""
    period = 1e-3 * seconds(name, SENSIBLE)
    areas = []
    for speed in (1.0, 100.0):
        trace = sine(name, period / speed, points=201)
        areas.append(abs(trapezoid(trace.i[:101], trace.v[:101])) / np.abs(trace.i).max())
    # Below 1e-12 both are rounding.
    assert areas[1] < 0.1 * areas[0] or areas[0] < 1e-12


@pytest.mark.parametrize("name", IDEAL)
def test_memristance_is_the_slope_of_flux_over_charge(name):
    device = make(name)
    s, step = np.linspace(0.05, 0.95, 19), 1e-5
    slope = (device.flux(s + step) - device.flux(s - step)) / (2 * step * device.charge_scale)
    # Central differences: step^2 times the third derivative, large at the mirror law's pole beyond s = 0.
    np.testing.assert_allclose(slope, device.memristance(s), rtol=1e-5)


@pytest.mark.parametrize("name", OTHERS)
def test_other_laws_are_no_functions_of_the_charge_that_passed(name):
    """dq/dt is not i: the same transported charge at another voltage or state moves the state by another amount."""
    p = defaults(name)
    law = LAWS[name]
    ratios = []
    for s in (0.2, 0.5, 0.9):
        for v in (-1.0, -0.05, 0.05, 1.0):
            i = law.conductance(s, v, p) * v
            ratios.append(law.charge_rate(s, v, i, p) / i)
    assert np.ptp(ratios) > 1e-3 * np.abs(ratios).max()
    with pytest.raises(ValueError, match="expected an ideal law"):
        make(name).flux(0.5)


def scaled_states(name, k):
    t = np.linspace(0.0, seconds(name) * 2.0, 33)
    v = 0.4 * np.sin(2 * np.pi * t / t[-1])
    slow = make(name).simulate(v, t, s0=0.5).s
    return slow, make(name).simulate(k * v, t / k, s0=0.5).s


@pytest.mark.parametrize("name", [*IDEAL, *INVARIANT])
def test_an_ideal_law_or_a_window_sees_the_flux_alone(name):
    slow, fast = scaled_states(name, 3.0)
    assert np.ptp(slow) > 1e-3
    np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-9)  # the integrator's own error


@pytest.mark.parametrize("name", [name for name in OTHERS if name not in INVARIANT])
def test_the_other_laws_see_more_than_the_flux(name):
    slow, fast = scaled_states(name, 3.0)
    assert np.abs(fast - slow).max() > 1e-4


@pytest.mark.parametrize("name", LAWS)
def test_python_arrays_and_the_compiled_law_agree(name):
    law, p = LAWS[name], np.array(defaults(name))
    index = kernels.LAW_INDEX[name]
    s, v = (a.ravel() for a in np.meshgrid([0.0, 0.3, 0.8, 1.0], [-0.9, -0.15, 0.0, 1e-4, 0.4, 1.0]))
    g = law.conductance(s, v, p)
    rate = law.charge_rate(s, v, g * v, p) + 0.0 * s
    for k in range(s.size):
        plain = law.conductance(float(s[k]), float(v[k]), defaults(name))
        moved = law.charge_rate(float(s[k]), float(v[k]), float(g[k] * v[k]), defaults(name))
        # Last bits of exp and sinh, enlarged by the exponents of Pickett's rates, up to 200.
        assert g[k] == pytest.approx(plain, rel=1e-13)
        assert kernels.conductance(index, s[k], v[k], p) == pytest.approx(plain, rel=1e-13)
        assert rate[k] == pytest.approx(moved, rel=1e-11, abs=0)
        assert kernels.charge_rate(index, s[k], v[k], g[k] * v[k], p) == pytest.approx(moved, rel=1e-11, abs=0)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(("s", "v"), [(0.23, 0.37), (0.61, -0.83)])
def test_exact_derivatives_agree_with_central_differences(name, s, v):
    casadi = pytest.importorskip("casadi")
    law, p = LAWS[name], np.array(defaults(name))
    x = casadi.SX.sym("x", 2 + p.size)
    given_p = [x[2 + k] for k in range(p.size)]
    g = law.conductance(x[0], x[1], given_p)
    out = casadi.vertcat(g, law.charge_rate(x[0], x[1], g * x[1], given_p))
    at = np.concatenate([[s, v], p])
    exact = np.array(casadi.Function("jacobian", [x], [casadi.jacobian(out, x)])(at))

    def value(z):
        g = law.conductance(z[0], z[1], z[2:])
        return np.array([g, law.charge_rate(z[0], z[1], g * z[1], z[2:])])

    base = value(at)
    for k in range(at.size):
        step = np.zeros_like(at)
        step[k] = 1e-5 * (abs(at[k]) or 1.0)
        # Two differences, whose errors of order step^2 cancel.
        wide, narrow = ((value(at + c * step) - value(at - c * step)) / (2 * c * step[k]) for c in (1.0, 0.5))
        numeric = (4.0 * narrow - wide) / 3.0
        # Rounding of the values, enlarged by the exponents of Pickett's rates, over the step.
        noise = 1e-10 * np.abs(base) / abs(step[k])
        assert (np.abs(exact[:, k] - numeric) <= 1e-6 * np.abs(numeric) + noise).all(), law.parameters[k - 2].name


@pytest.mark.parametrize("name", LAWS)
def test_every_law_documents_equation_source_validity_and_sign(name):
    text = inspect.getdoc(sys.modules[LAWS[name].charge_rate.__module__])
    assert "Equation" in text
    assert "Range of validity" in text
    assert "positive current" in " ".join(text.split()).lower()
    assert "terminal" in text
    # A source has a year or a chapter; a law made of two others names them.
    assert re.search(r"\b(19|20)\d\d\b|\bch\. \d|as in `\w+`", text)
