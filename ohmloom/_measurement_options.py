"""What `device fit` and `device compare` share: options that say how a file is read, and errors that name options."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ohmloom.errors import OhmloomError, ParameterError, shown
from ohmloom.units import parse_quantity

if TYPE_CHECKING:
    from ohmloom.devices import Measurement

PER_FILE = "One for all files, or one for each (sweeps first, then hold-outs)."
Files = Annotated[list[Path], typer.Argument(metavar="CSV", help="Sweeps to fit: text tables, a row per sample.")]
Holdout = Annotated[
    list[Path] | None, typer.Option(metavar="CSV", help="Sweep to predict, not to fit. May be repeated.")
]
Time = Annotated[str, typer.Option(metavar="NAME", help="Column of the time.")]
NoTime = Annotated[bool, typer.Option("--no-time", help="Ignore the column of the time, to make times as below.")]
Voltage = Annotated[str, typer.Option(metavar="NAME", help="Column of the voltage. No header: columns are 1, 2, ...")]
Current = Annotated[str, typer.Option(metavar="NAME", help="Column of the current, positive into the device.")]
Units = Annotated[
    list[str] | None,
    typer.Option("--unit", metavar="COLUMN=UNIT", help="Unit of a column that is not in s, V or A. May be repeated."),
]
Frequencies = Annotated[
    list[str] | None,
    typer.Option("--frequency", metavar="HZ", help=f"For files without times that hold one period. {PER_FILE}"),
]
Interval = Annotated[
    str | None, typer.Option(metavar="S", help="For files without times, sampled in equal steps of so many seconds.")
]
Resistances = Annotated[
    list[str] | None,
    typer.Option("--series-resistance", metavar="OHM",
                 help=f"The voltage is a source's, across the device and this resistor; 5k is 5 kOhm. {PER_FILE}"),
]  # fmt: skip
Rows = Annotated[
    str | None, typer.Option(metavar="START:STOP", help="Use data rows START to STOP-1 of each file only, from 0.")
]
Every = Annotated[int, typer.Option(metavar="N", help="Replace each N rows by their mean.")]
Inverted = Annotated[bool, typer.Option("--invert-current", help="The file counts current out of the device.")]
Weights = Annotated[
    str,
    typer.Option(metavar="relative|absolute|A,B",
                 help="Divide residuals by each sweep's rms current, by that of all sweeps, or by A + B |i|, A in A."),
]  # fmt: skip
Screen = Annotated[int, typer.Option(min=1, metavar="N", help="Random starts that are tried.")]
Starts = Annotated[int, typer.Option(min=1, metavar="N", help="The best so many of them are solved.")]

# How errors of the library name its arguments, and what they are called here.
_ARGUMENTS: tuple[tuple[str, str], ...] = (
    (r"Pass units=\{.*?\} \((--unit [^)]*)\)", r"Pass \1"),
    (r"Pass invert_current=True to read_csv", "Pass --invert-current"),
    (r"Name the column \(time=\.\.\.\), or give frequency= in Hz if the file is one period, or sample_interval= in s",
     "Name the column (--time NAME), or give --frequency HZ if the file is one period, or --sample-interval S"),
    (r"and (frequency|sample_interval)\. Leave \1 out, or pass time=None to ignore",
     r"and \1. Leave --\1 out, or pass --no-time to ignore"),
    (r"Did you mean (time|voltage|current)='([^']*)'\?", r"Did you mean --\1 '\2'?"),
    (r"(?<=got )time='([^']*)', voltage=", r"--time '\1', voltage="),
    (r"(?<=[ ,])voltage='([^']*)', current=('[^']*')", r"--voltage '\1', --current \2"),
    (r"rows=\(start, stop\)", "--rows START:STOP"),
    (r"Measurement\.read_csv: expected one of frequency and sample_interval",
     "--frequency, --sample-interval: expected one of them"),
    (r"Measurement\.read_csv: (frequency|rows|every)\b", r"--\1"),
    (r"Measurement\.read_csv: sample_interval", "--sample-interval"),
    (r"Measurement\.(?:read_csv: )?series_resistance", "--series-resistance"),
    (r"(?<=: )units: expected", "--unit: expected"),
    (r"^fit\.measurements: ", "CSV: "),
    (r"\bfit\.fixed\b", "--fix"),
    (r"\bfit\.(law|free|weights|screen|starts)\b", r"--\1"),
    (r"\bcompare\.laws\b", "--laws"),
)  # fmt: skip


@contextmanager
def named_as_options() -> Iterator[None]:
    """Errors raised inside name this command line's options where they named the library's arguments."""
    try:
        yield
    except OhmloomError as error:
        raise type(error)(*(_with_options(problem) for problem in error.problems)) from error


def _with_options(text: str) -> str:
    for argument, option in _ARGUMENTS:
        text = re.sub(argument, option, text)
    return text.replace("--sample_interval", "--sample-interval")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How the files of a command are read; texts as the options give them."""

    time: str
    no_time: bool
    voltage: str
    current: str
    units: Sequence[str]
    frequencies: Sequence[str]
    interval: str | None
    resistances: Sequence[str]
    rows: str | None
    every: int
    inverted: bool

    def read(self, files: Sequence[Path]) -> tuple[Measurement, ...]:
        """One measurement for each file."""
        from ohmloom.devices import Measurement

        frequencies = _per_file("--frequency", self.frequencies, "Hz", len(files))
        resistances = _per_file("--series-resistance", self.resistances, "Ohm", len(files))
        interval = None if self.interval is None else parse_quantity(self.interval, "s", where="--sample-interval")
        units = pairs("--unit", "COLUMN=UNIT", self.units)
        rows = None if self.rows is None else _rows(self.rows)
        with named_as_options():
            return tuple(
                Measurement.read_csv(
                    file, time=None if self.no_time else self.time, voltage=self.voltage, current=self.current,
                    units=units, frequency=frequency, sample_interval=interval, series_resistance=resistance,
                    rows=rows, every=self.every, invert_current=self.inverted, name=name,
                )
                for file, name, frequency, resistance in zip(
                    files, sweep_names(files), frequencies, resistances, strict=True
                )
            )  # fmt: skip


def sweep_names(files: Sequence[Path]) -> list[str]:
    """A name for each file: its name without ending, with as much before and after as tells them apart.

    >>> sweep_names([Path("a/loop.csv"), Path("b/loop.csv")])
    ['a/loop.csv', 'b/loop.csv']
    """
    shapes: tuple[Callable[[Path], str], ...] = (
        lambda file: file.stem,
        lambda file: file.name,
        lambda file: "/".join(file.parts[-2:]),
        str,
    )
    for shape in shapes:
        names = [shape(file) for file in files]
        if len(set(names)) == len(names):
            return names
    twice = next(file for file in files if files.count(file) > 1)
    raise ParameterError(f"CSV: expected each file once, among sweeps and hold-outs, got {twice} twice. Remove one.")


def pairs(option: str, form: str, texts: Sequence[str]) -> dict[str, str]:
    """Options of the form NAME=VALUE as a table; the name may hold a '='."""
    table: dict[str, str] = {}
    for text in texts:
        name, sign, value = text.rpartition("=")
        if not sign or not name or not value.strip():
            raise ParameterError(f"{option}: expected {form}, got {shown(text)}. Give both, with '=' between them.")
        if name in table:
            raise ParameterError(f"{option}: expected each name once, got {shown(name)} twice. Remove one.")
        table[name] = value.strip()
    return table


def parse_weights(text: str) -> Any:
    """ "relative", "absolute" or (a, b)."""
    if "," not in text:
        return text
    parts = text.split(",")
    if len(parts) != 2:
        raise ParameterError(f"--weights: expected relative, absolute or A,B, got {shown(text)}. Give two numbers.")
    return parse_quantity(parts[0], "A", where="--weights: A"), parse_quantity(parts[1], "", where="--weights: B")


def _rows(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d{1,12})\s*:\s*(\d{1,12})\s*", text)
    if found is None:
        raise ParameterError(f"--rows: expected START:STOP, two row numbers from 0, got {shown(text)}. Correct it.")
    return int(found[1]), int(found[2])


def _per_file(option: str, texts: Sequence[str], unit: str, files: int) -> list[float | None]:
    values = [parse_quantity(text, unit, where=option) for text in texts]
    if len(values) not in (0, 1, files):
        wanted = "1 value" if files == 1 else f"1 value for all files, or {files} (sweeps first, then hold-outs)"
        raise ParameterError(f"{option}: expected {wanted}, got {len(values)}. Repeat the option once for each file.")
    if len(values) == 1:
        values *= files
    return list(values) if values else [None] * files
