"""Pulse trains on all lines of an array: the corners that `MemristorCrossbar.simulate` takes, as CSV and picture."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom._files import read_bytes
from ohmloom.circuits.tables import write_rows
from ohmloom.errors import FileFormatError, ParameterError, expect_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Corners nearer than this share of the period are one.
SAME_TIME = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class PulseTrain:
    """Voltages of every row and column at the corners of a drive; between them they are linear.

    Attributes
    ----------
    t
        Times of the corners [s], axes (time,), rising.
    v_row, v_column
        Voltages [V], axes (time, word_line) and (time, bit_line).

    Examples
    --------
    >>> train = PulseTrain.rectangular([[1.0, 0.0], [0.0, -1.0]], columns=1, width=1e-6, edge=1e-8, period=2e-6)
    >>> train.v_row.shape, float(train.t[-1]).__round__(12)
    ((8, 2), 3.02e-06)
    """

    t: FloatArray
    v_row: FloatArray
    v_column: FloatArray

    def __post_init__(self) -> None:
        """Check and freeze."""
        axes = {"t": ("time",), "v_row": ("time", "word_line"), "v_column": ("time", "bit_line")}
        for name, names in axes.items():
            object.__setattr__(self, name, frozen_array(f"PulseTrain.{name}", getattr(self, name), names))
        if self.t.size < 2 or not (np.diff(self.t) > 0.0).all():
            raise ParameterError(f"PulseTrain.t: expected at least two times in s, each above the last, got "
                                 f"{self.t.size} of them. A pulse of no length has no place; drop "
                                 "repeats.")  # fmt: skip
        for name in ("v_row", "v_column"):
            if getattr(self, name).shape[0] != self.t.size:
                raise ParameterError(f"PulseTrain.{name}: expected axes (time={self.t.size}, line), got shape "
                                     f"{getattr(self, name).shape}. Give one voltage per time and line.")  # fmt: skip

    @classmethod
    def rectangular(
        cls, levels: Any, *, columns: int, width: float, edge: float, period: float, column_levels: Any = None,
        delays: Any = None,
    ) -> PulseTrain:  # fmt: skip
        """Pulses one after the other on all lines at once, each from 0 to its level over an edge and back.

        Parameters
        ----------
        levels
            Of the rows [V], axes (pulse, word_line).
        columns
            Number of columns.
        width, edge, period
            Of the flat part, of each edge, and from the begin of one pulse to the next [s].
        column_levels
            Of the columns [V], axes (pulse, bit_line); 0 by default.
        delays
            Of each row against the begin of the period [s], axes (word_line,); 0 by default.

        Raises
        ------
        ParameterError
            If shapes disagree, a time is not above 0, or pulses overlap.
        """
        where = "PulseTrain.rectangular"
        rows = frozen_array(f"{where}: levels", levels, ("pulse", "word_line"))
        held = np.zeros((rows.shape[0], columns)) if column_levels is None else column_levels
        held = frozen_array(f"{where}: column_levels", held, ("pulse", "bit_line"))
        if held.shape != (rows.shape[0], columns) or rows.size == 0 or columns < 1:
            raise ParameterError(f"{where}: column_levels: expected axes (pulse={rows.shape[0]}, bit_line={columns}), "
                                 f"got shape {held.shape}. Give one level per pulse and column.")  # fmt: skip
        times = {"width": width, "edge": edge, "period": period}
        for name, value in times.items():
            times[name] = expect_number(f"{where}: {name}", value, "a time in s")
            if times[name] <= 0.0:
                raise ParameterError(f"{where}: {name}: expected a time above 0 s, got {times[name]:g} s. Edges and "
                                     "levels take time.")  # fmt: skip
        late = np.zeros(rows.shape[1]) if delays is None else frozen_array(f"{where}: delays", delays, ("word_line",))
        if late.shape != (rows.shape[1],) or (late < 0.0).any():
            raise ParameterError(f"{where}: delays: expected times of 0 s or more, axes (word_line={rows.shape[1]},), "
                                 f"got {late}. Give one per row.")  # fmt: skip
        busy = times["width"] + 2.0 * times["edge"] + float(late.max(initial=0.0))
        if busy > times["period"] * (1.0 + SAME_TIME):
            raise ParameterError(f"{where}: period: expected at least width + 2 edges + the longest delay = {busy:g} "
                                 f"s, got {times['period']:g} s. Lengthen it.")  # fmt: skip
        return _sampled(rows, held, late, times["width"], times["edge"], times["period"])

    def write_csv(self, path: str | Path) -> None:
        """Write ``t_s,row_0_V,...,column_0_V,...``, a line per corner, whole or not at all."""
        header = ["t_s", *(f"row_{i}_V" for i in range(self.v_row.shape[1])),
                  *(f"column_{j}_V" for j in range(self.v_column.shape[1]))]  # fmt: skip
        table = np.column_stack([self.t, self.v_row, self.v_column])
        write_rows(path, header, [[repr(float(x)) for x in row] for row in table])

    @classmethod
    def read_csv(cls, path: str | Path) -> PulseTrain:
        """Read what `write_csv` wrote, or a table of one's own in that form.

        Raises
        ------
        MissingFileError, FileFormatError
            If there is no such file, or its columns or numbers are not these.
        """
        rows = list(csv.reader(io.StringIO(read_bytes(path, "pulses").decode("utf-8-sig", "replace"))))
        header = rows[0] if rows else []
        m = sum(name.startswith("row_") for name in header)
        n = sum(name.startswith("column_") for name in header)
        wanted = ["t_s", *(f"row_{i}_V" for i in range(m)), *(f"column_{j}_V" for j in range(n))]
        if m == 0 or n == 0 or header != wanted:
            raise FileFormatError(f"{path}: line 1: expected the columns t_s, row_0_V, ..., column_0_V, ..., got "
                                  f"{','.join(header)[:120]!r}. Name them so, in this order.")  # fmt: skip
        numbers = np.empty((len(rows) - 1, len(header)))
        for k, row in enumerate(rows[1:]):
            try:
                if len(row) != len(header):
                    raise ValueError(f"{len(row)} of them")
                numbers[k] = [float(x) for x in row]
            except ValueError as error:
                raise FileFormatError(f"{path}: line {k + 2}: expected {len(header)} numbers, got {error}. "
                                      "Correct the line.") from None  # fmt: skip
        try:
            return cls(t=numbers[:, 0], v_row=numbers[:, 1 : m + 1], v_column=numbers[:, m + 1 :])
        except ParameterError as error:
            raise FileFormatError(f"{path}: {error}") from error

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the pulses of every line, one below the other; returns the axes."""
        from ohmloom.circuits.plots import plot_pulses

        return plot_pulses(self, ax=ax)

    def _repr_html_(self) -> str:
        return (f"<table><tr><th>lines</th><td>{self.v_row.shape[1]} rows, {self.v_column.shape[1]} columns</td></tr>"
                f"<tr><th>corners</th><td>{self.t.size}</td></tr></table>")  # fmt: skip


def _sampled(rows: FloatArray, held: FloatArray, late: FloatArray, width: float, edge: float,
             period: float) -> PulseTrain:  # fmt: skip
    """All lines at all corners of any of them."""
    shape = np.array([0.0, edge, edge + width, 2.0 * edge + width])
    starts = period * np.arange(rows.shape[0])
    every = np.sort(
        np.concatenate([(starts[:, None, None] + delay + shape).ravel() for delay in {0.0, *late.tolist()}])
    )
    kept = np.concatenate([[True], np.diff(every) > SAME_TIME * period])
    t = every[kept]

    def line(levels: FloatArray, delay: float) -> FloatArray:
        corners = (starts[:, None] + delay + shape).ravel()
        values = (levels[:, None] * np.array([0.0, 1.0, 1.0, 0.0])).ravel()
        # Pulses that touch share a corner, at which both are 0.
        distinct = np.concatenate([[True], np.diff(corners) > 0.0])
        result: FloatArray = np.interp(t, corners[distinct], values[distinct])
        return result

    v_row = np.column_stack([line(rows[:, i], float(late[i])) for i in range(rows.shape[1])])
    v_column = np.column_stack([line(held[:, j], 0.0) for j in range(held.shape[1])])
    return PulseTrain(t=t, v_row=v_row, v_column=v_column)
