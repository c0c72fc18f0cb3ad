"""What a run of the paper's experiments measured, as samples over repeats, and how these compare."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from itertools import combinations
from typing import Final

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._files import read_bytes
from ohmloom.neurocontroller import Network
from ohmloom.neurocontroller.census import count_synapses
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.sim.paper.activity import Activity
from ohmloom.sim.paper.compare import Difference, holm, rank_test, welch
from ohmloom.sim.paper.experiment import Experiment

# Measure -> column of a run's table, and how many times larger the paper prints it.
COLUMNS: Final = {
    "best_fitness": ("best_fitness", 1.0), "mean_fitness": ("mean_fitness", 1.0),
    "connectivity": ("connectivity", 100.0), "nodes": ("nodes", 1.0),
    "mu": ("mu", 1.0), "psi": ("psi", 1.0), "omega": ("omega", 1.0), "tau": ("tau", 1.0),
}  # fmt: skip
MEASURES: Final = ("performance", *COLUMNS)
HOMOGENEOUS: Final = ("HP", "PEO", "LIN", "GA")
# Pairs that the paper tests together: Tables I and III, and Tables V and VI.
FAMILIES: Final = {
    "static": (tuple(combinations(HOMOGENEOUS, 2)), tuple(("HET", other) for other in ("PEO", "LIN", "GA"))),
    "dynamic": ((("HET", "GA"),),),
}
KIND_PAIRS: Final = tuple(combinations(PLASTIC_KINDS, 2))
SET_UP: Final = 250  # timesteps in which the paper finds most STDP


class Results:
    """Samples over the repeats of a finished `Experiment`."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.tasks = {
            task: tuple(system for key, system in experiment.evolutions if key == task)
            for task in dict.fromkeys(task for task, _ in experiment.evolutions)
        }

    @cached_property
    def at_best(self) -> Results | None:
        """The static task at the search's best combination alone, as ``static``; None if it was not run."""
        if "best" not in self.tasks:
            return None
        whole = self.experiment
        evolutions = {("static", system): whole.evolutions["best", system] for system in self.tasks["best"]}
        return Results(replace(whole, evolutions=evolutions, fresh={"static": whole.fresh["best"]},
                               activity={"static": whole.activity["best"]}))  # fmt: skip

    def sample(self, task: str, system: str, measure: str) -> FloatArray:
        """(repeat,) one of `MEASURES` at the end of each run; NaN is a goal that was never reached.

        Performance is in generations; in the dynamic task in trials from the first reward to the second.
        """
        if measure == "performance":
            return self._performance(task, system)
        column, factor = COLUMNS[measure]
        last: FloatArray = factor * self.course(task, system, column)[-1]
        return last

    def _performance(self, task: str, system: str) -> FloatArray:
        repeats = self.experiment.evolutions[task, system].repeats
        if task != "dynamic":
            return np.array([math.nan if r.first_solved is None else r.first_solved for r in repeats], dtype=float)
        times = [(r.first_reward_trial, r.first_solved_trial) for r in repeats]
        return np.array([math.nan if a is None or b is None else b - a for a, b in times], dtype=float)

    def _ends(self, task: str, system: str) -> float:
        """Latest time at which a run could have reached what `_performance` counts."""
        settings = self.experiment.evolutions[task, system].settings
        if task != "dynamic":
            return float(settings.generations)
        return float(settings.starts * (settings.population + 2 * settings.generations))

    def course(self, task: str, system: str, column: str) -> FloatArray:
        """(observation, repeat) a column of the runs' tables."""
        return np.array([[float(row[column]) for row in rows] for rows in self._tables[task, system]]).T

    def generations(self, task: str, system: str) -> FloatArray:
        """(observation,) generation of each row of `course`."""
        return self.course(task, system, "generation")[:, 0]

    @cached_property
    def _tables(self) -> dict[tuple[str, str], list[list[dict[str, str]]]]:
        found = {}
        for key, evolution in self.experiment.evolutions.items():
            paths = [evolution.out / "tables" / f"{key[1]}_{r.repeat}.csv" for r in evolution.repeats]
            texts = [read_bytes(path, "table").decode() for path in paths]
            found[key] = [list(csv.DictReader(io.StringIO(text))) for text in texts]
        return found

    @cached_property
    def networks(self) -> dict[tuple[str, str], list[Network]]:
        """Best network of each repeat."""
        return {
            key: [Network.load(r.network) for r in evolution.repeats]
            for key, evolution in self.experiment.evolutions.items()
        }

    @property
    def activities(self) -> Mapping[str, tuple[Activity, ...]]:
        """STDP of the best HET network of each repeat, in the trial that gave it its fitness."""
        return self.experiment.activity

    def counts(self, task: str, place: str) -> dict[str, FloatArray]:
        """Kind -> (repeat,) synapses of the best HET networks in one of `census.PLACES`."""
        found = [count_synapses(network, place) for network in self.networks[task, "HET"]]
        return {kind: np.array([count[kind] for count in found], dtype=float) for kind in PLASTIC_KINDS}

    def compare_systems(self, task: str, measure: str) -> dict[tuple[str, str], Difference]:
        """Every pair that the paper tests, Holm-corrected within each of its tables."""
        found: dict[tuple[str, str], Difference] = {}
        for family in FAMILIES["dynamic" if task == "dynamic" else "static"]:
            found |= corrected({pair: self._difference(task, measure, *pair) for pair in family})
        return found

    def _difference(self, task: str, measure: str, first: str, second: str) -> Difference:
        samples = [self.sample(task, system, measure) for system in (first, second)]
        known = [sample[~np.isnan(sample)] for sample in samples]
        if min(map(len, known)) == 0:
            bare = Difference(n=(len(known[0]), len(known[1])), value=math.nan, interval=(math.nan, math.nan),
                              p=math.nan, effect=math.nan)  # fmt: skip
        else:
            bare = welch(*known)
        if any(np.isnan(sample).any() for sample in samples):
            ends = self._ends(task, first), self._ends(task, second)
            p, is_later = rank_test(samples[0], samples[1], ends)
            return replace(bare, n=(len(samples[0]), len(samples[1])), p_rank=p, is_later=is_later)
        return bare

    def compare_counts(self, task: str, place: str) -> dict[tuple[str, str], Difference]:
        """Numbers of synapses of each pair of kinds in the best HET networks, Holm-corrected over the place."""
        counts = self.counts(task, place)
        return corrected({pair: welch(counts[pair[0]], counts[pair[1]]) for pair in KIND_PAIRS})

    def set_up(self, task: str, sign: str) -> dict[str, FloatArray]:
        """Kind -> (network,) events of this sign per timestep in the first 250; of networks that have the kind."""
        return self._per_kind(task, lambda a, k: float(getattr(a, sign)[:SET_UP, k].mean()))

    def final_weight(self, task: str) -> dict[str, FloatArray]:
        """Kind -> (network,) mean weight at the end of the trial."""
        return self._per_kind(task, lambda a, k: float(a.weight[-1, k]))

    def mean_weight(self, task: str) -> dict[str, FloatArray]:
        """Kind -> (network,) mean weight over the trial."""
        return self._per_kind(task, lambda a, k: float(a.weight[:, k].mean()))

    def whole_trial(self, task: str, sign: str) -> dict[str, FloatArray]:
        """Kind -> (network,) events of this sign per timestep over the whole trial."""
        return self._per_kind(task, lambda a, k: float(getattr(a, sign)[:, k].mean()))

    def _per_kind(self, task: str, value: Callable[[Activity, int], float]) -> dict[str, FloatArray]:
        return {
            kind: np.array([value(a, k) for a in self.activities[task] if not np.isnan(a.weight[0, k])])
            for k, kind in enumerate(PLASTIC_KINDS)
        }

    def fresh(self, task: str, system: str) -> FloatArray:
        """(repeat,) success of each best network on fresh starts, in [0, 1]."""
        solved = self.experiment.fresh[task][system]
        return np.array(solved, dtype=float) / self.experiment.settings.fresh_starts

    def best_network(self, task: str, system: str) -> int:
        """Repeat whose best network has the highest fitness."""
        return int(np.argmax(self.sample(task, system, "best_fitness")))


def corrected(differences: dict[tuple[str, str], Difference]) -> dict[tuple[str, str], Difference]:
    """Holm's correction over a family; where values were censored it takes the log-rank p."""
    used = holm([d.p if d.p_rank is None else d.p_rank for d in differences.values()])
    return {key: replace(d, p_holm=p) for (key, d), p in zip(differences.items(), used, strict=True)}


def mean_and_deviation(sample: Iterable[float]) -> tuple[float, float]:
    """Mean and standard deviation of what is not NaN."""
    known = np.array([value for value in sample if not math.isnan(value)])
    if not len(known):
        return math.nan, math.nan
    return float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else math.nan
