"""Order of the lines of a tile: heavy rows near the senses, heavy columns near the drivers, then swaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.circuits import Crossbar
from ohmloom.errors import ParameterError, expect_integer, expect_number

MOST_SWEEPS: Final = 50
MOST_CANDIDATES: Final = 400  # swaps tried at once; above that only those that move the worst crosspoint
LEAST_GAIN: Final = 1e-9  # relative: a swap within the solver's error of nothing is not made


@dataclass(frozen=True, kw_only=True)
class Wires:
    """What lies between a driver and a sense: ohm per segment of each line, and ohm of each end."""

    r_row: float = 0.0
    r_column: float = 0.0
    r_driver: float = 0.0
    r_sense: float = 0.0

    def __post_init__(self) -> None:
        for name in ("r_row", "r_column", "r_driver", "r_sense"):
            value = expect_number(f"Wires.{name}", getattr(self, name), "a finite resistance in ohm")
            if value < 0.0:
                raise ParameterError(f"Wires.{name}: expected 0 ohm or more, got {value:g} ohm. Correct it.")

    @property
    def is_ideal(self) -> bool:
        """Whether nothing lies in between."""
        return self.r_row == self.r_column == self.r_driver == self.r_sense == 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LineOrder:
    """The order of the lines of a tile and what it gains.

    Attributes
    ----------
    rows, columns
        Index of the line at each physical position; row 0 is the farthest from the senses, column 0 the nearest to
        the drivers.
    identity, sorted_, refined
        Worst read error in the order as given, after sorting, and after the swaps, exact, as fractions.
    swaps
        How many swaps were made.
    """

    rows: IntArray
    columns: IntArray
    identity: float
    sorted_: float
    refined: float
    swaps: int

    def __post_init__(self) -> None:
        for name in ("rows", "columns"):
            object.__setattr__(
                self, name, frozen_array(f"LineOrder.{name}", getattr(self, name), ("position",), dtype=np.int64)
            )


def read_errors(conductance: npt.ArrayLike, wires: Wires) -> FloatArray:
    """Share of the read voltage that each device does not see, while all rows are read at once in one polarity.

    The exact solution of the wires. Columns are at virtual ground behind `r_sense`.

    Parameters
    ----------
    conductance
        S, axes (..., word_line, bit_line); 0 where no device stands.
    wires
        What lies between drivers and senses.

    Returns
    -------
    The same axes; 0 where no device stands.

    Examples
    --------
    >>> read_errors([[1e-3]], Wires(r_driver=250.0, r_row=0.0)).round(3).tolist()
    [[0.2]]
    """
    g = np.asarray(conductance, dtype=np.float64)
    array = Crossbar(
        conductance=g, r_row=wires.r_row, r_column=wires.r_column, r_driver=wires.r_driver, r_sense=wires.r_sense
    )
    if wires.is_ideal:
        return np.zeros(g.shape)
    read = array.read(np.ones(array.shape[0]))
    errors: FloatArray = np.where(g > 0.0, 1.0 - (read.v_row - read.v_column), 0.0)
    return errors


def worst_read_error(conductance: npt.ArrayLike, wires: Wires) -> float:
    """The largest of `read_errors`."""
    return float(read_errors(conductance, wires).max(initial=0.0))


def order_lines(
    conductance: npt.ArrayLike,
    wires: Wires,
    *,
    activity: npt.ArrayLike | None = None,
    fixed_columns: int = 0,
    sweeps: int = MOST_SWEEPS,
) -> LineOrder:
    """Put the lines of a tile in the order with the least worst read error that sorting and swaps find.

    To first order the drop at a crosspoint is a sum, over the currents, of current times shared length of wire. By
    the rearrangement inequality it is small with the rows of most current next to the senses and the columns of most
    current next to the drivers. Then the best swap of two rows or two columns is made, by the exact solution, as long
    as there is one that gains. The result is never worse than the order as given; without wires that order stays.

    Parameters
    ----------
    conductance
        S, axes (word_line, bit_line); those at which the error shall be small, say the largest that devices reach.
    wires
        What lies between drivers and senses.
    activity
        How often each row spikes, axes (word_line,), >= 0; all alike by default. Enters the sorting only.
    fixed_columns
        How many of the last columns stay where they are, such as a reference column.
    sweeps
        Swaps at most; 0 only sorts.

    Raises
    ------
    ParameterError
        If one of these breaks its rule.
    """
    g = frozen_array("order_lines.conductance", conductance, ("word_line", "bit_line"))
    m, n = g.shape
    given = np.ones(m) if activity is None else activity
    spiking = frozen_array("order_lines.activity", given, (f"word_line={m}",))
    if (spiking < 0.0).any():
        raise ParameterError(f"order_lines.activity: expected numbers >= 0, got {spiking.min():g}. Correct it.")
    fixed = expect_integer("order_lines.fixed_columns", fixed_columns, 0, n)
    sweeps = expect_integer("order_lines.sweeps", sweeps)
    rows, columns = np.arange(m), np.arange(n)
    identity = worst_read_error(g, wires)
    if identity == 0.0:
        return LineOrder(rows=rows, columns=columns, identity=0.0, sorted_=0.0, refined=0.0, swaps=0)
    free = n - fixed
    current = spiking[:, None] * g
    sorted_rows = np.argsort(current.sum(axis=1), kind="stable")
    sorted_columns = np.concatenate([np.argsort(-current[:, :free].sum(axis=0), kind="stable"), columns[free:]])
    of_sorted = worst_read_error(g[np.ix_(sorted_rows, sorted_columns)], wires)
    if of_sorted < identity:
        rows, columns = sorted_rows, sorted_columns
    rows, columns, refined, swaps = _refined(g, wires, rows, columns, free, sweeps)
    return LineOrder(
        rows=rows, columns=columns, identity=identity, sorted_=of_sorted, refined=refined, swaps=swaps
    )  # fmt: skip


def _refined(
    g: FloatArray, wires: Wires, rows: IntArray, columns: IntArray, free: int, sweeps: int
) -> tuple[IntArray, IntArray, float, int]:
    """The best swap by the exact solution, again and again; what was reached, and how many were made."""
    rows, columns = rows.copy(), columns.copy()
    errors = read_errors(g[np.ix_(rows, columns)], wires)
    worst, made = float(errors.max()), 0
    while made < sweeps:
        swaps = _candidates(errors, free)
        if not swaps:
            break
        trials = np.stack([g[np.ix_(*_swapped(rows, columns, swap))] for swap in swaps])
        reached = read_errors(trials, wires).max(axis=(1, 2))
        best = int(reached.argmin())
        if not reached[best] < worst * (1.0 - LEAST_GAIN):
            break
        rows, columns = _swapped(rows, columns, swaps[best])
        errors = read_errors(g[np.ix_(rows, columns)], wires)
        worst, made = float(errors.max()), made + 1
    return rows, columns, worst, made


def _candidates(errors: FloatArray, free: int) -> list[tuple[int, int, int]]:
    """Swaps to try as (axis, position, position)."""
    m = errors.shape[0]
    pairs = [(0, a, b) for a in range(m) for b in range(a + 1, m)]
    pairs += [(1, a, b) for a in range(free) for b in range(a + 1, free)]
    if len(pairs) <= MOST_CANDIDATES:
        return pairs
    worst = np.unravel_index(int(errors.argmax()), errors.shape)
    moving = [(axis, a, b) for axis, a, b in pairs if worst[axis] in (a, b)]
    stride = -(-len(moving) // MOST_CANDIDATES)
    return moving[::stride]


def _swapped(rows: IntArray, columns: IntArray, swap: tuple[int, int, int]) -> tuple[IntArray, IntArray]:
    axis, a, b = swap
    lines = [rows.copy(), columns.copy()]
    lines[axis][[a, b]] = lines[axis][[b, a]]
    return lines[0], lines[1]
