"""Paired success: intervals and tests against tables, symmetry and simulated coverage."""

import numpy as np
import pytest
from scipy.stats import binomtest

from ohmloom.sim.statistics import Z95, paired_success, pairs_needed, tango_interval, tango_score


@pytest.mark.parametrize(("b", "c", "n"), [(0, 0, 20), (3, 9, 100), (1, 0, 44), (12, 2, 30)])
def test_bounds_are_where_the_score_reaches_the_quantile(b, c, n):
    low, high = tango_interval(b, c, n)
    assert tango_score(b, c, n, low) == pytest.approx(Z95, abs=1e-6)
    assert tango_score(b, c, n, high) == pytest.approx(-Z95, abs=1e-6)
    assert low < (b - c) / n < high


def test_interval_is_antisymmetric():
    low, high = tango_interval(3, 9, 100)
    assert tango_interval(9, 3, 100) == pytest.approx((-high, -low), abs=1e-9)


def test_coverage_is_close_to_nominal():
    rng = np.random.default_rng(1)
    n, p10, p01 = 60, 0.08, 0.12
    covered = 0
    for b, c, _ in rng.multinomial(n, (p10, p01, 1 - p10 - p01), size=600):
        low, high = tango_interval(int(b), int(c), n)
        covered += low <= p10 - p01 <= high
    # Four standard errors around 95 %.
    assert abs(covered / 600 - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 600)


def test_all_discordant_pairs_reach_the_end_of_the_scale():
    assert tango_interval(0, 20, 20)[0] == -1.0
    assert tango_interval(20, 0, 20)[1] == 1.0


def test_pairs_needed_is_the_smallest_number_that_reaches_the_limit():
    n = pairs_needed(0, 0, 20, -0.05)
    assert tango_interval(0, 0, n)[0] >= -0.05 > tango_interval(0, 0, n - 1)[0]
    n = pairs_needed(20, 20, 200, -0.05)
    assert tango_interval(n / 10, n / 10, n)[0] >= -0.05 > tango_interval((n - 1) / 10, (n - 1) / 10, n - 1)[0]


def test_no_number_of_pairs_shows_what_is_not_so():
    assert pairs_needed(0, 12, 200, -0.05) is None


def test_counts_rates_and_p():
    ideal = [True] * 12 + [False] * 8
    hardware = [True] * 7 + [False] * 5 + [True] + [False] * 7
    s = paired_success(ideal, hardware)
    assert (s.n, s.ideal, s.hardware) == (20, 0.6, 0.4)
    assert (s.both, s.only_ideal, s.only_hardware) == (7, 5, 1)
    assert s.p == pytest.approx(binomtest(1, 6).pvalue)
    # Wilson by hand: (p + z2/2n -+ z sqrt(p(1-p)/n + z2/4n2)) / (1 + z2/n).
    z2 = Z95**2
    middle, half = 0.6 + z2 / 40, Z95 * np.sqrt(0.6 * 0.4 / 20 + z2 / 1600)
    assert s.ideal_interval == pytest.approx(((middle - half) / (1 + z2 / 20), (middle + half) / (1 + z2 / 20)))
