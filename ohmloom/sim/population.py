"""One evolutionary run: a population, its fitness, and the generation loop of Section VI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray
from ohmloom._files import validate
from ohmloom.errors import FileFormatError, ParameterError
from ohmloom.neurocontroller import Adaptation, Network, Readings, SpikingController, mutate
from ohmloom.neurocontroller.census import LAYERS, count_synapses
from ohmloom.neurocontroller.variation import INITIAL_RANGES
from ohmloom.sim.arena import Arena
from ohmloom.sim.run_files import PopulationTable
from ohmloom.sim.trial import draw_trial_key, trial_fitness

OFFSPRING = 2  # Section VI


@dataclass(kw_only=True)
class IndividualState:
    """A network with the evaluations it has had."""

    network: Network
    birth: int
    trial_keys: list[int]
    total: float = 0.0
    solved: int = 0
    trials: int = 0

    @property
    def fitness(self) -> float:
        """Mean over all its trials."""
        return self.total / self.trials


def start_keys(trial_key: int, starts: int) -> list[int]:
    """Keys of the trials of one evaluation: `trial_key` itself, then keys drawn from it.

    >>> start_keys(5, 1)
    [5]
    >>> len(set(start_keys(5, 8)))
    8
    """
    if starts == 1:
        return [trial_key]
    words = np.random.SeedSequence(trial_key).generate_state(starts - 1, np.uint64)
    return [trial_key, *(int(word) for word in words)]


def run_starts(network: Network, arena: Arena, keys: Sequence[int]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Fitness of each trial and whether it reached the goal, axes (start,)."""
    controller = SpikingController(network)
    fitness, solved = np.zeros(len(keys)), np.zeros(len(keys), dtype=np.bool_)
    for k, key in enumerate(keys):
        fitness[k], solved[k], _ = trial_fitness(controller, arena, key)
    return fitness, solved


def _first(known: int | None, before: int, hits: npt.NDArray[np.bool_]) -> int | None:
    """Number of the first trial, from 0, that is a hit; `hits` are those after `before` others."""
    return before + int(np.argmax(hits)) if known is None and hits.any() else known


def roulette(fitness: FloatArray, rng: np.random.Generator) -> int:
    """Index drawn in proportion to `fitness` (individual,); uniformly if all are 0.

    >>> roulette(np.array([0.0, 0.0, 3.0]), np.random.default_rng(1))
    2
    """
    cumulative = np.cumsum(fitness)
    draw = rng.random()
    if cumulative[-1] <= 0.0:
        return int(draw * len(fitness))
    return int(np.searchsorted(cumulative, draw * cumulative[-1], side="right"))


class PopulationState:
    """Population of one repeat and its random generator; everything that a checkpoint holds."""

    def __init__(self, arena: Arena, rng: np.random.Generator, *, starts: int, reevaluate: bool) -> None:
        self.arena, self.rng, self.starts, self.reevaluate = arena, rng, starts, reevaluate
        self.individuals: list[IndividualState] = []
        self.generation = 0
        self.births = 0
        self.trials = 0
        self.first_solved: int | None = None
        self.first_reward_trial: int | None = None
        self.first_solved_trial: int | None = None

    def found(self, system: str, enable_probability: float, readings: Readings) -> None:
        """One more network of generation 0: random, and tried."""
        network = Network.random(system=system, rng=self.rng, enable_probability=enable_probability, readings=readings)
        self._join(network)

    def advance(self) -> None:
        """One generation: two parents, two offspring, the two worst leave."""
        self.generation += 1
        fitness = np.array([individual.fitness for individual in self.individuals])
        parents = [self.individuals[roulette(fitness, self.rng)] for _ in range(OFFSPRING)]
        for parent in parents:
            if self.reevaluate:
                self._try(parent)
            self._join(mutate(parent.network, rng=self.rng))
        for _ in range(OFFSPRING):
            # The list is in order of birth and min() takes the first, so ties go oldest first.
            self.individuals.remove(min(self.individuals, key=lambda individual: individual.fitness))

    def best(self) -> IndividualState:
        """The individual of the highest fitness, the oldest among equals."""
        return max(self.individuals, key=lambda individual: individual.fitness)

    def observe(self) -> dict[str, float]:
        """Means over the population, as the paper's tables have them, and the best network's synapses by layer."""
        best, members = self.best(), self.individuals
        row: dict[str, float] = {
            "generation": self.generation,
            "best_fitness": best.fitness,
            "best_success": best.solved / best.trials,
            "mean_fitness": float(np.mean([m.fitness for m in members])),
            "mean_success": sum(m.solved for m in members) / sum(m.trials for m in members),
            "connectivity": float(np.mean([m.network.connectivity for m in members])),
            "nodes": float(np.mean([m.network.neurons for m in members])),
            "hidden": float(np.mean([len(m.network.hidden) for m in members])),
        }
        for name in INITIAL_RANGES:
            row[name] = float(np.mean([getattr(m.network.adaptation, name) for m in members]))
        for name in LAYERS:
            row |= {f"best_{kind}_{name}": count for kind, count in count_synapses(best.network, name).items()}
        return row

    def _join(self, network: Network) -> None:
        individual = IndividualState(network=network, birth=self.births, trial_keys=[])
        self.births += 1
        self._try(individual)
        self.individuals.append(individual)

    def _try(self, individual: IndividualState) -> None:
        key = draw_trial_key(self.rng)
        fitness, reached = run_starts(individual.network, self.arena, start_keys(key, self.starts))
        solved = int(reached.sum())
        individual.trial_keys.append(key)
        # The floor of eq. 14 belongs to the static task; the dynamic one counts rewards from 0.
        individual.total += float(fitness.sum())
        individual.solved += solved
        individual.trials += self.starts
        rewarded = fitness >= 1.0 if self.arena.task == "dynamic" else reached
        self.first_reward_trial = _first(self.first_reward_trial, self.trials, rewarded)
        self.first_solved_trial = _first(self.first_solved_trial, self.trials, reached)
        self.trials += self.starts
        if solved and self.first_solved is None:
            self.first_solved = self.generation

    def to_table(self) -> dict[str, Any]:
        """Everything, as plain values."""
        return {
            "generation": self.generation,
            "births": self.births,
            "trials": self.trials,
            "first_solved": self.first_solved,
            "first_reward_trial": self.first_reward_trial,
            "first_solved_trial": self.first_solved_trial,
            "generator": self.rng.bit_generator.state,
            "individuals": [
                {
                    "hidden": "".join("+" if p == "excitatory" else "-" for p in i.network.hidden),
                    "synapses": [list(s) for s in i.network.synapses],
                    "adaptation": i.network.adaptation.model_dump(),
                    "birth": i.birth, "trial_keys": i.trial_keys, "total": i.total, "solved": i.solved,
                    "trials": i.trials,
                }
                for i in self.individuals
            ],
        }  # fmt: skip

    def restore(self, table: dict[str, Any], system: str, readings: Readings) -> None:
        """Continue from what `to_table` gave.

        Raises
        ------
        FileFormatError
            If the table is not whole, or one of its networks breaks a rule; names the field.
        """
        # The table itself is taken, not its checked copy: numbers must keep their type to the last byte.
        validate(PopulationTable, table, "population")
        individuals = [
            _individual(entry, f"population: individuals[{k}]", system, readings)
            for k, entry in enumerate(table["individuals"])
        ]
        self.generation, self.births = table["generation"], table["births"]
        self.trials, self.first_solved = table["trials"], table["first_solved"]
        self.first_reward_trial, self.first_solved_trial = table["first_reward_trial"], table["first_solved_trial"]
        self.rng.bit_generator.state = table["generator"]
        self.individuals = individuals


def _individual(entry: dict[str, Any], where: str, system: str, readings: Readings) -> IndividualState:
    try:
        network = Network(
            system=system,
            hidden=tuple("excitatory" if p == "+" else "inhibitory" for p in entry["hidden"]),
            synapses=entry["synapses"],
            readings=readings,
            adaptation=Adaptation(**entry["adaptation"]),
        )
    except ParameterError as error:
        raise FileFormatError(*(f"{where}.{p.removeprefix('Network.')}" for p in error.problems)) from error
    return IndividualState(
        network=network, birth=entry["birth"], trial_keys=entry["trial_keys"], total=entry["total"],
        solved=entry["solved"], trials=entry["trials"],
    )  # fmt: skip
