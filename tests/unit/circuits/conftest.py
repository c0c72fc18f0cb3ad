"""The same circuit written out as a dense nodal matrix: slow, and checked by eye."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture(scope="session")
def dense():
    """The function `solve_dense`."""
    return solve_dense


def solve_dense(g, v, r_row, r_column, r_driver, r_sense, drive="left", sense="bottom"):
    """(currents, row potentials, column potentials) of one crossbar; resistances per line, wires above 0."""
    m, n = g.shape
    matrix, source = np.zeros((2 * m * n, 2 * m * n)), np.zeros(2 * m * n)

    def row(i, j):
        return i * n + j

    def column(i, j):
        return m * n + i * n + j

    def resistor(a, b, conductance):
        matrix[a, a] += conductance
        matrix[b, b] += conductance
        matrix[a, b] -= conductance
        matrix[b, a] -= conductance

    def terminal(a, resistance, volts):
        if np.isfinite(resistance):
            matrix[a, a] += 1.0 / resistance
            source[a] += volts / resistance

    for i in range(m):
        terminal(row(i, 0), r_row + r_driver[i], v[i])
        if drive == "both":
            terminal(row(i, n - 1), r_row + r_driver[i], v[i])
        for j in range(n):
            resistor(row(i, j), column(i, j), g[i, j])
            if j + 1 < n:
                resistor(row(i, j), row(i, j + 1), 1.0 / r_row)
            if i + 1 < m:
                resistor(column(i, j), column(i + 1, j), 1.0 / r_column)
    for j in range(n):
        terminal(column(m - 1, j), r_column + r_sense[j], 0.0)
        if sense == "both":
            terminal(column(0, j), r_column + r_sense[j], 0.0)
    x = np.linalg.solve(matrix, source)
    u, w = x[: m * n].reshape(m, n), x[m * n :].reshape(m, n)
    return (g * (u - w)).sum(axis=0), u, w
