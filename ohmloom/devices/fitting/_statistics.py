"""How sure a fit is: intervals corrected for autocorrelated residuals, profiles, and what trades off against what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._search import Problem

CONFIDENCE = 0.95
LARGEST_CORRELATION = 0.9999
# A coordinate this near its bound, as a share of its range, counts as being there.
AT_BOUND = 1e-3
# Relative size of a column of the Jacobian, or of a singular value, under which the data say nothing of it.
BLIND = 1e-9
SMALLEST_FREEDOM = 5.0
# Width of the range that is left to a coordinate at a corner.
CORNER = 1e-9
PROFILE_POINTS, PROFILE_EVALUATIONS = 40, 60
PROFILE_STEP = 0.5  # of a standard deviation
# Longest step, in a logarithm or a linear parameter's unit, and as a share of the way to the bound.
SMALLEST_STEP, LARGEST_STEP, LARGEST_SHARE = 1e-4, 0.7, 0.12
# Where the limit is crossed, points are added until its neighbours differ by this share of it.
CROSSING_POINTS, CROSSING_GAP = 6, 0.3
# Relative change of the sum of squares at which a point is done, over that of the limit.
CROSSING_ERROR = 0.003


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Local uncertainty at the optimum.

    Attributes
    ----------
    lag1, n_eff
        Per sweep: lag-1 autocorrelation of the residual, and ``N (1 - rho)/(1 + rho)``, what N samples of a
        first-order autoregressive residual count as.
    is_at_bound
        Per coordinate.
    covariance
        Of the coordinates that are at no bound, in all coordinates (zeros elsewhere), already corrected.
    condition, weakest
        Condition number of the Jacobian in the coordinates at no bound, and the unit vector of its smallest singular
        value in all coordinates.
    quantile
        Student's t for 95 %, with N_eff less the number of unknowns as degrees of freedom, at least five: below, a
        correlation estimated from the same residual would only pretend to know more.
    points
        ``N_eff (N - n)/N``: the residual's variance is its sum of squares over this.
    """

    lag1: tuple[float, ...]
    n_eff: tuple[float, ...]
    is_at_bound: tuple[bool, ...]
    covariance: FloatArray
    condition: float
    weakest: FloatArray
    quantile: float
    points: float

    @property
    def ceiling(self) -> float:
        """Factor on the smallest error at which a profile crosses its 95 % limit."""
        return float(np.sqrt(1.0 + self.quantile**2 / self.points))


def assess(problem: Problem, z: FloatArray) -> Uncertainty:
    """Uncertainty at the optimum `z` by the delta method, corrected for autocorrelation."""
    from scipy.stats import t as student

    residual, jacobian = problem.shooting.residual(z), problem.shooting.jacobian(z)
    edges = np.cumsum([len(sweep.t) for sweep in problem.shooting.sweeps])[:-1]
    lag1 = tuple(lag_one(part) for part in np.split(residual, edges))
    sizes = [len(sweep.t) for sweep in problem.shooting.sweeps]
    n_eff = tuple(size * (1.0 - rho) / (1.0 + rho) for size, rho in zip(sizes, lag1, strict=True))
    span = problem.high - problem.low
    at_bound = (z - problem.low < AT_BOUND * span) | (problem.high - z < AT_BOUND * span)
    norms = np.linalg.norm(jacobian, axis=0)
    used = np.flatnonzero(~at_bound & (norms > BLIND * norms.max(initial=0.0)))
    # Coordinates that the data do not see at all belong to the weakest direction, with the bound ones left out.
    blind = np.flatnonzero(~at_bound & (norms <= BLIND * norms.max(initial=0.0)))
    freedom = max(sum(n_eff) - len(used), SMALLEST_FREEDOM)
    ratio = sum(n_eff) * max(len(residual) - len(used), 1) / len(residual)
    variance = float(residual @ residual) / ratio
    _, values, directions = np.linalg.svd(jacobian[:, used], full_matrices=False)
    floored = np.maximum(values, BLIND * values.max(initial=1e-300))
    covariance = np.zeros((len(z), len(z)))
    covariance[np.ix_(used, used)] = variance * (directions.T / floored**2) @ directions
    covariance[blind, blind] = np.inf
    weakest = np.zeros(len(z))
    if len(blind):
        weakest[blind[0]] = 1.0
    elif len(used):
        weakest[used] = directions[-1]
    return Uncertainty(
        lag1=lag1, n_eff=n_eff, is_at_bound=tuple(at_bound.tolist()), covariance=covariance,
        condition=np.inf if len(blind) else float(values[0] / max(values[-1], 1e-300)) if len(used) else 1.0,
        weakest=weakest, quantile=float(student.ppf(0.5 + CONFIDENCE / 2, freedom)), points=ratio,
    )  # fmt: skip


def lag_one(residual: FloatArray) -> float:
    """Lag-1 autocorrelation, held in [0, 0.9999]."""
    total = float(residual @ residual)
    return min(max(float(residual[1:] @ residual[:-1]) / total, 0.0), LARGEST_CORRELATION) if total > 0.0 else 0.0


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
    """

    coordinate: FloatArray
    error: FloatArray
    low: float
    high: float
    is_open: tuple[bool, bool]


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
    points = [point for point in (*reversed(below[0]), (middle, best), *above[0]) if np.isfinite(point[1])]
    return Scan(
        coordinate=np.array([point[0] for point in points]), error=np.array([point[1] for point in points]),
        low=below[1], high=above[1], is_open=(below[2], above[2]),
    )  # fmt: skip


def _walk(problem: Problem, z: FloatArray, direction: FloatArray, middle: float, limit: float, best: float,
          ceiling: float, uncertainty: Uncertainty) -> tuple[list[tuple[float, float]], float, bool]:  # fmt: skip
    """Walk from the optimum towards `limit`: the points, where the ceiling is crossed, and whether it never is."""
    covariance = np.where(np.isfinite(uncertainty.covariance), uncertainty.covariance, 0.0)
    deviation = float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))
    longest = max(min(LARGEST_STEP, LARGEST_SHARE * abs(limit - middle)), SMALLEST_STEP)
    step = min(max(PROFILE_STEP * deviation, SMALLEST_STEP), longest)

    def excess(error: float) -> float:
        """Close to linear in the coordinate, and 1 at the ceiling."""
        return float(np.sqrt(max(error**2 - best**2, 0.0) / (ceiling**2 - best**2)))

    # Enough to place the crossing.
    tolerance = min(CROSSING_ERROR * (uncertainty.ceiling**2 - 1.0), 1e-3)
    points: list[tuple[float, float]] = []
    at, above, here = middle, 0.0, z
    sign = 1.0 if limit > middle else -1.0
    if deviation == 0.0 or deviation > 0.1 * abs(limit - middle):
        # Perhaps nothing is known on this side: then its end fits as well, and a few points show it.
        for share in (1.0, 0.5, 0.25):
            there, reached = _constrained(problem, z, direction, middle + share * (limit - middle), tolerance)
            if excess(reached) > 1.0:
                break
            points.append((middle + share * (limit - middle), reached))
        else:
            return points[::-1], limit, True
        points = []
    for _ in range(PROFILE_POINTS):
        if abs(limit - at) <= 1e-12 * max(1.0, abs(limit)):
            return points, limit, True
        ahead = at + sign * min(step, abs(limit - at))
        there, reached = _constrained(problem, here, direction, ahead, tolerance)
        points.append((ahead, reached))
        if excess(reached) > 1.0:
            inner, outer = (at, above), (ahead, excess(reached))
            for _ in range(CROSSING_POINTS):
                if outer[1] - inner[1] <= CROSSING_GAP:
                    break
                share = min(max((1.0 - inner[1]) / (outer[1] - inner[1]), 0.25), 0.75)
                between = inner[0] + share * (outer[0] - inner[0])
                there, reached = _constrained(problem, here, direction, between, tolerance)
                points.append((between, reached))
                if excess(reached) > 1.0:
                    outer = (between, excess(reached))
                else:
                    inner, here = (between, excess(reached)), there
            crossing = inner[0] + (outer[0] - inner[0]) * (1.0 - inner[1]) / (outer[1] - inner[1])
            return sorted(points, key=lambda point: sign * point[0]), float(crossing), False
        rise = excess(reached) - above
        at, above, here = ahead, excess(reached), there
        step = min(step * (2.0 if rise < 0.2 else 1.0 if rise < 0.5 else 0.5), longest)
    return points, limit, True


def _constrained(
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
    start = np.clip(problem.inside(z)[others], low, high)
    with np.errstate(all="ignore"):
        if not len(others):
            end = whole(start)
        else:
            found = least_squares(lambda y: problem.shooting.residual(whole(y)), start, slopes, method="trf",
                                  bounds=(low, high),
                                  max_nfev=PROFILE_EVALUATIONS, ftol=tolerance)  # fmt: skip
            end = whole(found.x)
    return end, problem.error(end)
