"""`ohmloom fmu`: models written as FMUs, and FMUs of any tool checked and run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ohmloom._terminal import check_folder, check_targets, say
from ohmloom.errors import ParameterError, shown
from ohmloom.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from ohmloom.circuits import Netlist
    from ohmloom.fmu import Export
    from ohmloom.fmu._compile import Platforms
    from ohmloom.fmu.description import FmiVersion

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="FMUs: export models, check and run any FMU.")

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="FMU (*.fmu), or a system (*.ssp).")]
OutOption = Annotated[Path, typer.Option(help="FILE.fmu; of a system also FILE.ssp.")]
FmiOption = Annotated[Literal["2", "3"], typer.Option("--fmi", help="Version of FMI: 2.0 or 3.0.")]
PlatformsOption = Annotated[
    Literal["host", "all"],
    typer.Option(help="For this machine, or for linux, windows and darwin; all needs the extra 'fmu'."),
]
StartOption = Annotated[
    list[str] | None,
    typer.Option(
        "--start-values",
        metavar="NAME VALUE",
        help="Of parameters and inputs, in their own units: NAME=VALUE, repeated, or NAME VALUE ... as in FMPy.",
    ),
]
TimeoutOption = Annotated[float, typer.Option(min=0.001, metavar="S", help="Longest time of a process.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


Kind = Literal["device", "crossbar", "controller", "hardware-controller", "arena", "system"]


@app.command("export")
def fmu_export(
    kind: Annotated[
        Kind, typer.Argument(metavar="KIND", help="device, crossbar, controller, hardware-controller, arena or system.")
    ],
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="[CARD|FILE|NET]",
            help="device: a shipped card or a TOML file; crossbar: a *.netlist.json, or a *.net.json with --hardware; "
            "controllers and systems: a *.net.json.",
        ),
    ] = None,
    *,
    out: OutOption,
    fmi: FmiOption = "2",
    platforms: PlatformsOption = "host",
    q0: Annotated[
        str | None, typer.Option(metavar="C", help="device: charge at the start. Default: where W = 0.5.")
    ] = None,
    hardware: Annotated[
        str | None,
        typer.Option(
            metavar="HW", help="crossbar of a NET, hardware-controller, system: a shipped spec or a TOML file."
        ),
    ] = None,
    tile: Annotated[
        str | None, typer.Option(metavar="NAME", help="crossbar of a NET: number or kind of the tile, if several.")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="hardware-controller, system: seed of a sampled die. Default: the nominal one."),
    ] = None,
    task: Annotated[Literal["static", "dynamic"], typer.Option(help="arena, system: the task.")] = "static",
    trial_key: Annotated[int, typer.Option(metavar="N", help="arena, system: key of the random numbers.")] = 0,
    arrays: Annotated[
        bool, typer.Option("--arrays", help="FMI 3.0, all but device and system: lines, charges, sensors as arrays.")
    ] = False,
    json_: JsonOption = False,
) -> None:
    """Write an FMU, or for a system an SSP file: a memristor, a circuit, a controller, its arena, or both as a loop."""
    if kind == "arena":
        if source is not None:
            raise ParameterError(f"fmu export arena: expected no file, got {shown(source)}. Leave it out.")
    elif source is None:
        wanted = {"device": "CARD", "crossbar": "FILE.netlist.json"}.get(kind, "NET")
        raise ParameterError(f"fmu export {kind}: expected a {wanted}, got none. Name it.")
    is_built = kind == "hardware-controller" or (kind == "crossbar" and not (source or "").endswith(".netlist.json"))
    if (hardware is not None) != is_built and kind != "system":
        got = "none" if hardware is None else hardware
        raise ParameterError(f"--hardware: expected one for hardware or a tile of a NET alone, got {got}. "
                             "Correct it.")  # fmt: skip
    if q0 is not None and kind != "device":
        raise ParameterError(f"--q0: expected a device, got {kind}. Leave it out.")
    if arrays and kind in ("device", "system"):
        raise ParameterError(f"--arrays: expected a crossbar, a controller or an arena, got {kind}. Leave it out.")
    _check_out(out, Path(source or ""))
    version: FmiVersion = 2 if fmi == "2" else 3
    written = _write(kind, source or "", out, version, platforms, q0, task, trial_key, hardware, tile, seed, arrays)
    if json_:
        print(json.dumps({"file": str(written.path), "platforms": written.platforms, "token": written.token,
                          "size": written.size}, indent=1))  # fmt: skip
        return
    inside = ", ".join(written.platforms) or "no library: no C compiler was found, the sources are inside"
    print(f"{written.path} ({written.size / 1000:.1f} kB; {inside})")


def _write(
    kind: Kind,
    source: str,
    out: Path,
    fmi: FmiVersion,
    platforms: Platforms,
    q0: str | None,
    task: str,
    key: int,
    hardware: str | None,
    tile: str | None,
    seed: int | None,
    arrays: bool,
) -> Export:
    if kind == "device":
        from ohmloom.devices import Device
        from ohmloom.fmu import export_device

        charge = None if q0 is None else parse_quantity(q0, "C", where="--q0")
        return export_device(Device.load(source), out, fmi=fmi, platforms=platforms, q0=charge)
    if kind == "crossbar":
        from ohmloom.fmu import export_crossbar

        return export_crossbar(_circuit(source, hardware, tile), out, fmi=fmi, platforms=platforms, arrays=arrays)
    if kind == "arena":
        from ohmloom.fmu import export_arena

        return export_arena(task, out, fmi=fmi, platforms=platforms, trial_key=key, arrays=arrays)
    from ohmloom.fmu import export_controller, export_system
    from ohmloom.neurocontroller import Network

    network = Network.load(source)
    if hardware is not None:
        from ohmloom.fmu import export_hardware_controller
        from ohmloom.mapping import Hardware, place

        plan = place(network, Hardware.load(hardware))
        die = plan.nominal() if seed is None else plan.sample(seed=seed)
        if kind == "system":
            return export_system(die, out, fmi=fmi, platforms=platforms, task=task, trial_key=key)
        return export_hardware_controller(die, out, fmi=fmi, platforms=platforms, arrays=arrays)
    if kind == "controller":
        return export_controller(network, out, fmi=fmi, platforms=platforms, arrays=arrays)
    return export_system(network, out, fmi=fmi, platforms=platforms, task=task, trial_key=key)


def _circuit(source: str, hardware: str | None, tile: str | None) -> Netlist:
    if hardware is None:
        from ohmloom.circuits import Netlist

        return Netlist.load(source)
    from ohmloom.fmu.crossbar import choose_tile, tile_circuit
    from ohmloom.mapping import Hardware, place
    from ohmloom.neurocontroller import Network

    plan = place(Network.load(source), Hardware.load(hardware))
    return tile_circuit(plan, choose_tile(plan, tile))


@app.command("check")
def fmu_check(
    file: FileArgument,
    start_values: StartOption = None,
    timeout: TimeoutOption = 60.0,
    json_: JsonOption = False,
) -> int:
    """Validate, load and run an FMU, or a system, in every client that is installed; exit 1 if anything failed."""
    from ohmloom.fmu import check

    found = check(file, start_values=_pairs(start_values), timeout=timeout)
    if json_:
        print(json.dumps(found.to_dict(), indent=1))
    else:
        standard = f"FMI {found.fmi}.0" if found.fmi else "SSP 1.0"
        print(f"{found.path}: {standard}, {'passed' if found.passed else 'FAILED'}")
        wide = max(len(row.what) for row in found.rows)
        for row in found.rows:
            print(f"  {row.what:{wide}}  {row.client:10}  {row.status:7}  {row.detail}")
    return 0 if found.passed else 1


@app.command("run")
def fmu_run(
    file: FileArgument,
    stop_time: Annotated[str | None, typer.Option(metavar="S", help="Default: what the FMU suggests.")] = None,
    start_values: StartOption = None,
    interface_type: Annotated[
        Literal["CoSimulation", "ModelExchange"] | None, typer.Option(help="Default: the first that the FMU has.")
    ] = None,
    step_size: Annotated[str | None, typer.Option(metavar="S", help="Of co-simulation, and between outputs.")] = None,
    output_interval: Annotated[str | None, typer.Option(metavar="S", help="Between outputs of model exchange.")] = None,
    relative_tolerance: Annotated[float | None, typer.Option(help="Of the solver, or of the FMU itself.")] = None,
    input_file: Annotated[Path | None, typer.Option(help="CSV with the columns time and inputs.")] = None,
    output_variables: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="To record; repeat it. Default: the FMU's outputs.")
    ] = None,
    timeout: TimeoutOption = 60.0,
    output_file: Annotated[Path | None, typer.Option(help="FILE.csv, all times and outputs.")] = None,
    json_: JsonOption = False,
) -> None:
    """Run an FMU in a process of its own, with the options of FMPy's 'simulate'."""
    from ohmloom.fmu import run, run_ssp

    if output_file is not None:
        check_folder(output_file.parent)
        check_targets([output_file], [path for path in (file, input_file) if path is not None])
    if file.suffix == ".ssp":
        others = {"--interface-type": interface_type, "--output-interval": output_interval,
                  "--relative-tolerance": relative_tolerance, "--input-file": input_file,
                  "--output-variables": output_variables}  # fmt: skip
        given = [name for name, value in others.items() if value is not None]
        if given:
            raise ParameterError(f"{given[0]}: expected an FMU, got the system {file}. Leave it out.")
        trace = run_ssp(file, stop_time=_seconds(stop_time, "--stop-time"), timeout=timeout,
                        step_size=_seconds(step_size, "--step-size"), start_values=_pairs(start_values))  # fmt: skip
    else:
        trace = run(
            file, stop_time=_seconds(stop_time, "--stop-time"), step_size=_seconds(step_size, "--step-size"),
            output_interval=_seconds(output_interval, "--output-interval"), start_values=_pairs(start_values),
            interface=interface_type, tolerance=relative_tolerance, outputs=output_variables, timeout=timeout,
            inputs=None if input_file is None else _columns(input_file),
        )  # fmt: skip
    if output_file is not None:
        trace.write_csv(output_file)
    ends = {
        name: {"min": float(x.min()), "max": float(x.max()), "end": float(x[-1])} for name, x in trace.values.items()
    }
    files = [] if output_file is None else [str(output_file)]
    if json_:
        print(json.dumps({"file": str(file), "points": trace.t.size, "t_end": float(trace.t[-1]), "values": ends,
                          "files": files}, indent=1))  # fmt: skip
        return
    print(f"{file}: {trace.t.size} points to {format_quantity(float(trace.t[-1]), 's')}")
    for name, end in ends.items():
        print(f"  {name} from {end['min']:.6g} to {end['max']:.6g}, at the end {end['end']:.6g}")
    for name in files:
        say(name)


def _check_out(out: Path, source: Path) -> None:
    if out.is_dir():
        raise ParameterError(f"--out: expected a file, got the folder {out}. Use another path.")
    check_folder(out.parent)
    check_targets([out], [source])


def _seconds(text: str | None, option: str) -> float | None:
    return None if text is None else parse_quantity(text, "s", where=option)


def join_start_values(words: list[str]) -> list[str]:
    """Turn FMPy's ``--start-values NAME VALUE ...`` into options of one NAME=VALUE each.

    >>> join_start_values(["run", "--start-values", "v", "0.8", "q0", "0", "hp.fmu"])
    ['run', '--start-values', 'v=0.8', '--start-values', 'q0=0', 'hp.fmu']
    """
    joined: list[str] = []
    k = 0
    while k < len(words):
        if words[k] == "--start-values" and _is_pair(words[k + 1 : k + 3]):
            k += 1
            while _is_pair(words[k : k + 2]):
                joined += ["--start-values", f"{words[k]}={words[k + 1]}"]
                k += 2
        else:
            joined.append(words[k])
            k += 1
    return joined


def _is_pair(words: list[str]) -> bool:
    if len(words) < 2 or "=" in words[0] or words[0].startswith("--"):
        return False
    try:
        float(words[1])
    except ValueError:
        return False
    return True


def _pairs(words: list[str] | None) -> dict[str, float]:
    pairs = {}
    for word in words or ():
        name, sign, text = word.partition("=")
        try:
            pairs[name] = float(text)
        except ValueError as error:
            raise ParameterError(f"--start-values: expected NAME=VALUE, got {shown(word)}. Write it so.") from error
        if not (sign and name):
            raise ParameterError(f"--start-values: expected NAME=VALUE, got {shown(word)}. Write it so.")
    return pairs


def _columns(path: Path) -> dict[str, list[float]]:
    import csv

    from ohmloom._files import read_bytes
    from ohmloom.errors import FileFormatError

    rows = list(csv.reader(read_bytes(path, "CSV").decode(errors="replace").splitlines()))
    if len(rows) < 3 or any(len(row) != len(rows[0]) for row in rows):
        raise FileFormatError(f"{path}: expected a header and at least 2 rows as long as it, got {len(rows)} lines. "
                              "Correct it.")  # fmt: skip
    try:
        return {name: [float(row[k]) for row in rows[1:]] for k, name in enumerate(rows[0])}
    except ValueError as error:
        raise FileFormatError(f"{path}: expected numbers, got {error}. Correct it.") from error
