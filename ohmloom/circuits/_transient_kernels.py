"""Devices of a crossbar followed through time, by an embedded pair of orders 3 and 2, or of 5 and 4.

Each segment of the drive is first tried in one step of the small pair, which pulses of a small charge ask no more of,
then of the large one; a step whose two orders disagree by more than the tolerance is shortened. The last slopes of a
step are the first of the next, across segments too, as drives are continuous: three or six solves a step. Sources: P.
Bogacki, L. F. Shampine, Appl. Math. Lett. 2 (1989) 321; J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6 (1980)
19, table 2.

A device of an ideal law carries its flux, which barely bends within a pulse; any other its state. Both are held within
their walls: a wall within a step is exact for its own device, and the step's length for all others. A device that
starts a step at rest against a wall stays there until its slope points inward; one that a stage takes past a wall at
which its slope is 0 or points inward has been taken too far, and that counts as error.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmloom._jit import inner_kernel, kernel
from ohmloom.circuits._crossbar_kernels import SCRATCH, TOLERANCE, solve_potentials
from ohmloom.devices._kernels import charge_rate, conductance, flux, state_at_flux

# Of each pair: the times of its stages, in each stage the weights of the slopes before it (in the last those of the
# higher order), and the weights of the lower order.
SMALL_NODES = np.array([0.0, 1 / 2, 3 / 4, 1.0])
SMALL_WEIGHTS = np.array([[0.0, 0.0, 0.0], [1 / 2, 0.0, 0.0], [0.0, 3 / 4, 0.0], [2 / 9, 1 / 3, 4 / 9]])
SMALL_LOWER = np.array([7 / 24, 1 / 4, 1 / 3, 1 / 8])
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
WEIGHTS = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
    [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
    [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
LOWER = np.array([5179 / 57600, 0.0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40])
STAGES = 7
# Segments after one that the small pair does not manage, until it is tried again.
PAUSE = 8
# Errors of one sign add up from step to step.
SAFETY = 0.1
# Share of a segment; a state that snaps faster has no step.
SHORTEST = 1e-15
# Of the state: below it errors are those of rounding.
ROUNDING = 2e-15
# In one segment; a law whose state relaxes a million times faster than its drive changes needs as many.
MOST_STEPS = 200_000
NEWTON_ROUNDS = 60
INVERSION_ROUNDS = 80


@inner_kernel
def _state(law: int, p: Any, q_d: float, y: float, y_max: float, s: float) -> float:
    """State of an ideal device of flux `y`, in closed form or by Newton's rule from `s`, held by the walls."""
    if y <= 0.0:
        return 0.0
    if y >= y_max:
        return 1.0
    closed = state_at_flux(law, y, p)
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
    if solve_potentials(g, source, rows, columns, v_row, v_column, u, w, scratch, TOLERANCE, is_driven) < 0:
        return math.nan
    settled = not any_bends
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
def _combine(y: Any, k: Any, weights: Any, count: int, length: float, out: Any) -> None:
    """Where `count` slopes take the states `y`, walls aside."""
    for i in range(y.shape[0]):
        before, after = y[i], out[i]
        for j in range(y.shape[1]):
            after[j] = before[j]
    for part in range(count):
        weight = length * weights[part]
        if weight != 0.0:
            for i in range(y.shape[0]):
                slopes, after = k[part, i], out[i]
                for j in range(y.shape[1]):
                    after[j] += weight * slopes[j]


@inner_kernel
def _attempt(array: Any, y: Any, h: float, drives: Any, t0: float, t1: float, is_small: bool, s: Any, k: Any,
             power: Any, given: Any, volts: Any, end: Any, beyond: Any, rests: Any, now: Any,
             work: Any) -> float:  # fmt: skip
    """One step over the part [t0, t1] of a segment of h seconds, to `end`; returns its error, NaN on failure.

    `k`, `power` and `given` hold slopes, powers of devices and of sources at each stage; the first is known.
    """
    m, n = y.shape
    y_max, which = array[4], array[1]
    row0, row1, column0, column1 = drives
    row, column = now
    nodes = SMALL_NODES if is_small else NODES
    weights = SMALL_WEIGHTS if is_small else WEIGHTS
    lower = SMALL_LOWER if is_small else LOWER
    length, error = h * (t1 - t0), 0.0
    for part in range(1, nodes.shape[0]):
        at = t0 + nodes[part] * (t1 - t0)
        for i in range(m):
            row[i] = row0[i] + at * (row1[i] - row0[i])
        for j in range(n):
            column[j] = column0[j] + at * (column1[j] - column0[j])
        _combine(y, k, weights[part], part, length, end)
        for i in range(m):
            for j in range(n):
                reached = end[i, j]
                if math.isnan(reached):
                    return math.nan
                end[i, j] = min(max(reached, 0.0), y_max[which[i, j]])
                beyond[i, j] = reached - end[i, j]
        given[part] = _slopes(array, end, row, column, s, volts, k[part], power[part], work)
        if math.isnan(given[part]):
            return math.nan
        for i in range(m):
            for j in range(n):
                slope, past = k[part, i, j], beyond[i, j]
                if past != 0.0 and past * slope <= 0.0:
                    error = max(error, abs(past) * _per_state(array, work, i, j))
                if rests[i, j] and (slope < 0.0) == (y[i, j] <= 0.0):
                    k[part, i, j] = 0.0
    _combine(y, k, lower, nodes.shape[0], length, beyond)
    for i in range(m):
        for j in range(n):
            other = min(max(beyond[i, j], 0.0), y_max[which[i, j]])
            off = abs(end[i, j] - other) * _per_state(array, work, i, j)
            # NaN must not pass for no error.
            if not off <= error:
                error = off
    return error


@inner_kernel
def _per_state(array: Any, work: Any, i: int, j: int) -> float:
    """Change of the state for one of what is carried: G/q_d for a flux, G at the stage that was solved last."""
    k = array[1][i, j]
    return work[SCRATCH, i, j] / array[3][k] if array[5][k] else 1.0


@inner_kernel
def _is_still(drives: Any, k: Any) -> bool:
    """Whether the drive stands and no device moves: then none will."""
    row0, row1, column0, column1 = drives
    for i in range(row0.shape[0]):
        if row0[i] != row1[i]:
            return False
    for j in range(column0.shape[0]):
        if column0[j] != column1[j]:
            return False
    for i in range(k.shape[1]):
        for j in range(k.shape[2]):
            if k[0, i, j] != 0.0:
                return False
    return True


@inner_kernel
def _rest(array: Any, y: Any, k: Any, rests: Any) -> None:
    """Find the devices at a wall whose slope points outward, and hold them."""
    y_max, which = array[4], array[1]
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            slope = k[0, i, j]
            at_bottom, at_top = y[i, j] <= 0.0, y[i, j] >= y_max[which[i, j]]
            rests[i, j] = (at_bottom and slope <= 0.0) or (at_top and slope >= 0.0)
            if rests[i, j]:
                k[0, i, j] = 0.0


@kernel
def follow(array: Any, y: Any, s: Any, t: Any, v_row: Any, v_column: Any, tolerance: float, states: Any, currents: Any,
           energies: Any) -> tuple[int, float, int]:  # fmt: skip
    """Integrate over all segments of `t`, axes (time,); drives are linear between times.

    Fills states (time, word_line, bit_line), column currents (time, bit_line) and the energy of each device up to each
    time (time, word_line, bit_line). Returns (0 or the failed segment + 1, energy of the sources, steps).
    """
    m, n = y.shape
    work = np.zeros((SCRATCH + 4, m, n))
    end, volts, beyond, rests = np.empty((m, n)), np.zeros((m, n)), np.empty((m, n)), np.zeros((m, n), np.bool_)
    k, power, given = np.zeros((STAGES, m, n)), np.zeros((STAGES, m, n)), np.zeros(STAGES)
    now = (np.empty(m), np.empty(n))
    supplied, steps, pause = 0.0, 0, 0
    limit = max(SAFETY * tolerance, ROUNDING)
    given[0] = _slopes(array, y, v_row[0], v_column[0], s, volts, k[0], power[0], work)
    if math.isnan(given[0]):
        return 1, supplied, steps
    _rest(array, y, k, rests)
    for segment in range(t.shape[0]):
        if segment > 0:
            h = t[segment] - t[segment - 1]
            drives = (v_row[segment - 1], v_row[segment], v_column[segment - 1], v_column[segment])
            for i in range(m):
                for j in range(n):
                    energies[segment, i, j] = energies[segment - 1, i, j]
            at, size, first = 0.0, 1.0, steps
            if _is_still(drives, k):
                supplied += h * given[0]
                for i in range(m):
                    for j in range(n):
                        energies[segment, i, j] += h * power[0, i, j]
                at = 1.0
            is_small = pause == 0
            pause = max(pause - 1, 0)
            while at < 1.0:
                to = min(at + size, 1.0)
                error = _attempt(
                    array, y, h, drives, at, to, is_small, s, k, power, given, volts, end, beyond, rests, now, work
                )
                if not error <= limit:
                    if math.isnan(error):
                        return segment + 1, supplied, steps
                    if is_small:
                        is_small, pause = False, PAUSE
                        continue
                    size = (to - at) * max(0.1, 0.9 * (limit / error) ** 0.2)
                    if at + size <= at + SHORTEST:
                        return segment + 1, supplied, steps
                    continue
                length, last = h * (to - at), 3 if is_small else STAGES - 1
                for part in range(last):
                    weight = length * (SMALL_WEIGHTS[last, part] if is_small else WEIGHTS[last, part])
                    supplied += weight * given[part]
                    for i in range(m):
                        for j in range(n):
                            energies[segment, i, j] += weight * power[part, i, j]
                for i in range(m):
                    for j in range(n):
                        y[i, j] = end[i, j]
                        k[0, i, j], power[0, i, j] = k[last, i, j], power[last, i, j]
                given[0] = given[last]
                _rest(array, y, k, rests)
                steps += 1
                if steps - first > MOST_STEPS:
                    return segment + 1, supplied, steps
                size = (to - at) * min(8.0, 0.9 * (limit / max(error, 1e-300)) ** 0.2)
                at = to
        for i in range(m):
            for j in range(n):
                states[segment, i, j] = s[i, j]
        for j in range(n):
            total = 0.0
            for i in range(m):
                total += power[0, i, j] / volts[i, j] if volts[i, j] != 0.0 else 0.0
            currents[segment, j] = total
    return 0, supplied, steps
