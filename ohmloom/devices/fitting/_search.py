"""The search for the best fit: screened random starts, one from the data, some by charge regression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._coordinates import Coordinates
from ohmloom.devices.fitting._features import Features
from ohmloom.devices.fitting._shooting import Shooting

Origin = Literal["screened", "nominal", "regression", "profile"]
# A start keeps this share of the range from its bounds, where the trust region would not move.
MARGIN = 1e-6
NOMINAL_STATE = 0.3
EVALUATIONS = 100
POLISH_EVALUATIONS = 300
TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Start:
    """One start of the search and where it led.

    Attributes
    ----------
    origin
        "screened" (a random start that did well at once), "nominal" (sizes from the data), "regression" (solved
        first with the measured current moving the state) or "profile" (met on the way of a profile).
    before, after
        Relative RMS at the start and at the end of the local solution.
    evaluations
        Residuals that the local solution took.
    has_converged
        Whether it ended by its own tolerance.
    coordinates
        Where it ended.
    """

    origin: Origin
    before: float
    after: float
    evaluations: int
    has_converged: bool
    coordinates: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A fit before it is solved: residuals, bounds and what the data suggest."""

    coordinates: Coordinates
    features: Features
    shooting: Shooting
    regression: Shooting | None
    low: FloatArray
    high: FloatArray

    def inside(self, z: FloatArray) -> FloatArray:
        """`z` moved into the bounds, a little off them."""
        margin = MARGIN * (self.high - self.low)
        return np.clip(z, self.low + margin, self.high - margin)

    def error(self, z: FloatArray, shooting: Shooting | None = None) -> float:
        """Root of the sum of squared residuals; infinite where the law gives no number."""
        with np.errstate(all="ignore"):
            r = (shooting or self.shooting).residual(z)
            total = float(r @ r)
        return float(np.sqrt(total)) if np.isfinite(total) else np.inf

    def solve(self, z: FloatArray, shooting: Shooting, evaluations: int = EVALUATIONS) -> tuple[FloatArray, int, bool]:
        """Least squares from `z`: where it ends, residuals used, and whether it converged."""
        from scipy.optimize import least_squares

        with np.errstate(all="ignore"):
            found = least_squares(
                shooting.residual, self.inside(z), shooting.jacobian, bounds=(self.low, self.high), method="trf",
                max_nfev=evaluations, ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE,
            )  # fmt: skip
        return found.x, int(found.nfev), found.status > 0

    def polish(self, z: FloatArray) -> FloatArray:
        """The optimum near `z`, with more evaluations than a start gets; `z` itself if that is no better."""
        end = self.solve(z, self.shooting, POLISH_EVALUATIONS)[0]
        return end if self.error(end) <= self.error(z) else z


def search(problem: Problem, *, screen: int, starts: int, rng: np.random.Generator,
           report: Callable[[int, int, float], None] | None) -> tuple[Start, ...]:  # fmt: skip
    """Every start that gave a finite current, in the order in which they were tried.

    `screen` random starts are tried with one residual each, and the best `starts` of them solved; `report` gets the
    local solutions done, their number and the best relative RMS so far.
    """
    candidates = screened(problem, screen, rng)[:starts]
    chosen: list[tuple[Origin, FloatArray]] = [("screened", z) for z in candidates]
    chosen.append(("nominal", problem.inside(_nominal(problem))))
    if problem.regression is not None:
        chosen.append(("regression", _nominal(problem)))
        chosen += [("regression", z) for z in candidates[:1]]
    tried: list[Start] = []
    for done, (origin, z) in enumerate(chosen):
        if origin == "regression" and problem.regression is not None:
            z = problem.inside(z)
            if np.isfinite(problem.error(z, problem.regression)):
                z = problem.inside(problem.solve(z, problem.regression)[0])
        before = problem.error(z)
        if np.isfinite(before):
            end, evaluations, converged = problem.solve(z, problem.shooting)
            tried.append(Start(origin=origin, before=before, after=problem.error(end), evaluations=evaluations,
                               has_converged=converged, coordinates=tuple(end.tolist())))  # fmt: skip
        if report is not None and tried:
            report(done + 1, len(chosen), min(start.after for start in tried))
    return tuple(tried)


def resolved(problem: Problem, start: Start) -> Start:
    """The same start, solved again from where it ended."""
    end, evaluations, converged = problem.solve(np.array(start.coordinates), problem.shooting)
    return replace(start, after=problem.error(end), evaluations=start.evaluations + evaluations,
                   has_converged=converged, coordinates=tuple(end.tolist()))  # fmt: skip


def screened(problem: Problem, count: int, rng: np.random.Generator) -> list[FloatArray]:
    """Random starts, those with the smallest residual first; those without a finite one are left out."""
    found = []
    for k in range(count):
        z = problem.coordinates.random(problem.features, rng)
        z = problem.inside(np.concatenate([z, rng.uniform(0.0, 1.0, len(problem.shooting.sweeps))]))
        found.append((problem.error(z), k, z))
    return [z for error, _, z in sorted(found, key=lambda entry: entry[:2]) if np.isfinite(error)]


def _nominal(problem: Problem) -> FloatArray:
    z = problem.coordinates.of_values(problem.coordinates.nominal(problem.features))
    return np.concatenate([z, np.full(len(problem.shooting.sweeps), NOMINAL_STATE)])
