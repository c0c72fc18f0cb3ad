"""Tiles: arrays small enough for the lines that can be made and for the error that wires may cause."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.errors import MappingError, ParameterError, expect_integer, expect_number
from ohmloom.mapping.placement import MOST_SWEEPS, LineOrder, Wires, order_lines, worst_read_error

# Worst over mean of the separable sum below, from exact solutions of 15 x 11 arrays .
WORST_OVER_MEAN: Final = 1.45
FAR_OFF: Final = 3.0  # the estimate is of first order: beyond this factor of the limit nothing is solved


@dataclass(frozen=True, kw_only=True)
class Block:
    """The part of a demand that one tile carries.

    Attributes
    ----------
    rows, columns
        Indices into the demand, in physical order.
    order
        How its lines were ordered, and its worst read error without spare lines.
    read_error
        Worst read error with the spare lines, whose wires all currents pass.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    order: LineOrder
    read_error: float


@dataclass(frozen=True, kw_only=True)
class Tiling:
    """A demand divided into tiles.

    Attributes
    ----------
    blocks
        The tiles; every crosspoint with a device is in exactly one.
    limit
        Read error that was asked for.
    is_within
        Whether every tile stays under it. False only where a single device on a tile of its own would not, so that no
        size helps; the tiles are then as large as the array allows.
    """

    blocks: tuple[Block, ...]
    limit: float
    is_within: bool

    @property
    def worst(self) -> float:
        """Largest worst read error of a tile; 0 without tiles."""
        return max((block.read_error for block in self.blocks), default=0.0)


def estimated_error(rows: float, columns: float, *, conductance: float, density: float, wires: Wires) -> float:
    """Worst read error of a full tile by a formula of first order.

    ``1.45 r G density (rows^2 + columns^2)/2`` for wires, plus what driver and sense take. Good to some 15 % while it
    is small; a guess of where to begin, never a verdict.

    Parameters
    ----------
    rows, columns
        Lines of the tile.
    conductance
        Mean of the devices [S].
    density
        Share of crosspoints with a device.
    wires
        What lies between drivers and senses.
    """
    along = wires.r_row * columns**2 + wires.r_column * rows**2
    ends = wires.r_driver * columns + wires.r_sense * rows
    return float(conductance * density * (WORST_OVER_MEAN * along / 2.0 + ends))


def largest_tile(*, limit: float, conductance: float, density: float, wires: Wires) -> float:
    """Lines of the largest square tile whose worst read error stays under `limit`, by the same formula.

    >>> int(largest_tile(limit=0.01, conductance=1e-4, density=0.31, wires=Wires(r_row=1.06, r_column=1.06)))
    14

    Raises
    ------
    ParameterError
        If `limit` is not above 0.
    """
    if not limit > 0.0:
        raise ParameterError(f"largest_tile.limit: expected a share > 0, got {limit:g}. Correct it.")
    a = conductance * density * WORST_OVER_MEAN * (wires.r_row + wires.r_column) / 2.0
    b = conductance * density * (wires.r_driver + wires.r_sense)
    if a == 0.0:
        return limit / b if b > 0.0 else np.inf
    return float((np.sqrt(b * b + 4.0 * a * limit) - b) / (2.0 * a))


def split_demand(
    conductance: npt.ArrayLike,
    *,
    max_rows: int,
    max_columns: int,
    limit: float = np.inf,
    wires: Wires | None = None,
    reference: float | None = None,
    spare: tuple[int, int] = (0, 0),
    sweeps: int = MOST_SWEEPS,
    activity: npt.ArrayLike | None = None,
    name: Callable[[int, int], str] | None = None,
) -> Tiling:
    """Divide a demand into the fewest tiles that fit, each with its lines in order.

    Rows are cut into groups, and columns, of almost equal size in the order as given. A receiver whose senders are in
    several groups has a column in each, summed after the gain. A tile has only those lines that carry a device. Of the
    cuts into as many tiles the one with the smallest estimated error comes first; the exact solution of every tile
    decides.

    Parameters
    ----------
    conductance
        S, axes (row, column), 0 where no device stands: those at which the limit shall hold.
    max_rows, max_columns
        Lines that an array can have; spare lines and the reference column count.
    limit
        Largest worst read error of a tile.
    wires
        What lies between drivers and senses; nothing by default.
    reference
        Conductance of a device of the reference column [S]; None if tiles have none.
    spare
        Spare rows and columns of each tile, after its last row, and between its last column and the reference.
    sweeps
        Swaps of lines at most, in each tile; 0 only sorts them.
    activity
        How often each row spikes, axes (row,); enters the sorting of lines.
    name
        How an error calls crosspoint (row, column).

    Raises
    ------
    ParameterError
        If one of these breaks its rule.
    MappingError
        If an array has no room for a line beside the spare ones and the reference column; names the first crosspoint
        without a line.
    """
    g = frozen_array("split_demand.conductance", conductance, ("row", "column"))
    spiking = frozen_array(
        "split_demand.activity", np.ones(g.shape[0]) if activity is None else activity, (f"row={g.shape[0]}",)
    )
    max_rows = expect_integer("split_demand.max_rows", max_rows, 1)
    max_columns = expect_integer("split_demand.max_columns", max_columns, 1)
    if limit != np.inf and not expect_number("split_demand.limit", limit, "a share > 0") > 0.0:
        raise ParameterError(f"split_demand.limit: expected a share > 0, got {limit:g}. Correct it.")
    places = np.argwhere(g > 0.0)
    if not len(places):
        return Tiling(blocks=(), limit=limit, is_within=True)
    first = (int(places[0, 0]), int(places[0, 1]))
    first_name = f"crosspoint {first}" if name is None else name(*first)
    extra = (spare[0], spare[1] + (reference is not None))
    for axis, most, others in ((0, max_rows, "spare rows"), (1, max_columns, "spare columns and the reference column")):
        if most - extra[axis] < 1:
            raise MappingError(f"split_demand.max_{'columns' if axis else 'rows'}: expected at least "
                               f"{extra[axis] + 1}, for a line beside the {others}, got {most}; {first_name} is the "
                               "first without a line. Enlarge the array.")  # fmt: skip
    made = _Array(
        wires=Wires() if wires is None else wires, reference=reference, spare=spare, sweeps=sweeps, activity=spiking
    )
    i, j = divmod(int(g.argmax()), g.shape[1])
    alone = _block(g, np.array([i]), np.array([j]), made)
    assert alone is not None
    # What breaks the limit alone breaks it in every tile, and more tiles would only cost more.
    is_within = alone.read_error <= limit
    asked = limit if is_within else np.inf
    for groups in _cuts(g, max_rows - extra[0], max_columns - extra[1], asked, made):
        blocks = _blocks(g, groups, asked, made)
        if blocks is not None:
            return Tiling(blocks=blocks, limit=limit, is_within=is_within)
    raise AssertionError("the cut into single crosspoints comes last and passes")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Array:
    """What every tile has beside its devices."""

    wires: Wires
    reference: float | None
    spare: tuple[int, int]
    sweeps: int
    activity: FloatArray

    @property
    def extra(self) -> tuple[int, int]:
        """Rows and columns that carry no neuron."""
        return self.spare[0], self.spare[1] + (self.reference is not None)


def _cuts(g: FloatArray, rows: int, columns: int, limit: float, made: _Array) -> Iterator[tuple[int, int]]:
    """Numbers of groups of rows and of columns, fewest tiles first, without those whose estimate is far off."""
    m, n = g.shape
    mean = float(g[g > 0.0].mean())
    density = float((g > 0.0).mean())

    def entry(a: int, b: int) -> tuple[int, float, int, int]:
        size = (-(-m // a) + made.extra[0], -(-n // b) + made.extra[1])
        return a * b, estimated_error(*size, conductance=mean, density=density, wires=made.wires), a, b

    fewest = (-(-m // rows), -(-n // columns))
    queue, seen = [entry(*fewest)], {fewest}
    while queue:
        _, estimate, a, b = heapq.heappop(queue)
        if estimate <= FAR_OFF * limit or (a, b) == (m, n):
            yield a, b
        for following in ((a + 1, b), (a, b + 1)):
            if following[0] <= m and following[1] <= n and following not in seen:
                seen.add(following)
                heapq.heappush(queue, entry(*following))


def _blocks(g: FloatArray, groups: tuple[int, int], limit: float, made: _Array) -> tuple[Block, ...] | None:
    """The tiles of one cut, or None if one of them breaks the limit."""
    found = []
    for rows in np.array_split(np.arange(g.shape[0]), groups[0]):
        for columns in np.array_split(np.arange(g.shape[1]), groups[1]):
            block = _block(g, rows, columns, made)
            if block is None:
                continue
            if block.read_error > limit:
                return None
            found.append(block)
    return tuple(found)


def _block(g: FloatArray, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64], made: _Array) -> Block | None:
    part = g[np.ix_(rows, columns)]
    rows, columns = rows[(part > 0.0).any(axis=1)], columns[(part > 0.0).any(axis=0)]
    if not len(rows):
        return None
    array = g[np.ix_(rows, columns)]
    n = len(columns)
    if made.reference is not None:
        array = np.column_stack([array, np.full(len(rows), made.reference)])
    order = order_lines(
        array, made.wires, activity=made.activity[rows], fixed_columns=int(made.reference is not None),
        sweeps=made.sweeps,
    )  # fmt: skip
    error = order.refined
    if any(made.spare) and not made.wires.is_ideal:
        ordered = array[np.ix_(order.rows, order.columns)]
        padded = np.insert(ordered, [n] * made.spare[1], 0.0, axis=1)
        error = worst_read_error(np.pad(padded, ((0, made.spare[0]), (0, 0))), made.wires)
    return Block(
        rows=tuple(int(k) for k in rows[order.rows]),
        columns=tuple(int(columns[k]) for k in order.columns if k < n), order=order, read_error=error,
    )  # fmt: skip
