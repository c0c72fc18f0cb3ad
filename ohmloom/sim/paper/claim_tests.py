"""How a claim of the paper is tested: each function gives the `Finding`s of one kind of claim."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.sim.paper.compare import FEWEST, Difference, welch
from ohmloom.sim.paper.results import SET_UP, Results

Verdict = Literal["reproduces", "does not reproduce", "cannot be tested here"]
YES: Final = "reproduces"
NO: Final = "does not reproduce"
UNTESTED: Final = "cannot be tested here"
LEVEL = 0.05  # Section IX


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a run says of one claim.

    Attributes
    ----------
    section, claim, test
        Where the paper makes it; what it says, in our words; how it was tested.
    n, result, interval
        Sizes of the samples, the result and its 95 % interval, as text.
    p
        Corrected p, or NaN where the test has none.
    verdict
        ``reproduces``, ``does not reproduce`` or ``cannot be tested here``.
    """

    section: str
    claim: str
    test: str
    n: str
    result: str
    interval: str
    p: float
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """The task that a claim is about, or nothing, and what a run's results say of it."""

    task: str
    examine: Callable[[Results], Iterator[Finding]]


Pair = Callable[[Results, str], tuple[FloatArray, FloatArray]]  # of a task
KIND_NAMES: Final = {"hp": "HP", "peo_pani": "PEO-PANI", "linear": "LIN"}
MEASURE_NAMES: Final = {
    "performance": "generations to the first solution", "best_fitness": "best fitness", "mean_fitness": "mean fitness",
    "connectivity": "connectivity in percent", "nodes": "neurons", "mu": "mu", "psi": "psi", "omega": "omega",
    "tau": "tau",
}  # fmt: skip


def short(value: float, sign: str = "") -> str:
    """Three significant digits, of large numbers all before the point; `sign` as in a format.

    >>> short(0.123456), short(-1813.4), short(59.31, "+")
    ('0.123', '-1813', '+59.3')
    """
    return f"{value:{sign}.0f}" if abs(value) >= 999.5 else f"{value:{sign}.3g}"


def _finding(section: str, claim: str, test: str, difference: Difference, sign: int) -> Finding:
    """Verdict on a difference that should have this sign; with 0, on one that should not be significant."""
    verdict: Verdict
    p = difference.p_holm
    if math.isnan(p) or min(difference.n) < FEWEST:
        verdict = UNTESTED
    elif sign == 0:
        verdict = YES if p >= LEVEL else NO
    else:
        is_larger = difference.value > 0.0 if difference.is_later is None else difference.is_later
        verdict = YES if p < LEVEL and is_larger == (sign > 0) else NO
    low, high = difference.interval
    numbers = [text for text in (short(difference.value, "+"), f"g = {difference.effect:+.2f}") if "nan" not in text]
    return Finding(
        section=section, claim=claim, test=test + (", log-rank p" if difference.p_rank is not None else ""),
        n=f"{difference.n[0]}, {difference.n[1]}", result=", ".join(numbers) or "too few solved",
        interval="" if math.isnan(low) else f"{short(low, '+')} to {short(high, '+')}", p=p, verdict=verdict,
    )  # fmt: skip


def systems(
    section: str, measure: str, first: str, second: str, sign: int, claim: str, task: str = "static"
) -> Claim:  # fmt: skip
    """The first system's measure is larger (sign 1) or smaller (-1) than the second's, or does not differ (0)."""
    name = "trials between the rewards" if (task, measure) == ("dynamic", "performance") else MEASURE_NAMES[measure]
    test = f"{name}, {first} less {second}: Welch, Holm over its table"

    def examine(results: Results) -> Iterator[Finding]:
        yield _finding(section, claim, test, results.compare_systems(task, measure)[first, second], sign)

    return Claim(task, examine)


def kinds(section: str, place: str, first: str, second: str, claim: str, task: str = "static") -> Claim:
    """The best HET networks have more synapses of the first kind than of the second in one place."""

    def examine(results: Results) -> Iterator[Finding]:
        pairs = results.compare_counts(task, place)
        larger, pair = (1, (first, second)) if (first, second) in pairs else (-1, (second, first))
        test = f"synapses in the best HET networks, {KIND_NAMES[pair[0]]} less {KIND_NAMES[pair[1]]}"
        yield _finding(section, claim, test + ": Welch, Holm over the place", pairs[pair], larger)

    return Claim(task, examine)


def samples(section: str, claim: str, test: str, get: Pair, task: str = "static") -> Claim:
    """The first sample's mean is larger than the second's."""

    def examine(results: Results) -> Iterator[Finding]:
        first, second = get(results, task)
        if min(len(first), len(second)) == 0:
            yield _without(section, claim, test, "no network has both kinds")
            return
        bare = welch(first, second)
        yield _finding(section, claim, test + ": Welch", replace(bare, p_holm=bare.p), 1)

    return Claim(task, examine)


def _without(section: str, claim: str, test: str, result: str) -> Finding:
    return Finding(section=section, claim=claim, test=test, n="", result=result, interval="", p=math.nan,
                   verdict=UNTESTED)  # fmt: skip


def solved(section: str, system: str, missed: tuple[int, int], claim: str, task: str = "static") -> Claim:
    """As many runs without a solution as the paper has, `missed` of so many."""

    def examine(results: Results) -> Iterator[Finding]:
        from scipy.stats import fisher_exact

        sample = results.sample(task, system, "performance")
        ours, n = int(np.isnan(sample).sum()), len(sample)
        p = float(fisher_exact([[ours, n - ours], [missed[0], missed[1] - missed[0]]]).pvalue)
        verdict: Verdict = UNTESTED if n < FEWEST else YES if p >= LEVEL else NO
        yield Finding(
            section=section, claim=claim, test=f"{system} runs without a solution, against the paper's: Fisher",
            n=f"{n}, {missed[1]}", result=f"{ours} of {n}", interval="", p=p, verdict=verdict,
        )  # fmt: skip

    return Claim(task, examine)


def never(section: str, claim: str, why: str) -> Claim:
    """What no test here can stand for."""
    return Claim("", lambda results: iter([_without(section, claim, "none", why)]))


def more_reliable(results: Results) -> Iterator[Finding]:
    """Not a claim of the paper, but what its comparison rests on: fitness is one trial."""
    samples = {system: 100.0 * results.fresh("static", system) for system in results.tasks["static"]}
    for system in ("PEO", "LIN", "HET"):
        bare = welch(samples[system], samples["GA"])
        yield _finding(
            "ours", f"{system} networks are more reliable than constant ones from fresh starts",
            f"success on fresh starts ({samples[system].mean():.0f} %), less GA's, in points: Welch, Bonferroni over 3",
            replace(bare, p_holm=min(1.0, 3.0 * bare.p)), 1,
        )  # fmt: skip


def kinds_differ(kind: str, other: str, quantity: str, sign: str = "") -> Pair:
    """A quantity of `Results` for two kinds."""

    def get(results: Results, task: str) -> tuple[FloatArray, FloatArray]:
        values = getattr(results, quantity)(task, sign) if sign else getattr(results, quantity)(task)
        return values[kind], values[other]

    return get


def signs_differ(kind: str, larger: str, smaller: str, quantity: str = "set_up") -> Pair:
    """Events of two signs, for one kind."""

    def get(results: Results, task: str) -> tuple[FloatArray, FloatArray]:
        of = getattr(results, quantity)
        return of(task, larger)[kind], of(task, smaller)[kind]

    return get


def all_events(results: Results, task: str) -> tuple[FloatArray, FloatArray]:
    """Positive and negative events per timestep, all kinds, whole trials."""
    runs = results.activities[task]
    positive, negative = ([getattr(a, sign).sum(axis=1).mean() for a in runs] for sign in ("positive", "negative"))
    return np.array(positive), np.array(negative)


def early_events(results: Results, task: str) -> tuple[FloatArray, FloatArray]:
    """Events per timestep before and after timestep 250, of the trials that were longer."""
    totals = [(a.positive + a.negative).sum(axis=1) for a in results.activities[task]]
    longer = [total for total in totals if len(total) > SET_UP]
    return (np.array([total[:SET_UP].mean() for total in longer]),
            np.array([total[SET_UP:].mean() for total in longer]))  # fmt: skip
