"""The paper's experiments as one run folder: evolutions, random networks, fresh starts, activity. Resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from ohmloom._files import StrictModel
from ohmloom.errors import Interrupted
from ohmloom.neurocontroller import SYSTEMS, Network, Readings
from ohmloom.sim.arena import Arena
from ohmloom.sim.evolution import Evolution, EvolutionSettings, OpenSettings, claim_evolution, run_repeat
from ohmloom.sim.paper.activity import Activity, record_activity
from ohmloom.sim.paper.readings import ALTERNATIVES, candidates, deviance
from ohmloom.sim.population import run_starts
from ohmloom.sim.run_folder import claim
from ohmloom.sim.trial import draw_trial_key
from ohmloom.sim.work import Batch, Row, Work, work_here
from ohmloom.sim.workers import Report, Stopped, Unit

EXPERIMENTS: Final = {"static": tuple(SYSTEMS), "dynamic": ("HET", "GA")}
TASKS: Final = (*EXPERIMENTS, "best")
JUDGES: Final = ("GA", "HP")  # of the search
OF_EVOLUTIONS: Final = ("repeats", "generations", "population", "starts", "seed")
CHUNK = 250  # networks of one unit of work, about 3 s
FINALISTS = 5  # candidates of the search that are looked at again, with more networks
# First word of the key of each stream of random numbers, so that no two experiments share one.
SOLVE, FRESH, SEARCH, SCREEN, FINAL, CONFIRM = range(8001, 8007)
# Names of the stages.
RANDOM, EVOLUTIONS, BEST = "random networks", "evolutions", "evolutions at the best"
SEARCHES: Final = ("search", "search, best again", "search, all systems")
FRESH_STARTS, ACTIVITY = "fresh starts", "STDP activity"
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
        task -> (repeat,) STDP of each best HET network in the trial that gave it its fitness.
    search
        None if it was left out.
    """

    settings: PaperSettings
    out: Path
    evolutions: Mapping[tuple[str, str], Evolution]
    solve: Mapping[str, Mapping[str, Count]]
    fresh: Mapping[str, Mapping[str, tuple[int, ...]]]
    activity: Mapping[str, tuple[Activity, ...]]
    search: Search | None


def stages(settings: PaperSettings) -> list[str]:
    """Names of the stages of a run, in order."""
    best = [BEST] if settings.best else []
    return [RANDOM, EVOLUTIONS, *([*SEARCHES, *best] if settings.candidates else []), FRESH_STARTS, ACTIVITY]


def run_paper(
    settings: PaperSettings,
    *,
    out: Path | str,
    work: Work | None = None,
    stage: Stage | None = None,
) -> Experiment:
    """Run, or resume, the paper's experiments in the folder `out`.

    Parameters
    ----------
    settings
        How much of them.
    out
        Run folder; with the same settings it is resumed, to the same final bytes.
    work
        Where units are worked on, see `ohmloom.sim.work.open_work`; by default here. It does not change the result.
        Workers on other machines must see `out`.
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
    run = _Run(settings=settings, folder=Path(out), work=work or work_here(), stage=stage or (lambda *_: None))
    run = replace(run, work=replace(run.work, folder=run.folder))
    claim(run.folder, {"command": "paper", "settings": settings.model_dump()})
    solve = _solve_rates(run)
    evolutions = run.evolve({key: OpenSettings() for key in _pairs(EXPERIMENTS)}, EVOLUTIONS)
    search = _search(run) if settings.candidates else None
    if search is not None and settings.best:
        left_open = OpenSettings(**_unpacked(search.finalists[0].settings))
        evolutions |= run.evolve({("best", system): left_open for system in SYSTEMS}, BEST)
    fresh = _fresh_starts(run, evolutions)
    activity = _activities(run, evolutions)
    return Experiment(
        settings=settings, out=run.folder, evolutions=evolutions, solve=solve, fresh=fresh, activity=activity,
        search=search,
    )  # fmt: skip


def _pairs(experiments: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    return [(task, system) for task, systems in experiments.items() for system in systems]


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A run's folder, and how work for it is done."""

    settings: PaperSettings
    folder: Path
    work: Work
    stage: Stage

    def batch(self, name: str, unit: Unit, inputs: Sequence[Any]) -> list[list[Row]]:
        """What a unit of work reports of each of its inputs, which are JSON values."""
        batch = Batch(name=name.replace(",", "").replace(" ", "_"), unit=unit, items=range(len(inputs)),
                      inputs={"inputs": list(inputs)})  # fmt: skip
        found = self.work.run(batch, lambda done, whole: self.stage(name, done, whole))
        return list(found.values())

    def each(self, name: str, function: Callable[..., Any], arguments: Sequence[Any]) -> list[Any]:
        """What a function gives for each of these lists of arguments, in their order."""
        found = self.batch(name, _Each(function, tuple(arguments)), arguments)
        return [rows[0][1]["result"] for rows in found]

    def evolve(self, left_open: Mapping[tuple[str, str], OpenSettings], name: str) -> dict[tuple[str, str], Evolution]:
        """Evolutions, each in a run folder of its own; a unit is a repeat of one of them."""
        runs = {
            (task, system): EvolutionSettings(
                **{name: getattr(self.settings, name) for name in OF_EVOLUTIONS}
                | dict(given)
                | {"system": system, "task": "dynamic" if task == "dynamic" else "static"}
            )
            for (task, system), given in left_open.items()
        }
        folders = {key: self.folder / "runs" / "_".join(key) for key in runs}
        for key, settings in runs.items():
            claim_evolution(settings, folders[key])
        # The slowest first would end soonest, but which these are is not known; repeats of all take turns.
        items = [(key, repeat) for repeat in range(self.settings.repeats) for key in runs]
        unit = _Repeats(tuple((runs[key], folders[key], repeat) for key, repeat in items))
        # What is done is told by the evolutions' own files, so that deleting one does its repeat again.
        here = replace(self, work=replace(self.work, folder=None))
        try:
            here.batch(name, unit, [["_".join(key), repeat] for key, repeat in items])
        except KeyboardInterrupt as error:
            raise Interrupted(f"{self.folder}: interrupted; all finished work is kept.") from error
        return {key: Evolution.load(folders[key]) for key in runs}


@dataclass(frozen=True)
class _Each:
    """A unit of work for each of some values."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool:
        report(item, {"result": self.function(*self.arguments[item])})
        return True


@dataclass(frozen=True)
class _Repeats:
    """A unit of work for each repeat of some evolutions; its files are the evolution's own."""

    items: tuple[tuple[EvolutionSettings, Path, int], ...]

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool:
        return run_repeat(*self.items[item], stopped, lambda *_: None)


def _chunks(networks: int) -> Iterator[tuple[int, int]]:
    for k, first in enumerate(range(0, networks, CHUNK)):
        yield k, min(CHUNK, networks - first)


def _count_arguments(system: str, open_settings: Mapping[str, Any], networks: int, key: tuple[int, ...]) -> list[Any]:
    """Random networks of one system under some settings, in chunks that can be made anywhere."""
    index = list(SYSTEMS).index(system)
    return [[system, dict(open_settings), count, [*key, index, k]] for k, count in _chunks(networks)]


def _count_solved(
    seed: int, system: str, open_settings: Mapping[str, Any], networks: int, stream: Sequence[int]
) -> list[int]:
    settings = EvolutionSettings(**_unpacked(open_settings) | {"system": system})
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(stream)))
    solved = 0
    for _ in range(networks):
        network = Network.random(
            system=system, rng=rng, enable_probability=settings.enable_probability, readings=settings.readings
        )
        solved += int(run_starts(network, settings.arena(), [draw_trial_key(rng)])[1].sum())
    return [solved, networks]


def _unpacked(open_settings: Mapping[str, Any]) -> dict[str, Any]:
    values = dict(open_settings)
    return values | {"readings": Readings(**values.get("readings", {}))}


def _counts(run: _Run, name: str, wanted: Mapping[Any, list[Any]]) -> dict[Any, Count]:
    """Counts of several groups of chunks, all as one batch."""
    arguments = [[run.settings.seed, *one] for group in wanted.values() for one in group]
    found = iter(run.each(name, _count_solved, arguments))
    sums = {key: np.sum([next(found) for _ in group], axis=0) for key, group in wanted.items()}
    return {key: Count(solved=int(solved), tried=int(tried)) for key, (solved, tried) in sums.items()}


def _solve_rates(run: _Run) -> dict[str, dict[str, Count]]:
    # All readings share their streams: the same random numbers, so that they differ by the reading alone.
    found = _counts(run, RANDOM, {
        (reading, system): _count_arguments(system, values, run.settings.random_networks, (SOLVE,))
        for reading, values in ALTERNATIVES.items() for system in SYSTEMS
    })  # fmt: skip
    return {reading: {system: found[reading, system] for system in SYSTEMS} for reading in ALTERNATIVES}


def _search(run: _Run) -> Search:
    """GA and HP decide; PEO, LIN and HET are not looked at until the best is known."""
    networks = run.settings.random_networks
    rng = np.random.default_rng(np.random.SeedSequence(run.settings.seed, spawn_key=(SEARCH,)))
    drawn = candidates(run.settings.candidates, rng)
    few = max(1, networks // 4)

    def counts(name: str, chosen: Sequence[int], size: int, word: int, systems: Sequence[str]) -> list[Counts]:
        found = _counts(run, name, {
            (k, system): _count_arguments(system, drawn[k], size, (word, k)) for k in chosen for system in systems
        })  # fmt: skip
        return [{system: found[k, system] for system in systems} for k in chosen]

    screened = counts(SEARCHES[0], range(len(drawn)), few, SCREEN, JUDGES)
    first = sorted(range(len(drawn)), key=lambda k: deviance(screened[k]))[:FINALISTS]
    again = counts(SEARCHES[1], first, networks, FINAL, JUDGES)
    finalists = sorted(
        (Finalist(settings=drawn[k], deviance=deviance(found), counts=found)
         for k, found in zip(first, again, strict=True)),
        key=lambda finalist: finalist.deviance,
    )  # fmt: skip
    confirmed = counts(SEARCHES[2], [drawn.index(finalists[0].settings)], networks, CONFIRM, tuple(SYSTEMS))[0]
    return Search(tried=len(drawn), networks=few, finalists=tuple(finalists), confirmed=confirmed)


def _fresh_starts(run: _Run, evolutions: Mapping[tuple[str, str], Evolution]) -> dict[str, dict[str, tuple[int, ...]]]:
    arguments = [
        [run.settings.seed, Network.load(r.network).to_json(), evolution.settings.arena().settings(),
         run.settings.fresh_starts, [FRESH, TASKS.index(task), list(SYSTEMS).index(system), r.repeat]]
        for (task, system), evolution in evolutions.items() for r in evolution.repeats
    ]  # fmt: skip
    solved = iter(run.each(FRESH_STARTS, _try_fresh, arguments))
    found: dict[str, dict[str, tuple[int, ...]]] = {}
    for (task, system), evolution in evolutions.items():
        found.setdefault(task, {})[system] = tuple(next(solved) for _ in evolution.repeats)
    return found


def _network(text: str) -> Network:
    return Network.from_json(text.encode(), "unit: network")


def _try_fresh(seed: int, network: str, arena: Mapping[str, Any], starts: int, stream: Sequence[int]) -> int:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(stream)))
    keys = [draw_trial_key(rng) for _ in range(starts)]
    return int(run_starts(_network(network), Arena(**arena), keys)[1].sum())


def _activities(run: _Run, evolutions: Mapping[tuple[str, str], Evolution]) -> dict[str, tuple[Activity, ...]]:
    mixed = {task: one for (task, system), one in evolutions.items() if system == "HET"}
    arguments = [
        [Network.load(r.network).to_json(), one.settings.arena().settings()]
        for one in mixed.values() for r in one.repeats
    ]  # fmt: skip
    found = iter(run.each(ACTIVITY, _record, arguments))
    return {task: tuple(Activity.from_dict(next(found)) for _ in one.repeats) for task, one in mixed.items()}


def _record(text: str, arena: Mapping[str, Any]) -> dict[str, Any]:
    network = _network(text)
    return record_activity(network, Arena(**arena), int(network.provenance["trial_key"])).to_dict()
