"""Measured sweeps: voltage and current of one device over time, read from a file and checked."""

from __future__ import annotations

import html
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom._files import write_atomic
from ohmloom.devices._checks import LARGEST_TIME, LARGEST_VOLTAGE, check_size
from ohmloom.devices._columns import QUANTITIES, check_times, choose_columns, choose_rows, column_factors
from ohmloom.devices._read_csv import read_table
from ohmloom.errors import (
    FileFormatError,
    MissingFileError,
    ParameterError,
    UnknownNameError,
    expect_number,
    expect_type,
    shown,
)
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LARGEST_CURRENT = 1e6  # A


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """One measured sweep of one device, axes (time,), SI.

    Current counts positive into the terminal at which a positive voltage is applied, so that the device takes up
    energy.

    Attributes
    ----------
    name
        What reports and pictures call it.
    t
        Time in s, strictly increasing.
    v, i
        Voltage in V and current in A at these times.
    series_resistance
        Known resistor in Ohm. 0: `v` is the device's own voltage. Above 0: `v` is a source's, across the device
        and this resistor in series.
    frequency
        Of a periodic sweep, in Hz, or None.
    file, sha256
        Name of the file it was read from and the digest of its bytes; "" if it came from arrays.
    rows, every
        Data rows of the file that were used, [start, stop), or None, and how many of them make one point.

    Raises
    ------
    ParameterError
        If an array is not finite, too short or of another length, times do not increase, the voltage is constant, the
        current is zero, or the device would give out energy.

    Examples
    --------
    >>> sweep = Measurement(name="resistor", t=[0.0, 1.0, 2.0], v=[0.0, 1.0, 0.0], i=[0.0, 1e-3, 0.0])
    >>> sweep.duration, sweep.charge.tolist(), sweep.zero_offset()
    (2.0, [0.0, 0.0005, 0.001], 0.0)
    """

    name: str
    t: FloatArray
    v: FloatArray
    i: FloatArray
    series_resistance: float = 0.0
    frequency: float | None = None
    file: str = ""
    sha256: str = ""
    rows: tuple[int, int] | None = None
    every: int = 1

    def __post_init__(self) -> None:
        """Freeze the arrays and check them."""
        for name in ("name", "file", "sha256"):
            expect_type(f"Measurement.{name}", getattr(self, name), str)
        if self.sha256 and not re.fullmatch("[0-9a-f]{64}", self.sha256):
            raise ParameterError(f"Measurement.sha256: expected 64 hexadecimal digits or nothing, got "
                                 f"{shown(self.sha256)}. Leave it out.")  # fmt: skip
        resistance = _resistance("Measurement.series_resistance", self.series_resistance)
        object.__setattr__(self, "series_resistance", resistance)
        if self.frequency is not None:
            object.__setattr__(self, "frequency", _positive("Measurement.frequency", self.frequency, "Hz"))
        for name, limit, unit in (("t", LARGEST_TIME, "s"), ("v", LARGEST_VOLTAGE, "V"), ("i", LARGEST_CURRENT, "A")):
            array = frozen_array(f"Measurement.{name}", getattr(self, name), ("time",))
            check_size(f"Measurement.{name}", array, limit, unit)
            object.__setattr__(self, name, array)
        self._check_arrays()
        self._check_energy()

    @classmethod
    def read_csv(
        cls,
        path: str | Path,
        time: str | None = "t",
        voltage: str = "v",
        current: str = "i",
        *,
        units: Mapping[str, str] | None = None,
        frequency: float | None = None,
        sample_interval: float | None = None,
        series_resistance: float | None = None,
        rows: tuple[int, int] | None = None,
        every: int = 1,
        invert_current: bool = False,
        name: str | None = None,
    ) -> Measurement:
        """Read one sweep from a text table.

        The file has one row per sample and, in its first line, names of columns. Fields are separated by commas,
        semicolons, tabs or blanks; numbers have a decimal point. Empty lines and lines that start with '#' are skipped.
        If all fields of the first line are numbers, there are no names, and columns are called "1", "2", ... Columns
        that are not asked for may hold anything. Of several sweeps in one file, `rows` chooses one.

        Parameters
        ----------
        path
            The file, up to 200 MB; or the name of a synthetic sweep that comes with ohmloom (`shipped_names`).
        time, voltage, current
            Names of the columns. ``time=None`` ignores a time column.
        units
            Unit by column name, as ``{"i_uA": "uA"}``, for columns that are not in s, V and A. A name that ends in
            another unit ("i_uA", "I [mA]", "t(ms)") is refused until its unit is given here.
        frequency
            In Hz, for a file without times that holds exactly one period of a periodic sweep: ``t = k/(N f)`` for
            its N rows, k = 0 ... N - 1.
        sample_interval
            In s, for a file without times, sampled in equal steps: ``t = k * sample_interval``.
        series_resistance
            In Ohm: `voltage` is a source's, across the device and this resistor in series. None: it is the
            device's own.
        rows
            Use data rows [start, stop) only, counted from 0 below the names; lines outside are not read.
        every
            Replace each block of so many rows by its mean (of time, voltage and current), which lowers noise by the
            square root of `every` and blurs steps that are shorter. A last block that is not full is left out.
        invert_current
            Change the sign of the current, for a file that counts it positive out of the device.
        name
            Default: the file's name without its ending.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If a field is no finite number, a row has another number of fields, a name stands twice, times do not
            increase, or the sweep breaks a rule of `Measurement`.
        UnknownNameError
            If there is no such column, or a unit is unknown or one of something else.
        ParameterError
            If the time is given twice or not at all, a unit is missing, or an argument is out of range.
        """
        path = _shipped_path(path)
        where = "Measurement.read_csv"
        resistance = _resistance(f"{where}: series_resistance", 0.0 if series_resistance is None else series_resistance)
        if frequency is not None:
            frequency = _positive(f"{where}: frequency", frequency, "Hz")
        if sample_interval is not None:
            sample_interval = _positive(f"{where}: sample_interval", sample_interval, "s")
        table = read_table(path)
        chosen = choose_columns(table, time, voltage, current, frequency, sample_interval)
        factors = column_factors(table, chosen, units)
        start, stop = choose_rows(table, rows, every)
        read = dict(zip(chosen, table.columns(list(chosen.values()), start, stop), strict=True))
        if "time" in chosen:
            check_times(table, chosen["time"], read["time"], start)
        else:
            read["time"] = _equal_times(len(table.body), frequency, sample_interval)[start:stop]
        t, v, i = (_block_means(read[quantity] * factors.get(quantity, 1.0), every) for quantity in QUANTITIES)
        try:
            return cls(
                name=Path(path).stem if name is None else name,
                t=t,
                v=v,
                i=-i if invert_current else i,
                series_resistance=resistance,
                frequency=frequency,
                file=Path(path).name,
                sha256=table.sha256,
                rows=(start, stop),
                every=every,
            )
        except ParameterError as error:
            raise FileFormatError(*(f"{table.where}: {problem}" for problem in error.problems)) from error

    @staticmethod
    def shipped_names() -> list[str]:
        """Names of the sweeps that come with ohmloom: simulated by other laws, with noise, and so free to share.

        >>> Measurement.shipped_names()
        ['pickett', 'pickett_fast', 'redox', 'redox_staircase']
        >>> len(Measurement.read_csv("pickett", series_resistance=2400.0).t)
        250
        """
        return sorted(item.name.removesuffix(".csv") for item in _shipped_folder().iterdir())

    @property
    def duration(self) -> float:
        """Time from the first point to the last, in s."""
        return float(self.t[-1] - self.t[0])

    @property
    def device_voltage(self) -> FloatArray:
        """Voltage across the device itself, ``v - R i``, in V, axes (time,)."""
        return self.v - self.series_resistance * self.i

    @property
    def charge(self) -> FloatArray:
        """Transported charge: running integral of the current (trapezoidal), in C, axes (time,); starts at 0."""
        return _integral(self.i, self.t)

    @property
    def flux(self) -> FloatArray:
        """Running integral of the device's voltage (trapezoidal), in V s, axes (time,); starts at 0."""
        return _integral(self.device_voltage, self.t)

    def zero_offset(self) -> float | None:
        """Current at zero device voltage, over the largest current; an ideal memristor has 0.

        Interpolates between the samples on the two sides of zero, and takes the mean over all crossings; a sample at
        exactly zero is a crossing. None if the voltage never is zero.
        """
        v, i = self.device_voltage, self.i
        k = np.flatnonzero(np.sign(v[:-1]) * np.sign(v[1:]) < 0)
        share = v[k] / (v[k] - v[k + 1])
        found = np.concatenate([i[k] + share * (i[k + 1] - i[k]), i[v == 0.0]])
        return float(np.mean(found / np.abs(i).max())) if found.size else None

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the loop: current over the device's voltage, both with their units; returns the axes."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").subplots()
        ax.plot(self.device_voltage, self.i, label=self.name)
        ax.set_xlabel("device voltage [V]")
        ax.set_ylabel("current [A]")
        return ax

    def save(self, path: str | Path) -> None:
        """Write ``t,v,i`` in SI as CSV; `read_csv` gives the same numbers back, to the last bit.

        What else is known of the sweep stands above them as comments; `read_csv` does not read these.

        Raises
        ------
        OperationError
            If the file cannot be written.
        """
        about = [f"# {shown(self.name)[1:-1]}: t in s, v in V, i in A"]
        if self.file:
            about.append(f"# from {shown(self.file)[1:-1]}, sha256 {self.sha256}")
        if self.frequency is not None:
            about.append(f"# frequency {self.frequency!r} Hz")
        if self.series_resistance:
            about.append(f"# v is a source's, across the device and {self.series_resistance!r} Ohm in series")
        points = zip(self.t.tolist(), self.v.tolist(), self.i.tolist(), strict=True)
        write_atomic(path, "\n".join([*about, "t,v,i", *(f"{t!r},{v!r},{i!r}" for t, v, i in points), ""]))

    def _repr_html_(self) -> str:
        rows = [
            ("measurement", self.name),
            ("file", self.file or "none"),
            ("points", str(self.t.size)),
            ("duration", format_quantity(self.duration, "s")),
            ("largest voltage", format_quantity(float(np.abs(self.v).max()), "V")),
            ("largest current", format_quantity(float(np.abs(self.i).max()), "A")),
            ("series resistance", format_quantity(self.series_resistance, "Ohm")),
        ]
        cells = "".join(f"<tr><th>{html.escape(key)}</th><td>{html.escape(value)}</td></tr>" for key, value in rows)
        return f"<table>{cells}</table>"

    def _check_arrays(self) -> None:
        for name in ("v", "i"):
            size = getattr(self, name).size
            if size != self.t.size:
                raise ParameterError(
                    f"Measurement.{name}: expected axes (time,) as long as t, {self.t.size}, got {size}. "
                    "Give one value per time."
                )
        if self.t.size < 2:
            raise ParameterError(f"Measurement.t: expected at least 2 points, got {self.t.size}. Give a whole sweep.")
        steps = np.diff(self.t)
        if not (steps > 0).all():
            k = int(np.argmin(steps > 0))
            raise ParameterError(
                f"Measurement.t: expected strictly increasing times in s, got {self.t[k + 1]:.9g} s after "
                f"{self.t[k]:.9g} s. Sort them and drop repeats."
            )
        if (self.v == self.v[0]).all():
            raise ParameterError(f"Measurement.v: expected a voltage that changes, got {self.v[0]:.6g} V throughout. "
                                 "Check the column.")  # fmt: skip
        if not self.i.any():
            raise ParameterError("Measurement.i: expected a current, got 0 A throughout. Check the column.")

    def _check_energy(self) -> None:
        """A passive device takes up energy over a sweep; scaled, so that small numbers do not vanish."""
        i = self.i / np.abs(self.i).max()
        supplied = _integral(self.v * i, self.t)[-1]
        lost = _integral(self.series_resistance * self.i * i, self.t)[-1]
        if supplied - lost > 0.0:
            return
        if supplied > 0.0:
            largest = float(supplied / lost) * self.series_resistance
            raise ParameterError(
                f"Measurement.series_resistance: expected less than {largest:.4g} Ohm, beyond which the resistor alone "
                f"would take up more energy than the source gives, got {self.series_resistance:.6g} Ohm. "
                "Check the resistor, and that v is the source's voltage."
            )
        raise ParameterError(
            "Measurement.i: expected a current that takes energy into the device (integral of v i dt above 0), got one "
            "of the wrong sign. Pass invert_current=True to read_csv, or swap the terminals."
        )


def _shipped_folder() -> Traversable:
    return resources.files("ohmloom.devices") / "measurements"


def _shipped_path(path: str | Path) -> str | Path:
    """The path itself; or that of a shipped sweep, where a bare name is no file."""
    expect_type("Measurement.read_csv: path", path, str, os.PathLike, name="a path, or the name of a shipped sweep")
    text = str(path)
    if Path(text).suffix or Path(text).name != text or os.path.exists(text):
        return path
    if text in Measurement.shipped_names():
        return Path(str(_shipped_folder() / f"{text}.csv"))
    unknown = UnknownNameError.of("Measurement.read_csv: path", text, Measurement.shipped_names())
    raise MissingFileError(f"{unknown} A file is given by its path, with its ending.")


def _integral(y: FloatArray, t: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(t))])


def _equal_times(size: int, frequency: float | None, sample_interval: float | None) -> FloatArray:
    k = np.arange(float(size))
    return k / (size * frequency) if frequency is not None else k * (sample_interval or 0.0)


def _block_means(values: FloatArray, size: int) -> FloatArray:
    return values if size == 1 else values.reshape(-1, size).mean(axis=1)


def _positive(where: str, value: Any, unit: str) -> float:
    number = expect_number(where, value, f"a number above 0 {unit}")
    if number <= 0.0:
        raise ParameterError(f"{where}: expected a number above 0 {unit}, got {number:.6g} {unit}. Correct it.")
    return number


def _resistance(where: str, value: Any) -> float:
    number = expect_number(where, value, "a resistance of 0 Ohm or more")
    if number < 0.0:
        raise ParameterError(f"{where}: expected a resistance of 0 Ohm or more, got {number:.6g} Ohm. Correct it.")
    return number
