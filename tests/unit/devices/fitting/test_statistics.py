"""Intervals, correlation of residuals, profiles, and what a fit cannot know."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ohmloom.devices import LAWS, fit
from ohmloom.devices.fitting._checks import sizes
from ohmloom.devices.fitting._coordinates import choose
from ohmloom.devices.fitting._statistics import assess, lag_one
from ohmloom.devices.fitting.fit import _problem

QUICK = {"screen": 30, "starts": 1}


def at_truth(law, sweep, device, s0):
    coordinates = choose(LAWS[law], {}, ())
    problem = _problem(coordinates, (sweep,), sizes((sweep,), "relative"), 8)
    z, _, _ = problem.solve(np.append(coordinates.of_values(device(law).parameters), s0), problem.shooting)
    return problem, z


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_lag_one_finds_the_correlation_of_simulated_noise(rho):
    raw = np.random.default_rng(3).standard_normal(20_000)
    e = raw.copy()
    for k in range(1, e.size):
        e[k] = rho * e[k - 1] + raw[k]
    assert lag_one(e) == pytest.approx(rho, abs=0.02)  # standard error below 1/sqrt(20000)
    assert lag_one(np.zeros(5)) == 0.0
    assert lag_one(np.array([1.0, -1.0, 1.0, -1.0])) == 0.0  # never counts for more points than there are


def test_correlated_noise_widens_intervals_by_the_usual_factor(sweep, device):
    """sqrt((1 + rho)/(1 - rho)) over the plain covariance sigma^2 (J'J)^-1."""
    problem, z = at_truth("linear", sweep("linear", 5, correlation=0.8, points=400), device, 0.2)
    found = assess(problem, z)
    (rho,) = found.lag1
    assert rho == pytest.approx(0.8, abs=0.1)
    r, jacobian = problem.shooting.residual(z), problem.shooting.jacobian(z)
    plain = np.linalg.inv(jacobian.T @ jacobian) * (r @ r) / (len(r) - len(z))
    np.testing.assert_allclose(found.covariance, plain * (1 + rho) / (1 - rho), rtol=1e-6)


def test_the_covariance_of_a_problem_that_is_linear(sweep):
    """One resistor: i = g v, var(ln g) = sigma^2/sum (g v)^2; t for N - 1 degrees of freedom."""
    loop = sweep("linear", noise=0.0, points=50)
    i = 1e-4 * loop.v + 1e-6 * np.random.default_rng(0).standard_normal(50)
    resistor = type(loop)(name="resistor", t=loop.t, v=loop.v, i=i)
    coordinates = choose(LAWS["linear"], {"r_off": 1e12, "q_d": 1e6}, ())
    problem = _problem(coordinates, (resistor,), sizes((resistor,), "relative"), 1)
    z, _, _ = problem.solve(np.array([math.log(5e3), 0.5]), problem.shooting)
    shooting = problem.shooting
    # s0 and r_on do the same here, so hold s0 by its bound.
    low, high = problem.low.copy(), problem.high.copy()
    low[1], high[1] = 0.5, 0.5001
    fixed = type(problem)(coordinates=coordinates, features=problem.features, shooting=shooting, regression=None,
                          low=low, high=high)  # fmt: skip
    z, _, _ = fixed.solve(np.array([math.log(5e3), 0.50001]), shooting)
    z[1] = 0.5
    g = float(np.sum(loop.v * i) / np.sum(loop.v**2))
    residual = i - g * loop.v
    rho = lag_one(residual)
    sigma2 = float(residual @ residual) / 49 * (1 + rho) / (1 - rho)
    found = assess(fixed, z)
    assert found.is_at_bound == (False, True)
    assert found.covariance[0, 0] == pytest.approx(sigma2 / float(np.sum((g * loop.v) ** 2)), rel=1e-3)


@pytest.mark.parametrize("law", ["linear", "peo_pani_redox"])
def test_intervals_hold_the_truth(law, sweep, device):
    """95 % of 25 seeds; 20 or fewer by chance in 1 of 140."""
    truth, inside = device(law).parameters, {}
    for seed in range(25):
        found = fit(sweep(law, [7, seed]), law, rng=np.random.default_rng(seed), screen=20, starts=1)
        for name, (low, high) in found.intervals.items():
            inside[name] = inside.get(name, 0) + (low <= truth[name] <= high)
    assert min(inside.values()) >= 20, inside


def test_profile_and_covariance_agree_where_the_problem_is_nearly_linear(sweep):
    plain = fit(sweep("linear"), "linear", rng=np.random.default_rng(0), **QUICK)
    profiled = fit(sweep("linear"), "linear", rng=np.random.default_rng(0), profile=True, **QUICK)
    assert plain.profiles == {}
    assert set(profiled.profiles) == {"r_on", "r_off", "q_d", "s0"}
    for name in plain.intervals:
        (a, b), (c, d) = plain.intervals[name], profiled.intervals[name]
        assert d - c == pytest.approx(b - a, rel=0.05), name
        assert profiled.profiles[name].is_open == (False, False)


def test_a_start_state_that_relaxes_at_once_is_said_to_be_undetermined(sweep):
    fast = sweep("peo_pani_redox", k0=1e4, period=1.0)
    found = fit(fast, "peo_pani_redox", fixed={"k0": 1e4}, rng=np.random.default_rng(0), **QUICK)
    assert "s0 is not determined by this sweep: any value from 0 to 1 fits as well." in found.warnings
    assert found.sweeps[0].s0_interval is None


def test_a_wall_that_was_never_near_leaves_its_resistance_open(sweep):
    found = fit(sweep("hp_linear", s0=0.3, beta=10.0), "hp_linear", rng=np.random.default_rng(0), **QUICK)
    told = [text for text in found.warnings if text.startswith("r_on ")]
    assert len(told) == 1
    assert told[0].startswith(("r_on is not determined by this sweep: any value ", "r_on has no lower limit in this "))
    assert told[0].endswith("fits as well.")


def test_a_profile_of_r_off_stays_above_r_on(sweep):
    """Where little is known, r_off still is at least the largest memristance that was seen, about 1.1 kOhm."""
    found = fit(sweep("hp_linear", s0=0.3, beta=10.0), "hp_linear", rng=np.random.default_rng(0), **QUICK)
    assert found.profiles["r_off"].interval[0] > 900.0
    assert not any(text.startswith("r_off has no lower limit") for text in found.warnings)


def test_a_combination_that_the_data_do_not_see_is_named(sweep):
    """Without walls an ideal law's loop holds M0 and r_on r_off beta only: two combinations of four unknowns are free.

    Which of them comes out weakest is up to rounding; that it moves neither of the two is not.
    """
    found = fit(sweep("hp_linear", s0=0.5, beta=1.0), "hp_linear", rng=np.random.default_rng(0), **QUICK)
    assert found.condition is None or found.condition > 1e4
    told = [text for text in found.warnings if text.startswith("The data hardly see one combination of the unknowns, ")]
    assert len(told) == 1
    assert max(found.weakest, key=lambda name: abs(found.weakest[name])) in told[0]
    # The shares are those of ln r_on, ln(r_off/r_on), ln beta and s0.
    names = ("r_on", "r_off", "beta")
    r_on, ratio, beta, s0 = (found.weakest[name] for name in (*names, "s0"))
    values = found.device.parameters
    rho, start = values["r_off"] / values["r_on"], found.sweeps[0].s0
    m0 = rho - (rho - 1.0) * start
    assert abs(2.0 * r_on + ratio + beta) < 1e-3
    assert abs(m0 * r_on + rho * (1.0 - start) * ratio - (rho - 1.0) * s0) < 1e-3 * m0
    assert sum(share**2 for share in found.weakest.values()) == pytest.approx(1.0)


def test_a_start_state_at_its_wall_is_named_and_bounded_on_one_side(sweep):
    found = fit(sweep("linear", s0=0.0), "linear", rng=np.random.default_rng(0), **QUICK)
    assert found.at_bound == ("s0",)
    low, high = found.sweeps[0].s0_interval
    assert low == 0.0
    assert high < 0.01
    assert any(text.startswith("s0 has no lower limit in this sweep: any value below 0.00") for text in found.warnings)
