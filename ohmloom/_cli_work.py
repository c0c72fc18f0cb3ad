"""The verbs `work`, `status` and `watch`: run folders that several machines share."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from ohmloom._cli_evaluate import AddressOption, EngineOption, WorkersOption, run_study
from ohmloom._cli_paper import work_on_paper
from ohmloom._terminal import say

RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder of an evolution, a study or the paper's runs.")
]
LOOK_EVERY = 2.0  # s
LAST_FILE = {"evaluate": "report.json", "paper": "paper.html"}  # that a command writes when all its units are done


def work_on_run(
    run: RunArgument,
    shard: Annotated[str, typer.Option(metavar="I/N", help="The I-th of N drivers that share the folder.")] = "1/1",
    workers: WorkersOption = None,
    engine: EngineOption = "processes",
    address: AddressOption = None,
) -> None:
    """Do what is left to do in a run folder, its share first; the command that began it then writes the report."""
    from ohmloom.errors import ParameterError
    from ohmloom.sim.study_files import read_run, read_study
    from ohmloom.sim.work import Shard

    part = Shard.parse(shard)
    table = read_run(run)
    if table["command"] == "evolve":
        raise ParameterError(f"{run}: expected the folder of a study or of the paper's runs, got that of an evolution. "
                             "Resume it with the command that began it.")  # fmt: skip
    if table["command"] == "paper":
        work_on_paper(run, table["settings"], workers=workers, engine=engine, address=address, shard=part)
    else:
        plan, asked = read_study(run)
        run_study(
            plan.network, plan.hardware, dies=asked.dies, seed=asked.seed, starts=asked.starts, study=asked.study,
            workers=workers, engine=engine, address=address, out=run, shard=part,
        )  # fmt: skip
    verb = f"ohmloom {table['command']}"
    say(f"{run}: all units are done. '{verb}' with the options that began it now writes the report at once.")


def show_status(
    run: RunArgument, json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead.")] = False
) -> None:
    """How much of a run is done, and what failed."""
    table = _status(run)
    print(json.dumps(table, indent=1) if json_ else "\n".join(_lines(table)))


def watch_run(run: RunArgument) -> None:
    """The status again whenever it changes, until the run is finished or Ctrl-C."""
    shown: list[str] = []
    while True:
        table = _status(run)
        lines = _lines(table)
        for line in lines:
            if line not in shown:
                print(line, flush=True)
        shown = lines
        if table["finished"]:
            return
        time.sleep(LOOK_EVERY)


def _status(run: Path) -> dict[str, Any]:
    from ohmloom.sim.study_files import batches, read_run

    table = read_run(run)
    command = table["command"]
    if command == "evolve":
        parts = [_repeats(run, table)]
        return {"command": command, "parts": parts, "finished": parts[0]["done"] == parts[0]["units"]}
    evolutions = [path.parent for path in sorted(run.glob("runs/*/run.json"))]
    parts = [{"name": one.name, "done": one.done, "units": one.units, "failed": [str(path) for path in one.failed]}
             for one in batches(run)]  # fmt: skip
    parts += [_repeats(folder, read_run(folder)) for folder in evolutions]
    return {"command": command, "parts": parts, "finished": (run / LAST_FILE[command]).exists()}


def _repeats(run: Path, table: dict[str, Any]) -> dict[str, Any]:
    done = len(list((run / "networks").glob("*.net.json")))
    return {"name": f"{run.name}: repeats", "done": done, "units": table["settings"]["repeats"], "failed": []}


def _lines(table: dict[str, Any]) -> list[str]:
    lines = [f"{part['name']}: {part['done']} of {part['units']}" for part in table["parts"]]
    lines += [f"failed: {path}" for part in table["parts"] for path in part["failed"]]
    return [*lines, "finished" if table["finished"] else "not finished"]
