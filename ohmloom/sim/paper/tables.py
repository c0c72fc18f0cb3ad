"""The paper's tables with our numbers beside its own, under its own numbers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.sim.paper.claim_tests import KIND_NAMES, YES, Finding, short
from ohmloom.sim.paper.claims import examine, examine_at_best
from ohmloom.sim.paper.compare import Difference, resampled_p
from ohmloom.sim.paper.experiment import Count, Search
from ohmloom.sim.paper.published import published
from ohmloom.sim.paper.results import (
    FAMILIES,
    HOMOGENEOUS,
    KIND_PAIRS,
    MEASURES,
    Results,
    mean_and_deviation,
)
from ohmloom.sim.statistics import wilson_of_rate

SYMBOLS: Final = {"mu": "μ", "psi": "ψ", "omega": "ω", "tau": "τ"}
NAMES: Final = {
    "performance": "performance", "best_fitness": "high fitness", "mean_fitness": "average fitness",
    "connectivity": "connectivity (%)", "nodes": "neurons", **SYMBOLS,
}  # fmt: skip
PERFORMANCE: Final = ("performance", "best_fitness", "nodes", "connectivity")
ADAPTIVE: Final = tuple(SYMBOLS)
PLACES: Final = {
    "VII": {"all": "whole network"},
    "VIII": {"input_hidden": "input - hidden", "hidden_hidden": "hidden - hidden", "hidden_output": "hidden - output"},
    "IX": {
        "pre_excitatory": "presynaptic excitatory", "pre_inhibitory": "presynaptic inhibitory",
        "post_excitatory": "postsynaptic excitatory", "post_inhibitory": "postsynaptic inhibitory",
    },
    "X": {"infrared": "from infrared sensors", "light": "from light sensors"},
}  # fmt: skip
DYNAMIC_PLACES: Final = {"hidden_output": "hidden - output", "light": "from light sensors"}
PAPERS_RUNS = 5  # that its dynamic p-values fit, where it says thirty


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table as text.

    Attributes
    ----------
    name
        Of its file, and its anchor in a page.
    title, note
        What it shows; what has to be known to read it.
    head, rows
        Column names; cells.
    """

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def to_csv(self) -> str:
        """Comma-separated text."""
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="\n").writerows([self.head, *self.rows])
        return buffer.getvalue()

    def to_markdown(self) -> str:
        """A table of GitHub's Markdown."""
        lines = [self.head, ("---",) * len(self.head), *self.rows]
        cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines]
        return "\n".join("| " + " | ".join(line) + " |" for line in cells) + "\n"


def tables(results: Results) -> list[Table]:
    """Every table of the paper, by its number, then ours."""
    found = [
        _tests("I", "static", PERFORMANCE, results, 0), _means("II", "static", HOMOGENEOUS, results),
        _tests("III", "static", ADAPTIVE, results, 0), _means("IV", "static", ("HET", "PEO", "LIN", "GA"), results),
        _tests("V", "static", PERFORMANCE, results, 1), _tests("VI", "static", ADAPTIVE, results, 1),
        *(_kinds(number, "static", places, results) for number, places in PLACES.items()),
        _turn(results), _means("XII", "dynamic", ("HET", "GA"), results),
        _tests("XII_tests", "dynamic", MEASURES, results, 0),
        _kinds("dynamic_places", "dynamic", DYNAMIC_PLACES, results),
        _early_events(results), _weights(results), _fresh(results), _solve(results), _few(results),
    ]  # fmt: skip
    search = results.experiment.search
    if search is not None:
        found += [_finalists(search), _confirmed(search)]
    if "best" in results.tasks:
        found += [_means("best_II_IV", "best", results.tasks["best"], results),
                  _tests("best_I_V", "best", PERFORMANCE, results, 0, 1), _claims_at_best(results)]  # fmt: skip
    return found


def claims_table(findings: Sequence[Finding]) -> Table:
    """A line per claim."""
    rows = tuple(
        (f.section, f.claim, f.verdict, f.result, f.interval, _p(f.p), f.n, f.test) for f in findings
    )  # fmt: skip
    head = ("section", "claim", "verdict", "result", "95 % interval", "p", "n", "test")
    return Table(name="claims", title="What the paper claims, and what this run found", head=head, rows=rows)


def _title(number: str, text: str) -> str:
    is_papers = set(number) <= set("IVX")
    return f"Table {number}: {text}" if is_papers else text[0].upper() + text[1:]


def _means(number: str, task: str, systems: Sequence[str], results: Results) -> Table:
    printed = published().means["dynamic" if task == "dynamic" else "static"]
    rows = []
    for measure in MEASURES:
        ours, theirs = [NAMES[measure], "here"], ["", "paper"]
        for system in systems:
            sample = results.sample(task, system, measure)
            missed = int(np.isnan(sample).sum())
            ours.append(_mean(*mean_and_deviation(sample)) + (f", {missed} unsolved" if missed else ""))
            theirs.append(_mean(*printed[measure][system]))
        rows += [tuple(ours), tuple(theirs)]
    n = results.experiment.settings.repeats
    time = "trials from the first reward to the second" if task == "dynamic" else "generations to the first solution"
    return Table(
        name=f"table_{number}", title=_title(number, f"means and standard deviations, {_task(task)}"),
        head=("measure", "", *systems), rows=tuple(rows),
        note=f"{n} runs per system; performance in {time}, of the runs that had one.",
    )  # fmt: skip


def _tests(number: str, task: str, measures: Sequence[str], results: Results, *families: int) -> Table:
    printed = published().tests["dynamic" if task == "dynamic" else "static"]
    known = FAMILIES["dynamic" if task == "dynamic" else "static"]
    pairs = [pair for family in families for pair in known[family]]
    apart = ", those with HET apart" if len(families) > 1 else ""
    rows = []
    for measure in measures:
        compared = results.compare_systems(task, measure)
        for first, second in pairs:
            theirs = printed[measure].get(f"{first}-{second}")
            rows.append((NAMES[measure], f"{first} - {second}", *_difference(compared[first, second]), _p(theirs)))
    return Table(
        name=f"table_{number}", title=_title(number, f"differences between systems, {_task(task)}"),
        head=("measure", "pair", *DIFFERENCE, "paper's p"), rows=tuple(rows),
        note=f"First less second. Welch's test; Holm's correction over the pairs of one measure{apart}; g is Hedges'. "
             "Where runs did not solve the task, the difference is of those that did, and the corrected p is that of "
             "the log-rank test of all.",
    )  # fmt: skip


def _kinds(number: str, task: str, places: dict[str, str], results: Results) -> Table:
    printed = published().counts[task]
    numbers = published().numbers.get(task, {})
    rows = []
    for place, words in places.items():
        counts, compared = results.counts(task, place), results.compare_counts(task, place)
        for first, second in KIND_PAIRS:
            theirs = printed.get(place, {}).get(f"{first}-{second}")
            means = [
                f"{counts[kind].mean():.1f}" + (f" ({numbers[place][kind]})" if kind in numbers.get(place, {}) else "")
                for kind in (first, second)
            ]
            pair = f"{KIND_NAMES[first]} - {KIND_NAMES[second]}"
            rows.append((words, pair, *means, *_difference(compared[first, second]), _p(theirs)))
    return Table(
        name=f"table_{number}", title=_title(number, f"synapses of the best HET networks, {_task(task)}"),
        head=("place", "pair", "first", "second", *DIFFERENCE, "paper's p"), rows=tuple(rows),
        note="Mean numbers in the best network of each run, the paper's in brackets where it gives them.",
    )  # fmt: skip


def _turn(results: Results) -> Table:
    printed = published().turn
    best = results.best_network("static", "HET")
    activity = results.activities["static"][best]
    turn = activity.turn()
    rows = []
    for sign in ("positive", "negative"):
        for k, kind in enumerate(PLASTIC_KINDS):
            events = getattr(activity, sign)[:, k]
            rows.append((f"{sign} STDP", KIND_NAMES[kind], *_around(events, turn), *printed[sign][kind]))
    when = "it never turned" if turn is None else f"it turned in timesteps {turn[0]} to {turn[1]}"
    moments = ("entering", "in the turn", "its end", "afterwards")
    return Table(
        name="table_XI", title="Table XI: STDP events per timestep around the turn of the best HET network",
        head=("", "kind", *moments, *(f"paper, {moment}" for moment in moments)), rows=tuple(rows),
        note=f"Repeat {best}, fitness {results.sample('static', 'HET', 'best_fitness')[best]:.0f}; {when} of "
             f"{len(activity.actions)}. Means of the ten timesteps before, in the middle, at the end and after it.",
    )  # fmt: skip


def _around(events: np.ndarray, turn: tuple[int, int] | None) -> tuple[str, ...]:
    if turn is None:
        return ("", "", "", "")
    first, last = turn
    middle = (first + last) // 2
    spans = ((first - 10, first), (middle - 5, middle + 5), (last - 9, last + 1), (last + 1, last + 11))
    parts = [events[max(0, a) : max(0, b)] for a, b in spans]
    return tuple(f"{part.mean():.1f}" if len(part) else "" for part in parts)


def _early_events(results: Results) -> Table:
    rows = []
    for task in ("static", "dynamic"):
        for kind in PLASTIC_KINDS:
            cells = []
            for sign in ("positive", "negative"):
                sample = results.set_up(task, sign)[kind]
                cells.append(_mean(*mean_and_deviation(sample)))
                theirs = published().activity[task].get(sign)
                cells.append("" if theirs is None else f"{theirs[kind]}")
            rows.append((task, KIND_NAMES[kind], *cells))
    return Table(
        name="stdp", title="STDP events per timestep in the first 250 timesteps (Section XII-A)",
        head=("task", "kind", "positive", "paper", "negative", "paper"), rows=tuple(rows),
        note="Mean (standard deviation) over the best HET network of each run that has the kind.",
    )  # fmt: skip


def _weights(results: Results) -> Table:
    rows = []
    for task in ("static", "dynamic"):
        theirs = published().activity[task]
        for kind in PLASTIC_KINDS:
            end, mean = (getattr(results, name)(task)[kind] for name in ("final_weight", "mean_weight"))
            printed = [_number(theirs.get(name, {}).get(kind)) for name in ("final_weight", "mean_weight")]
            ours = [_mean(*mean_and_deviation(sample)) for sample in (end, mean)]
            rows.append((task, KIND_NAMES[kind], ours[0], printed[0], ours[1], printed[1]))
    return Table(
        name="weights", title="Weights of the best HET networks (Sections XII-A and XIII-B)",
        head=("task", "kind", "at the end", "paper", "over the trial", "paper"), rows=tuple(rows),
        note="Mean (standard deviation) over networks.",
    )  # fmt: skip


def _fresh(results: Results) -> Table:
    starts = results.experiment.settings.fresh_starts
    rows = []
    for task, systems in results.tasks.items():
        for system in systems:
            sample = results.fresh(task, system)
            low, high = wilson_of_rate(float(sample.mean()), starts * len(sample))
            fitness = _mean(*mean_and_deviation(results.sample(task, system, "best_fitness")))
            rows.append((_task(task), system, fitness, f"{sample.mean():.1%}", f"{low:.1%} to {high:.1%}",
                         f"{sample.min():.0%} to {sample.max():.0%}"))  # fmt: skip
    return Table(
        name="fresh_starts", title=f"Success of the best networks on {starts} fresh starts each",
        head=("task", "system", "fitness", "success", "95 % interval", "lowest and highest"), rows=tuple(rows),
        note=f"Fitness is the mean over {results.experiment.settings.starts} start(s). Wilson's interval over all "
             "trials; it leaves out that networks differ.",
    )  # fmt: skip


def _solve(results: Results) -> Table:
    solve = results.experiment.solve
    systems = tuple(next(iter(solve.values())))
    implied = published().implied_success
    rows = [("implied by the paper", *(f"{implied[system]:.2%}" for system in systems))]
    rows += [(reading, *(_rate(counts[system]) for system in systems)) for reading, counts in solve.items()]
    n = next(iter(next(iter(solve.values())).values())).tried
    return Table(
        name="random_networks", title="Random networks that solve the static task, by reading",
        head=("reading", *systems), rows=tuple(rows),
        note=f"{n} networks each, the same random numbers for all readings; Wilson's 95 % interval.",
    )  # fmt: skip


def _few(results: Results) -> Table:
    samples = {measure: [results.sample("dynamic", s, measure) for s in ("HET", "GA")] for measure in MEASURES}
    rng = np.random.default_rng(np.random.SeedSequence(results.experiment.settings.seed, spawn_key=(8010,)))
    rows = []
    for measure, both in samples.items():
        known = [sample[~np.isnan(sample)] for sample in both]
        theirs = published().tests["dynamic"][measure]["HET-GA"]
        if min(map(len, known)) < PAPERS_RUNS:
            rows.append((NAMES[measure], "", "", _p(theirs)))
            continue
        median, share = resampled_p(known[0], known[1], PAPERS_RUNS, rng)
        rows.append((NAMES[measure], _p(median), f"{share:.0%}", _p(theirs)))
    return Table(
        name="few_runs", title=f"The dynamic comparison with only {PAPERS_RUNS} runs of each system",
        head=("measure", "median p", "share below 0.05", "paper's p"), rows=tuple(rows),
        note="The p-values printed for the dynamic task fit five runs, not thirty: 1,000 draws of five of ours. Empty "
             "where fewer than five runs found both rewards.",
    )  # fmt: skip


def _finalists(search: Search) -> Table:
    rows = []
    for k, finalist in enumerate(search.finalists):
        chosen = finalist.settings
        words = ", ".join(f"{name} {value}" for name, value in _flat(chosen)) or "the default"
        rows.append((str(k + 1), words, f"{finalist.deviance:.1f}", *(_rate(finalist.counts[s]) for s in ("GA", "HP"))))
    return Table(
        name="search", title="Readings and constants under which GA and HP fit the paper best",
        head=("rank", "settings", "deviance", "GA", "HP"), rows=tuple(rows),
        note=f"{search.tried} combinations drawn at random, {search.networks} networks of each of the two systems; the "
             f"best {len(search.finalists)} again with more. PEO, LIN and HET were not looked at.",
    )  # fmt: skip


def _flat(settings: dict[str, object]) -> Iterator[tuple[str, object]]:
    for name, value in settings.items():
        if isinstance(value, dict):
            yield from _flat(value)
        else:
            yield name, value


def _confirmed(search: Search) -> Table:
    implied = published().implied_success
    rows = tuple((system, _rate(count), f"{implied[system]:.2%}") for system, count in search.confirmed.items())
    return Table(name="confirmed", title="All systems at the best combination, on fresh seeds",
                 head=("system", "solved", "implied by the paper"), rows=rows)  # fmt: skip


def _claims_at_best(results: Results) -> Table:
    default = {finding.claim: finding.verdict for finding in examine(results)}
    found = examine_at_best(results)
    rows = tuple((f.section, f.claim, default[f.claim], f.verdict, f.result, f.interval, _p(f.p)) for f in found)
    papers = [finding for finding in found if finding.section != "ours"]
    counts = [sum(verdict == YES for verdict in verdicts)
              for verdicts in ([f.verdict for f in papers], [default[f.claim] for f in papers])]  # fmt: skip
    return Table(
        name="best_claims", title="Claims about the static task at the search's best combination",
        head=("section", "claim", "default readings", "at the best", "result", "95 % interval", "p"), rows=rows,
        note=f"Of {len(papers)} claims {counts[0]} reproduce, of the same under the default readings {counts[1]}. "
             "Result, interval and p are those at the best combination.",
    )  # fmt: skip


DIFFERENCE: Final = ("difference", "95 % interval", "p", "corrected p", "g", "n")


def _difference(d: Difference) -> tuple[str, ...]:
    low, high = d.interval
    interval = "" if math.isnan(low) else f"{short(low)} to {short(high)}"
    return (_number(d.value), interval, _p(d.p), _p(d.p_holm), _number(d.effect), f"{d.n[0]}, {d.n[1]}")


def _task(task: str) -> str:
    return "static task at the search's best combination" if task == "best" else f"{task} task"


def _mean(mean: float, deviation: float) -> str:
    if math.isnan(mean):
        return "none"
    digits = 0 if abs(mean) >= 1000 else 1 if abs(mean) >= 10 else 3
    return f"{mean:.{digits}f}" + ("" if math.isnan(deviation) else f" ({deviation:.{digits}f})")


def _number(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else short(value)


def _p(p: float | None) -> str:
    if p is None or math.isnan(p):
        return ""
    return "< 0.001" if p <= 0.001 else f"{p:.3f}"


def _rate(count: Count) -> str:
    rate = count.solved / count.tried
    low, high = wilson_of_rate(rate, count.tried)
    return f"{rate:.2%} ({low:.2%} to {high:.2%})"
