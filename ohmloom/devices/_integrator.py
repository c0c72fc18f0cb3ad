"""From where the state is to the end of a gap or to the first wall, whichever comes first."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

from ohmloom.devices._events import TerminalEvent
from ohmloom.errors import OperationError

Rate = Callable[[float, float], float]
Event = Callable[[float, Any], float]

# Tolerances of the adaptive integrators, on s: well under 1e-9 of an event-sized change over a whole sweep.
RTOL = 1e-10
ATOL = 1e-13
# Newton's iteration asks for 2e-5 of it, which must stay above the rounding of s near 1.
IMPLICIT_ATOL = 1e-10
# Decay within one gap, as -(d rate/d s) times its length, beyond which an explicit method follows stability and not the
# solution: it then needs a step, twelve evaluations, for every six units.
STIFF = 600.0
# The estimate looks at one point, so an explicit run is also given up after this many evaluations.
EXPLICIT_EVALUATIONS = 4000
IMPLICIT_EVALUATIONS = 100_000
# How far past a wall the implicit method asks for a rate: a state that rests nearer to a wall than the tolerance must
# find the rate smooth there.
BEYOND = 10.0 * IMPLICIT_ATOL
# In lengths of the gap and ranges of the state; the evaluations run out before.
LONGEST_PATH = 1e9
# Share of the state's range over which the estimate takes the slope of the rate.
COARSE_DIFFERENCE = 1e-3
# The same for the Jacobian: relative to the distance from the wall (or of the gap), and at the least.
DIFFERENCE, SMALLEST_DIFFERENCE = 1e-6, 1e-10


class _GivenUpError(Exception):
    """An explicit run that took too long."""


def failure(name: str, start: float, end: float, got: str) -> OperationError:
    """The error of an integration of law `name` that ended with `got`."""
    return OperationError(
        f"Device.simulate: expected {name} to be integrated from t = {start:.6g} s to {end:.6g} s, "
        f"got {got.rstrip('.')}. Give t finer steps, or lower the voltage."
    )


def cross_between_walls(rate: Rate, start: float, end: float, s: float, name: str) -> tuple[float, float]:
    """Integrate from the state `s` until `end` or the first wall; returns (time, state there).

    Explicitly in time; where the rate is stiff, or the state snaps faster than times can tell, implicitly along the
    arc length of its path in the plane of time and state.
    """
    if not _is_stiff(rate, start, end, s):
        try:
            return _explicit(rate, start, end, s)
        except _GivenUpError:
            pass
    return _implicit(rate, start, end, s, name)


def _is_stiff(rate: Rate, start: float, end: float, s: float) -> bool:
    low, high = max(s - COARSE_DIFFERENCE, 0.0), min(s + COARSE_DIFFERENCE, 1.0)
    return any((rate(time, low) - rate(time, high)) * (end - start) > STIFF * (high - low) for time in (start, end))


def _explicit(rate: Rate, start: float, end: float, s: float) -> tuple[float, float]:
    from scipy.integrate import solve_ivp

    sign, origin = _nearer_wall(s)
    evaluations = 0

    def slope(time: float, distance: float) -> float:
        return sign * rate(time, origin + sign * min(max(distance, 0.0), 1.0))

    def slopes(time: float, y: Any) -> list[float]:
        nonlocal evaluations
        evaluations += 1
        if evaluations > EXPLICIT_EVALUATIONS:
            raise _GivenUpError
        return [slope(time, float(y[0]))]

    solution = solve_ivp(
        slopes,
        (start, end),
        [sign * (s - origin)],
        method="DOP853",
        first_step=end - start,
        rtol=RTOL,
        atol=ATOL,
        events=_walls(lambda time, _, wall: slope(time, wall) * (1.0 - 2.0 * wall)),
    )
    if solution.status < 0:
        raise _GivenUpError
    if solution.status == 1:
        return float(solution.t[-1]), 1.0 - origin if len(solution.t_events[0]) else origin
    return end, origin + sign * min(max(float(solution.y[0, -1]), 0.0), 1.0)


def _implicit(rate: Rate, start: float, end: float, s: float, name: str) -> tuple[float, float]:
    """Radau along the arc length x: du/dx = 1/sqrt(1 + f^2), ds/dx = f du/dx, with u the share of the gap, f = ds/du.

    Neither slope exceeds 1, so a rate of 1e80/s is a step in s like any other, at a standing time.
    """
    from scipy.integrate import solve_ivp

    sign, origin = _nearer_wall(s)
    gap = end - start
    evaluations = 0

    def speed(share: float, distance: float) -> float:
        time = start + max(share, 0.0) * gap if share < 1.0 else end
        return sign * rate(time, origin + sign * min(max(distance, -BEYOND), 1.0 + BEYOND)) * gap

    def slopes(_: float, y: Any) -> list[float]:
        nonlocal evaluations
        evaluations += 1
        if evaluations > IMPLICIT_EVALUATIONS:
            raise failure(name, start, end, f"more than {IMPLICIT_EVALUATIONS} evaluations of its rate")
        f = speed(float(y[0]), float(y[1]))
        if not math.isfinite(f):
            raise failure(name, start, end, f"a state that moves {f} times its range")
        length = math.hypot(1.0, f)
        return [1.0 / length, f / length]

    def jacobian(_: float, y: Any) -> list[list[float]]:
        # SciPy's own differences are relative to y, and lost to rounding in s where y is a small distance from s = 1.
        share, distance = float(y[0]), float(y[1])
        f = speed(share, distance)
        # Near s = 0, unlike s = 1, small distances are whole numbers of their own rounding.
        least = SMALLEST_DIFFERENCE if origin == 1.0 else 0.0
        nudge_share = math.copysign(DIFFERENCE, 0.5 - share)
        nudge = math.copysign(max(DIFFERENCE * abs(distance), least, ATOL * DIFFERENCE), 0.5 - distance)
        by_share = (speed(share + nudge_share, distance) - f) / nudge_share
        by_distance = (speed(share, distance + nudge) - f) / nudge
        length = math.hypot(1.0, f)
        rows = -f / length / length / length, 1.0 / length / length / length
        return [[row * by_share, row * by_distance] for row in rows]

    def done(_: float, y: Any) -> float:
        return float(y[0]) - 1.0

    solution = solve_ivp(
        slopes,
        (0.0, LONGEST_PATH),
        [0.0, sign * (s - origin)],
        method="Radau",
        jac=jacobian,
        rtol=RTOL,
        atol=IMPLICIT_ATOL,
        events=(*_walls(lambda _, y, wall: speed(float(y[0]), wall) * (1.0 - 2.0 * wall)), TerminalEvent(done, 1.0)),
    )
    if solution.status != 1:
        raise failure(name, start, end, solution.message)
    share, distance = (min(max(float(part), 0.0), 1.0) for part in solution.y[:, -1])
    if len(solution.t_events[2]):
        return end, origin + sign * distance
    return min(start + share * gap, end), 1.0 - origin if len(solution.t_events[0]) else origin


def _nearer_wall(s: float) -> tuple[float, float]:
    """(sign, origin) of the distance from the nearer wall: the first moves away from s = 1 are not lost to rounding."""
    return (-1.0, 1.0) if s > 0.5 else (1.0, 0.0)


def _walls(inward_rate: Callable[[float, Any, float], float]) -> tuple[Event, Event]:
    """Events: the distance from the nearer wall, the last of `y`, comes to 1, the other wall, or back to 0.

    ``inward_rate(x, y, distance)`` is the rate at which the state leaves the wall at that distance. A state that rests
    within the tolerance of a wall may step over it; where the rate there points inward, that is no arrival.
    """

    def far(x: float, y: Any) -> float:
        beyond = float(y[-1]) - 1.0
        return beyond if beyond < 0.0 or inward_rate(x, y, 1.0) <= 0.0 else -sys.float_info.min

    def near(x: float, y: Any) -> float:
        distance = float(y[-1])
        return distance if distance > 0.0 or inward_rate(x, y, 0.0) <= 0.0 else sys.float_info.min

    return TerminalEvent(far, 1.0), TerminalEvent(near, -1.0)
