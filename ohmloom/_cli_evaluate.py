"""The verb `evaluate`: studies of networks on hardware, and how they compare."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ohmloom._cli_map import HardwareHelp
from ohmloom._files import write_atomic
from ohmloom._terminal import bars, check_folder, check_targets, cores, say, study_folders

if TYPE_CHECKING:
    from ohmloom.mapping import Hardware
    from ohmloom.neurocontroller import Network
    from ohmloom.sim import Feasibility
    from ohmloom.sim.work import Shard

COMPARISON = "comparison.json"
FEW_DIES = 4  # are tried sooner than processes have started
WorkersOption = Annotated[
    int | None,
    typer.Option(min=1, help="Processes; they do not change the result. [default: the cores, 1 for up to 4 dies]"),
]
EngineOption = Annotated[
    Literal["processes", "dask"], typer.Option(help="Processes of this machine, or a dask cluster (extra: cluster).")
]
AddressOption = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="The dask scheduler. Without it: a cluster of this machine.")
]


def evaluate_networks(
    nets: Annotated[list[Path], typer.Argument(metavar="NET...", help="Network files (*.net.json).")],
    hardware: Annotated[list[str], typer.Option(help=HardwareHelp + " May be repeated.")],
    dies: Annotated[
        int | None,
        typer.Option(
            min=0, help="Sampled pieces of hardware; 0: only what needs none. [default: 200, fewer with wires]"
        ),
    ] = None,
    starts: Annotated[int, typer.Option(min=1, help="Starts of each die.")] = 1,
    study: Annotated[
        Literal["default", "full"], typer.Option(help="full adds corners, sensitivity, requirements, lifetime.")
    ] = "default",
    workers: WorkersOption = None,
    engine: EngineOption = "processes",
    address: AddressOption = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Every random number follows from it.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for report.html and report.json; the same command resumes it.")
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Would this network work on this hardware, and why (not)? Exit code 0 for PASS, else 1."""
    from ohmloom.mapping import Hardware, place
    from ohmloom.neurocontroller import Network
    from ohmloom.report.output import STUDY_FILES
    from ohmloom.sim.comparison import not_built, rank_studies, why_not_built

    pairs = [(net, name, Network.load(net), Hardware.load(name)) for net in nets for name in hardware]
    refused = [why_not_built(network, spec) for _, _, network, spec in pairs]
    if None not in refused:
        place(pairs[0][2], pairs[0][3])  # refuses with the whole reason
    folders = study_folders(out, nets, hardware)
    for folder in folders:
        check_folder(folder)
        check_targets([folder / name for name in STUDY_FILES], [*nets, *map(Path, hardware)])
    if len(pairs) > 1 and out is not None:
        check_targets([out / COMPARISON], [*nets, *map(Path, hardware)])
    found: list[Feasibility | Mapping[str, Any]] = []
    for k, (net, name, network, spec) in enumerate(pairs):
        reason = refused[k]
        if reason is not None:
            found.append(not_built(network, spec, reason))
            say(f"{network.name} on {spec.name} cannot be built: {reason}")
            continue
        one = run_study(
            network, spec, dies=dies, seed=seed, starts=starts, study=study,
            workers=workers, engine=engine, address=address, out=folders[k] if folders else None,
        )  # fmt: skip
        found.append(one)
        words = ["ohmloom", "evaluate", str(net), "--hardware", name, "--dies", str(one.provenance["dies"])]
        words += ["--seed", str(seed)]
        words += ["--starts", str(starts)] if starts > 1 else []
        words += ["--study", study] if study != "default" else []
        if folders:
            _save(one, folders[k], shlex.join(words))
        if not json_:
            _print_study(one)
    ranked = rank_studies(found)
    tables = [one if isinstance(one, Mapping) else one.to_dict() for one in found]
    if len(pairs) > 1 and out is not None:
        write_atomic(out / COMPARISON, json.dumps(ranked, indent=1) + "\n")
        say(f"wrote {out / COMPARISON}")
    if json_:
        print(json.dumps(tables[0] if len(pairs) == 1 else {"pairs": tables, "comparison": ranked}, indent=1))
    elif len(pairs) > 1:
        _print_comparison(ranked)
    raise typer.Exit(0 if all(table["verdict"] == "PASS" for table in tables) else 1)


def run_study(
    network: Network,
    spec: Hardware,
    *,
    dies: int | None,
    seed: int,
    starts: int,
    study: Literal["default", "full"],
    workers: int | None,
    engine: str,
    address: str | None,
    out: Path | None,
    shard: Shard | None = None,
) -> Feasibility:
    """A study with its progress on stderr; where nothing else is said, on as many processes as are worth it."""
    from ohmloom.sim import feasibility

    more = f", {starts} starts each" if starts > 1 else ""
    number = "" if dies is None else f", {dies} dies"
    say(f"{network.name} on {spec.name}{number}{more}, seed {seed} (compiling at the first run)")
    names = {0: "dies", 1: "sensitivity", 2: "corners"} if study == "full" else {0: "dies"}
    keys = {name: key for key, name in names.items()}
    few = study == "default" and dies is not None and dies <= FEW_DIES and engine == "processes"
    count = workers or (1 if few else cores())
    with bars(names, dies or 0) as update:
        return feasibility(
            network, spec, dies=dies, seed=seed, starts=starts, study=study, workers=count, engine=engine,
            address=address, out=out, shard=shard, progress=lambda done, whole: update(0, done, "", whole),
            stage=lambda name, done, whole: update(keys[name], done, "", whole),
        )  # fmt: skip


def _save(study: Feasibility, folder: Path, command: str) -> None:
    from ohmloom.report.output import save_study

    save_study(study, folder, command=command)
    say(f"wrote {folder / 'report.html'} and {folder / 'report.json'}")


def _print_study(study: Feasibility) -> None:
    from ohmloom.units import format_quantity

    names = study.provenance
    print(f"{names['network']} on {names['hardware']}: {study.verdict}")
    for reason in study.reasons:
        print(f"  - {reason}")
    for figure in study.figures:
        value = "-" if figure.value is None else format_quantity(figure.value, figure.unit)
        limit = "-" if figure.limit is None else format_quantity(figure.limit, figure.unit)
        margin = "-" if figure.margin is None else f"{figure.margin:+.3g}"
        print(f"  {figure.name:22}{value:>16}  limit {limit:>14}  margin {margin:>10}  {figure.status}")
    if study.success is not None:
        s = study.success
        where = f"{s.n} starts" if s.dies == s.n else f"{s.n} starts of {s.dies} dies"
        print(f"  goal reached from {s.hardware:.1%} of {where} on hardware, {s.ideal:.1%} ideal")
    for row in study.requirements:
        print(f"  {row['sentence']}")
    for corner in study.corners:
        reached = "" if corner["success"] is None else f", goal reached from {corner['success']['hardware']:.1%}"
        print(f"  corner {corner['name']}: {corner['verdict']}{reached}")
    held = ", ".join(f"{name} {'holds' if holds else 'DOES NOT HOLD'}" for name, holds in study.exactness.items())
    print(f"  exactness: {held}")


def _print_comparison(ranked: list[dict[str, Any]]) -> None:
    nets = max(len(row["network"]) for row in ranked)
    specs = max(len(row["hardware"]) for row in ranked)
    for row in ranked:
        rank = "-" if row["rank"] is None else row["rank"]
        line = f"{rank:>3}  {row['network']:{nets}}  {row['hardware']:{specs}}  "
        if row["rank"] is None:
            print(f"{line}cannot be built: {row['reason']}")
            continue
        reached = "not sampled" if row["success"] is None else f"{row['success']:.1%} of {row['ideal']:.1%} ideal"
        print(f"{line}{row['verdict']:9}{reached:>22}  {', '.join(row['failing']) or '-'}")
