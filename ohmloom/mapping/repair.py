"""Repair: which logical line goes to which physical one, so that no synapse stands on a faulty crosspoint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.errors import MappingError, ParameterError, expect_integer, expect_type

GOOD, STUCK_ON, STUCK_OFF = 0, 1, 2
STARTS: Final = 6  # with one, many dies stay faulty that six repair; with forty, hardly more are repaired
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Repair:
    """Where the lines of a tile go on a grid with faults and spare lines.

    Attributes
    ----------
    rows, columns
        Physical line of each logical one, axes (logical_row,) and (logical_column,).
    residual
        Logical (row, column) that still conflict with a fault, most important first.
    cost
        Sum of their importance; 0 is a full repair.
    """

    rows: IntArray
    columns: IntArray
    residual: tuple[tuple[int, int], ...]
    cost: float

    def __post_init__(self) -> None:
        for name, axis in (("rows", "logical_row"), ("columns", "logical_column")):
            object.__setattr__(self, name, frozen_array(f"Repair.{name}", getattr(self, name), (axis,), dtype=np.int64))

    @property
    def is_complete(self) -> bool:
        """Whether no crosspoint conflicts with a fault."""
        return not self.residual


def repair(
    faults: npt.ArrayLike,
    demand: npt.ArrayLike,
    importance: npt.ArrayLike | None = None,
    *,
    starts: int = STARTS,
    rng: np.random.Generator,
) -> Repair:
    """Permute rows and columns so that as little importance as possible stands on faults.

    An enabled crosspoint conflicts with any fault, a disabled one with a stuck-on device only; spare lines that stay
    unused conflict with nothing. For fixed columns the best rows are a linear assignment, and the other way round;
    these two alternate until neither gains, from the order as placed and from random ones. The joint problem is a
    quadratic assignment, so that this is a lower bound on what can be repaired. Any line may go to any place of its
    side, which the periphery's routing must allow.

    Parameters
    ----------
    faults
        0 good, 1 stuck on, 2 stuck off or unformed, axes (physical_row, physical_column).
    demand
        Whether a synapse stands there, axes (logical_row, logical_column).
    importance
        Cost of a conflict at each logical crosspoint, >= 0, the same axes; 1 everywhere by default.
    starts
        Starts at most; fewer where one repairs everything.
    rng
        Draws the starts after the first.

    Raises
    ------
    ParameterError
        If an array breaks these rules, `starts` is no integer >= 1, or `rng` no Generator.
    MappingError
        If the grid has fewer lines than the demand.

    Examples
    --------
    >>> found = repair([[1, 0, 0], [0, 0, 0]], [[True, False]], rng=np.random.default_rng(1))
    >>> found.residual, found.cost
    ((), 0.0)
    """
    grid, wanted, cost = _checked(faults, demand, importance)
    starts = expect_integer("repair.starts", starts, 1)
    expect_type("repair.rng", rng, np.random.Generator)
    best = _improved(grid, wanted, cost, np.arange(wanted.shape[0]), np.arange(wanted.shape[1]))
    for _ in range(starts - 1):
        if best[0] == 0.0:
            break
        rows, columns = (rng.permutation(grid.shape[axis])[: wanted.shape[axis]] for axis in (0, 1))
        found = _improved(grid, wanted, cost, rows, columns)
        best = found if found[0] < best[0] else best
    _, rows, columns = best
    return _result(grid, wanted, cost, rows, columns)


def unrepaired(faults: npt.ArrayLike, demand: npt.ArrayLike, importance: npt.ArrayLike | None = None) -> Repair:
    """Every line where it was placed, on the first physical lines: what a die without repair has.

    Raises
    ------
    ParameterError, MappingError
        As `repair`.
    """
    grid, wanted, cost = _checked(faults, demand, importance)
    return _result(grid, wanted, cost, np.arange(wanted.shape[0]), np.arange(wanted.shape[1]))


def _improved(
    grid: IntArray, wanted: BoolArray, cost: FloatArray, rows: IntArray, columns: IntArray
) -> tuple[float, IntArray, IntArray]:
    from scipy.optimize import linear_sum_assignment

    now = float(cost[_conflicts(grid, wanted, rows, columns)].sum())
    while now > 0.0:
        rows_now = linear_sum_assignment(_line_costs(grid[:, columns], wanted, cost))[1]
        columns_now = linear_sum_assignment(_line_costs(grid[rows_now].T, wanted.T, cost.T))[1]
        after = float(cost[_conflicts(grid, wanted, rows_now, columns_now)].sum())
        if after >= now:
            break
        now, rows, columns = after, rows_now, columns_now
    return now, rows, columns


def _line_costs(grid: IntArray, wanted: BoolArray, cost: FloatArray) -> FloatArray:
    """Cost of putting each logical line onto each physical one, axes (logical, physical)."""
    enabled, disabled = np.where(wanted, cost, 0.0), np.where(wanted, 0.0, cost)
    costs: FloatArray = enabled @ (grid != GOOD).T + disabled @ (grid == STUCK_ON).T
    return costs


def _conflicts(grid: IntArray, wanted: BoolArray, rows: IntArray, columns: IntArray) -> BoolArray:
    there = grid[np.ix_(rows, columns)]
    found: BoolArray = np.where(wanted, there != GOOD, there == STUCK_ON)
    return found


def _result(grid: IntArray, wanted: BoolArray, cost: FloatArray, rows: IntArray, columns: IntArray) -> Repair:
    # A conflict that costs nothing is listed all the same: what stands on a fault is a fact.
    places = [(int(i), int(j)) for i, j in np.argwhere(_conflicts(grid, wanted, rows, columns))]
    places.sort(key=lambda place: -cost[place])
    total = float(sum(cost[place] for place in places))
    return Repair(rows=rows, columns=columns, residual=tuple(places), cost=total)


def _checked(faults: Any, demand: Any, importance: Any) -> tuple[IntArray, BoolArray, FloatArray]:
    grid = frozen_array("repair.faults", faults, ("physical_row", "physical_column"))
    if not np.isin(grid, (GOOD, STUCK_ON, STUCK_OFF)).all():
        raise ParameterError("repair.faults: expected 0 (good), 1 (stuck on) or 2 (stuck off), got "
                             f"{grid[~np.isin(grid, (GOOD, STUCK_ON, STUCK_OFF))].flat[0]:g}. Correct it.")  # fmt: skip
    mask = frozen_array("repair.demand", demand, ("logical_row", "logical_column"))
    if not np.isin(mask, (0.0, 1.0)).all():
        raise ParameterError("repair.demand: expected true or false, got "
                             f"{mask[~np.isin(mask, (0.0, 1.0))].flat[0]:g}. Give a mask.")  # fmt: skip
    for axis, name in ((0, "rows"), (1, "columns")):
        if grid.shape[axis] < mask.shape[axis]:
            raise MappingError(f"repair.faults: expected at least {mask.shape[axis]} {name}, those of the demand, got "
                               f"{grid.shape[axis]}. Give the whole grid with its spare lines.")  # fmt: skip
    shape = (f"logical_row={mask.shape[0]}", f"logical_column={mask.shape[1]}")
    cost = frozen_array("repair.importance", np.ones(mask.shape) if importance is None else importance, shape)
    if (cost < 0.0).any():
        raise ParameterError(f"repair.importance: expected numbers >= 0, got {cost.min():g}. Correct it.")
    return grid.astype(np.int64), mask.astype(np.bool_), cost
