"""`ohmloom fmu`: models written as FMUs, and FMUs of any tool checked and run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from ohmloom._terminal import check_folder, check_targets, say
from ohmloom.errors import ParameterError, shown
from ohmloom.units import format_quantity, parse_quantity

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="FMUs: export models, check and run any FMU.")

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="FMU (*.fmu).")]
OutOption = Annotated[Path, typer.Option(help="FILE.fmu, the FMU.")]
FmiOption = Annotated[Literal["2", "3"], typer.Option("--fmi", help="Version of FMI: 2.0 or 3.0.")]
PlatformsOption = Annotated[
    Literal["host", "all"],
    typer.Option(help="For this machine, or for linux, windows and darwin; all needs the extra 'fmu'."),
]
StartOption = Annotated[
    list[str] | None,
    typer.Option(
        "--start-values", metavar="NAME=VALUE", help="Of a parameter or an input, in its own unit; repeat it."
    ),
]
TimeoutOption = Annotated[float, typer.Option(min=0.001, metavar="S", help="Longest time of a process.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


@app.command("export")
def fmu_export(
    kind: Annotated[Literal["device"], typer.Argument(metavar="device", help="What to export.")],
    card: Annotated[
        str, typer.Argument(metavar="CARD", help="Shipped card or a TOML file; see 'ohmloom device list'.")
    ],
    out: OutOption,
    fmi: FmiOption = "2",
    platforms: PlatformsOption = "host",
    q0: Annotated[str | None, typer.Option(metavar="C", help="Charge at the start. Default: where W = 0.5.")] = None,
    json_: JsonOption = False,
) -> None:
    """Write a memristor as an FMU: v in; i, q, memristance and weight out; the card's parameters tunable."""
    from ohmloom.devices import Device
    from ohmloom.fmu import export_device

    _check_out(out, Path(card))
    charge = None if q0 is None else parse_quantity(q0, "C", where="--q0")
    written = export_device(Device.load(card), out, fmi=2 if fmi == "2" else 3, platforms=platforms, q0=charge)
    if json_:
        print(json.dumps({"file": str(written.path), "platforms": written.platforms, "token": written.token,
                          "size": written.size}, indent=1))  # fmt: skip
        return
    inside = ", ".join(written.platforms) or "no library: no C compiler was found, the sources are inside"
    print(f"{written.path} ({written.size / 1000:.1f} kB; {inside})")


@app.command("check")
def fmu_check(
    file: FileArgument,
    start_values: StartOption = None,
    timeout: TimeoutOption = 60.0,
    json_: JsonOption = False,
) -> int:
    """Validate, load and run an FMU in every client that is installed; exit 1 if anything failed."""
    from ohmloom.fmu import check

    found = check(file, start_values=_pairs(start_values), timeout=timeout)
    if json_:
        print(json.dumps(found.to_dict(), indent=1))
    else:
        print(f"{found.path}: FMI {found.fmi}.0, {'passed' if found.passed else 'FAILED'}")
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
    from ohmloom.fmu import run

    if output_file is not None:
        check_folder(output_file.parent)
        check_targets([output_file], [path for path in (file, input_file) if path is not None])
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
