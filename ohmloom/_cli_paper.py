"""The verb `paper`: the paper's experiments, and what of it reproduces."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ohmloom._cli_evaluate import AddressOption, EngineOption
from ohmloom._terminal import bars, cores, say

if TYPE_CHECKING:
    from ohmloom.sim.paper.experiment import Experiment, PaperSettings
    from ohmloom.sim.work import Shard

LEAST, MOST = 50, 2000  # random networks of a draft, and of the whole


def run_paper(
    out: Annotated[Path, typer.Option(help="Run folder; the same command resumes it.")],
    repeats: Annotated[int, typer.Option(min=1, help="Repeats of each evolution.")] = 30,
    generations: Annotated[int, typer.Option(min=0, help="Generations after the first.")] = 1000,
    starts: Annotated[int, typer.Option(min=1, help="Fitness is the mean over this many starts (1: the paper's).")] = 1,
    random_networks: Annotated[
        int | None,
        typer.Option(min=1, help="Per system and reading; default: 2000 for the paper's size, fewer for less."),
    ] = None,
    candidates: Annotated[
        int | None, typer.Option(min=0, help="Combinations of readings to search; default: 60, fewer for less.")
    ] = None,
    best: Annotated[
        bool | None,
        typer.Option("--best/--no-best", help="Evolve at the search's best too; default: with the paper's size."),
    ] = None,
    fresh_starts: Annotated[int, typer.Option(min=1, help="Fresh starts of each best network.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Every random number follows from it.")] = 0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; they do not change the result. [default: the cores]")
    ] = None,
    engine: EngineOption = "processes",
    address: AddressOption = None,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Run the paper's experiments; say claim by claim what reproduces (draft: --repeats 3 --generations 100)."""
    from ohmloom.report.paper_page import save_paper
    from ohmloom.sim.paper.claims import examine
    from ohmloom.sim.paper.experiment import PaperSettings
    from ohmloom.sim.paper.results import Results

    share = min(1.0, repeats * generations / 30_000)
    is_whole = share == 1.0
    settings = PaperSettings(
        repeats=repeats, generations=generations, starts=starts, seed=seed, fresh_starts=fresh_starts,
        random_networks=max(LEAST, round(MOST * share)) if random_networks is None else random_networks,
        candidates=(60 if is_whole else 10) if candidates is None else candidates,
        best=is_whole if best is None else best,
    )  # fmt: skip
    words = ["ohmloom", "paper", "--out", str(out), "--repeats", str(repeats), "--generations", str(generations)]
    words += ["--starts", str(starts)] if starts > 1 else []
    words += ["--random-networks", str(settings.random_networks), "--candidates", str(settings.candidates)]
    words += ["--best" if settings.best else "--no-best", "--fresh-starts", str(fresh_starts), "--seed", str(seed)]
    say(f"the paper: {repeats} repeats of {generations} generations, seed {seed} (compiling at the first run)")
    experiment = _run(settings, out, workers=workers, engine=engine, address=address, shard=None)
    results = Results(experiment)
    say("drawing")
    findings = examine(results)
    paths = save_paper(results, findings, out, command=shlex.join(words))
    if json_:
        claims = [vars(finding) | {"p": None if math.isnan(finding.p) else finding.p} for finding in findings]
        print(json.dumps({"out": str(out), "settings": settings.model_dump(), "claims": claims}, indent=1))
        return
    for finding in findings:
        print(f"{finding.verdict:22}  {finding.section:6}  {finding.claim}: {finding.result}")
    print(f"seed {seed}; {next(path for path in paths if path.suffix == '.html')}")


def work_on_paper(
    out: Path, settings: dict[str, Any], *, workers: int | None, engine: str, address: str | None, shard: Shard
) -> None:
    """Do what is left to do in a folder that `ohmloom paper` began."""
    from ohmloom._files import validate
    from ohmloom.sim.paper.experiment import PaperSettings

    asked = validate(PaperSettings, settings, f"{out / 'run.json'}: settings")
    _run(asked, out, workers=workers, engine=engine, address=address, shard=shard)


def _run(
    settings: PaperSettings, out: Path, *, workers: int | None, engine: str, address: str | None, shard: Shard | None
) -> Experiment:
    from ohmloom.sim.paper.experiment import run_paper, stages
    from ohmloom.sim.work import open_work

    names = dict(enumerate(stages(settings)))
    keys = {name: key for key, name in names.items()}
    with (
        open_work(workers=workers or cores(), engine=engine, address=address, shard=shard) as work,
        bars(names, 1) as update,
    ):
        return run_paper(
            settings, out=out, work=work, stage=lambda name, done, whole: update(keys[name], done, "", whole)
        )
