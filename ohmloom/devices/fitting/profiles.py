"""Profile likelihood: for each value of one parameter, the best fit that the others allow."""

from __future__ import annotations

import math

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._scan import constrained, scan
from ohmloom.devices.fitting._search import Problem
from ohmloom.devices.fitting._statistics import Uncertainty
from ohmloom.devices.fitting.result import ProfileResult

# Beyond these half widths (a factor of 3, a fifth of the state's range, a tenth of the voltage) an interval from the
# covariance is a guess, and the profile is asked.
WIDE_FACTOR, WIDE_STATE, WIDE_VOLTAGE, WIDE_SHARE = math.log(3.0), 0.2, 0.1, 0.2
# So it is where the error at an end of that interval is not near its limit: the excess over the optimum, 1 there.
NEAR_LIMIT = (0.6, 1.6)
END_TOLERANCE = 1e-6


def needed_profiles(problem: Problem, z: FloatArray, uncertainty: Uncertainty) -> list[int]:
    """Indices of the unknowns that are at a bound, or whose interval is too wide or too bent for a linear estimate."""
    found = []
    for k in range(len(z)):
        direction = direction_of(problem, k)
        with np.errstate(invalid="ignore"):
            variance = float(direction @ uncertainty.covariance @ direction)
        half = uncertainty.quantile * math.sqrt(variance) if math.isfinite(variance) else math.inf
        if (
            uncertainty.is_at_bound[k]
            or half > _widest(problem, k)
            or _is_bent(problem, z, direction, half, uncertainty)
        ):
            found.append(k)
    return found


def _widest(problem: Problem, k: int) -> float:
    """Half width up to which a linear estimate may be right."""
    free = problem.coordinates.free
    if k >= len(free):
        return WIDE_STATE
    if free[k].scale == "log":
        return WIDE_FACTOR
    if free[k].unit == "V":
        return WIDE_VOLTAGE * problem.features.voltage
    return WIDE_SHARE * float(problem.high[k] - problem.low[k])


def _is_bent(problem: Problem, z: FloatArray, direction: FloatArray, half: float, uncertainty: Uncertainty) -> bool:
    """Whether the error at either end of the linear interval, all else fitted again, is far from its limit."""
    best, middle = problem.error(z), float(direction @ z)
    if best == 0.0 or half == 0.0:
        return False
    for end in (middle - half, middle + half):
        if not direction @ problem.low <= end <= direction @ problem.high:
            return True
        error = constrained(problem, z, direction, end, END_TOLERANCE)[1]
        excess = math.sqrt(max((error / best) ** 2 - 1.0, 0.0) / (uncertainty.ceiling**2 - 1.0))
        if not NEAR_LIMIT[0] <= excess <= NEAR_LIMIT[1]:
            return True
    return False


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
    # r_off ends where its ratio to the fitted r_on does: further, r_on would be dragged along.
    own = np.where(np.arange(len(z)) == k, 1.0, 0.0)
    rest = float((direction - own) @ z)
    limits = (float(own @ problem.low) + rest, float(own @ problem.high) + rest)
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
