"""Devices of a crossbar followed through time, by embedded Runge-Kutta pairs of orders 3(2) and 5(4).

Each segment of the drive is first tried in one step; a step whose two orders disagree by more than the tolerance is
shortened. The last slopes of a step are the first of the next, across segments too, as drives are continuous: six
solves a step, or three where the devices hardly move. Source: J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6
(1980) 19, table 2.

A device of an ideal law carries its flux, which barely bends within a pulse; any other its state. Both are held within
their walls: a wall within a step is exact for its own device, and the step's length for all others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ohmloom._jit import closure_kernel, inner_kernel, kernel
from ohmloom.circuits._crossbar_kernels import SCRATCH, TOLERANCE, solve_potentials
from ohmloom.devices._kernels import charge_rate, conductance, flux, no_flux
from ohmloom.devices.laws import LAWS

STAGES = 7
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
# Weights of earlier slopes for each stage; those of the last stage are those of order 5.
WEIGHTS = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
    [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
    [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
# The pair of Bogacki and Shampine of orders 3 and 2, half the work, where a segment hardly moves the devices.
# Source: P. Bogacki, L. F. Shampine, Appl. Math. Lett. 2 (1989) 321.
QUICK_NODES = np.array([0.0, 1 / 2, 3 / 4, 1.0])
QUICK_WEIGHTS = np.array([[0.0, 0.0, 0.0], [1 / 2, 0.0, 0.0], [0.0, 3 / 4, 0.0], [2 / 9, 1 / 3, 4 / 9]])
QUICK_LOWER_ORDER = np.array([7 / 24, 1 / 4, 1 / 3, 1 / 8])
QUICK_CHANGE = 5e-3  # of the range; beyond it the quick pair is seldom accepted
LOWER_ORDER = np.array([5179 / 57600, 0.0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40])
# Errors of one sign add up from step to step.
SAFETY = 0.1
MOST_SHORTENINGS = 60
# In one segment; a law whose state relaxes a million times faster than its drive changes needs as many.
MOST_STEPS = 200_000
NEWTON_ROUNDS = 60
INVERSION_ROUNDS = 80
# Laws whose inverse of the flux compiles; it is several times faster than Newton's rule on the flux.
CLOSED_FORMS = ("hp_linear", "linear")


def _build_state_at_flux(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled inverses of the flux: the first answers to `index`, the second to the next, and so on."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, phi: float, p: Any) -> float:
            return head(phi, p) if law_index == index else float("nan")

        return last
    tail = _build_state_at_flux(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, phi: float, p: Any) -> float:
        return head(phi, p) if law_index == index else tail(law_index, phi, p)

    return choose


_state_at_flux = _build_state_at_flux(
    [(law.state_at_flux if law.name in CLOSED_FORMS else None) or no_flux for law in LAWS.values()]
)


@inner_kernel
def _state(law: int, p: Any, q_d: float, y: float, y_max: float, s: float) -> float:
    """State of an ideal device of flux `y`, in closed form or by Newton's rule from `s`, held by the walls."""
    if y <= 0.0:
        return 0.0
    if y >= y_max:
        return 1.0
    closed = _state_at_flux(law, y, p)
    if not math.isnan(closed):
        return min(max(closed, 0.0), 1.0)
    low, high = 0.0, 1.0
    for _ in range(INVERSION_ROUNDS):
        excess = flux(law, s, p) - y
        if excess > 0.0:
            high = s
        else:
            low = s
        # d flux/d s = q_d/G.
        after = s - excess * conductance(law, s, 0.0, p) / q_d
        # Newton's rule squares what is left; first, as the bracket is at its end already where s is exact.
        if abs(after - s) <= 1e-9:
            return min(max(after, 0.0), 1.0)
        if not low < after < high:
            after = 0.5 * (low + high)
        s = after
    return s


@inner_kernel
def _slopes(array: Any, y: Any, v_row: Any, v_column: Any, s: Any, volts: Any, dy: Any, power: Any, work: Any) -> float:
    """Rates `dy`, device voltages and powers for states `y`; returns the power of all sources [W], NaN on failure."""
    law, which, parameters, q_d, y_max, carries_flux, bends, present, rows, columns = array
    m, n = y.shape
    scratch = work[:SCRATCH]
    g, source, u, w = work[SCRATCH], work[SCRATCH + 1], work[SCRATCH + 2], work[SCRATCH + 3]
    any_bends, is_driven = False, False
    for i in range(m):
        is_driven = is_driven or v_row[i] != 0.0
    for j in range(n):
        is_driven = is_driven or v_column[j] != 0.0
    for i in range(m):
        for j in range(n):
            k = which[i, j]
            held = min(max(y[i, j], 0.0), y_max[k])
            s[i, j] = _state(law[k], parameters[k], q_d[k], held, y_max[k], s[i, j]) if carries_flux[k] else held
            g[i, j] = conductance(law[k], s[i, j], 0.0, parameters[k]) if present[i, j] else 0.0
            source[i, j] = 0.0
            any_bends = any_bends or (bends[k] and present[i, j])
    if not is_driven:
        # Lines at rest: no device sees a voltage, whatever its law.
        u[:, :] = 0.0
        w[:, :] = 0.0
    elif solve_potentials(g, source, rows, columns, v_row, v_column, u, w, scratch, TOLERANCE, True) < 0:
        return math.nan
    settled = not any_bends or not is_driven
    for _ in range(NEWTON_ROUNDS):
        if settled:
            break
        for i in range(m):
            for j in range(n):
                k = which[i, j]
                if bends[k] and present[i, j]:
                    v = u[i, j] - w[i, j]
                    step = 1e-6 * (abs(v) + 1e-3)
                    current = conductance(law[k], s[i, j], v, parameters[k]) * v
                    further = conductance(law[k], s[i, j], v + step, parameters[k]) * (v + step)
                    g[i, j] = (further - current) / step
                    source[i, j] = current - g[i, j] * v
                    volts[i, j] = v
        if solve_potentials(g, source, rows, columns, v_row, v_column, u, w, scratch, TOLERANCE, is_driven) < 0:
            return math.nan
        largest, moved = 0.0, 0.0
        for i in range(m):
            for j in range(n):
                if bends[which[i, j]] and present[i, j]:
                    moved = max(moved, abs(u[i, j] - w[i, j] - volts[i, j]))
                    largest = max(largest, abs(u[i, j] - w[i, j]))
        settled = moved <= 1e-11 * largest
    if not settled:
        return math.nan
    total = 0.0
    for i in range(m):
        for j in range(n):
            k = which[i, j]
            v = u[i, j] - w[i, j]
            current = g[i, j] * v + source[i, j]
            volts[i, j] = v
            power[i, j] = current * v
            dy[i, j] = v if carries_flux[k] else charge_rate(law[k], s[i, j], v, current, parameters[k]) / q_d[k]
            # What a row's driver and a column's holder put in: their voltage times the current through the device.
            total += current * (v_row[i] - v_column[j])
    return total


@inner_kernel
def _attempt(array: Any, y: Any, h: float, drives: Any, t0: float, t1: float, s: Any, k: Any, power: Any, given: Any,
             volts: Any, end: Any, now: Any, work: Any, nodes: Any, weights: Any,
             lower_order: Any) -> float:  # fmt: skip
    """One step over the part [t0, t1] of a segment of h seconds, to `end`; returns its error, NaN on failure.

    `k`, `power` and `given` hold slopes, powers of devices and of sources at each stage; the first is known. `nodes`,
    `weights` and `lower_order` are the pair's.
    """
    m, n = y.shape
    y_max, which = array[4], array[1]
    row0, row1, column0, column1 = drives
    row, column = now
    length = h * (t1 - t0)
    stages = nodes.shape[0]
    for part in range(1, stages):
        at = t0 + nodes[part] * (t1 - t0)
        for i in range(m):
            row[i] = row0[i] + at * (row1[i] - row0[i])
        for j in range(n):
            column[j] = column0[j] + at * (column1[j] - column0[j])
        for i in range(m):
            for j in range(n):
                moved = 0.0
                for before in range(part):
                    moved += weights[part, before] * k[before, i, j]
                end[i, j] = min(max(y[i, j] + length * moved, 0.0), y_max[which[i, j]])
        given[part] = _slopes(array, end, row, column, s, volts, k[part], power[part], work)
        if math.isnan(given[part]):
            return math.nan
    error = 0.0
    for i in range(m):
        for j in range(n):
            moved, top = 0.0, y_max[which[i, j]]
            for part in range(stages):
                moved += lower_order[part] * k[part, i, j]
            other = min(max(y[i, j] + length * moved, 0.0), top)
            # Of the state: ds = G/q_d d flux for an ideal law, whose G is that at the end now.
            per_state = work[SCRATCH, i, j] / array[3][which[i, j]] if array[5][which[i, j]] else 1.0
            off = abs(end[i, j] - other) * per_state
            # NaN must not pass for no error.
            if not off <= error:
                error = off
    return error


@kernel
def follow(array: Any, y: Any, s: Any, t: Any, v_row: Any, v_column: Any, tolerance: float, states: Any, currents: Any,
           energies: Any) -> tuple[int, float, int]:  # fmt: skip
    """Integrate over all segments of `t`, axes (time,); drives are linear between times.

    Fills states (time, word_line, bit_line), column currents (time, bit_line) and the energy of each device up to each
    time (time, word_line, bit_line). Returns (0 or the failed segment + 1, energy of the sources, steps).
    """
    m, n = y.shape
    work = np.zeros((SCRATCH + 4, m, n))
    end, volts = np.empty((m, n)), np.zeros((m, n))
    k, power, given = np.zeros((STAGES, m, n)), np.zeros((STAGES, m, n)), np.zeros(STAGES)
    now = (np.empty(m), np.empty(n))
    supplied, steps = 0.0, 0
    given[0] = _slopes(array, y, v_row[0], v_column[0], s, volts, k[0], power[0], work)
    if math.isnan(given[0]):
        return 1, supplied, steps
    for segment in range(t.shape[0]):
        if segment > 0:
            h = t[segment] - t[segment - 1]
            drives = (v_row[segment - 1], v_row[segment], v_column[segment - 1], v_column[segment])
            for i in range(m):
                for j in range(n):
                    energies[segment, i, j] = energies[segment - 1, i, j]
            at, size, shortenings, first, largest = 0.0, 1.0, 0, steps, 0.0
            for i in range(m):
                for j in range(n):
                    largest = max(largest, abs(k[0, i, j]) / array[4][array[1][i, j]])
            while at < 1.0:
                to = min(at + size, 1.0)
                is_quick = at == 0.0 and shortenings == 0 and largest * h <= QUICK_CHANGE
                if is_quick:
                    error = _attempt(array, y, h, drives, at, to, s, k, power, given, volts, end, now, work,
                                     QUICK_NODES, QUICK_WEIGHTS, QUICK_LOWER_ORDER)  # fmt: skip
                    is_quick = error <= SAFETY * tolerance
                if not is_quick:
                    error = _attempt(array, y, h, drives, at, to, s, k, power, given, volts, end, now, work,
                                     NODES, WEIGHTS, LOWER_ORDER)  # fmt: skip
                error /= SAFETY
                if not error <= tolerance:
                    shortenings += 1
                    if math.isnan(error) or shortenings > MOST_SHORTENINGS:
                        return segment + 1, supplied, steps
                    size = (to - at) * max(0.1, 0.9 * (tolerance / error) ** 0.2)
                    continue
                length = h * (to - at)
                last = 3 if is_quick else STAGES - 1
                for part in range(last):
                    weight = length * (QUICK_WEIGHTS[last, part] if is_quick else WEIGHTS[last, part])
                    supplied += weight * given[part]
                    for i in range(m):
                        for j in range(n):
                            energies[segment, i, j] += weight * power[part, i, j]
                for i in range(m):
                    for j in range(n):
                        y[i, j] = end[i, j]
                        k[0, i, j], power[0, i, j] = k[last, i, j], power[last, i, j]
                given[0] = given[last]
                steps += 1
                if steps - first > MOST_STEPS:
                    return segment + 1, supplied, steps
                size = (to - at) * min(8.0, 0.9 * (tolerance / max(error, 1e-300)) ** 0.2)
                at, shortenings = to, 0
        for i in range(m):
            for j in range(n):
                states[segment, i, j] = s[i, j]
        for j in range(n):
            total = 0.0
            for i in range(m):
                total += power[0, i, j] / volts[i, j] if volts[i, j] != 0.0 else 0.0
            currents[segment, j] = total
    return 0, supplied, steps
