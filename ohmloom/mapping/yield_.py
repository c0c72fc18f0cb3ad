"""Yield: the share of dies on which no synapse stands on a fault, by formula and from samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import IntArray, frozen_array
from ohmloom.errors import ParameterError, expect_integer, expect_number, expect_type
from ohmloom.mapping.repair import GOOD, STARTS, STUCK_OFF, STUCK_ON, repair, unrepaired


@dataclass(frozen=True, kw_only=True)
class Yield:
    """Share of dies without a conflict between a crosspoint and a fault.

    Attributes
    ----------
    dies
        How many were sampled.
    formula
        Without repair, ``(1 - p)^enabled (1 - p_on)^disabled``.
    plain, plain_interval
        Share of the sampled dies without repair, with its Wilson 95 % interval.
    repaired, repaired_interval
        The same with repair, on the same faults; a lower bound, since repair is a heuristic.
    """

    dies: int
    formula: float
    plain: float
    plain_interval: tuple[float, float]
    repaired: float
    repaired_interval: tuple[float, float]


def yield_formula(demand: npt.ArrayLike, *, stuck_on: float, stuck_off: float) -> float:
    """Yield without repair: every enabled device good, no disabled one stuck on.

    Parameters
    ----------
    demand
        Whether a synapse stands there, axes (row, column).
    stuck_on, stuck_off
        Probability per device; faults are independent.

    Raises
    ------
    ParameterError
        If these are no probabilities, or add up to more than 1.

    Examples
    --------
    >>> round(yield_formula([[True, False]], stuck_on=0.1, stuck_off=0.2), 12)
    0.63
    """
    mask = frozen_array("yield_formula.demand", demand, ("row", "column")).astype(bool)
    stuck_on, stuck_off = _probabilities("yield_formula", stuck_on, stuck_off)
    enabled = int(mask.sum())
    return float((1.0 - stuck_on - stuck_off) ** enabled * (1.0 - stuck_on) ** (mask.size - enabled))


def sample_yield(
    demand: npt.ArrayLike,
    *,
    stuck_on: float,
    stuck_off: float,
    spare_rows: int = 0,
    spare_columns: int = 0,
    dies: int = 400,
    starts: int = STARTS,
    rng: np.random.Generator,
) -> Yield:
    """Sample dies with independent faults and count those that work as they are, and those that repair makes work.

    Faults and starts have streams of their own, so that the same faults come back with other `starts`.

    Parameters
    ----------
    demand, stuck_on, stuck_off
        As for `yield_formula`.
    spare_rows, spare_columns
        Lines beyond those of the demand.
    dies
        How many to sample.
    starts
        Of each repair.

    Raises
    ------
    ParameterError
        If one of these is out of its range.
    """
    mask = frozen_array("sample_yield.demand", demand, ("row", "column")).astype(bool)
    stuck_on, stuck_off = _probabilities("sample_yield", stuck_on, stuck_off)
    spare_rows = expect_integer("sample_yield.spare_rows", spare_rows)
    spare_columns = expect_integer("sample_yield.spare_columns", spare_columns)
    dies = expect_integer("sample_yield.dies", dies, 1)
    expect_type("sample_yield.rng", rng, np.random.Generator)
    of_faults, of_starts = rng.spawn(2)
    shape = (mask.shape[0] + spare_rows, mask.shape[1] + spare_columns)
    plain = repaired = 0
    for _ in range(dies):
        faults = draw_faults(shape, stuck_on=stuck_on, stuck_off=stuck_off, rng=of_faults)
        plain += unrepaired(faults, mask).is_complete
        repaired += repair(faults, mask, starts=starts, rng=of_starts).is_complete
    return Yield(
        dies=dies, formula=yield_formula(mask, stuck_on=stuck_on, stuck_off=stuck_off), plain=plain / dies,
        plain_interval=wilson(plain, dies), repaired=repaired / dies, repaired_interval=wilson(repaired, dies),
    )  # fmt: skip


def draw_faults(shape: tuple[int, int], *, stuck_on: float, stuck_off: float, rng: np.random.Generator) -> IntArray:
    """Independent faults, 0 good, 1 stuck on, 2 stuck off, axes (physical_row, physical_column)."""
    u = rng.random(shape)
    # The same draw with a larger probability keeps every fault that it had: common random numbers along a curve.
    faults: IntArray = np.where(u < stuck_on, STUCK_ON, np.where(u >= 1.0 - stuck_off, STUCK_OFF, GOOD))
    return faults.astype(np.int64)


def wilson(count: int, n: int) -> tuple[float, float]:
    """Wilson 95 % interval of a share.

    >>> [round(bound, 3) for bound in wilson(9, 10)]
    [0.596, 0.982]
    """
    from scipy.stats import binomtest

    interval = binomtest(count, n).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def _probabilities(where: str, stuck_on: float, stuck_off: float) -> tuple[float, float]:
    rule = "a probability in [0, 1]"
    values = [expect_number(f"{where}.stuck_on", stuck_on, rule), expect_number(f"{where}.stuck_off", stuck_off, rule)]
    for name, value in zip(("stuck_on", "stuck_off"), values, strict=True):
        if not 0.0 <= value <= 1.0:
            raise ParameterError(f"{where}.{name}: expected {rule}, got {value:g}. Correct it.")
    if sum(values) > 1.0:
        raise ParameterError(f"{where}.stuck_off: expected at most {1.0 - values[0]:g} beside stuck_on = "
                             f"{values[0]:g}, got {values[1]:g}. A device has one fault at most.")  # fmt: skip
    return values[0], values[1]
