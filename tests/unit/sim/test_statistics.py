"""Paired success: intervals and tests against tables, symmetry and simulated coverage."""

import numpy as np
import pytest
from scipy.stats import binomtest

from ohmloom.errors import ParameterError
from ohmloom.sim.statistics import (
    CLUSTERED,
    CLUSTERED_FEW,
    Z95,
    clustered_success,
    dies_needed,
    paired_success,
    pairs_needed,
    tango_interval,
    tango_score,
    wilson_of_rate,
)

TRUE_CLIPPED_MEAN = 0.69416  # of a normal variable of mean 0.7 and deviation 0.2, cut to [0, 1]


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


def test_starts_of_one_die_count_as_one_where_dies_decide():
    # Every die keeps or loses the goal on all of its ten starts: 40 pieces of information, not 400.
    die = [k // 10 for k in range(400)]
    lost = [d % 2 == 0 for d in die]
    clustered = clustered_success([True] * 400, [not x for x in lost], die)
    apart = paired_success([True] * 400, [not x for x in lost])
    assert clustered.method == CLUSTERED
    assert (clustered.n, clustered.dies, clustered.hardware) == (400, 40, 0.5)
    widths = [one.interval[1] - one.interval[0] for one in (clustered, apart)]
    # sqrt(10) by theory; a bootstrap of 40 dies knows its width to about 15 %.
    assert widths[0] / widths[1] == pytest.approx(np.sqrt(10), rel=0.2)
    assert clustered.p < 0.01


def test_dies_that_never_differ_prove_no_more_than_as_many_pairs():
    s = clustered_success([True] * 200, [True] * 200, [k // 10 for k in range(200)])
    assert s.method == CLUSTERED_FEW
    assert s.interval == pytest.approx(tango_interval(0, 0, 20))
    assert s.p == 1.0


def test_bootstrap_covers_the_true_difference():
    rng = np.random.default_rng(11)
    covered = 0
    for k in range(200):
        of_die = np.clip(rng.normal(0.7, 0.2, 60), 0.0, 1.0).repeat(5)
        ideal, hardware = rng.random(300) < 0.9, rng.random(300) < of_die
        low, high = clustered_success(list(ideal), list(hardware), list(np.arange(300) // 5), seed=k).interval
        covered += low <= TRUE_CLIPPED_MEAN - 0.9 <= high
    # Four standard errors around 95 %, and a bootstrap of 60 dies covers a little less.
    assert covered / 200 > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 200) - 0.01


def test_number_of_dies_from_a_precision():
    n = dies_needed(0.9, 0.03)
    widths = [np.diff(wilson_of_rate(0.9, k))[0] for k in (n - 1, n)]
    assert widths[1] <= 0.06 < widths[0]


@pytest.mark.parametrize(("rate", "half", "name"), [(1.1, 0.1, "rate"), (0.5, 0.0, "half_width")])
def test_impossible_precisions_are_refused(rate, half, name):
    with pytest.raises(ParameterError, match=rf"dies_needed\.{name}: expected"):
        dies_needed(rate, half)
