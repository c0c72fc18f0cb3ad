"""The verb `map`: a network placed on hardware, with everything that is needed to build and drive it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ohmloom._terminal import check_folder, check_targets

HardwareHelp = (
    "Shipped spec (het_mixed, hp_1t1r, hp_passive, hp_strukov, ideal, peo_pani, peo_pani_redox) or a TOML file."
)


def map_network(
    net: Annotated[Path, typer.Argument(metavar="NET", help="Network file (*.net.json).")],
    hardware: Annotated[str, typer.Option(help=HardwareHelp)],
    out: Annotated[Path, typer.Option(help="Folder for plan, tables, netlists, SPICE decks and pictures.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the sampled yield, where the spec has faults.")] = 0,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Place a network on crossbars: which synapse on which device, pulses, reset, cost, netlists and pictures."""
    from ohmloom.mapping import Hardware, place
    from ohmloom.neurocontroller import Network
    from ohmloom.report.map_output import map_files, map_words, save_map, study_map

    plan = place(Network.load(net), Hardware.load(hardware))
    check_folder(out)
    check_targets([out / name for name in map_files(plan)], [net, Path(hardware)])
    study = study_map(plan, seed=seed)
    paths = save_map(study, out)
    assumed = plan.hardware.assumptions()
    if json_:
        table = {"plan": str(paths[0]), "files": [str(path) for path in paths], "seed": seed}
        print(json.dumps({**table, **study.to_dict(), "assumed": assumed}, indent=1))
        return
    for line in map_words(study):
        print(line)
    if study.yields:
        print(f"seed {seed}")
    for line in assumed:
        print(f"assumed: {line}")
    for path in paths:
        print(path)
