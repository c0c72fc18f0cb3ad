"""Statistics of paired success: Wilson, exact McNemar, and Tango's score interval of a paired difference."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import ParameterError

RESAMPLES = 4000  # of a bootstrap: its 95 % bounds then vary by about 2 % of their distance
FEWEST_DIFFERENT = 10  # dies that differ; with fewer a bootstrap over dies is too narrow
PAIRED = "one start per die: Wilson, Tango, exact McNemar"
CLUSTERED = "several starts per die: bootstrap and sign flips over dies"
CLUSTERED_FEW = "several starts per die, few of which differ: each die counted as one pair"
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
    dies
        Pieces of hardware behind the pairs; `n` if each had one start.
    method
        How intervals and `p` were found.
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
    dies: int = 0
    method: str = PAIRED

    def __post_init__(self) -> None:
        if not self.dies:
            object.__setattr__(self, "dies", self.n)


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


def clustered_success(ideal: list[bool], hardware: list[bool], die: list[int], *, seed: int = 0) -> Success:
    """Compare two controllers on several starts per die: dies, not starts, are what was sampled.

    Intervals are percentiles of a bootstrap that draws whole dies; `p` flips the sign of whole dies' differences. Where
    fewer than ten dies differ, no bootstrap can know how often others would, and each die counts as one pair.

    Parameters
    ----------
    ideal, hardware
        Whether each reached the goal, start by start.
    die
        The die of each start.
    seed
        Of the resampling.
    """
    _, cluster = np.unique(np.asarray(die), return_inverse=True)
    sizes = np.bincount(cluster)
    reached = np.array([np.bincount(cluster, weights=np.asarray(one, dtype=float)) for one in (ideal, hardware)])
    difference = reached[1] - reached[0]
    plain = paired_success(ideal, hardware)
    p = _sign_flips(difference, seed)
    if np.count_nonzero(difference) < FEWEST_DIFFERENT:
        starts = plain.n / len(sizes)
        return replace(
            plain, dies=len(sizes), method=CLUSTERED_FEW, p=p,
            ideal_interval=wilson_of_rate(plain.ideal, len(sizes)),
            hardware_interval=wilson_of_rate(plain.hardware, len(sizes)),
            interval=tango_interval(plain.only_hardware / starts, plain.only_ideal / starts, len(sizes)),
        )  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    drawn = rng.integers(0, len(sizes), (RESAMPLES, len(sizes)))
    rates = reached[:, drawn].sum(axis=2) / sizes[drawn].sum(axis=1)

    def percentiles(sample: FloatArray) -> tuple[float, float]:
        low, high = np.percentile(sample, (2.5, 97.5))
        return float(low), float(high)

    return replace(
        plain, dies=len(sizes), method=CLUSTERED, p=p, ideal_interval=percentiles(rates[0]),
        hardware_interval=percentiles(rates[1]), interval=percentiles(rates[1] - rates[0]),
    )  # fmt: skip


def _sign_flips(difference: FloatArray, seed: int) -> float:
    """Share of sign flips of whole dies whose mean difference is as large as the observed one."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    signs = rng.choice((-1.0, 1.0), (RESAMPLES, len(difference)))
    as_large = np.abs(signs @ difference) >= abs(difference.sum()) - 1e-9
    return float((as_large.sum() + 1) / (RESAMPLES + 1))


def wilson_of_rate(rate: float, n: float) -> tuple[float, float]:
    """Wilson 95 % interval of a rate seen in `n` trials, which need not be a whole number of successes.

    >>> [round(bound, 3) for bound in wilson_of_rate(0.9, 10)]
    [0.596, 0.982]
    """
    z2 = Z95 * Z95
    middle, half = rate + z2 / (2.0 * n), Z95 * math.sqrt(rate * (1.0 - rate) / n + z2 / (4.0 * n * n))
    return (middle - half) / (1.0 + z2 / n), (middle + half) / (1.0 + z2 / n)


def dies_needed(rate: float, half_width: float) -> int:
    """Dies, with one start each, at which a rate's Wilson 95 % interval is at most so wide to each side.

    Parameters
    ----------
    rate
        Expected success, in [0, 1].
    half_width
        Wanted precision, in (0, 0.5).

    Raises
    ------
    ParameterError
        If one of these is out of its range.

    Examples
    --------
    >>> dies_needed(0.9, 0.03), dies_needed(1.0, 0.05)
    (388, 35)
    """
    for name, value, low, high in (("rate", rate, 0.0, 1.0), ("half_width", half_width, 0.0, 0.5)):
        is_inside = low <= value <= high if name == "rate" else low < value < high
        if not is_inside:
            rule = f"a number in [{low:g}, {high:g}]" if name == "rate" else "a number between 0 and 0.5"
            raise ParameterError(f"dies_needed.{name}: expected {rule}, got {value}. Give a fraction.")

    def is_enough(n: int) -> bool:
        low, high = wilson_of_rate(rate, n)
        return high - low <= 2.0 * half_width

    low, high = 1, 1
    while not is_enough(high):
        low, high = high, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle + 1, high)
    return low


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
