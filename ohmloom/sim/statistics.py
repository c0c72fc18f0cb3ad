"""Statistics of paired success: Wilson, exact McNemar, and Tango's score interval of a paired difference."""

from __future__ import annotations

import math
from dataclasses import dataclass

Z95 = 1.959963984540054  # two-sided 95 % quantile of the normal distribution


@dataclass(frozen=True, kw_only=True)
class Success:
    """Closed-loop success of two controllers on the same starts.

    Attributes
    ----------
    n
        Pairs of trials, one start each.
    ideal, hardware
        Fractions that reached the goal.
    ideal_interval, hardware_interval
        Wilson 95 % intervals.
    interval
        Tango's 95 % score interval of hardware - ideal.
    p
        Exact McNemar test, two-sided.
    both, only_ideal, only_hardware
        Pairs in which both reached the goal, only the ideal one, only the hardware.
    """

    n: int
    ideal: float
    hardware: float
    ideal_interval: tuple[float, float]
    hardware_interval: tuple[float, float]
    interval: tuple[float, float]
    p: float
    both: int
    only_ideal: int
    only_hardware: int


def paired_success(ideal: list[bool], hardware: list[bool]) -> Success:
    """Compare two controllers from whether each reached the goal, pair by pair.

    >>> round(paired_success([True] * 20, [True] * 20).interval[0], 3)
    -0.161
    """
    from scipy.stats import binomtest

    n = len(ideal)
    both = sum(i and h for i, h in zip(ideal, hardware, strict=True))
    only_ideal, only_hardware = sum(ideal) - both, sum(hardware) - both
    discordant = only_ideal + only_hardware

    def wilson(count: int) -> tuple[float, float]:
        interval = binomtest(count, n).proportion_ci(method="wilson")
        return float(interval.low), float(interval.high)

    return Success(
        n=n, ideal=sum(ideal) / n, hardware=sum(hardware) / n, ideal_interval=wilson(sum(ideal)),
        hardware_interval=wilson(sum(hardware)), interval=tango_interval(only_hardware, only_ideal, n),
        p=float(binomtest(only_ideal, discordant).pvalue) if discordant else 1.0, both=both, only_ideal=only_ideal,
        only_hardware=only_hardware,
    )  # fmt: skip


def tango_score(b: float, c: float, n: float, difference: float) -> float:
    """Score statistic of a paired difference (Tango, Statistics in Medicine 17 (1998) 891, eq. 11).

    `b` pairs have only the first successful, `c` only the second, of `n`; `difference` is first minus second.
    """
    quadratic = 2.0 * n
    linear = -b - c + (2.0 * n - b + c) * difference
    constant = -c * difference * (1.0 - difference)
    q21 = (math.sqrt(max(linear * linear - 4.0 * quadratic * constant, 0.0)) - linear) / (2.0 * quadratic)
    variance = n * (2.0 * q21 + difference * (1.0 - difference))
    distance = b - c - n * difference
    return distance / math.sqrt(variance) if variance > 0.0 else math.copysign(math.inf, distance)


def tango_interval(b: float, c: float, n: float, z: float = Z95) -> tuple[float, float]:
    """Score interval of the paired difference (b - c) / n, within [-1, 1]."""
    from scipy.optimize import brentq

    observed = (b - c) / n
    edge = 1.0 - 1e-12

    def bound(wanted: float, outer: float) -> float:
        if observed * math.copysign(1.0, outer) >= edge:
            return math.copysign(1.0, outer)
        step = math.copysign(1e-9, outer)
        return float(brentq(lambda d: tango_score(b, c, n, d) - wanted, observed + step, outer, xtol=1e-12))

    return bound(z, -edge), bound(-z, edge)


def pairs_needed(b: int, c: int, n: int, limit: float, most: int = 1_000_000) -> int | None:
    """Pairs at which the lower bound would reach `limit`, were the same outcome to go on; None if it never would.

    Without a discordant pair the lower bound is -z^2 / (n + z^2), so that it takes 73 pairs for 5 points.

    >>> pairs_needed(0, 0, 20, -0.05), pairs_needed(0, 5, 20, -0.05)
    (73, None)
    """

    def is_enough(pairs: int) -> bool:
        return tango_interval(b * pairs / n, c * pairs / n, pairs)[0] >= limit

    if not is_enough(most):
        return None
    low, high = 1, most
    while low < high:
        middle = (low + high) // 2
        if is_enough(middle):
            high = middle
        else:
            low = middle + 1
    return low
