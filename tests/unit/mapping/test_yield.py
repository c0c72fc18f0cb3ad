"""Yield: the formula against samples, and what repair and spare lines add."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping.repair import STUCK_OFF, STUCK_ON
from ohmloom.mapping.yield_ import draw_faults, sample_yield, wilson, yield_formula

DEMAND = np.random.default_rng(8).random((15, 11)) < 0.3


def sampled(**changes):
    options = {"stuck_on": 0.002, "stuck_off": 0.01, "dies": 1500, "starts": 1, "rng": np.random.default_rng(3)}
    return sample_yield(DEMAND, **(options | changes))


def test_formula_is_inside_the_interval_of_the_samples():
    # Of 95 % intervals one in twenty misses; this seed is one of the nineteen, and a wrong exponent is far outside.
    for on, off in ((0.002, 0.01), (0.004, 0.0), (0.0, 0.02)):
        found = sampled(stuck_on=on, stuck_off=off)
        assert found.plain_interval[0] < found.formula < found.plain_interval[1], (on, off)
        assert found.plain_interval[1] - found.plain_interval[0] < 0.06
        assert found.formula == yield_formula(DEMAND, stuck_on=on, stuck_off=off)


def test_formula_by_hand():
    # Two enabled devices with no fault at all, one disabled that is not stuck on.
    wanted = 0.8 * 0.8 * 0.95
    assert yield_formula([[1, 1, 0]], stuck_on=0.05, stuck_off=0.15) == pytest.approx(wanted, rel=1e-12)


def test_permutation_and_spare_lines_raise_the_yield_on_the_same_faults():
    few = {"stuck_on": 0.005, "stuck_off": 0.045, "dies": 100, "starts": 6}
    permuted = sampled(**few)
    spared = sampled(**few, spare_rows=2, spare_columns=2)
    assert permuted.plain < permuted.repaired < spared.repaired
    assert spared.repaired > 0.95


def test_same_seed_gives_the_same_and_starts_leave_the_faults_alone():
    few = {"stuck_off": 0.03, "dies": 60}
    assert sampled(**few) == sampled(**few)
    assert sampled(**few, starts=6).plain == sampled(**few).plain
    assert sampled(**few, starts=6).repaired >= sampled(**few).repaired


def test_faults_are_as_frequent_as_asked_and_stay_when_they_become_more_frequent():
    one = draw_faults((400, 400), stuck_on=0.1, stuck_off=0.2, rng=np.random.default_rng(1))
    # Four standard deviations of a share from 160,000 devices.
    assert np.mean(one == STUCK_ON) == pytest.approx(0.1, abs=0.003)
    assert np.mean(one == STUCK_OFF) == pytest.approx(0.2, abs=0.004)
    more = draw_faults((400, 400), stuck_on=0.15, stuck_off=0.25, rng=np.random.default_rng(1))
    assert (more[one != 0] == one[one != 0]).all()


def test_wilson_by_its_own_equation():
    z, n, p = 1.959963984540054, 40, 0.9
    middle, half = (p + z * z / (2 * n)), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    wanted = [(middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)]
    assert wilson(36, 40) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stuck_on": -0.1}, r"sample_yield\.stuck_on: expected a probability in \[0, 1\], got -0\.1"),
        ({"stuck_off": float("nan")}, r"sample_yield\.stuck_off: expected a probability in \[0, 1\], got nan"),
        ({"stuck_on": 0.6, "stuck_off": 0.5}, r"sample_yield\.stuck_off: expected at most 0\.4 beside stuck_on = 0\.6"),
        ({"dies": 0}, r"sample_yield\.dies: expected an integer >= 1, got 0"),
        ({"spare_rows": -1}, r"sample_yield\.spare_rows: expected an integer >= 0, got -1"),
    ],
)
def test_bad_input_is_refused(changes, words):
    with pytest.raises(ParameterError, match=words):
        sampled(**changes)
