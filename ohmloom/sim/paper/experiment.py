"""The paper's experiments as one run folder: evolutions, random networks, fresh starts, activity. Resumable."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from ohmloom._files import StrictModel, parse_json, read_bytes, write_atomic
from ohmloom.errors import Interrupted
from ohmloom.neurocontroller import SYSTEMS, Network, Readings
from ohmloom.sim.evolution import Evolution, EvolutionSettings, OpenSettings, evolve
from ohmloom.sim.paper.activity import record_activity
from ohmloom.sim.paper.readings import ALTERNATIVES, candidates, deviance
from ohmloom.sim.population import run_starts
from ohmloom.sim.run_folder import claim
from ohmloom.sim.trial import draw_trial_key
from ohmloom.sim.workers import Report, Stopped, run_units, stop_on_interrupt

FORMAT, VERSION = "ohmloom.paper", 1
EXPERIMENTS: Final = {"static": tuple(SYSTEMS), "dynamic": ("HET", "GA")}
TASKS: Final = (*EXPERIMENTS, "best")
JUDGES: Final = ("GA", "HP")  # of the search
OF_EVOLUTIONS: Final = ("repeats", "generations", "population", "starts", "seed")
CHUNK = 250  # networks of one unit of work, about 3 s
FINALISTS = 5  # candidates of the search that are looked at again, with more networks
# First word of the key of each stream of random numbers, so that no two experiments share one.
SOLVE, FRESH, SEARCH, SCREEN, FINAL, CONFIRM = range(8001, 8007)
Stage = Callable[[str, int, int], None]


class PaperSettings(StrictModel):
    """What determines a run of the paper's experiments.

    Attributes
    ----------
    repeats, generations, population, starts, seed
        Of every evolution, as in `EvolutionSettings`.
    random_networks
        Random networks per system and reading, for the probability of solving.
    fresh_starts
        Trials of each best network from new starts.
    candidates
        Combinations of readings and constants that the search draws; 0 leaves it out.
    best
        Whether the whole static experiment is run again at the search's best combination.
    """

    repeats: int = Field(default=30, ge=1)
    generations: int = Field(default=1000, ge=0)
    population: int = Field(default=100, ge=3)
    starts: int = Field(default=1, ge=1)
    seed: int = Field(default=0, ge=0)
    random_networks: int = Field(default=2000, ge=1)
    fresh_starts: int = Field(default=100, ge=1)
    candidates: int = Field(default=60, ge=0)
    best: bool = True


@dataclass(frozen=True, kw_only=True)
class Count:
    """Networks that solved the static task, of those tried."""

    solved: int
    tried: int


Counts = dict[str, Count]  # by system


@dataclass(frozen=True, kw_only=True)
class Finalist:
    """Settings that fit GA and HP well, as plain values of `OpenSettings`; their deviance and counts."""

    settings: dict[str, Any]
    deviance: float
    counts: Counts


@dataclass(frozen=True, kw_only=True)
class Search:
    """Search for the readings under which GA and HP alone solve as often as the paper implies.

    Attributes
    ----------
    tried, networks
        Combinations drawn, and random networks for each and each of the two systems.
    finalists
        The best of them, tried again with more networks; best first.
    confirmed
        system -> count of all five at the best, on fresh seeds.
    """

    tried: int
    networks: int
    finalists: tuple[Finalist, ...]
    confirmed: Counts


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A finished run.

    Attributes
    ----------
    settings, out
        What was run, and where.
    evolutions
        (task, system) -> evolution; task ``best`` is the static one at the search's best combination.
    solve
        reading -> system -> count of random networks; the first reading is the default.
    fresh
        task -> system -> (repeat,) solved of `settings.fresh_starts`, by the best network of each repeat.
    activity
        task -> (repeat,) file of each best HET network's `Activity`.
    search
        None if it was left out.
    """

    settings: PaperSettings
    out: Path
    evolutions: Mapping[tuple[str, str], Evolution]
    solve: Mapping[str, Mapping[str, Count]]
    fresh: Mapping[str, Mapping[str, tuple[int, ...]]]
    activity: Mapping[str, tuple[Path, ...]]
    search: Search | None


def stages(settings: PaperSettings) -> list[str]:
    """Names of the stages of a run, in order."""
    evolutions = [f"{task} {system}" for task, systems in EXPERIMENTS.items() for system in systems]
    search = [f"search, {part}" for part in ("screen", "final", "confirm")] if settings.candidates else []
    best = [f"best {system}" for system in SYSTEMS] if settings.candidates and settings.best else []
    return ["random networks", *evolutions, *search, *best, "fresh starts", "STDP activity"]


def run_paper(
    settings: PaperSettings,
    *,
    out: Path | str,
    workers: int = 1,
    stage: Stage | None = None,
) -> Experiment:
    """Run, or resume, the paper's experiments in the folder `out`.

    Parameters
    ----------
    settings
        How much of them.
    out
        Run folder; with the same settings it is resumed, to the same final bytes.
    workers
        Processes; they do not change the result.
    stage
        Called with the name of a stage, the pieces of it that are done, and how many there are.

    Raises
    ------
    SettingsConflictError
        If the folder holds a run with other settings; names the first that differs.
    Interrupted
        After Ctrl-C; everything done so far is kept.
    OperationError
        If a worker dies or a file cannot be written.
    """
    run = _Run(settings=settings, folder=Path(out), workers=workers, stage=stage or (lambda *_: None))
    claim(run.folder, FORMAT, VERSION, {"command": "paper", "settings": settings.model_dump()})
    solve = _solve_rates(run)
    evolutions = {
        (task, system): run.evolve(task, system, OpenSettings())
        for task, systems in EXPERIMENTS.items() for system in systems
    }  # fmt: skip
    search = _search(run) if settings.candidates else None
    if search is not None and settings.best:
        left_open = OpenSettings(**_unpacked(search.finalists[0].settings))
        evolutions |= {("best", system): run.evolve("best", system, left_open) for system in SYSTEMS}
    fresh = _fresh_starts(run, evolutions)
    activity = _activities(run, evolutions)
    return Experiment(
        settings=settings, out=run.folder, evolutions=evolutions, solve=solve, fresh=fresh, activity=activity,
        search=search,
    )  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A piece of work that writes one file, which marks it as done."""

    file: str
    work: Callable[[Path], None]


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A run's folder, and how work for it is done."""

    settings: PaperSettings
    folder: Path
    workers: int
    stage: Stage

    def evolve(self, task: str, system: str, left_open: OpenSettings) -> Evolution:
        """One evolution, in a run folder of its own."""
        chosen = EvolutionSettings(
            **{name: getattr(self.settings, name) for name in OF_EVOLUTIONS}
            | dict(left_open)
            | {"system": system, "task": "dynamic" if task == "dynamic" else "static"}
        )
        done = dict.fromkeys(range(chosen.repeats), 0)

        def note(repeat: int, row: dict[str, float]) -> None:
            done[repeat] = int(row["generation"])
            self.stage(f"{task} {system}", sum(done.values()), chosen.repeats * chosen.generations)

        return evolve(chosen, out=self.folder / "runs" / f"{task}_{system}", workers=self.workers, report=note)

    def parts(self, name: str, parts: Sequence[Part]) -> None:
        """Do the pieces of work whose file is not there yet."""
        todo = [part for part in parts if not (self.folder / part.file).exists()]
        done = len(parts) - len(todo)

        def note(*_: Any) -> None:
            nonlocal done
            done += 1
            self.stage(name, done, len(parts))

        if todo:
            with stop_on_interrupt() as stopped:
                unit = partial(_run_part, self.folder, todo)
                run_units(unit, range(len(todo)), workers=self.workers, stopped=stopped, report=note)
            if not all((self.folder / part.file).exists() for part in todo):
                raise Interrupted(f"{self.folder}: interrupted; all finished work is kept.")

    def counted(self, parts: Sequence[Part]) -> Count:
        """Sum of the counts that these pieces wrote."""
        paths = [self.folder / part.file for part in parts]
        counts = [Count(**parse_json(read_bytes(path, "count"), str(path))) for path in paths]
        return Count(solved=sum(count.solved for count in counts), tried=sum(count.tried for count in counts))


def _run_part(folder: Path, parts: Sequence[Part], k: int, stopped: Stopped, report: Report) -> bool:
    parts[k].work(folder / parts[k].file)
    report(k, {})
    return True


def _chunks(networks: int) -> Iterator[tuple[int, int]]:
    for k, first in enumerate(range(0, networks, CHUNK)):
        yield k, min(CHUNK, networks - first)


def _count_parts(
    stem: str, system: str, open_settings: Mapping[str, Any], networks: int, key: tuple[int, ...], seed: int
) -> list[Part]:
    """Random networks of one system under some settings, in chunks that can be made anywhere."""
    index = list(SYSTEMS).index(system)
    return [
        Part(f"{stem}_{system}_{k}.json",
             partial(_count_solved, system, dict(open_settings), count, (seed, (*key, index, k))))
        for k, count in _chunks(networks)
    ]  # fmt: skip


def _count_solved(
    system: str, open_settings: Mapping[str, Any], networks: int, stream: tuple[int, tuple[int, ...]], path: Path
) -> None:
    settings = EvolutionSettings(**_unpacked(open_settings) | {"system": system})
    rng = np.random.default_rng(np.random.SeedSequence(stream[0], spawn_key=stream[1]))
    solved = 0
    for _ in range(networks):
        network = Network.random(
            system=system, rng=rng, enable_probability=settings.enable_probability, readings=settings.readings
        )
        solved += int(run_starts(network, settings.arena(), [draw_trial_key(rng)])[1].sum())
    write_atomic(path, json.dumps({"solved": solved, "tried": networks}) + "\n")


def _unpacked(open_settings: Mapping[str, Any]) -> dict[str, Any]:
    values = dict(open_settings)
    return values | {"readings": Readings(**values.get("readings", {}))}


def _solve_rates(run: _Run) -> dict[str, dict[str, Count]]:
    # All readings share their streams: the same random numbers, so that they differ by the reading alone.
    parts = {
        (reading, system): _count_parts(f"solve/{reading}", system, values, run.settings.random_networks, (SOLVE,),
                                        run.settings.seed)
        for reading, values in ALTERNATIVES.items() for system in SYSTEMS
    }  # fmt: skip
    run.parts("random networks", [part for some in parts.values() for part in some])
    return {
        reading: {system: run.counted(parts[reading, system]) for system in SYSTEMS} for reading in ALTERNATIVES
    }  # fmt: skip


def _search(run: _Run) -> Search:
    """GA and HP decide; PEO, LIN and HET are not looked at until the best is known."""
    seed, networks = run.settings.seed, run.settings.random_networks
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SEARCH,)))
    drawn = candidates(run.settings.candidates, rng)
    few = max(1, networks // 4)

    def counts(label: str, chosen: Sequence[int], size: int, word: int, systems: Sequence[str]) -> list[Counts]:
        parts = {
            (k, system): _count_parts(f"search/{label}_{k}", system, drawn[k], size, (word, k), seed)
            for k in chosen for system in systems
        }  # fmt: skip
        run.parts(f"search, {label}", [part for some in parts.values() for part in some])
        return [{system: run.counted(parts[k, system]) for system in systems} for k in chosen]

    screened = counts("screen", range(len(drawn)), few, SCREEN, JUDGES)
    first = sorted(range(len(drawn)), key=lambda k: deviance(screened[k]))[:FINALISTS]
    again = counts("final", first, networks, FINAL, JUDGES)
    finalists = sorted(
        (Finalist(settings=drawn[k], deviance=deviance(found), counts=found)
         for k, found in zip(first, again, strict=True)),
        key=lambda finalist: finalist.deviance,
    )  # fmt: skip
    confirmed = counts("confirm", [drawn.index(finalists[0].settings)], networks, CONFIRM, tuple(SYSTEMS))[0]
    return Search(tried=len(drawn), networks=few, finalists=tuple(finalists), confirmed=confirmed)


def _fresh_starts(run: _Run, evolutions: Mapping[tuple[str, str], Evolution]) -> dict[str, dict[str, tuple[int, ...]]]:
    found: dict[str, dict[str, list[Part]]] = {}
    for (task, system), evolution in evolutions.items():
        key = (FRESH, TASKS.index(task), list(SYSTEMS).index(system))
        found.setdefault(task, {})[system] = [
            Part(f"fresh/{task}_{system}_{r.repeat}.json",
                 partial(_try_fresh, r.network, evolution.settings, run.settings.fresh_starts,
                         (run.settings.seed, (*key, r.repeat))))
            for r in evolution.repeats
        ]  # fmt: skip
    run.parts("fresh starts", [part for by_system in found.values() for some in by_system.values() for part in some])
    return {
        task: {system: tuple(run.counted([part]).solved for part in some) for system, some in by_system.items()}
        for task, by_system in found.items()
    }


def _try_fresh(
    path: Path, settings: EvolutionSettings, starts: int, stream: tuple[int, tuple[int, ...]], target: Path
) -> None:
    rng = np.random.default_rng(np.random.SeedSequence(stream[0], spawn_key=stream[1]))
    _, solved = run_starts(Network.load(path), settings.arena(), [draw_trial_key(rng) for _ in range(starts)])
    write_atomic(target, json.dumps({"solved": int(solved.sum()), "tried": starts}) + "\n")


def _activities(run: _Run, evolutions: Mapping[tuple[str, str], Evolution]) -> dict[str, tuple[Path, ...]]:
    parts = {
        task: [
            Part(f"activity/{task}_{r.repeat}.npz", partial(_record, r.network, evolutions[task, "HET"].settings))
            for r in evolutions[task, "HET"].repeats
        ]
        for task in EXPERIMENTS
    }
    run.parts("STDP activity", [part for some in parts.values() for part in some])
    return {task: tuple(run.folder / part.file for part in some) for task, some in parts.items()}


def _record(path: Path, settings: EvolutionSettings, target: Path) -> None:
    network = Network.load(path)
    record_activity(network, settings.arena(), int(network.provenance["trial_key"])).save(target)
