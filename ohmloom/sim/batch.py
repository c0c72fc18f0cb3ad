"""Many dies from many starts in one call, behind the interface of a controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.errors import ParameterError, expect_integer, expect_type, shown
from ohmloom.mapping import Die, EmulatedController, Ledger
from ohmloom.sim.arena import Arena
from ohmloom.sim.trial import trial_fitness


@dataclass(frozen=True, kw_only=True, eq=False)
class DieRuns:
    """What dies did, axes (die, start).

    Attributes
    ----------
    fitness, solved
        As in `Trial`.
    timesteps
        Executed timesteps.
    ledgers
        What each die spent in each trial.
    """

    fitness: FloatArray
    solved: npt.NDArray[np.bool_]
    timesteps: IntArray
    ledgers: tuple[tuple[Ledger, ...], ...]

    def __post_init__(self) -> None:
        axes = ("die", "start")
        object.__setattr__(self, "fitness", frozen_array("DieRuns.fitness", self.fitness, axes))
        for name, dtype in (("solved", np.bool_), ("timesteps", np.int64)):
            object.__setattr__(self, name, frozen_array(f"DieRuns.{name}", getattr(self, name), axes, dtype=dtype))


def run_dies(dies: Sequence[Die], arena: Arena | None = None, *, trial_keys: Sequence[Sequence[int]]) -> DieRuns:
    """Let every die drive the robot from each of its starts; nothing is recorded, which spares time in Python.

    Each trial is the one that `run_trial` runs of the die's `EmulatedController` with that key.

    Parameters
    ----------
    dies
        From `Plan.sample`, of one plan or of several.
    arena
        Where; the paper's static arena by default.
    trial_keys
        (die, start) 64-bit keys of the trials, as many for each die.

    Raises
    ------
    ParameterError
        If a die is no Die, or the keys are not as many for each die.
    OperationError
        If the potentials of wires do not converge.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import champion
    >>> plan = place(champion("HET"), Hardware.load("ideal"))
    >>> runs = run_dies([plan.sample(seed=1, die=k) for k in range(2)], trial_keys=[[1, 2], [3, 4]])
    >>> runs.solved.shape
    (2, 2)
    """
    dies, keys = tuple(dies), [tuple(row) for row in trial_keys]
    for k, die in enumerate(dies):
        expect_type(f"run_dies.dies[{k}]", die, Die)
    expect_type("run_dies.arena", arena, Arena, type(None), name="an Arena or None")
    if len(keys) != len(dies) or len({len(row) for row in keys}) > 1:
        raise ParameterError(f"run_dies.trial_keys: expected as many keys for each of {len(dies)} dies, got "
                             f"{shown([len(row) for row in keys])}. Give axes (die, start).")  # fmt: skip
    keys = [
        tuple(expect_integer(f"run_dies.trial_keys[{d}][{t}]", key, 0, 2**64 - 1) for t, key in enumerate(row))
        for d, row in enumerate(keys)
    ]
    place, shape = Arena.paper() if arena is None else arena, (len(dies), len(keys[0]) if keys else 0)
    fitness, solved, timesteps = np.zeros(shape), np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.int64)
    ledgers = []
    for d, die in enumerate(dies):
        emulated, spent = EmulatedController(die), []
        for t, key in enumerate(keys[d]):
            fitness[d, t], solved[d, t], timesteps[d, t] = trial_fitness(emulated, place, key)
            spent.append(emulated.ledger)
        ledgers.append(tuple(spent))
    return DieRuns(fitness=fitness, solved=solved, timesteps=timesteps, ledgers=tuple(ledgers))
