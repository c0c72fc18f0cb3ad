"""How sure a fit is: intervals corrected for autocorrelated residuals, and what trades off against what."""

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
