"""Potentials of a crossbar: conjugate gradients on the row nodes, preconditioned by the exact factor of all rows.

With ``u`` the row and ``w`` the column potentials and ``G`` the devices, ``u = u0 + P_r(G w)`` and ``w = w0 + P_c(G
u)``, P the solved lines (`_lines`). Eliminating ``w`` leaves ``(A_r - G A_c^-1 G) u = A_r u0 + G w0`` with ``P =
A^-1``, symmetric and positive; ``A_r`` preconditions it. The number of iterations grows as the square root of ``N^2
g r``.
"""

from __future__ import annotations

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits._lines import Lines
from ohmloom.errors import OperationError

# Error in the energy norm, relative to that of the sources; rounding is reached at about 1e-14.
TOLERANCE = 1e-13
# Where rounding stops it earlier, this still counts as solved.
ACCEPTED = 1e-11
MOST_ITERATIONS = 5000
PATIENCE = 25


def solve(g: FloatArray, rows: Lines, columns: Lines,
          guess: FloatArray | None = None) -> tuple[FloatArray, FloatArray, int]:  # fmt: skip
    """Row and column potentials, axes (pattern, batch, word_line, bit_line), and the iterations used.

    Parameters
    ----------
    g
        Conductances [S], axes (batch, word_line, bit_line).
    rows, columns
        The lines; those of the columns have axes (..., bit_line, word_line).
    guess
        Row potentials to start from.

    Raises
    ------
    OperationError
        If it does not converge; carries the residual and the iterations.
    """
    w0 = _turned(columns.offset)
    source = rows.driven + g * w0
    base = rows.offset + rows.potential(g * w0)
    scale = _dot(source, base)
    # An ideal drive puts its energy into the columns only.
    scale = np.maximum(scale, _dot(g * base, base))

    def coupled(p: FloatArray) -> FloatArray:
        return g * _turned(columns.potential(_turned(g * p)))

    if guess is None:
        u, r = base, coupled(base)
    else:
        u = guess
        # A_r u is not known, so the guess enters as a change of the right-hand side: the error of one fixed-point step.
        u = base + rows.potential(coupled(guess))
        r = coupled(u - guess)
    z = rows.potential(r)
    p, ap = z, r
    rz = _dot(r, z)
    goal = TOLERANCE**2 * scale
    best, since, iterations = rz.copy(), 0, 0
    while (rz > goal).any():
        if iterations >= MOST_ITERATIONS or since >= PATIENCE:
            if (best <= ACCEPTED**2 * scale).all():
                break
            worst = float(np.sqrt(np.max(best / np.maximum(scale, 1e-300))))
            raise OperationError(f"Crossbar.read: expected convergence, got a relative residual of {worst:.1e} "
                                 f"after {iterations} iterations. Check the resistances.")  # fmt: skip
        q = ap - coupled(p)
        pq = _dot(p, q)
        active = (rz > 0.0) & (pq > 0.0)
        step = np.where(active, rz / np.where(active, pq, 1.0), 0.0)[..., None, None]
        u = u + step * p
        r = r - step * q
        z = rows.potential(r)
        after = _dot(r, z)
        ratio = np.where(active, after / np.where(active, rz, 1.0), 0.0)[..., None, None]
        p, ap = z + ratio * p, r + ratio * ap
        rz = after
        iterations += 1
        since = 0 if (rz < 0.9 * best).any() else since + 1
        best = np.minimum(best, rz)
    w = w0 + _turned(columns.potential(_turned(g * u)))
    return u, w, iterations


def _turned(x: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.swapaxes(x, -1, -2))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("...ij,...ij->...", a, b)
    return product
