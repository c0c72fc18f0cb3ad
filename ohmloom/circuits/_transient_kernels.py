"""Devices of a crossbar followed through time: classical Runge-Kutta steps, halved until two halves agree with one.

A device of an ideal law carries its flux, which barely bends within a pulse; any other its state. Both are held within
their walls: a wall within a step is exact for its own device, and the step's length for all others.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmloom._jit import inner_kernel, kernel
from ohmloom.circuits._crossbar_kernels import SCRATCH, TOLERANCE, solve_potentials
from ohmloom.devices._kernels import charge_rate, conductance, flux

MOST_HALVINGS = 40
NEWTON_ROUNDS = 60
INVERSION_ROUNDS = 80


@inner_kernel
def _state(law: int, p: Any, q_d: float, y: float, y_max: float, s: float) -> float:
    """The state of an ideal device whose flux is `y`, by Newton's rule from `s`, kept between the walls."""
    if y <= 0.0:
        return 0.0
    if y >= y_max:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(INVERSION_ROUNDS):
        excess = flux(law, s, p) - y
        if excess > 0.0:
            high = s
        else:
            low = s
        # d flux/d s = q_d/G.
        after = s - excess * conductance(law, s, 0.0, p) / q_d
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - s) <= 4e-16:
            return after
        s = after
    return s


@inner_kernel
def _slopes(array: Any, y: Any, v_row: Any, v_column: Any, s: Any, volts: Any, dy: Any, power: Any, work: Any) -> float:
    """Rates `dy`, device voltages and powers for states `y`; returns the power of all sources [W], NaN on failure."""
    law, which, parameters, q_d, y_max, carries_flux, bends, present, rows, columns = array
    m, n = y.shape
    g, source, u, w = work[SCRATCH], work[SCRATCH + 1], work[SCRATCH + 2], work[SCRATCH + 3]
    any_bends = False
    for i in range(m):
        for j in range(n):
            k = which[i, j]
            held = min(max(y[i, j], 0.0), y_max[k])
            s[i, j] = _state(law[k], parameters[k], q_d[k], held, y_max[k], s[i, j]) if carries_flux[k] else held
            g[i, j] = conductance(law[k], s[i, j], 0.0, parameters[k]) if present[i, j] else 0.0
            source[i, j] = 0.0
            any_bends = any_bends or (bends[k] and present[i, j])
    if solve_potentials(g, source, rows, columns, v_row, v_column, u, w, work[:SCRATCH], TOLERANCE, False) < 0:
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
        if solve_potentials(g, source, rows, columns, v_row, v_column, u, w, work[:SCRATCH], TOLERANCE, False) < 0:
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
def _step(array: Any, y: Any, h: float, row0: Any, row1: Any, column0: Any, column1: Any, t0: float, t1: float, s: Any,
          stage: Any, out: Any, energy: Any, k: Any, power: Any, volts: Any, work: Any) -> float:  # fmt: skip
    """One Runge-Kutta step over the part [t0, t1] of a segment of h seconds; adds to `energy`, returns the sources'."""
    m, n = y.shape
    length = h * (t1 - t0)
    supplied = 0.0
    for part in range(4):
        at = t0 if part == 0 else (t1 if part == 3 else 0.5 * (t0 + t1))
        reach = 0.0 if part == 0 else (1.0 if part == 3 else 0.5)
        weight = 1.0 / 6.0 if part in (0, 3) else 1.0 / 3.0
        for i in range(m):
            for j in range(n):
                stage[i, j] = y[i, j] + (reach * length * k[i, j] if part else 0.0)
                if part == 0:
                    out[i, j] = y[i, j]
        given = _slopes(
            array, stage, row0 + at * (row1 - row0), column0 + at * (column1 - column0), s, volts, k, power, work
        )
        if math.isnan(given):
            return math.nan
        supplied += weight * length * given
        for i in range(m):
            for j in range(n):
                out[i, j] += weight * length * k[i, j]
                energy[i, j] += weight * length * power[i, j]
    for i in range(m):
        for j in range(n):
            out[i, j] = min(max(out[i, j], 0.0), array[4][array[1][i, j]])
    return supplied


@kernel
def follow(array: Any, y: Any, s: Any, t: Any, v_row: Any, v_column: Any, tolerance: float, states: Any, currents: Any,
           energies: Any) -> tuple[int, float, int]:  # fmt: skip
    """Integrate over all segments of `t`, axes (time,); drives are linear between times.

    Fills states (time, word_line, bit_line), column currents (time, bit_line) and the energy of each device up to each
    time (time, word_line, bit_line). Returns (0 or the failed segment + 1, energy of the sources, steps).
    """
    m, n = y.shape
    work = np.zeros((SCRATCH + 4, m, n))
    stage, whole, half, end, k = (
        np.empty((m, n)),
        np.empty((m, n)),
        np.empty((m, n)),
        np.empty((m, n)),
        np.zeros((m, n)),
    )
    power, volts, one, two = np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n))
    y_max, which = array[4], array[1]
    supplied, steps = 0.0, 0
    for segment in range(t.shape[0]):
        if segment > 0:
            h = t[segment] - t[segment - 1]
            row0, row1 = v_row[segment - 1], v_row[segment]
            column0, column1 = v_column[segment - 1], v_column[segment]
            at, size, halvings = 0.0, 1.0, 0
            energies[segment] = energies[segment - 1]
            while at < 1.0:
                to = min(at + size, 1.0)
                middle = 0.5 * (at + to)
                one[:, :] = 0.0
                two[:, :] = 0.0
                _step(array, y, h, row0, row1, column0, column1, at, to, s, stage, whole, one, k, power, volts, work)
                first = _step(
                    array, y, h, row0, row1, column0, column1, at, middle, s, stage, half, two, k, power, volts, work
                )
                second = _step(
                    array, half, h, row0, row1, column0, column1, middle, to, s, stage, end, two, k, power, volts, work
                )
                error = 0.0
                for i in range(m):
                    for j in range(n):
                        error = max(error, abs(end[i, j] - whole[i, j]) / y_max[which[i, j]])
                if math.isnan(first + second) or math.isnan(error):
                    return segment + 1, supplied, steps
                # The two halves are better than what they differ by, fifteen times.
                if error > 15.0 * tolerance:
                    halvings += 1
                    if halvings > MOST_HALVINGS:
                        return segment + 1, supplied, steps
                    size *= max(0.1, min(0.5, 0.9 * (15.0 * tolerance / error) ** 0.2))
                    continue
                steps += 1
                supplied += first + second
                for i in range(m):
                    for j in range(n):
                        y[i, j] = end[i, j]
                        energies[segment, i, j] += two[i, j]
                at = to
                size = min(size * min(4.0, 0.9 * (15.0 * tolerance / max(error, 1e-300)) ** 0.2), 1.0)
                halvings = 0
        if math.isnan(_slopes(array, y, v_row[segment], v_column[segment], s, volts, k, power, work)):
            return segment + 1, supplied, steps
        for i in range(m):
            for j in range(n):
                states[segment, i, j] = s[i, j]
        for j in range(n):
            total = 0.0
            for i in range(m):
                total += power[i, j] / volts[i, j] if volts[i, j] != 0.0 else 0.0
            currents[segment, j] = total
    return 0, supplied, steps
