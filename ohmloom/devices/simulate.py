"""Integration of one device under a driven voltage, with exact walls."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.laws import Law
from ohmloom.errors import OhmloomError, OperationError

# Tolerances of the adaptive integrator, on s: well under 1e-9 of an event-sized change over a whole sweep.
RTOL = 1e-10
ATOL = 1e-13


def integrate(law: Law, p: tuple[float, ...], drive: Callable[[float], float], t: FloatArray, s0: float) -> FloatArray:
    """State s at each of the times `t` under the voltage ``drive(t)``.

    Each gap of `t` is integrated by itself, so that a kink of the drive at a sample costs no accuracy. Walls
    are `clip`: the moment of arrival is located as an event, the state rests while the charge rate points
    outward, and leaves at the moment it turns.

    Raises
    ------
    OperationError
        If the integrator fails; no numbers are returned.
    """
    q_d = float(law.charge_scale(p))

    def rate(time: float, s: float) -> float:
        v = drive(time)
        return float(law.charge_rate(s, v, law.conductance(s, v, p) * v, p)) / q_d

    states = np.empty(len(t))
    states[0] = s = s0
    for k in range(len(t) - 1):
        start, end = float(t[k]), float(t[k + 1])
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                s = _cross_gap(rate, start, end, s, law.name)
        except OhmloomError:
            raise
        except (RuntimeError, ArithmeticError, ValueError) as error:
            raise _failure(law.name, start, end, str(error)) from error
        states[k + 1] = s
    return states


def _failure(name: str, start: float, end: float, got: str) -> OperationError:
    return OperationError(
        f"Device.simulate: expected {name} to be integrated from t = {start:.6g} s to {end:.6g} s, "
        f"got {got.rstrip('.')}. Give t finer steps, or lower the voltage."
    )


def _cross_gap(rate: Callable[[float, float], float], start: float, end: float, s: float, name: str) -> float:
    while start < end:
        if s in (0.0, 1.0):
            start = _release(rate, start, end, s)
            if start >= end:
                return s
        start, s = _between_walls(rate, start, end, s, name)
    return s


def _release(rate: Callable[[float, float], float], start: float, end: float, wall: float) -> float:
    """First time from `start` on at which the rate at the `wall` points inward; `end` if it never does."""
    from scipy.optimize import brentq

    inward = 1.0 if wall == 0.0 else -1.0
    if inward * rate(start, wall) > 0.0:
        return start
    if not inward * rate(end, wall) > 0.0:
        return end
    tolerance = 4.0 * math.ulp(max(abs(start), abs(end)))
    turn = float(brentq(lambda time: rate(time, wall), start, end, xtol=tolerance))
    # Past the root by its own uncertainty, the rate has its final sign.
    return min(turn + 4.0 * tolerance, end)


def _between_walls(
    rate: Callable[[float, float], float], start: float, end: float, s: float, name: str
) -> tuple[float, float]:
    """Integrate until `end` or the first wall; returns (time, state there)."""
    from scipy.integrate import solve_ivp

    # The distance from the nearer wall, so that the first moves away from s = 1 are not lost to rounding.
    sign, origin = (-1.0, 1.0) if s > 0.5 else (1.0, 0.0)

    def far(time: float, y: Any) -> float:
        return float(y[0]) - 1.0

    def near(time: float, y: Any) -> float:
        return float(y[0])

    # SciPy reads an event's settings from attributes of its function, which a type checker does not expect.
    far.terminal, far.direction = True, 1.0  # type: ignore[attr-defined]
    near.terminal, near.direction = True, -1.0  # type: ignore[attr-defined]
    solution = solve_ivp(
        lambda time, y: [sign * rate(time, origin + sign * min(max(float(y[0]), 0.0), 1.0))],
        (start, end),
        [sign * (s - origin)],
        method="DOP853",
        first_step=end - start,
        rtol=RTOL,
        atol=ATOL,
        events=(far, near),
    )
    if solution.status < 0:
        raise _failure(name, start, end, solution.message)
    if solution.status == 1:
        arrival, wall = float(solution.t[-1]), 1.0 - origin if len(solution.t_events[0]) else origin
        # No time passed: the drive is too weak to move the state off its wall by even the smallest float.
        return (arrival, wall) if arrival > start else (end, s)
    return end, origin + sign * min(max(float(solution.y[0, -1]), 0.0), 1.0)
