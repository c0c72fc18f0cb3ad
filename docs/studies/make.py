"""Studies every champion on every shipped spec, and writes the page that ranks them. Run from the repository's root.

    python docs/studies/make.py [--dies N] [--workers N]

Every study is made again; one that was stopped goes on where it was, in runs/studies.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
from pathlib import Path
from typing import Any

from ohmloom._files import write_atomic
from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import Network
from ohmloom.report.page import report_page
from ohmloom.sim import Feasibility, feasibility
from ohmloom.sim.comparison import not_built, rank_studies, why_not_built

HERE = Path(__file__).parent
CHAMPIONS = ("HP", "PEO", "LIN", "GA", "HET")
PAGE = """# Studies of the champions

Each shipped champion on each shipped hardware spec, best first: by verdict, by success on hardware, by how many figures
fail. A pair without a card for one of its kinds cannot be built. One command made this page and all that it links to:

```sh
{command}
```

{dies} Each link leads to the report that `ohmloom evaluate` writes, which says how to make it again, and each report
has its numbers in the JSON file beside it. What a success on so many dies is worth is told by its interval there.

| rank | network | hardware | verdict | goal reached on hardware | ideal | first reason | files |
|---|---|---|---|---|---|---|---|
{rows}
"""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--dies", type=int, help="of each pair; as many as `ohmloom evaluate` would choose by default")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    asked = parser.parse_args()
    specs = [Hardware.load(name) for name in Hardware.names()]
    found: list[Feasibility | dict[str, Any]] = []
    for name in CHAMPIONS:
        network = Network.load(net_file(name))
        for spec in specs:
            reason = why_not_built(network, spec)
            if reason is not None:
                found.append(not_built(network, spec, reason))
                continue
            found.append(make(name, network, spec, asked))
    write_page(found, asked.dies)


def net_file(name: str) -> str:
    return f"examples/champions/{name}.net.json"


def path(name: str, spec: Hardware, ending: str) -> Path:
    return HERE / f"{name}_{spec.name}.{ending}"


def make(name: str, network: Network, spec: Hardware, asked: argparse.Namespace) -> Feasibility:
    out = Path("runs/studies") / f"{name}_{spec.name}{'' if asked.dies is None else f'_{asked.dies}'}"
    study = feasibility(network, spec, dies=asked.dies, out=out, workers=asked.workers)
    words = ["ohmloom", "evaluate", net_file(name), "--hardware", spec.name, *dies_option(asked.dies), "--seed", "0"]
    study.save(path(name, spec, "json"))
    write_atomic(path(name, spec, "html"), report_page(study, command=shlex.join(words)))
    print(f"{name} on {spec.name}: {study.verdict}", flush=True)
    return study


def dies_option(dies: int | None) -> list[str]:
    return [] if dies is None else ["--dies", str(dies)]


def write_page(found: list[Feasibility | dict[str, Any]], dies: int | None) -> None:
    rows = "\n".join(row(one) for one in rank_studies(found))
    command = shlex.join(["python", "docs/studies/make.py", *dies_option(dies)])
    many = "As many dies of each as `ohmloom evaluate` chooses by default" if dies is None else f"{dies} dies of each"
    text = PAGE.format(command=command, dies=f"{many}, each from a start of its own, seed 0.", rows=rows)
    write_atomic(HERE / "index.md", text)


def row(one: dict[str, Any]) -> str:
    if one["rank"] is None:
        return f"| | {one['network']} | `{one['hardware']}` | *cannot be built: {one['reason']}* | | | | |"
    stem = f"{one['network']}_{one['hardware']}"
    numbers = json.loads((HERE / f"{stem}.json").read_text(encoding="utf-8"))
    success = numbers["success"]
    reached = ("not sampled", "")
    if success is not None:
        reached = (f"{one['success']:.0%} of {success['n']}", f"{one['ideal']:.0%}")
    reason = one["reason"].replace("|", "/") or "–"
    files = f"[report]({stem}.html), [numbers]({stem}.json)"
    cells = [one["rank"], one["network"], f"`{one['hardware']}`", one["verdict"], *reached, reason, files]
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
