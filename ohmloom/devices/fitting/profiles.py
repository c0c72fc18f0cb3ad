"""Profile likelihood: for each value of one parameter, the best fit that the others allow."""

from __future__ import annotations

import math

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._scan import scan
from ohmloom.devices.fitting._search import Problem
from ohmloom.devices.fitting._statistics import Uncertainty
from ohmloom.devices.fitting.result import ProfileResult

# Beyond these half widths (a factor of 3, or a fifth of the state's range) an interval from the covariance is a
# guess, and the profile is asked.
WIDE_FACTOR, WIDE_STATE = math.log(3.0), 0.2


def needed_profiles(problem: Problem, z: FloatArray, uncertainty: Uncertainty) -> list[int]:
    """Indices of the unknowns that are at a bound, or too uncertain for a linear estimate."""
    found = []
    for k in range(len(z)):
        direction = direction_of(problem, k)
        with np.errstate(invalid="ignore"):
            variance = float(direction @ uncertainty.covariance @ direction)
        half = uncertainty.quantile * math.sqrt(variance) if math.isfinite(variance) else math.inf
        n = len(problem.coordinates.free)
        limit = WIDE_STATE if k >= n else WIDE_FACTOR
        if k < n and problem.coordinates.free[k].scale == "linear":
            limit = 0.2 * float(problem.high[k] - problem.low[k])
        if uncertainty.is_at_bound[k] or half > limit:
            found.append(k)
    return found


def direction_of(problem: Problem, k: int) -> FloatArray:
    """The combination of coordinates that is the logarithm (or value) of the k-th unknown."""
    direction = np.zeros(len(problem.low))
    n = len(problem.coordinates.free)
    direction[k] = 1.0
    if k < n:
        direction[:n] = problem.coordinates.transform()[k]
    return direction


def profile_of(
    problem: Problem, z: FloatArray, k: int, uncertainty: Uncertainty
) -> tuple[ProfileResult, FloatArray | None]:
    """Profile of the k-th unknown (a fitted parameter, or a start state) from `z`; a better point, if one was met."""
    direction = direction_of(problem, k)
    limits = (float(direction @ problem.low), float(direction @ problem.high))
    found = scan(problem, z, direction, limits, uncertainty)
    n = len(problem.coordinates.free)
    is_log = k < n and problem.coordinates.free[k].scale == "log"

    def value(coordinate: float) -> float:
        return math.exp(coordinate) if is_log else coordinate

    profile = ProfileResult(
        values=tuple(value(x) for x in found.coordinate.tolist()), relative_rms=tuple(found.error.tolist()),
        limit=problem.error(z) * uncertainty.ceiling, interval=(value(found.low), value(found.high)),
        is_open=found.is_open,
    )  # fmt: skip
    return profile, found.better
