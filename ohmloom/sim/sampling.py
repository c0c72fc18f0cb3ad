"""Sampled dies: each drives the robot from starts of its own, beside the ideal controller from the same starts."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ohmloom.mapping import EmulatedController, Ledger, Plan
from ohmloom.neurocontroller import SpikingController
from ohmloom.sim.arena import Arena
from ohmloom.sim.statistics import Success, clustered_success, paired_success
from ohmloom.sim.trial import Trial, run_trial, trial_fitness
from ohmloom.sim.work import Batch, Progress, Work, open_work
from ohmloom.sim.workers import Report, Stopped

START_STREAM = 100  # beside the streams of ohmloom.mapping.die.EFFECTS


@dataclass(frozen=True, kw_only=True)
class DieOutcome:
    """One start of one sampled die: its key, whether the ideal controller and the hardware reached the goal, counts."""

    die: int
    trial_key: int
    ideal: bool
    hardware: bool
    lost: int
    spurious: int
    most_pulses: int
    worst_programming_time: float
    start: int = 0


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """What sampled dies did.

    Attributes
    ----------
    success
        Closed-loop success on paired starts, or None without dies.
    outcomes, ledgers
        One a start, die by die; what the die spent in that trial.
    first_trial
        Trial of the first die on its first start.
    """

    success: Success | None
    outcomes: tuple[DieOutcome, ...]
    ledgers: tuple[Ledger, ...]
    first_trial: Trial | None


NOT_SAMPLED = Sampled(success=None, outcomes=(), ledgers=(), first_trial=None)


def start_key(seed: int, die: int, start: int = 0) -> int:
    """Key of a start on which a die is tried; that of the first does not depend on how many there are."""
    stream = np.random.SeedSequence(seed, spawn_key=(START_STREAM, die, *((start,) if start else ())))
    return int(stream.generate_state(1, np.uint64)[0])


def sample_dies(
    plan: Plan,
    arena: Arena,
    *,
    dies: int,
    seed: int,
    starts: int = 1,
    workers: int = 1,
    work: Work | None = None,
    progress: Progress | None = None,
) -> Sampled:
    """Try `dies` pieces of hardware on `starts` starts each; neither `workers` nor their order changes the result.

    Parameters
    ----------
    plan, arena
        What is built; the world.
    dies, seed, starts
        How many, from which random numbers, from how many starts each.
    workers
        Processes, if no `work` says where the dies are tried.
    work
        Where they are tried, and where the outcomes are kept.
    progress
        Called with the number of dies done and of all.

    Raises
    ------
    OperationError
        If a die fails again and again, because a worker dies or the potentials of wires do not converge.
    Interrupted, KeyboardInterrupt
        After Ctrl-C, once the dies under way are done.
    """
    if work is None:
        with open_work(workers=workers) as own:
            return sample_dies(plan, arena, dies=dies, seed=seed, starts=starts, work=own, progress=progress)
    unit, first = _DieUnit(plan=plan, arena=arena, seed=seed, starts=starts), None
    found: dict[int, list[tuple[DieOutcome, Ledger]]] = {}
    if dies:
        # The first die is tried here: a trial is kept of it, and reports of workers are numbers.
        for row, trial in unit.tries(0):
            found.setdefault(0, []).append(_from_row(0, row))
            first = first or trial
        if progress is not None:
            progress(1, dies)
    inputs = study_inputs(plan, arena) | {"seed": seed, "starts": starts}
    batch = Batch(name="dies", unit=unit, items=range(1, dies), inputs=inputs)
    rest = work.run(batch, None if progress is None else lambda done, _: progress(done + 1, dies))
    found |= {die: [_from_row(die, row) for _, row in rows] for die, rows in rest.items()}
    outcomes = [outcome for die in sorted(found) for outcome, _ in found[die]]
    ledgers = [ledger for die in sorted(found) for _, ledger in found[die]]
    return Sampled(
        success=_success(outcomes, starts, seed) if outcomes else None,
        outcomes=tuple(outcomes), ledgers=tuple(ledgers), first_trial=first,
    )  # fmt: skip


def study_inputs(plan: Plan, arena: Arena) -> dict[str, Any]:
    """What every unit of a study follows from, as plain values."""
    return {"plan": json.loads(plan.to_json()), "arena": arena.settings()}


def _success(outcomes: Sequence[DieOutcome], starts: int, seed: int) -> Success:
    ideal, hardware = [one.ideal for one in outcomes], [one.hardware for one in outcomes]
    if starts == 1:
        return paired_success(ideal, hardware)
    return clustered_success(ideal, hardware, [one.die for one in outcomes], seed=seed)


@dataclass(frozen=True, kw_only=True)
class _DieUnit:
    """All starts of one die: the unit of work. A faster way to run many dies at once belongs in here."""

    plan: Plan
    arena: Arena
    seed: int
    starts: int

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool:
        for row, _ in self.tries(item):
            report(item, row)
            if stopped():
                return False
        return True

    def tries(self, item: int) -> Iterator[tuple[dict[str, float], Trial | None]]:
        """Each start of a die: what is reported of it, and the hardware's trial of the first start of die 0, the only
        one that is recorded."""
        ideal = SpikingController(self.plan.network)
        emulated = EmulatedController(self.plan.sample(seed=self.seed, die=item))
        for start in range(self.starts):
            key = start_key(self.seed, item, start)
            _, reached, _ = trial_fitness(ideal, self.arena, key)
            trial = run_trial(emulated, self.arena, trial_key=key) if item == start == 0 else None
            solved = trial.solved if trial is not None else trial_fitness(emulated, self.arena, key)[1]
            row = {"start": start, "trial_key": key, "ideal": reached, "hardware": solved}
            yield row | vars(emulated.ledger), trial


def _from_row(die: int, row: Mapping[str, Any]) -> tuple[DieOutcome, Ledger]:
    ledger = Ledger(**{f.name: row[f.name] for f in fields(Ledger)})
    outcome = DieOutcome(
        die=die, start=int(row["start"]), trial_key=int(row["trial_key"]), ideal=bool(row["ideal"]),
        hardware=bool(row["hardware"]), lost=ledger.lost, spurious=ledger.spurious, most_pulses=ledger.most_pulses,
        worst_programming_time=ledger.worst_programming_time,
    )  # fmt: skip
    return outcome, ledger
