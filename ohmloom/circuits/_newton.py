"""Potentials of a crossbar whose devices are not ohmic: Newton's rule around the linear solver.

Each device is replaced by its tangent, a conductance beside a current source; the sources are currents put into the
lines. A step that makes the tangents' error larger is halved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits._line_solver import solve
from ohmloom.circuits._lines import make_lines
from ohmloom.circuits.conduction import Conduction
from ohmloom.errors import OperationError

# Error of a device's current, relative to the largest; rounding of the linear solve stands at about 1e-13.
TOLERANCE = 1e-12
MOST_ROUNDS = 200
Side = tuple[float, FloatArray, FloatArray]


def solve_nonlinear(
    g: FloatArray, rows: Side, columns: Side, conduction: Conduction
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Row and column potentials and device currents, axes (batch, word_line, bit_line), and iterations in all.

    Parameters
    ----------
    g
        Conductances at low field [S], axes (batch, word_line, bit_line).
    rows, columns
        Segment resistance [ohm], terminations [S], axes (line, end), and held voltages [V], axes (1, batch, line, end).

    Raises
    ------
    OperationError
        If it does not converge; carries error and rounds.
    """
    # No voltage in a passive network exceeds the span of its sources.
    held = np.concatenate([rows[2].ravel(), columns[2].ravel(), [0.0]])
    span = float(held.max() - held.min())
    if span > conduction.largest_voltage:
        raise OperationError(f"Crossbar.read: expected at most {conduction.largest_voltage:g} V, beyond which the "
                             f"conduction overflows, got {span:g} V. Lower the voltages.")  # fmt: skip
    at = np.zeros_like(g)
    share, iterations, best = 1.0, 0, np.inf
    for _ in range(MOST_ROUNDS):
        tangent = conduction.slope(g, at)
        source = conduction.current(g, at) - tangent * at
        u, w, used = _solve_tangent(tangent, source, rows, columns)
        iterations += used
        v = np.clip(u - w, -span, span)
        current = conduction.current(g, v)
        error = np.abs(current - tangent * (u - w) - source).max(initial=0.0)
        largest = np.abs(current).max(initial=0.0)
        if error <= TOLERANCE * largest or largest == 0.0:
            return u, w, current, iterations
        share = 1.0 if error < best else max(0.5 * share, 1.0 / 64.0)
        best = min(best, error)
        at = at + share * (v - at)
    raise OperationError(f"Crossbar.read: expected Newton's rule to converge, got a relative error of "
                         f"{error / largest:.1e} after {MOST_ROUNDS} rounds. Widen the selector, or lower the "
                         "voltages.")  # fmt: skip


def _solve_tangent(g: FloatArray, source: FloatArray, rows: Side, columns: Side) -> tuple[FloatArray, FloatArray, int]:
    above = make_lines(g, *rows)
    below = make_lines(np.ascontiguousarray(np.swapaxes(g, -1, -2)), *columns)
    out = -source[None]
    into = np.ascontiguousarray(np.swapaxes(source, -1, -2))[None]
    above = replace(above, offset=above.offset + above.potential(out), driven=above.driven + out)
    below = replace(below, offset=below.offset + below.potential(into), driven=below.driven + into)
    u, w, used = solve(g, above, below)
    return u[0], w[0], used
