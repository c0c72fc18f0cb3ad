"""The verbs `work`, `status` and `watch`: run folders that several machines share."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from ohmloom._cli_evaluate import AddressOption, EngineOption, WorkersOption, run_study
from ohmloom._terminal import say

RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder of an evolution, of a study or of the paper's runs.")
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
    """Do what is left to do in a study's folder, its share first; the command that began it then writes the report."""
    from ohmloom.errors import ParameterError
    from ohmloom.sim.study_files import read_run, read_study
    from ohmloom.sim.work import Shard

    part = Shard.parse(shard)
    if read_run(run)["command"] != "evaluate":
        raise ParameterError(f"{run}: expected the folder of a study, got that of an evolution. Resume it with the "
                             "command that began it.")  # fmt: skip
    plan, asked = read_study(run)
    run_study(
        plan.network, plan.hardware, dies=asked.dies, seed=asked.seed, starts=asked.starts, study=asked.study,
        workers=workers, engine=engine, address=address, out=run, shard=part,
    )  # fmt: skip
    say(f"{run}: all units are done. 'ohmloom evaluate' with the options that began it now writes the report at once.")


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
    if table["command"] in LAST_FILE:
        found = batches(run)
        parts = [{"name": one.name, "done": one.done, "units": one.units, "failed": [str(path) for path in one.failed]}
                 for one in found]  # fmt: skip
        finished = (run / LAST_FILE[table["command"]]).exists()
        return {"command": table["command"], "parts": parts, "finished": finished}
    repeats = table.get("settings", {}).get("repeats", 0)
    done = len(list((run / "networks").glob("*.net.json")))
    parts = [{"name": "repeats", "done": done, "units": repeats, "failed": []}]
    return {"command": table["command"], "parts": parts, "finished": done == repeats}


def _lines(table: dict[str, Any]) -> list[str]:
    lines = [f"{part['name']}: {part['done']} of {part['units']}" for part in table["parts"]]
    lines += [f"failed: {path}" for part in table["parts"] for path in part["failed"]]
    return [*lines, "finished" if table["finished"] else "not finished"]
