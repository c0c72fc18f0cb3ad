"""Two samples beside each other: Welch's test, Hedges' g, Holm's correction, log-rank test of censored times."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray

FEWEST = 5  # per sample; with fewer a test says more about the spread that it guessed than about the systems


@dataclass(frozen=True, kw_only=True)
class Difference:
    """First sample less second.

    Attributes
    ----------
    n
        Sizes of both samples, censored values included.
    value, interval
        Difference of the means and its 95 % interval (Welch).
    p
        Welch's test, two-sided. With censored values it holds for the uncensored ones only.
    effect
        Hedges' g: the difference in pooled standard deviations, small-sample corrected.
    p_holm
        `p` after Holm's correction over the family that the difference was tested in.
    p_rank, is_later
        Log-rank test of all values, censored ones as "later than", and whether the first sample's come later; None
        where nothing was censored.
    """

    n: tuple[int, int]
    value: float
    interval: tuple[float, float]
    p: float
    effect: float
    p_holm: float = math.nan
    p_rank: float | None = None
    is_later: bool | None = None


def welch(first: FloatArray, second: FloatArray) -> Difference:
    """Compare the means of two samples without NaN, of at least two values each.

    >>> found = welch(np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.0, 4.0]))
    >>> found.value, round(found.p, 3), round(found.effect, 2)
    (-1.0, 0.288, -0.8)
    """
    from scipy.stats import ttest_ind

    value = float(first.mean() - second.mean())
    n = (len(first), len(second))
    if min(n) < 2:
        return Difference(n=n, value=value, interval=(math.nan, math.nan), p=math.nan, effect=math.nan)
    pooled = math.sqrt(((n[0] - 1) * first.var(ddof=1) + (n[1] - 1) * second.var(ddof=1)) / (sum(n) - 2))
    if pooled == 0.0:  # no spread at all, and so no test
        p = 1.0 if value == 0.0 else 0.0
        return Difference(n=n, value=value, interval=(value, value), p=p, effect=0.0 if value == 0.0 else math.inf)
    with warnings.catch_warnings():
        # One sample may well hold the same value throughout; the other's variance then carries the test.
        warnings.filterwarnings("ignore", message="Precision loss", category=RuntimeWarning)
        found = ttest_ind(first, second, equal_var=False)
    interval = found.confidence_interval(0.95)
    correction = 1.0 - 3.0 / (4.0 * sum(n) - 9.0)
    return Difference(
        n=n, value=value, interval=(float(interval.low), float(interval.high)), p=float(found.pvalue),
        effect=value / pooled * correction,
    )  # fmt: skip


def rank_test(first: FloatArray, second: FloatArray, ends: tuple[float, float]) -> tuple[float, bool]:
    """Log-rank p of two samples of times, and whether the first comes later; NaN is what had not happened by its end.

    The p is NaN where nothing happened, or everything at once.

    >>> p, is_later = rank_test(np.array([5.0, 7.0, np.nan]), np.array([1.0, 2.0, 2.0]), (9.0, 9.0))
    >>> round(p, 3), is_later
    (0.03, True)
    """
    from scipy.stats import CensoredData, logrank

    data = [
        CensoredData(uncensored=sample[~np.isnan(sample)], right=np.full(int(np.isnan(sample).sum()), end))
        for sample, end in zip((first, second), ends, strict=True)
    ]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = logrank(*data)
    # Its statistic is what happened in the first sample beyond what was to be expected.
    return float(found.pvalue), bool(found.statistic < 0.0)


def holm(p: Sequence[float]) -> list[float]:
    """Holm's step-down correction (Scand. J. Stat. 6 (1979) 65); NaN stays NaN and counts for nothing.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    known = sorted((value, k) for k, value in enumerate(p) if not math.isnan(value))
    corrected = [math.nan] * len(p)
    largest = 0.0
    for rank, (value, k) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * value))
        corrected[k] = largest
    return corrected


def resampled_p(first: FloatArray, second: FloatArray, size: int, rng: np.random.Generator) -> tuple[float, float]:
    """Median Welch p, and share of p < 0.05, when only `size` runs of each sample had been made; 1,000 draws."""
    draws = [
        welch(rng.choice(first, size, replace=False), rng.choice(second, size, replace=False)).p for _ in range(1000)
    ]
    return float(np.median(draws)), float(np.mean(np.array(draws) < 0.05))
