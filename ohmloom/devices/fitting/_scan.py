"""Profile likelihood along one combination of coordinates: walk from the optimum, fit all else again at each point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._search import Problem
from ohmloom.devices.fitting._statistics import Uncertainty

# A point that is lower than the optimum by this factor shows that it is none.
BETTER = 0.999
# Share of the trace of J'J that keeps its inverse finite.
RIDGE = 1e-10
# Width of the range that is left to a coordinate at a corner.
CORNER = 1e-9
PROFILE_POINTS, PROFILE_EVALUATIONS = 40, 60
PROFILE_STEP = 0.5  # of a standard deviation
# Longest step, in a logarithm or a linear parameter's unit, and as a share of the way to the bound.
SMALLEST_STEP, LARGEST_STEP, LARGEST_SHARE = 1e-4, 0.7, 0.12
# A step over the limit counts where it rises by no more than this share of it, or after so many shorter ones.
CROSSING_GAP, CROSSING_STEPS = 0.3, 7
# Relative change of the sum of squares at which a point is done, over that of the limit.
CROSSING_ERROR = 1e-4


@dataclass(frozen=True, kw_only=True)
class Scan:
    """Profile along one combination of coordinates.

    Attributes
    ----------
    coordinate, error
        Values along it, rising, and the smallest error with the others free, axes (point,).
    low, high
        Where the error crosses its 95 % limit; the end of the range where it does not.
    is_open
        Whether it crosses no limit below, above.
    better
        Coordinates of a point that is lower than the optimum by more than rounding, which then is none; else None.
    """

    coordinate: FloatArray
    error: FloatArray
    low: float
    high: float
    is_open: tuple[bool, bool]
    better: FloatArray | None


# Coordinate, error and where the others ended.
Point = tuple[float, float, FloatArray]


def scan(problem: Problem, z: FloatArray, direction: FloatArray, limits: tuple[float, float],
         uncertainty: Uncertainty) -> Scan:  # fmt: skip
    """Profile likelihood along ``direction @ z``: everything else is fitted again at each point.

    The 95 % limit is ``RSS = RSS_min (1 + t^2/(N - n))`` (D. M. Bates, D. G. Watts, Nonlinear Regression Analysis
    and Its Applications, 1988, section 6.1), with N - n scaled by N_eff/N as in the covariance.
    """
    best = problem.error(z)
    middle = float(direction @ z)
    ceiling = best * uncertainty.ceiling
    sides = [_walk(problem, z, direction, middle, limit, best, ceiling, uncertainty) for limit in limits]
    below, above = sides
    # Where the law gives no number there is nothing to draw.
    points = [point for point in (*reversed(below[0]), (middle, best, z), *above[0]) if np.isfinite(point[1])]
    lowest = min(points, key=lambda point: point[1])
    return Scan(
        better=lowest[2] if lowest[1] < BETTER * best else None,
        coordinate=np.array([point[0] for point in points]), error=np.array([point[1] for point in points]),
        low=below[1], high=above[1], is_open=(below[2], above[2]),
    )  # fmt: skip


def _walk(problem: Problem, z: FloatArray, direction: FloatArray, middle: float, limit: float, best: float,
          ceiling: float, uncertainty: Uncertainty) -> tuple[list[Point], float, bool]:  # fmt: skip
    """Walk from the optimum towards `limit`: the points, where the ceiling is crossed, and whether it never is."""
    covariance = np.where(np.isfinite(uncertainty.covariance), uncertainty.covariance, 0.0)
    deviation = float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))
    longest = max(min(LARGEST_STEP, LARGEST_SHARE * abs(limit - middle)), SMALLEST_STEP)
    step = min(max(PROFILE_STEP * deviation, SMALLEST_STEP), longest)

    def excess(error: float) -> float:
        """Close to linear in the coordinate, and 1 at the ceiling."""
        return float(np.sqrt(max(error**2 - best**2, 0.0) / (ceiling**2 - best**2)))

    # Enough to place the crossing.
    tolerance = min(CROSSING_ERROR * (uncertainty.ceiling**2 - 1.0), 1e-4)
    points: list[Point] = []
    at, above, here = middle, 0.0, z
    sign = 1.0 if limit > middle else -1.0
    if deviation == 0.0 or deviation > 0.1 * abs(limit - middle):
        # Perhaps nothing is known on this side: then its end fits as well, and a few points show it.
        for share in (1.0, 0.5, 0.25):
            there, reached = constrained(problem, z, direction, middle + share * (limit - middle), tolerance)
            if excess(reached) > 1.0:
                break
            points.append((middle + share * (limit - middle), reached, there))
        else:
            return points[::-1], limit, True
        points = []
    shrunk = 0
    for _ in range(PROFILE_POINTS):
        if abs(limit - at) <= 1e-12 * max(1.0, abs(limit)):
            return points, limit, True
        ahead = at + sign * min(step, abs(limit - at))
        there, reached = constrained(problem, here, direction, ahead, tolerance)
        points.append((ahead, reached, there))
        rise = excess(reached) - above
        if excess(reached) <= 1.0:
            at, above, here, shrunk = ahead, excess(reached), there, 0
            step = min(step * (2.0 if rise < 0.2 else 1.0 if rise < 0.5 else 0.5), longest)
        elif rise <= CROSSING_GAP or shrunk == CROSSING_STEPS:
            return sorted(points, key=lambda point: sign * point[0]), at + (ahead - at) * (1.0 - above) / rise, False
        else:
            # Either the limit lies between, or the search lost its way on too long a step: a shorter one tells.
            step = abs(ahead - at) * min(max((1.0 - above) / rise, 0.2), 0.6)
            shrunk += 1
            points.pop()
    return points, limit, True


def constrained(
    problem: Problem, z: FloatArray, direction: FloatArray, value: float, tolerance: float
) -> tuple[FloatArray, float]:
    """Fit again with ``direction @ z`` held at `value`; one coordinate follows from the others."""
    from scipy.optimize import least_squares

    # The last one: for r_off, whose direction is r_on plus ratio, that is the ratio.
    k = int(np.flatnonzero(direction)[-1])
    others = np.delete(np.arange(len(z)), k)

    def whole(y: FloatArray) -> FloatArray:
        full = np.empty(len(z))
        full[others] = y
        full[k] = (value - direction[others] @ y) / direction[k]
        return full

    def slopes(y: FloatArray) -> FloatArray:
        jacobian = problem.shooting.jacobian(whole(y))
        return np.asarray(jacobian[:, others] - np.outer(jacobian[:, k], direction[others] / direction[k]))

    low, high = problem.low[others].copy(), problem.high[others].copy()
    for j in np.flatnonzero(direction[others]):
        # What follows must stay in its own range too: r_off above r_on.
        low[j] = max(low[j], value - problem.high[k])
        high[j] = min(high[j], value - problem.low[k])
        # At an end of the range only a corner is left.
        low[j], high[j] = min(low[j], high[j]) - CORNER, max(low[j], high[j]) + CORNER
    guesses = (z, _along_the_valley(problem, z, direction, value))
    starts = [np.clip(problem.inside(guess)[others], low, high) for guess in guesses]
    start = min(starts, key=lambda y: problem.error(whole(y)))
    with np.errstate(all="ignore"):
        if not len(others):
            end = whole(start)
        else:
            found = least_squares(lambda y: problem.shooting.residual(whole(y)), start, slopes, method="trf",
                                  bounds=(low, high),
                                  max_nfev=PROFILE_EVALUATIONS, ftol=tolerance)  # fmt: skip
            end = whole(found.x)
    return end, problem.error(end)


def _along_the_valley(problem: Problem, z: FloatArray, direction: FloatArray, value: float) -> FloatArray:
    """A first guess of the constrained optimum: the move to `value` that changes the residual least, to first order.

    Without it, a search from `z` would have to find its way along a curved valley that is nearly flat.
    """
    jacobian = problem.shooting.jacobian(z)
    matrix = jacobian.T @ jacobian
    matrix += RIDGE * max(float(np.trace(matrix)), 1e-300) * np.eye(len(z))
    move = np.linalg.solve(matrix, direction)
    along = float(direction @ move)
    # Where nothing moves the residual, straight on is as good as any way.
    if not (np.isfinite(move).all() and along > 0.0):
        move, along = direction, float(direction @ direction)
    moved: FloatArray = z + move * (value - float(direction @ z)) / along
    return moved
