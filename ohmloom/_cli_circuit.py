"""`ohmloom circuit`: netlists followed through time here or by ngspice, and written as SPICE decks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ohmloom._terminal import check_folder, check_targets
from ohmloom.errors import ParameterError
from ohmloom.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from ohmloom.circuits import NetlistTrace

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Circuits: netlist files (*.netlist.json).")
FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Netlist (*.netlist.json).")]
EndOption = Annotated[str | None, typer.Option("--t-end", metavar="S", help="Duration. Default: the netlist's own.")]
StepOption = Annotated[
    str | None, typer.Option("--max-step", metavar="S", help="Longest time step; no longer than an edge of a source.")
]
ENDINGS = (".csv", ".npz", ".png")


@app.command("run")
def circuit_run(
    file: FileArgument,
    t_end: EndOption = None,
    points: Annotated[int, typer.Option(min=2, max=10_000_000, help="Evenly spaced times of the result.")] = 1001,
    engine: Annotated[Literal["ohmloom", "ngspice"], typer.Option(help="Who solves it.")] = "ohmloom",
    max_step: StepOption = None,
    timeout: Annotated[float, typer.Option(min=0.001, metavar="S", help="Longest run of ngspice.")] = 60.0,
    out: Annotated[
        Path | None, typer.Option(help="FILE.csv (columns t, v(node), i(element), ...), FILE.npz, or FILE.png.")
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Follow a netlist through time: what each node and element comes to, and the trace in a file."""
    from ohmloom.circuits import Netlist, run_ngspice

    if out is not None:
        if out.suffix not in ENDINGS:
            raise ParameterError(f"--out: expected a file that ends in {', '.join(ENDINGS)}, got {out}. Rename it.")
        _check_file(out, file)
    netlist = Netlist.load(file)
    end, step = _seconds(t_end, "--t-end"), _seconds(max_step, "--max-step")
    if end is None and netlist.t_end is None:
        raise ParameterError(f"{file}: t_end: expected a duration in s, got none. Give --t-end.")
    if engine == "ohmloom":
        trace = netlist.simulate(end, points=points, max_step=step)
    else:
        trace = _evenly(run_ngspice(netlist, t_end=end, max_step=step, timeout=timeout), points)
    if out is not None:
        _write(trace, out)
    if json_:
        _print_json(trace, engine, out)
        return
    print(f"{netlist.name}: {trace.t.size} points to {format_quantity(float(trace.t[-1]), 's')} by {engine}, "
          f"Kirchhoff's residual {trace.residual:.1e}")  # fmt: skip
    for name, v in trace.v.items():
        low, high, last = (format_quantity(float(x), "V") for x in (v.min(), v.max(), v[-1]))
        print(f"  v({name}) from {low} to {high}, at the end {last}")
    for name, s in trace.s.items():
        print(f"  s({name}) from {s.min():.4g} to {s.max():.4g}, at the end {s[-1]:.4g}")
    if out is not None:
        print(out)


@app.command("export")
def circuit_export(
    file: FileArgument,
    out: Annotated[Path, typer.Option(help="FILE.cir, the deck.")],
    t_end: EndOption = None,
    max_step: StepOption = None,
) -> None:
    """Write a netlist as a deck for ngspice, memristors as subcircuits of their cards."""
    from ohmloom.circuits import Netlist

    _check_file(out, file)
    netlist = Netlist.load(file)
    netlist.to_spice(out, t_end=_seconds(t_end, "--t-end"), max_step=_seconds(max_step, "--max-step"))
    print(out)


def _seconds(text: str | None, option: str) -> float | None:
    return None if text is None else parse_quantity(text, "s", where=option)


def _check_file(out: Path, file: Path) -> None:
    if out.is_dir():
        raise ParameterError(f"--out: expected a file, got the folder {out}. Use another path.")
    check_folder(out.parent)
    check_targets([out], [file])


def _evenly(trace: NetlistTrace, points: int) -> NetlistTrace:
    """ngspice's own times made even, by straight lines; with capacitors its first one is just after 0."""
    import numpy as np

    return trace.at(np.linspace(float(trace.t[0]), float(trace.t[-1]), points))


def _write(trace: NetlistTrace, out: Path) -> None:
    if out.suffix == ".npz":
        trace.save(out)
    elif out.suffix == ".csv":
        trace.write_csv(out)
    else:
        import io

        import matplotlib
        from matplotlib.figure import Figure

        from ohmloom._files import write_atomic

        buffer = io.BytesIO()
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            figure = Figure(figsize=(6.0, 3.6), layout="constrained")
            trace.plot(figure.add_subplot())
            figure.savefig(buffer, format="png", dpi=200, metadata={"Software": None})
        write_atomic(out, buffer.getvalue())


def _print_json(trace: NetlistTrace, engine: str, out: Path | None) -> None:
    parts = {
        part: {name: {"min": float(x.min()), "max": float(x.max()), "end": float(x[-1])} for name, x in values.items()}
        for part, values in (("v", trace.v), ("i", trace.i), ("s", trace.s), ("q", trace.q))
    }
    table = {**json.loads(trace.provenance), "engine": engine, "points": trace.t.size, "t_end": float(trace.t[-1]),
             "residual": trace.residual, **parts, "files": [] if out is None else [str(out)]}  # fmt: skip
    print(json.dumps(table, indent=1))
