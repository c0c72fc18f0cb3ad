"""The state of one device under a driven voltage: integration with exact walls, and the closed form in the flux."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices._integrator import cross_between_walls, failure
from ohmloom.devices.laws import Law
from ohmloom.devices.walls import Walls, soften
from ohmloom.errors import OhmloomError

Method = Literal["integrate", "closed_form"]
METHODS: tuple[Method, ...] = ("integrate", "closed_form")
# A state that goes from wall to wall this often within one gap of t has a drive that t does not resolve.
MOST_ARRIVALS = 1000


def integrate(
    law: Law,
    p: tuple[float, ...],
    drive: Callable[[float], float],
    t: FloatArray,
    s0: float,
    walls: Walls = "clip",
    turns: FloatArray | None = None,
) -> FloatArray:
    """State s at each of the times `t` under the voltage ``drive(t)``.

    Each gap of `t` is integrated by itself, so that a kink of the drive at a sample costs no accuracy, and in two
    parts where one of the times `turns` lies inside. Walls that are `clip` stop the state: the moment of arrival is
    located as an event, the state rests while the charge rate points outward, and leaves at the moment it turns.
    Walls that are `soft` slow it down, see `walls.soften`.

    Raises
    ------
    OperationError
        If the integrator fails; no numbers are returned.
    """
    q_d = float(law.charge_scale(p))

    def rate(time: float, s: float) -> float:
        v = drive(time)
        return float(law.charge_rate(s, v, law.conductance(s, v, p) * v, p)) / q_d

    def softened(time: float, s: float) -> float:
        # Past a wall an integrator's trial step finds the rate that there is at the wall.
        held = min(max(s, 0.0), 1.0)
        return float(soften(held, rate(time, held)))

    follow = softened if walls == "soft" else rate
    ends = t if turns is None else np.unique(np.concatenate([t, turns]))
    is_sample = np.isin(ends, t)
    states, s = [s0], s0
    for k, (start, end) in enumerate(pairwise(ends.tolist())):
        try:
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                s = _cross_gap(follow, start, end, s, law.name)
        except OhmloomError:
            raise
        except (RuntimeError, ArithmeticError, ValueError) as error:
            raise failure(law.name, start, end, str(error)) from error
        if is_sample[k + 1]:
            states.append(s)
    if walls == "soft" and 0.0 < s0 < 1.0:
        # A soft wall is reached by rounding alone.
        return np.clip(states, np.finfo(float).tiny, np.nextafter(1.0, 0.0))
    return np.array(states)


def sign_changes(t: FloatArray, v: FloatArray) -> FloatArray:
    """Times strictly inside a gap at which the piecewise linear voltage `v` passes through 0."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        inside = v[:-1] * np.sign(v[1:]) < 0.0
        share = np.where(inside, v[:-1] / (v[:-1] - v[1:]), 0.0)
    times = t[:-1] + share * np.diff(t)
    return np.asarray(times[inside & (times > t[:-1]) & (times < t[1:])])


def follow_flux(law: Law, p: tuple[float, ...], v: FloatArray, t: FloatArray, s0: float) -> FloatArray:
    """State s of an ideal law at each of the times `t`, its voltage piecewise linear between samples: exact.

    The flux is the integral of v, by trapezoids and in two parts where v changes sign within a gap, so that it is
    monotone in each; `clip` walls hold it in [0, flux(1)] after each part.
    """
    assert law.flux is not None
    assert law.state_at_flux is not None
    largest = float(law.flux(1.0, p))
    gap, before, after = np.diff(t), v[:-1], v[1:]
    turn = np.where(before * after < 0.0, before / np.where(before == after, 1.0, before - after), 1.0)
    parts = np.stack([0.5 * (before + np.where(turn < 1.0, 0.0, after)) * gap * turn, 0.5 * after * gap * (1.0 - turn)])
    phi = float(law.flux(s0, p))
    fluxes = []
    for first, second in parts.T.tolist():
        phi = min(max(phi + first, 0.0), largest)
        phi = min(max(phi + second, 0.0), largest)
        fluxes.append(phi)
    flux = np.array(fluxes)
    s = np.clip(law.state_at_flux(flux, p), 0.0, 1.0)
    # The inverse of the largest flux is 1 but for rounding.
    return np.concatenate([[s0], np.where(flux == largest, 1.0, s)])


def _cross_gap(rate: Callable[[float, float], float], start: float, end: float, s: float, name: str) -> float:
    for _ in range(MOST_ARRIVALS):
        if s in (0.0, 1.0):
            start = _release(rate, start, end, s)
        if start >= end:
            return s
        arrival, wall = cross_between_walls(rate, start, end, s, name)
        # Back at the wall that it left, at once: the rate turned within the rounding of the time.
        start = math.nextafter(arrival, math.inf) if (arrival, wall) == (start, s) else arrival
        s = wall
    raise failure(name, start, end, f"more than {MOST_ARRIVALS} arrivals at a wall")


def _release(rate: Callable[[float, float], float], start: float, end: float, wall: float) -> float:
    """First time from `start` on at which the rate at the `wall` points inward; `end` if it never does."""
    inward = 1.0 if wall == 0.0 else -1.0

    def points_inward(time: float) -> bool:
        return inward * rate(time, wall) > 0.0

    if points_inward(start):
        return start
    if not points_inward(end):
        return end
    # By halving: a rate that rests at zero below a threshold has no root to find. `end` points inward all along.
    while start < (middle := 0.5 * (start + end)) < end:
        if points_inward(middle):
            end = middle
        else:
            start = middle
    return end
