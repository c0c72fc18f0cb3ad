"""The verb `check`: discrete against continuous."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ohmloom._cli_map import HardwareHelp
from ohmloom._terminal import check_folder, check_targets, say, study_folders

if TYPE_CHECKING:
    from ohmloom.sim.check import Check


def check_network(
    nets: Annotated[list[Path], typer.Argument(metavar="NET...", help="Network files (*.net.json).")],
    hardware: Annotated[list[str], typer.Option(help=HardwareHelp + " May be repeated.")],
    perturb: Annotated[
        float, typer.Option(help="Relative error of every emulated event's charge; anything but 0 must fail.")
    ] = 0.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Draws the trial's start and noise.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for check.json and divergence.png.")] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Is the emulation exact where it must be, and what would this hardware's drive do? Exit code 0 if exact, else
    1."""
    from ohmloom.mapping import Hardware, place
    from ohmloom.neurocontroller import Network
    from ohmloom.report.output import CHECK_FILES, save_check
    from ohmloom.sim import check

    pairs = [(Network.load(net), Hardware.load(name)) for net in nets for name in hardware]
    for network, spec in pairs:
        place(network, spec)
    folders = study_folders(out, nets, hardware)
    for folder in folders:
        check_folder(folder)
        check_targets([folder / name for name in CHECK_FILES], [*nets, *map(Path, hardware)])
    found = []
    for k, (network, spec) in enumerate(pairs):
        say(f"{network.name} on {spec.name}, seed {seed} (compiling at the first run)")
        one = check(network, spec, seed=seed, perturb=perturb, progress=lambda name: say(f"  {name}"))
        found.append(one)
        if folders:
            for path in save_check(one, folders[k]):
                say(f"wrote {path}")
        if not json_:
            _print_check(one)
    if json_:
        tables = [one.to_dict() for one in found]
        print(json.dumps(tables[0] if len(tables) == 1 else {"pairs": tables}, indent=1))
    raise typer.Exit(0 if all(one.passes for one in found) else 1)


def _print_check(one: Check) -> None:
    names = one.provenance
    print(f"{names['network']} on {names['hardware']}: {'exact' if one.passes else 'NOT EXACT'}")
    for name, holds in one.exact.items():
        ties = one.ties.get(name, 0)
        print(f"  {name:20}{'holds' if holds else 'DOES NOT HOLD'}{f', {ties} ties' if ties else ''}")
    for name, reason in one.not_applicable.items():
        print(f"  {name:20}not claimed: {reason}")
    print("what each way of writing events does, beside the paper's discrete rule, over one trial on the same sensors:")
    for name, scheme in one.schemes.items():
        rms = ", ".join(f"{kind} {value:.3g}" for kind, value in scheme.worst_rms.items()) or "no synapse"
        first = scheme.first_divergence
        since = "spikes never differ" if first is None else f"spikes differ from timestep {first['timestep']}"
        loop = scheme.closed_loop
        ends = ", ".join(f"{who} {'reaches' if loop[who]['solved'] else 'misses'} the goal ({loop[who]['timesteps']})"
                         for who in ("ideal", "hardware"))  # fmt: skip
        print(f"  {name}")
        print(f"    worst rms of W: {rms}; {since}")
        print(f"    equal spikes {scheme.spike_agreement:.2%}, equal actions {scheme.action_agreement:.2%}; "
              f"{scheme.lost:,} lost and {scheme.spurious:,} spurious events beside {scheme.events:,} "
              "written")  # fmt: skip
        print(f"    on its own: {ends}, equal actions {loop['action_agreement']:.2%}")
