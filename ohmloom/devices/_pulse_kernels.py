"""Pulses on a law's state equation, for any pair of compiled `conductance` and `charge_rate`.

The state obeys the autonomous equation ds/dx = f(s), with x the transported charge or the time, beside a
running integral dy/dx = h(s). Both are advanced by three-stage Gauss collocation (order 6): near a wall the
mirror law's resistance changes tenfold within one event, where a classical Runge-Kutta step needs several
times as many evaluations for the same duration. Walls are `clip`: the state stops there exactly, charge still
passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ohmloom._jit import closure_kernel

# Gauss-Legendre collocation with three stages on [0, 1]; the nodes' offsets are +-sqrt(15)/10.
_R = math.sqrt(15.0)
A11, A12, A13 = 5 / 36, 2 / 9 - _R / 15, 5 / 36 - _R / 30
A21, A22, A23 = 5 / 36 + _R / 24, 2 / 9, 5 / 36 - _R / 24
A31, A32, A33 = 5 / 36 + _R / 30, 2 / 9 + _R / 15, 5 / 36
B1, B2, B3 = 5 / 18, 4 / 9, 5 / 18
# The stages' rates extrapolated to the start of the step.
E1, E2, E3 = 5 / 6 + _R / 6, -2 / 3, 5 / 6 - _R / 6

# Largest relative difference between Simpson's rule, of order 4, and the step's own integral of h, of order 6;
# the latter is then good to 2e-10, also near the mirror law's pole.
ROUGH = 3e-7
# Largest change of s in one step, for laws whose rate depends on s.
STEP_CHANGE = 1.0 / 32.0
# Distance from a wall that counts as being there: two ulp of 1.
WALL = 4.5e-16
# Rounds of fixed-point iteration before a step is halved.
ROUNDS = 12
# A rate that agrees to this, relative to the largest in the step, has converged.
SETTLED = 4e-16

# The same for Newton's rule, whose rates are known to the rounding of s times its slope.
RELAXED = 1e-12
SHIFT = 1e-6
# Roughness of s that passes, of its change and always: the step itself, of order 6, is far better.
STRAIN, LOOSE = 1e-5, 1e-10

# A change of s too small to matter to anything.
STILL = 1e-18


def build_pulses(
    conductance: Callable[..., float], charge_rate: Callable[..., float], tag: str
) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """Make `metered_pulse`, `current_pulse` and `voltage_pulse` out of inner kernels; contracts are in `_kernels`.

    `tag` tells these pulses from those made of other kernels.
    """
    port_voltage = build_port_voltage(conductance, tag)

    @closure_kernel(tag)
    def charge_slopes(law_index: int, s: float, p: Any, q_d: float, voltage: float) -> tuple[float, float]:
        i = conductance(law_index, s, voltage, p) * voltage
        size = abs(i)
        return charge_rate(law_index, s, voltage, i, p) / size / q_d, 1.0 / size

    @closure_kernel(tag)
    def time_slopes(law_index: int, s: float, p: Any, q_d: float, current: float) -> tuple[float, float]:
        v = port_voltage(law_index, s, p, current)
        return charge_rate(law_index, s, v, current, p) / q_d, v * current

    @closure_kernel(tag)
    def held_slopes(law_index: int, s: float, p: Any, q_d: float, voltage: float) -> tuple[float, float]:
        i = conductance(law_index, s, voltage, p) * voltage
        return charge_rate(law_index, s, voltage, i, p) / q_d, i

    over_charge = _build_advance(charge_slopes, f"{tag}_charge")
    over_time = _build_advance(time_slopes, f"{tag}_time")
    over_held = _build_advance(held_slopes, f"{tag}_held")

    @closure_kernel(tag, is_large=True)
    def metered_pulse(
        law_index: int, s: float, p: Any, q_d: float, voltage: float, charge: float
    ) -> tuple[float, float, float]:
        if charge == 0.0:
            return s, 0.0, 0.0
        if not voltage * charge > 0.0:
            return math.nan, math.nan, math.nan
        s_new, duration = over_charge(law_index, s, p, q_d, voltage, abs(charge))
        return s_new, duration, voltage * charge

    @closure_kernel(tag, is_large=True)
    def current_pulse(
        law_index: int, s: float, p: Any, q_d: float, current: float, duration: float
    ) -> tuple[float, float, float]:
        s_new, energy = over_time(law_index, s, p, q_d, current, duration)
        # The state of an autonomous equation never turns back, so |v| is largest at one of the two ends.
        first = abs(port_voltage(law_index, s, p, current))
        last = abs(port_voltage(law_index, s_new, p, current))
        return s_new, energy, max(first, last)

    @closure_kernel(tag, is_large=True)
    def voltage_pulse(
        law_index: int, s: float, p: Any, q_d: float, voltage: float, duration: float
    ) -> tuple[float, float]:
        result: tuple[float, float] = over_held(law_index, s, p, q_d, voltage, duration)
        return result

    return metered_pulse, current_pulse, voltage_pulse


def build_port_voltage(conductance: Callable[..., float], tag: str) -> Callable[..., float]:
    """Make ``(law_index, s, p, i) -> v`` that solves i = G(s, v) v; closed if G does not depend on v."""

    @closure_kernel(tag)
    def port_voltage(law_index: int, s: float, p: Any, i: float) -> float:
        low_field = conductance(law_index, s, 0.0, p)
        high = i / low_field
        g = conductance(law_index, s, high, p)
        if g == low_field:
            return high
        # G rises with |v|, so v lies between i/G(high) and high; bisection is safe on any such law.
        low = i / g
        for _ in range(2000):
            v = 0.5 * (low + high)
            if v in (low, high):
                break
            if abs(conductance(law_index, s, v, p) * v) > abs(i):
                high = v
            else:
                low = v
        return high

    return port_voltage


def _build_advance(slopes: Callable[..., tuple[float, float]], tag: str) -> Callable[..., tuple[float, float]]:
    """Make ``(law_index, s, p, q_d, drive, span) -> (s_new, integral of h)`` for ``(f, h) = slopes(s)``."""

    @closure_kernel(tag)
    def relax(
        law_index: int, s: float, p: Any, q_d: float, drive: float, span: float, f: float
    ) -> tuple[float, float, float, float, float, float, bool]:
        """The stages by simplified Newton iteration, its slope df/ds from a difference: rates, integrands, settled."""
        shift = SHIFT if s < 0.5 else -SHIFT
        z = span * (slopes(law_index, s + shift, p, q_d, drive)[0] - f) / shift
        f1 = f2 = f3 = f / (1.0 - 0.5 * z) if z < 0.0 else f
        y1 = y2 = y3 = 0.0
        # Minors of I - z A.
        m11, m12, m13 = 1.0 - z * A11, -z * A12, -z * A13
        m21, m22, m23 = -z * A21, 1.0 - z * A22, -z * A23
        m31, m32, m33 = -z * A31, -z * A32, 1.0 - z * A33
        c11, c12, c13 = m22 * m33 - m23 * m32, m23 * m31 - m21 * m33, m21 * m32 - m22 * m31
        determinant = m11 * c11 + m12 * c12 + m13 * c13
        for _ in range(ROUNDS):
            s1 = min(max(s + span * (A11 * f1 + A12 * f2 + A13 * f3), 0.0), 1.0)
            s2 = min(max(s + span * (A21 * f1 + A22 * f2 + A23 * f3), 0.0), 1.0)
            s3 = min(max(s + span * (A31 * f1 + A32 * f2 + A33 * f3), 0.0), 1.0)
            g1, y1 = slopes(law_index, s1, p, q_d, drive)
            g2, y2 = slopes(law_index, s2, p, q_d, drive)
            g3, y3 = slopes(law_index, s3, p, q_d, drive)
            r1, r2, r3 = g1 - f1, g2 - f2, g3 - f3
            d1 = (c11 * r1 + (m13 * m32 - m12 * m33) * r2 + (m12 * m23 - m13 * m22) * r3) / determinant
            d2 = (c12 * r1 + (m11 * m33 - m13 * m31) * r2 + (m13 * m21 - m11 * m23) * r3) / determinant
            d3 = (c13 * r1 + (m12 * m31 - m11 * m32) * r2 + (m11 * m22 - m12 * m21) * r3) / determinant
            f1, f2, f3 = f1 + d1, f2 + d2, f3 + d3
            moved = max(abs(d1), abs(d2), abs(d3))
            if moved <= RELAXED * max(abs(f), abs(f1), abs(f3)) or moved * span <= STILL:
                return f1, f2, f3, y1, y2, y3, True
        return f1, f2, f3, y1, y2, y3, False

    @closure_kernel(tag)
    def step(
        law_index: int, s: float, p: Any, q_d: float, drive: float, span: float, f: float, is_stiff: bool
    ) -> tuple[float, float, float, float, bool, bool]:
        """One collocation step: (change of s, its roughness, integral of h, h in the middle, settled, is stiff)."""
        f1 = f2 = f3 = f
        y1 = y2 = y3 = 0.0
        settled = False
        for _ in range(0 if is_stiff else ROUNDS):
            s1 = min(max(s + span * (A11 * f1 + A12 * f2 + A13 * f3), 0.0), 1.0)
            s2 = min(max(s + span * (A21 * f1 + A22 * f2 + A23 * f3), 0.0), 1.0)
            s3 = min(max(s + span * (A31 * f1 + A32 * f2 + A33 * f3), 0.0), 1.0)
            g1, y1 = slopes(law_index, s1, p, q_d, drive)
            g2, y2 = slopes(law_index, s2, p, q_d, drive)
            g3, y3 = slopes(law_index, s3, p, q_d, drive)
            moved = max(abs(g1 - f1), abs(g2 - f2), abs(g3 - f3))
            settled = moved <= SETTLED * max(abs(f), abs(g1), abs(g3)) or moved * span <= STILL
            f1, f2, f3 = g1, g2, g3
            if settled:
                break
        if not settled:
            # Where the state relaxes faster than the step, only Newton's rule converges.
            is_stiff = True
            f1, f2, f3, y1, y2, y3, settled = relax(law_index, s, p, q_d, drive, span, f)
        change, part = span * (B1 * f1 + B2 * f2 + B3 * f3), span * (B1 * y1 + B2 * y2 + B3 * y3)
        # Simpson's rule is blind to the error of a linear relaxation, which has opposite signs at the two ends.
        strain = span * abs(E1 * f1 + E2 * f2 + E3 * f3 - f)
        return change, strain, part, y2, settled, is_stiff

    @closure_kernel(tag)
    def advance(law_index: int, s: float, p: Any, q_d: float, drive: float, span: float) -> tuple[float, float]:
        start, moved, total, left, size = s, 0.0, 0.0, span, span
        f, h = slopes(law_index, s, p, q_d, drive)
        is_stiff = False
        while left > 0.0:
            if not abs(f) < math.inf:
                return math.nan, math.nan
            reach = 1.0 - s if f > 0.0 else s
            if f == 0.0 or reach <= WALL:
                if f > 0.0:
                    s = 1.0
                elif f < 0.0:
                    s = 0.0
                return s, total + slopes(law_index, s, p, q_d, drive)[1] * left
            size = min(left, size, min(reach, STEP_CHANGE) / abs(f))
            change, strain, part, middle, settled, is_stiff = step(law_index, s, p, q_d, drive, size, f, is_stiff)
            can_shrink = size * abs(f) > STILL
            if not settled and can_shrink:
                size *= 0.5
                continue
            if abs(change) > reach + WALL:
                # A rate that grows along the step overshoots the wall: land on it instead.
                size *= reach / abs(change)
                continue
            s_end = min(max(start + (moved + change), 0.0), 1.0)
            f_end, h_end = slopes(law_index, s_end, p, q_d, drive)
            rough = abs((h + 4.0 * middle + h_end) * size / 6.0 - part)
            allowed = ROUGH * abs(part)
            scale = 2.0 if rough <= 0.04 * allowed else 0.9 * (allowed / rough) ** 0.25
            if is_stiff:
                # Steps that Newton's rule allows are long enough to need a check of s itself.
                strain /= STRAIN * abs(change) + LOOSE
                scale = min(scale, 2.0 if strain <= 0.04 else 0.9 * (1.0 / strain) ** 0.25)
                rough = max(rough, strain * allowed)
            if rough > allowed and can_shrink:
                size *= max(scale, 0.1)
                continue
            # Summed apart from s, so that many small steps round once.
            moved += change
            total += part
            left -= size
            size *= scale
            s, f, h = s_end, f_end, h_end
        return s, total

    return advance
