"""`ohmloom device`: cards and laws, what they do, and their text for other tools; fits are in `_cli_fit`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ohmloom._cli_fit import JsonOption, device_compare, device_fit
from ohmloom._terminal import check_folder, check_targets
from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from ohmloom._arrays import FloatArray
    from ohmloom.devices import Trace

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Memristors: device cards, simulation, fits to measured sweeps."
)
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Shipped card, or a TOML file.")]
TRACE_ENDINGS = (".csv", ".npz", ".png")


@app.command("list")
def device_list(
    laws: Annotated[bool, typer.Option("--laws", help="List the laws, with units and bounds, not the cards.")] = False,
    json_: JsonOption = False,
) -> None:
    """List the shipped device cards, or the laws."""
    from ohmloom.devices import Device

    if laws:
        _list_laws(json_=json_)
        return
    devices = [Device.load(name) for name in Device.names()]
    if json_:
        _print_json([{"name": d.name, "law": d.law, "parameters": d.parameters} for d in devices])
        return
    for d in devices:
        print(f"{d.name:16}{d.law:18}" + ", ".join(f"{k} = {v:g}" for k, v in d.parameters.items()))


def _list_laws(*, json_: bool) -> None:
    from ohmloom.devices import LAWS

    if json_:
        _print_json([{"name": law.name, "doc": law.doc, "parameters": [
            {"name": p.name, "unit": p.unit, "default": p.default, "lower": p.lower, "upper": p.upper,
             "scale": p.scale, "is_fitted": p.fitted, "doc": p.doc} for p in law.parameters
        ]} for law in LAWS.values()])  # fmt: skip
        return
    for law in LAWS.values():
        print(f"{law.name}: {law.doc}")
        for p in law.parameters:
            held = "" if p.fitted else " (held in a fit unless --free)"
            unit = "" if p.unit == "1" else p.unit
            bounds = f"{p.lower:g} to {p.upper:g}"
            print(f"  {p.name:12}{unit:9}{bounds:20}default {p.default:<11g} {p.doc}{held}")


@app.command("show")
def device_show(name: NameArgument, json_: JsonOption = False) -> None:
    """Show one card: law, parameters in SI with 95 % intervals, sources, and the files it was fitted to."""
    from ohmloom.devices import LAWS, Device

    d = Device.load(name)
    parameters = {p.name: (p.unit, entry) for p, entry in zip(LAWS[d.law].parameters, d.values, strict=True)}
    if json_:
        _print_json({"name": d.name, "law": d.law, "charge_scale": d.charge_scale, "sha256": d.sha256,
                     "parameters": {k: {"value": entry.value, "unit": unit, "source": entry.source,
                                        "interval": entry.interval} for k, (unit, entry) in parameters.items()},
                     "data": [{"file": used.file, "sha256": used.sha256} for used in d.data]})  # fmt: skip
        return
    print(f"{d.name}: law {d.law}, charge scale q_d = {d.charge_scale:g} C")
    for key, (unit, entry) in parameters.items():
        interval = "" if entry.interval is None else f", 95 % [{entry.interval[0]:.4g}, {entry.interval[1]:.4g}]"
        value = f"{entry.value:g} {unit}".strip()
        print(f"  {key} = {value}{interval}  ({entry.source})")
    for used in d.data:
        print(f"  data: {used.file}, sha256 {used.sha256}")


@app.command("simulate")
def device_simulate(
    name: NameArgument,
    amplitude: Annotated[str, typer.Option(metavar="V", help="Largest voltage.")] = "1",
    frequency: Annotated[str, typer.Option(metavar="HZ", help="Periods per second.")] = "1",
    periods: Annotated[int, typer.Option(min=1, max=10_000, help="How many.")] = 1,
    points: Annotated[int, typer.Option(min=8, max=1_000_000, help="Samples of each period.")] = 200,
    s0: Annotated[float, typer.Option(help="State at the start, 0 to 1.")] = 0.5,
    waveform: Annotated[Literal["sine", "triangle"], typer.Option(help="Shape of the voltage.")] = "sine",
    drive: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Voltage from a table with columns t in s and v in V instead.")
    ] = None,
    walls: Annotated[
        Literal["clip", "soft"], typer.Option(help="The state stops at 0 and 1, or slows down before them.")
    ] = "clip",
    out: Annotated[
        Path | None, typer.Option(help="FILE.csv (columns t, v, i, q, s), FILE.npz, or FILE.png (the loop).")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Drive a device with a voltage: area of its loop, range of its state, and the trace in a file."""
    import numpy as np

    from ohmloom.devices import Device
    from ohmloom.report.fit_output import save_trace

    if out is not None:
        _check_trace_file(out, [Path(name), *([drive] if drive else [])])
    if drive is not None:
        t, v = _read_drive(drive)
        begin = 0
    else:
        peak, rate = (parse_quantity(text, unit, where=option) for text, unit, option in (
            (amplitude, "V", "--amplitude"), (frequency, "Hz", "--frequency")))  # fmt: skip
        if rate <= 0.0:
            raise ParameterError(f"--frequency: expected a number above 0 Hz, got {rate:g} Hz. Correct it.")
        phase = np.arange(periods * points + 1) / points
        turned = np.abs((phase + 0.75) % 1.0 - 0.5)
        t, v = phase / rate, peak * (np.sin(2 * np.pi * phase) if waveform == "sine" else 4.0 * turned - 1.0)
        begin = (periods - 1) * points
    device = Device.load(name)
    trace = device.simulate(v, t, s0=s0, walls=walls)
    if out is not None:
        save_trace(trace, out)
    above, below = (_lobe_area(sign * trace.v[begin:], sign * trace.i[begin:]) for sign in (1.0, -1.0))
    if json_:
        _print_json({**json.loads(trace.provenance), "points": trace.t.size, "lobe_area": [above, below],
                     "largest_current": float(np.abs(trace.i).max()), "s_range": _range(trace),
                     "s_end": float(trace.s[-1]), "files": [] if out is None else [str(out)]})  # fmt: skip
        return
    which = "the drive" if drive is not None else "the last period"
    low, high = _range(trace)
    print(f"{device.name}: {trace.t.size} points, largest current {format_quantity(float(np.abs(trace.i).max()), 'A')}")
    print(f"  lobe areas of {which}: {format_quantity(above, 'W')} at v > 0, {format_quantity(below, 'W')} at v < 0")
    print(f"  s from {low:.4g} to {high:.4g}, at the end {trace.s[-1]:.4g}")
    if out is not None:
        print(out)


@app.command("emit")
def device_emit(
    name: NameArgument,
    to: Annotated[Literal["c", "spice", "verilog-a"], typer.Option(help="Language.")],
    out: Annotated[Path | None, typer.Option(help="FILE to write; without it: to stdout.")] = None,
) -> None:
    """Write a device as C functions, as an ngspice subcircuit, or as a Verilog-A module."""
    from ohmloom._files import write_atomic
    from ohmloom.devices import Device

    text = Device.load(name).emit(to)
    if out is None:
        print(text, end="" if text.endswith("\n") else "\n")
        return
    _check_file(out, [Path(name)])
    write_atomic(out, text if text.endswith("\n") else f"{text}\n")
    print(out)


app.command("fit")(device_fit)
app.command("compare")(device_compare)


def _read_drive(path: Path) -> tuple[FloatArray, FloatArray]:
    from ohmloom.devices._read_csv import read_table

    table = read_table(path)
    for column in ("t", "v"):
        if column not in table.names:
            raise UnknownNameError.of(f"{path}: column", column, table.names)
    t, v = table.columns(["t", "v"], 0, len(table.body))
    return t, v


def _check_trace_file(out: Path, inputs: list[Path]) -> None:
    if out.suffix not in TRACE_ENDINGS:
        raise ParameterError(f"--out: expected a file that ends in {', '.join(TRACE_ENDINGS)}, got {out}. Rename it.")
    _check_file(out, inputs)


def _check_file(out: Path, inputs: list[Path]) -> None:
    if out.is_dir():
        raise ParameterError(f"--out: expected a file, got the folder {out}. Use another path.")
    check_folder(out.parent)
    check_targets([out], inputs)


def _lobe_area(v: FloatArray, i: FloatArray) -> float:
    """Area in W that the loop encloses at v > 0; a lobe is closed where the voltage is 0."""
    import numpy as np

    above = np.maximum(v, 0.0)
    return abs(float(np.sum(0.5 * (i[1:] + i[:-1]) * np.diff(above))))


def _range(trace: Trace) -> list[float]:
    return [float(trace.s.min()), float(trace.s.max())]


def _print_json(table: Any) -> None:
    print(json.dumps(table, indent=1))
