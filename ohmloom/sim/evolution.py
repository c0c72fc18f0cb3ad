"""Evolution runs: repeats as units of work in a run folder, resumable, the same for any number of workers."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ohmloom._files import (
    StrictModel,
    advise,
    check_format,
    parse_json,
    parse_toml,
    read_bytes,
    remove_temporaries,
    validate,
    write_atomic,
)
from ohmloom.errors import (
    FileFormatError,
    Interrupted,
    ParameterError,
    expect_integer,
    expect_type,
    shown,
)
from ohmloom.neurocontroller import SYSTEMS, Readings
from ohmloom.sim.arena import LARGEST, SMALLEST, Arena
from ohmloom.sim.population import PopulationState
from ohmloom.sim.run_files import REDO, check_checkpoint, last_row, read_outcome
from ohmloom.sim.run_folder import FORMAT, VERSION, claim
from ohmloom.sim.workers import Report, Stopped, run_units, stop_on_interrupt

OBSERVE_EVERY = 20  # Section IX
ARENA_SETTINGS = ("shadow", "slip_mode", "second_part_start", "axle", "ir_range", "light_saturation")


class OpenSettings(StrictModel):
    """What the paper leaves open of arena, births and controller; a settings file holds some or all of it.

    Attributes
    ----------
    shadow, slip_mode, second_part_start, axle, ir_range, light_saturation
        Settings of the arena, see `Arena`.
    enable_probability
        Probability that a legal synapse exists at birth.
    readings
        Settings of the controller.
    """

    shadow: bool = False
    slip_mode: Literal["stall", "uniform"] = "stall"
    second_part_start: Literal["goal", "start"] = "goal"
    axle: float = Field(default=Arena.axle, ge=SMALLEST, le=LARGEST)
    ir_range: float = Field(default=Arena.ir_range, ge=SMALLEST, le=LARGEST)
    light_saturation: float = Field(default=Arena.light_saturation, ge=SMALLEST, le=LARGEST)
    enable_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    readings: Readings = Readings()

    @classmethod
    def load(cls, path: Path | str) -> OpenSettings:
        """Read a TOML file with format = "ohmloom.settings", version = 1.

        Raises
        ------
        MissingFileError, FileFormatError
            If the file does not exist, or breaks a rule; names every field that does.
        """
        where = str(path)
        table = parse_toml(read_bytes(path, "settings"), where)
        return validate(OpenSettings, check_format(table, where, "ohmloom.settings", 1), where)


class EvolutionSettings(OpenSettings):
    """What determines an evolution run.

    Attributes
    ----------
    system
        ``HP``, ``PEO``, ``LIN``, ``GA`` or ``HET``.
    repeats, generations, population
        Independent repeats; generations after the first; networks per population.
    seed
        Every random number follows from it.
    starts
        Fitness is the mean over this many starts; 1 is the paper's.
    reevaluate
        Whether a parent is tried again on fresh starts each time it is used; fitness is the mean over all.
    task
        ``static`` or ``dynamic``.
    shadow, slip_mode, second_part_start, axle, ir_range, light_saturation, enable_probability, readings
        See `OpenSettings`.
    """

    system: Literal["HP", "PEO", "LIN", "GA", "HET"]
    repeats: int = Field(default=1, ge=1)
    generations: int = Field(default=1000, ge=0)
    population: int = Field(default=100, ge=3)
    seed: int = Field(default=0, ge=0)
    starts: int = Field(default=1, ge=1)
    reevaluate: bool = False
    task: Literal["static", "dynamic"] = "static"

    def arena(self) -> Arena:
        """The arena of these settings."""
        return Arena(task=self.task, **{name: getattr(self, name) for name in ARENA_SETTINGS})


@dataclass(frozen=True, kw_only=True)
class Repeat:
    """Outcome of one repeat: best network's file, fitness, success, and when the goal was first reached.

    Trials are counted from 0; in the dynamic task the first reward is that of the first part.
    """

    repeat: int
    best_fitness: float
    best_success: float
    mean_fitness: float
    first_solved: int | None
    first_reward_trial: int | None
    first_solved_trial: int | None
    network: Path


@dataclass(frozen=True, kw_only=True)
class Evolution:
    """A finished run: its folder and the outcome of each repeat."""

    settings: EvolutionSettings
    out: Path
    repeats: tuple[Repeat, ...]

    @classmethod
    def load(cls, out: Path | str) -> Evolution:
        """Read a finished run from its folder.

        Raises
        ------
        MissingFileError
            If the folder holds no run, or a repeat is not finished.
        FileFormatError
            If ``run.json`` is not of this version.
        """
        path = Path(out) / "run.json"
        table = check_format(parse_json(read_bytes(path, "run"), str(path)), str(path), FORMAT, VERSION)
        return _collect(Path(out), validate(EvolutionSettings, table.get("settings"), f"{path}: settings"))

    def _repr_html_(self) -> str:
        cells = "".join(
            f"<tr><td>{r.repeat}</td><td>{r.best_fitness:.1f}</td><td>{r.best_success:.0%}</td></tr>"
            for r in self.repeats
        )
        head = "<tr><th>repeat</th><th>best fitness</th><th>success</th></tr>"
        return f"<table><caption>{self.settings.system}</caption>{head}{cells}</table>"


def evolve(
    settings: EvolutionSettings | Mapping[str, Any], *, out: Path | str, workers: int = 1, report: Report | None = None
) -> Evolution:
    """Run, or resume, an evolution in the folder `out`.

    Parameters
    ----------
    settings
        What to run; a mapping of the same names will do.
    out
        Run folder; made if absent. With the same settings the run resumes, to the same final bytes.
    workers
        Processes; they do not change the result.
    report
        Called with a repeat's index and its latest row of observations.

    Raises
    ------
    SettingsConflictError
        If the folder holds a run with other settings; names the first that differs.
    ParameterError
        If a setting breaks a rule, `workers` is no integer >= 1, or an argument is of another type.
    FileFormatError, MissingFileError
        If a file of the run folder is damaged or gone; names it, and what to delete to redo its repeat.
    Interrupted
        After Ctrl-C; everything done so far is kept.
    OperationError
        If a worker dies or a file cannot be written.
    """
    workers = expect_integer("evolve.workers", workers, 1)
    expect_type("evolve.settings", settings, EvolutionSettings, Mapping, name="EvolutionSettings or a mapping")
    expect_type("evolve.out", out, str, os.PathLike, name="a path")
    if report is not None and not callable(report):
        raise ParameterError(f"evolve.report: expected a function, got {shown(report)}. Pass a function.")
    if not isinstance(settings, EvolutionSettings):
        settings = EvolutionSettings(**{str(name): value for name, value in settings.items()})
    folder = Path(out)
    claim_evolution(settings, folder)
    todo = [k for k in range(settings.repeats) if not _network_path(folder, settings, k).exists()]
    if todo:
        with stop_on_interrupt() as stopped:
            unit = partial(run_repeat, settings, folder)
            run_units(unit, todo, workers=workers, stopped=stopped, report=report or (lambda *_: None))
        if not all(_network_path(folder, settings, k).exists() for k in todo):
            raise Interrupted(f"{folder}: interrupted; all finished work is kept.")
    return _collect(folder, settings)


def claim_evolution(settings: EvolutionSettings, folder: Path) -> None:
    """Make `folder` the run folder of an evolution, or see that it is one; errors as of `evolve`."""
    wanted = {"command": "evolve", "settings": settings.model_dump(), "arena": settings.arena().settings()}
    claim(folder, wanted, tidy=partial(_tidy, folder, settings))


def _tidy(folder: Path, settings: EvolutionSettings) -> None:
    """Remove half-written files of a run that was killed."""
    ours = re.compile(rf"(run\.json|summary\.csv|{settings.system}_\d+\.(net\.json|json|csv))")
    for part in (folder, *(folder / name for name in ("networks", "populations", "tables"))):
        remove_temporaries(part, lambda name: ours.fullmatch(name) is not None)


def _stem(settings: EvolutionSettings, repeat: int) -> str:
    return f"{settings.system}_{repeat}"


def _network_path(folder: Path, settings: EvolutionSettings, repeat: int) -> Path:
    return folder / "networks" / f"{_stem(settings, repeat)}.net.json"


def run_repeat(settings: EvolutionSettings, folder: Path, repeat: int, stopped: Stopped, report: Report) -> bool:
    """Run one repeat of a claimed folder to its end, or to a stop; whether it finished."""
    if _network_path(folder, settings, repeat).exists():
        return True
    checkpoint = folder / "populations" / f"{_stem(settings, repeat)}.json"
    key = (list(SYSTEMS).index(settings.system), repeat)
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=key))
    population = PopulationState(settings.arena(), rng, starts=settings.starts, reevaluate=settings.reevaluate)
    rows: list[dict[str, float]] = []
    if checkpoint.exists():
        rows = _resume(checkpoint, settings, population)

    def save() -> None:
        write_atomic(checkpoint, json.dumps({"rows": rows, "population": population.to_table()}))

    while not rows:
        if stopped():
            save()
            return False
        if len(population.individuals) < settings.population:
            population.found(settings.system, settings.enable_probability, settings.readings)
        else:
            rows.append(population.observe())
    while population.generation < settings.generations:
        if stopped():
            save()
            return False
        population.advance()
        if population.generation % OBSERVE_EVERY == 0 or population.generation == settings.generations:
            rows.append(population.observe())
            save()
            report(repeat, rows[-1])
    save()
    _publish(settings, folder, repeat, population, rows)
    report(repeat, rows[-1])
    return True


def _resume(checkpoint: Path, settings: EvolutionSettings, population: PopulationState) -> list[dict[str, float]]:
    """Restore `population`; the rows observed so far."""
    where = str(checkpoint)
    try:
        saved = parse_json(read_bytes(checkpoint, "checkpoint", limit=None), where)
        check_checkpoint(saved, where, population=settings.population, generations=settings.generations,
                         starts=settings.starts)  # fmt: skip
    except FileFormatError as error:
        raise FileFormatError(*advise(error.problems, REDO)) from error
    try:
        population.restore(saved["population"], settings.system, settings.readings)
    except FileFormatError as error:
        raise FileFormatError(*advise((f"{where}: {p}" for p in error.problems), REDO)) from error
    rows: list[dict[str, float]] = saved["rows"]
    return rows


def _publish(
    settings: EvolutionSettings,
    folder: Path,
    repeat: int,
    population: PopulationState,
    rows: list[dict[str, float]],
) -> None:
    write_atomic(folder / "tables" / f"{_stem(settings, repeat)}.csv", _csv(rows))
    best = population.best()
    provenance: dict[str, Any] = {
        "seed": settings.seed, "repeat": repeat, "generation": settings.generations, "fitness": best.fitness,
        "task": settings.task, "starts": settings.starts, "trial_key": best.trial_keys[0],
        "trial_keys": best.trial_keys, "solved": best.solved, "trials": best.trials,
        "first_solved": population.first_solved, "first_reward_trial": population.first_reward_trial,
        "first_solved_trial": population.first_solved_trial, "trials_in_all": population.trials,
    }  # fmt: skip
    # The network's file marks the repeat as done, so it comes last.
    network = best.network.replace(name=_stem(settings, repeat), provenance=provenance)
    network.save(_network_path(folder, settings, repeat))


def _csv(rows: list[dict[str, Any]]) -> str:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def _collect(folder: Path, settings: EvolutionSettings) -> Evolution:
    repeats, rows = [], []
    for k in range(settings.repeats):
        path = _network_path(folder, settings, k)
        found = read_outcome(path)
        last = last_row(folder / "tables" / f"{_stem(settings, k)}.csv", path)
        outcome = Repeat(
            repeat=k, best_fitness=found.fitness, best_success=found.solved / found.trials,
            mean_fitness=float(last["mean_fitness"]), first_solved=found.first_solved,
            first_reward_trial=found.first_reward_trial, first_solved_trial=found.first_solved_trial, network=path,
        )  # fmt: skip
        repeats.append(outcome)
        first = "" if outcome.first_solved is None else outcome.first_solved
        rows.append(
            {"repeat": k, "first_solved_generation": first} | {n: v for n, v in last.items() if n != "generation"}
        )
    write_atomic(folder / "tables" / "summary.csv", _csv(rows))
    return Evolution(settings=settings, out=folder, repeats=tuple(repeats))
