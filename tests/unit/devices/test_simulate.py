"""Simulation against closed forms in the flux, and what holds for every law under any drive."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, simpson

from ohmloom.devices import LAWS, Device
from ohmloom.devices.simulate import integrate
from ohmloom.devices.walls import SOFT_WIDTH, soften
from ohmloom.errors import OperationError, ParameterError

HP = Device.load("hp_tio2_10k")
CARDS = ["hp_tio2_10k", "linear", "peo_pani"]
# The integrator works at 1e-10 per gap; a hundred gaps of one sweep stay below this.
FLUX = 1e-9


def memristance_at_flux(device, m0, flux):
    """Linear drift: dM/dt = -a i = -a v/M, so M^2 = M0^2 - 2 a phi."""
    r_on, r_off = device.parameters["r_on"], device.parameters["r_off"]
    return np.sqrt(m0**2 - 2 * (r_off - r_on) / device.charge_scale * flux)


def volts_for(device, seconds):
    """A voltage that sweeps the whole state in about so many seconds from the middle."""
    return device.charge_scale / (seconds * device.conductance(0.5))


def test_sinusoid_follows_the_flux():
    amplitude, omega = 3.0, 2 * math.pi * 10
    t = np.linspace(0.0, 0.2, 101)
    trace = HP.simulate(lambda time: amplitude * math.sin(omega * time), t, s0=0.5)
    wanted = memristance_at_flux(HP, HP.memristance(0.5), amplitude / omega * (1 - np.cos(omega * t)))
    np.testing.assert_allclose(HP.memristance(trace.s), wanted, rtol=FLUX)
    assert trace.s.max() - trace.s.min() > 0.2


def test_a_sampled_voltage_is_piecewise_linear_to_full_accuracy():
    t = np.array([0.0, 0.01, 0.012, 0.02, 0.05])
    v = np.array([0.0, 4.0, -2.0, 3.0, -1.0])
    trace = HP.simulate(v, t, s0=0.5)
    flux = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
    np.testing.assert_allclose(HP.memristance(trace.s), memristance_at_flux(HP, HP.memristance(0.5), flux), rtol=FLUX)


def test_a_zero_mean_drive_returns_the_state():
    t = np.linspace(0.0, 0.1, 51)
    for name in CARDS:
        device = Device.load(name)
        size = 0.2 * volts_for(device, 0.1)
        trace = device.simulate(lambda time, size=size: size * math.sin(20 * math.pi * time), t, s0=0.5)
        assert trace.s.max() > 0.5001
        assert trace.s[-1] == pytest.approx(0.5, abs=FLUX)


def test_the_state_stops_at_the_wall_and_leaves_when_the_voltage_turns():
    amplitude, omega = 6.0, 2 * math.pi * 10
    t = np.linspace(0.0, 0.1, 101)
    trace = HP.simulate(lambda time: amplitude * math.sin(omega * time), t, s0=0.5)
    first = t <= 0.05
    m0, flux = HP.memristance(0.5), amplitude / omega * (1 - np.cos(omega * t))
    to_wall = (m0**2 - 1e4**2) / (2 * (1e6 - 1e4) / HP.charge_scale)
    at_wall = first & (flux > to_wall)
    assert at_wall.sum() > 5
    assert (trace.s[at_wall] == 1.0).all()
    assert (trace.s[first & (flux < to_wall)] < 1.0).all()
    back = amplitude / omega * (-1 - np.cos(omega * t[~first]))
    np.testing.assert_allclose(HP.memristance(trace.s[~first]), memristance_at_flux(HP, 1e4, back), rtol=FLUX)
    # Charge still passes at the wall: the current is that of R_on.
    np.testing.assert_allclose(trace.i[at_wall], trace.v[at_wall] / 1e4, rtol=1e-14)


def test_a_turn_inside_a_gap_leaves_the_wall_at_that_moment():
    # v falls from 1 V to -3 V within one gap, so it turns at t = 0.25 s; s rests at 1 until then.
    trace = HP.simulate([1.0, -3.0], [0.0, 1.0], s0=1.0)
    flux = -3.0 * 0.75 / 2
    if memristance_at_flux(HP, 1e4, flux) > 1e6:
        assert trace.s[-1] == 0.0
    short = HP.simulate([0.1, -0.3], [0.0, 1.0], s0=1.0)
    wanted = memristance_at_flux(HP, 1e4, -0.3 * 0.75 / 2)
    assert wanted < 1e6
    assert HP.memristance(short.s[-1]) == pytest.approx(wanted, rel=FLUX)


def test_both_walls_within_one_gap():
    # Up for the first half, down for the second, each far more than the whole range.
    volts = 100.0
    trace = HP.simulate(lambda time: volts * math.cos(math.pi * time), [0.0, 0.5, 1.0], s0=0.0)
    assert trace.s.tolist() == [0.0, 1.0, 0.0]
    one_gap = HP.simulate(lambda time: volts * math.cos(math.pi * time), [0.0, 1.0], s0=0.0)
    assert one_gap.s.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", CARDS)
def test_charge_is_the_integral_of_the_current_between_walls(name):
    device = Device.load(name)
    size = 0.2 * volts_for(device, 1.0)
    t = np.linspace(0.0, 1.0, 401)
    trace = device.simulate(lambda time: size * math.sin(5 * time), t, s0=0.5)
    assert 0.0 < trace.s.min() < trace.s.max() < 1.0
    moved = simpson(trace.i, x=t)
    assert abs(moved) > 1e-3 * device.charge_scale
    # Simpson's own error on this grid, (5 h)^4/180 times the shape of i.
    assert trace.q[-1] - trace.q[0] == pytest.approx(moved, rel=1e-7)
    np.testing.assert_array_equal(trace.q, trace.s * device.charge_scale)


@pytest.mark.parametrize("name", CARDS)
@settings(max_examples=25, deadline=None)
@given(
    steps=st.lists(st.tuples(st.floats(-30.0, 30.0), st.floats(0.01, 1.0)), min_size=2, max_size=8),
    s0=st.floats(0.0, 1.0),
)
def test_any_drive_is_passive_pinched_and_keeps_the_charge_in_bounds(name, steps, s0):
    device = Device.load(name)
    unit = volts_for(device, 1.0)
    v = np.array([volts * unit for volts, _ in steps])
    t = np.cumsum([gap for _, gap in steps])
    trace = device.simulate(v, t, s0=s0)
    assert (trace.s >= 0.0).all()
    assert (trace.s <= 1.0).all()
    assert (trace.q <= device.charge_scale).all()
    assert (trace.v * trace.i >= 0.0).all()
    assert (trace.i[trace.v == 0.0] == 0.0).all()
    # The state follows the sign of a drive that keeps it.
    rising, falling = (v[1:] >= 0) & (v[:-1] >= 0), (v[1:] <= 0) & (v[:-1] <= 0)
    assert (np.diff(trace.s)[rising] >= 0.0).all()
    assert (np.diff(trace.s)[falling] <= 0.0).all()


@pytest.mark.parametrize("name", CARDS)
@pytest.mark.parametrize("wall", [0.0, 1.0])
def test_no_wall_is_a_trap(name, wall):
    device = Device.load(name)
    outward = math.copysign(1.0, wall - 0.5) * 20 * volts_for(device, 1.0)
    trace = device.simulate([outward, outward, -outward, -outward], [0.0, 1.0, 1.5, 1.51], s0=0.5)
    assert trace.s[1] == wall
    assert trace.s[-1] != wall


@pytest.mark.parametrize(("wall", "volts"), [(1.0, -1e-20), (0.0, 1e-322)])
def test_a_drive_too_weak_to_leave_the_wall_ends(wall, volts):
    """The move inward is lost to rounding, which must not be taken for an arrival, over and over."""
    trace = HP.simulate([volts, volts, -math.copysign(1.0, wall - 0.5)], [0.0, 1.0, 2.0], s0=wall)
    assert trace.s[1] == wall
    assert trace.s[2] != wall


@pytest.mark.parametrize("name", CARDS)
def test_current_is_zero_exactly_where_the_voltage_is(name):
    trace = Device.load(name).simulate([1.0, 0.0, -1.0, 0.0], [0.0, 0.1, 0.2, 0.3], s0=0.4)
    assert trace.i[[1, 3]].tolist() == [0.0, 0.0]
    assert (trace.i[[0, 2]] != 0.0).all()


def test_every_ideal_law_is_covered_by_a_card_here():
    assert {Device.load(name).law for name in CARDS} == {name for name, law in LAWS.items() if law.is_ideal}


def test_a_snap_within_the_rounding_of_the_time_arrives():
    """At 1e30 V the state crosses its range faster than two floats beside t = 1 s are apart."""
    s = integrate(LAWS["hp_linear"], tuple(HP.parameters.values()), lambda t: 1e30, np.array([1.0, 2.0]), 0.5)
    assert s.tolist() == [0.5, 1.0]


def test_a_failed_integration_returns_no_numbers():
    # A voltage that no step resolves.
    rng = np.random.default_rng(1)
    with pytest.raises(OperationError) as caught:
        integrate(LAWS["hp_linear"], tuple(HP.parameters.values()), lambda t: rng.normal(), np.array([1.0, 2.0]), 0.5)
    assert str(caught.value).startswith(
        "Device.simulate: expected hp_linear to be integrated from t = 1 s to 2 s, got "
    )
    assert str(caught.value).endswith("Give t finer steps, or lower the voltage.")


@pytest.mark.parametrize("name", CARDS)
@pytest.mark.parametrize("size", [0.2, 20.0])
def test_the_closed_form_agrees_with_the_integrator(name, size):
    """Once between the walls, once with both of them reached and sign changes within gaps."""
    device = Device.load(name)
    t = np.linspace(0.0, 2.0, 38)
    v = size * volts_for(device, 1.0) * np.sin(7.0 * t + 0.3)
    closed = device.simulate(v, t, s0=0.4, method="closed_form")
    stepped = device.simulate(v, t, s0=0.4)
    assert ({0.0, 1.0} <= set(closed.s.tolist())) == (size > 1.0)
    # The integrator's own error.
    np.testing.assert_allclose(closed.s, stepped.s, rtol=0, atol=2e-9)
    assert json.loads(closed.provenance)["method"] == "closed_form"


def test_the_closed_form_is_the_square_root_of_the_flux():
    t = np.array([0.0, 0.01, 0.012, 0.02, 0.05])
    v = np.array([0.0, 4.0, -2.0, 3.0, -1.0])
    trace = HP.simulate(v, t, s0=0.5, method="closed_form")
    flux = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
    wanted = memristance_at_flux(HP, HP.memristance(0.5), flux)
    np.testing.assert_allclose(HP.memristance(trace.s), wanted, rtol=1e-12)  # rounding of a square root's difference


@pytest.mark.parametrize("name", CARDS)
def test_flux_and_its_inverse_are_the_integral_of_the_memristance(name):
    device = Device.load(name)
    for s in (1e-3, 0.3, 0.9, 1.0):
        nodes = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 40)]) * s
        phi = device.charge_scale * math.fsum(quad(device.memristance, a, b)[0] for a, b in itertools.pairwise(nodes))
        assert device.flux(s) == pytest.approx(phi, rel=1e-9)
        assert device.state_at_flux(device.flux(s)) == pytest.approx(s, rel=1e-12)
    assert device.flux(0.0) == device.state_at_flux(0.0) == 0.0
    assert device.flux(np.zeros((2, 1))).shape == (2, 1)


def test_a_soft_wall_is_never_reached_and_left_at_once():
    volts = 20 * volts_for(HP, 1.0)
    t = [0.0, 1.0, 2.0, 2.001, 4.0]
    trace = HP.simulate([volts, volts, -1e-9, -volts, -volts], t, s0=0.5, walls="soft")
    assert (trace.s > 0.0).all()
    assert (trace.s < 1.0).all()
    assert trace.s[2] > 0.98
    assert trace.s[3] < trace.s[2]
    assert json.loads(trace.provenance)["walls"] == "soft"
    hard = HP.simulate([0.0, 1.0], [0.0, 0.01], s0=0.5).s
    # Half the range away, a wall of width 0.02 is felt to e^-25.
    np.testing.assert_allclose(HP.simulate([0.0, 1.0], [0.0, 0.01], s0=0.5, walls="soft").s, hard, rtol=1e-9)


def test_soft_fading_is_the_same_for_numbers_arrays_and_symbols():
    casadi = pytest.importorskip("casadi")
    s, rate = casadi.SX.sym("s"), casadi.SX.sym("rate")
    symbolic = casadi.Function("soften", [s, rate], [soften(s, rate)])
    for at, speed in ((0.0, 1.0), (0.0, -1.0), (0.01, -3.0), (0.99, 2.0), (0.5, 0.0), (1.0, 1.0)):
        ahead = 1.0 - at if speed > 0 else at
        wanted = speed * (1 - math.exp(-ahead / SOFT_WIDTH)) / (1 - math.exp(-1 / SOFT_WIDTH))
        assert soften(at, speed) == pytest.approx(wanted, rel=1e-13, abs=0)
        assert soften(np.array([at]), np.array([speed]))[0] == pytest.approx(wanted, rel=1e-13, abs=0)
        assert float(symbolic(at, speed)) == pytest.approx(wanted, rel=1e-13, abs=0)


@pytest.mark.parametrize("walls", ["clip", "soft"])
@pytest.mark.parametrize("name", ["peo_pani_redox", "vteam_memtorch", "yakopcic_miao", "pickett"])
def test_stiff_laws_and_snaps_follow_a_sweep_whatever_its_steps(name, walls):
    """Rates of 1e12/s, decays of 1e6 per gap and tunnel gaps that close at once: the same states from finer steps."""
    device = Device.load(name)
    t = np.linspace(0.0, 1.0, 25)
    v = 1.5 * np.sin(2 * np.pi * t)
    finer = np.linspace(0.0, 1.0, 49)
    coarse = device.simulate(v, t, s0=0.3, walls=walls)
    fine = device.simulate(np.interp(finer, t, v), finer, s0=0.3, walls=walls)
    assert np.ptp(coarse.s) > 0.1
    np.testing.assert_allclose(coarse.s, fine.s[::2], rtol=0, atol=1e-7)  # the stiff method's own error


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda d: d.simulate(lambda t: t, [0, 1], s0=0.5, method="closed_form"),
            "hp_tio2_10k.simulate: method: expected a sampled voltage and clip walls for closed_form, got a function "
            "as voltage. Use method='integrate'.",
        ),
        (
            lambda d: d.simulate([0, 1], [0, 1], s0=0.5, method="closed_form", walls="soft"),
            "hp_tio2_10k.simulate: method: expected a sampled voltage and clip walls for closed_form, got soft walls. "
            "Use method='integrate'.",
        ),
        (
            lambda d: d.simulate([0, 1], [0, 1], s0=0.5, walls="hard"),
            "hp_tio2_10k.simulate: walls: expected one of clip, soft, got 'hard'. Use one of these.",
        ),
        (
            lambda d: Device.load("pickett").simulate([0, 1], [0, 1], s0=0.5, method="closed_form"),
            "pickett.simulate: method: expected an ideal law (dq/dt = i, G a function of s alone): closed_form needs "
            "one, got pickett. Use one of hp_linear, linear, peo_pani_mirror, or simulate with method='integrate'.",
        ),
        (
            lambda d: Device.load("pickett").flux(0.5),
            "pickett.flux: expected an ideal law (dq/dt = i, G a function of s alone): only an ideal one has a flux, "
            "got pickett. Use one of hp_linear, linear, peo_pani_mirror, or simulate with method='integrate'.",
        ),
        (
            lambda d: d.state_at_flux(1.0),
            "hp_tio2_10k.state_at_flux: phi: expected 0 <= phi <= 0.49995 Wb = flux(1), got 1 Wb. "
            "Walls hold the flux in this range.",
        ),
    ],
)
def test_what_a_closed_form_or_a_wall_cannot_do_is_said(call, message):
    with pytest.raises(ParameterError) as caught:
        call(HP)
    assert str(caught.value) == message


def test_a_release_below_a_threshold_waits_for_it():
    """The rate at the wall rests at zero before it turns inward."""
    device = Device.load("vteam_memtorch")
    trace = device.simulate([-1.0, 1.0], [0.0, 1.0], s0=0.0)
    assert trace.s.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("voltage", "t", "s0", "message"),
    [
        (
            [0.0, 1.0, 0.0],
            [0.0, 1.0],
            0.5,
            "voltage: expected axes (time,) as long as t, 2, got 3. "
            "Give one value in V per time, or a function of the time.",
        ),
        (
            [[0.0, 1.0]],
            [0.0, 1.0],
            0.5,
            "voltage: expected axes (time), got shape (1, 2). Give one axis per name.",
        ),
        (
            [0.0, math.nan],
            [0.0, 1.0],
            0.5,
            "voltage: expected finite numbers, got NaN or infinity. Check the input.",
        ),
        ("sine", [0.0, 1.0], 0.5, "voltage: expected numbers in V, got 'sine'. Pass floats."),
        (
            [0.0, 1.0, 2.0],
            [0.0, 2.0, 2.0],
            0.5,
            "t: expected at least two times in s, strictly increasing, got 3 with smallest step 0 s. "
            "Sort them and drop repeats.",
        ),
        (
            [0.0],
            [0.0],
            0.5,
            "t: expected at least two times in s, strictly increasing, got 1 with smallest step inf s. "
            "Sort them and drop repeats.",
        ),
        (
            lambda time: math.inf if time > 0.5 else 1.0,
            [0.0, 1.0],
            0.5,
            "voltage: expected finite volts, got inf at t = ",
        ),
        (
            lambda time: "one",
            [0.0, 1.0],
            0.5,
            "voltage: expected a function from a time in s to one voltage in V, got "
            "could not convert string to float: 'one'. Return a float for a float.",
        ),
    ],
)
def test_a_bad_drive_is_told_what_was_expected(voltage, t, s0, message):
    with pytest.raises(ParameterError) as caught:
        HP.simulate(voltage, t, s0=s0)
    assert str(caught.value).startswith(f"hp_tio2_10k.simulate: {message}")


def test_a_bad_start_is_told_what_was_expected():
    with pytest.raises(ParameterError) as caught:
        HP.simulate([0.0, 1.0], [0.0, 1.0], s0=1.2)
    assert str(caught.value) == (
        "hp_tio2_10k: s0: expected 0 <= s0 <= 1, got 1.2. Divide a charge by charge_scale = 9.9e-07 C."
    )
    with pytest.raises(ParameterError) as caught:
        HP.simulate([0.0, 1.0], [0.0, 1.0], s0=[0.1, 0.2])
    assert str(caught.value) == "hp_tio2_10k: s0: expected a single state, got shape (2,). Give one number."


@pytest.mark.parametrize(("voltage", "t", "field"), [
    ([0, 1e308], [0, 1], "voltage"), (lambda t: 1e7, [0, 1], "voltage"), ([0, 1], [0, 1e308], "t"),
])  # fmt: skip
def test_absurd_sizes_are_refused_before_they_overflow(voltage, t, field):
    with pytest.raises(ParameterError, match=rf"^hp_tio2[a-z0-9_]*\.simulate: {field}: expected at most "):
        HP.simulate(voltage, t, s0=0.5)


def test_an_overflow_inside_is_an_error_with_advice():
    with pytest.raises(OperationError, match=r"^Device\.simulate: expected hp_linear to be integrated from t = 0 s"):
        integrate(LAWS["hp_linear"], tuple(HP.parameters.values()), lambda t: 1e308 * t, np.array([0.0, 10.0]), 0.5)
