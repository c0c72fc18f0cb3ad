"""Compiled potentials of one crossbar, for other kernels to call: line-preconditioned conjugate gradients in loops.

The method is that of `_line_solver`, without batch. The one to call is

    solve_potentials(g, source, rows, columns, v_row, v_column, u, w, work, tolerance, is_warm) -> iterations

`g`, `source`, `u` and `w` have axes (word_line, bit_line) = (m, n): conductances [S] (0 is open), a current that each
device drives besides from row to column [A] (zeros for plain devices), and the potentials of the row nodes and of the
column nodes [V], which it fills. `rows` and `columns` are ``(segment, near, far)``: ohm per wire segment (0 is
allowed), and of every line the conductance [S] of its terminations before the first and after the last node, the
segment up to there included: 0 is none (a line may float), infinite is ideal and needs `segment` 0. `v_row` (m,) and
`v_column` (n,) are the voltages [V] that they hold. `work` is scratch, C-contiguous of shape ``(SCRATCH, m, n)``, with
nothing to keep in it; nothing is allocated. `tolerance` is the relative error in the energy norm (`TOLERANCE` is as
far as rounding goes). With `is_warm`, `u` holds a guess on entry, which costs nothing and saves iterations.

Returns the iterations, or -1 if they do not converge: then `u` and `w` hold no solution. Terminations, `g` and
`source` must be finite otherwise; nothing is checked here.

Every line is eliminated node by node, with all lines of a set side by side in the inner loop: node is the first axis,
so that the rows are worked on transposed. Pivots are sums of conductances without a difference, so that a floating
line behind small resistances keeps its digits.
"""

from __future__ import annotations

import math
from typing import Any

from ohmloom._jit import inner_kernel, large_kernel

MOST_ITERATIONS = 2000
# Relative error in the energy norm; the potentials' own is of this size.
TOLERANCE = 1e-13
# Where rounding stops it earlier, this still counts as solved.
ACCEPTED = 1e-11
SCRATCH = 11


@inner_kernel
def _factor(g: Any, segment: float, near: Any, far: Any, factors: Any) -> None:
    """Inverse pivots of every wire, axes (node, line); without resistance, those of the whole line in node 0."""
    nodes, lines = g.shape
    first, last = factors[0], factors[nodes - 1]
    if segment == 0.0:
        for a in range(lines):
            first[a] = near[a] + far[a]
        for b in range(nodes):
            devices = g[b]
            for a in range(lines):
                first[a] += devices[a]
        for a in range(lines):
            # An ideal line takes any current: 1/infinity. One that nothing holds is at zero.
            first[a] = 1.0 / first[a] if first[a] > 0.0 else 1.0
        return
    c = 1.0 / segment
    # What holds a node from behind, in series with the segment to the next one.
    for a in range(lines):
        last[a] = near[a]
    for b in range(nodes - 1):
        devices, pivots = g[b], factors[b]
        for a in range(lines):
            held = last[a] + devices[a]
            inverse = 1.0 / (held + c)
            last[a] = c * held * inverse
            pivots[a] = inverse
    devices = g[nodes - 1]
    for a in range(lines):
        held = last[a] + devices[a] + far[a]
        last[a] = 1.0 / held if held > 0.0 else 1.0


@inner_kernel
def _potential(segment: float, factors: Any, put_in: Any, out: Any) -> None:
    """Potentials for currents that are put in, terminations at zero; axes (node, line)."""
    nodes, lines = put_in.shape
    if segment == 0.0:
        first, inverses = out[0], factors[0]
        for a in range(lines):
            first[a] = 0.0
        for b in range(nodes):
            given = put_in[b]
            for a in range(lines):
                first[a] += given[a]
        for a in range(lines):
            first[a] *= inverses[a]
        for b in range(1, nodes):
            here = out[b]
            for a in range(lines):
                here[a] = first[a]
        return
    c = 1.0 / segment
    here, given, inverses = out[0], put_in[0], factors[0]
    for a in range(lines):
        here[a] = given[a] * inverses[a]
    for b in range(1, nodes):
        here, before, given, inverses = out[b], out[b - 1], put_in[b], factors[b]
        for a in range(lines):
            here[a] = (given[a] + c * before[a]) * inverses[a]
    for b in range(nodes - 2, -1, -1):
        here, after, inverses = out[b], out[b + 1], factors[b]
        for a in range(lines):
            here[a] += c * inverses[a] * after[a]


@inner_kernel
def _terminals(near: Any, far: Any, held: Any, put_in: Any) -> None:
    """Add the currents that the terminations put in; an ideal line gets none, its potential is `held`."""
    nodes, lines = put_in.shape
    for a in range(lines):
        if not math.isinf(near[a] + far[a]):
            put_in[0, a] += near[a] * held[a]
            put_in[nodes - 1, a] += far[a] * held[a]


@inner_kernel
def _ideal(near: Any, far: Any, held: Any, out: Any) -> None:
    """Add the voltage of ideal lines."""
    nodes, lines = out.shape
    for a in range(lines):
        if math.isinf(near[a] + far[a]):
            for b in range(nodes):
                out[b, a] += held[a]


@inner_kernel
def _turn(x: Any, out: Any) -> None:
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[j, i] = x[i, j]


@inner_kernel
def _turn_product(g: Any, x: Any, out: Any) -> None:
    """The transpose of the product, element by element."""
    for j in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[j, i] = g[i, j] * x[i, j]


@large_kernel
def solve_potentials(g: Any, source: Any, rows: Any, columns: Any, v_row: Any, v_column: Any, u: Any, w: Any,
                     work: Any, tolerance: float, is_warm: bool) -> int:  # fmt: skip
    """Potentials `u` of the rows and `w` of the columns; see the module for shapes and units."""
    m, n = g.shape
    # Of the columns, axes (word_line, bit_line); then of the rows, turned.
    column_factors, put_in, q = work[0], work[1], work[2]
    row_factors, turned_g = work[3].reshape(n, m), work[4].reshape(n, m)
    x, r, z = work[5].reshape(n, m), work[6].reshape(n, m), work[7].reshape(n, m)
    p, ap, other = work[8].reshape(n, m), work[9].reshape(n, m), work[10].reshape(n, m)
    r_row, row_near, row_far = rows
    r_column, column_near, column_far = columns
    _turn(g, turned_g)
    _factor(turned_g, r_row, row_near, row_far, row_factors)
    _factor(g, r_column, column_near, column_far, column_factors)
    # One sweep of the equations, columns then rows, from the guess or from row nodes at zero.
    for i in range(m):
        for j in range(n):
            put_in[i, j] = source[i, j] + (g[i, j] * u[i, j] if is_warm else 0.0)
    _terminals(column_near, column_far, v_column, put_in)
    _potential(r_column, column_factors, put_in, w)
    _ideal(column_near, column_far, v_column, w)
    for i in range(m):
        for j in range(n):
            put_in[i, j] = g[i, j] * w[i, j] - source[i, j]
    _turn(put_in, other)
    _terminals(row_near, row_far, v_row, other)
    _potential(r_row, row_factors, other, x)
    _ideal(row_near, row_far, v_row, x)
    scale = 0.0
    for j in range(n):
        for i in range(m):
            # Ideal rows put their energy into the columns only.
            scale += abs(turned_g[j, i] * x[j, i] * x[j, i]) + abs(other[j, i] * x[j, i])
            # By how much the sweep moved the rows.
            p[j, i] = x[j, i] - (u[i, j] if is_warm else 0.0)
            other[j, i] = turned_g[j, i] * p[j, i]
    _turn(other, put_in)
    _potential(r_column, column_factors, put_in, q)
    _turn_product(g, q, r)
    _potential(r_row, row_factors, r, z)
    rz = 0.0
    for j in range(n):
        for i in range(m):
            p[j, i], ap[j, i] = z[j, i], r[j, i]
            rz += r[j, i] * z[j, i]
    goal, accepted = tolerance * tolerance * scale, ACCEPTED * ACCEPTED * scale
    iterations = 0
    # Written so that NaN is not taken for convergence.
    while not rz <= goal:
        for j in range(n):
            for i in range(m):
                other[j, i] = turned_g[j, i] * p[j, i]
        _turn(other, put_in)
        _potential(r_column, column_factors, put_in, q)
        _turn_product(g, q, other)
        pq = 0.0
        for j in range(n):
            for i in range(m):
                other[j, i] = ap[j, i] - other[j, i]
                pq += p[j, i] * other[j, i]
        if iterations == MOST_ITERATIONS or not pq > 0.0:
            if rz <= accepted:
                break
            return -1
        step = rz / pq
        for j in range(n):
            for i in range(m):
                x[j, i] += step * p[j, i]
                r[j, i] -= step * other[j, i]
        _potential(r_row, row_factors, r, z)
        after = 0.0
        for j in range(n):
            for i in range(m):
                after += r[j, i] * z[j, i]
        iterations += 1
        # Rounding ends the descent.
        if after >= rz and rz <= accepted:
            break
        ratio = after / rz
        for j in range(n):
            for i in range(m):
                p[j, i] = z[j, i] + ratio * p[j, i]
                ap[j, i] = r[j, i] + ratio * ap[j, i]
        rz = after
    for i in range(m):
        for j in range(n):
            u[i, j] = x[j, i]
            put_in[i, j] = g[i, j] * x[j, i] + source[i, j]
    _terminals(column_near, column_far, v_column, put_in)
    _potential(r_column, column_factors, put_in, w)
    _ideal(column_near, column_far, v_column, w)
    return iterations
