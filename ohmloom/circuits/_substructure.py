"""The whole operator of a crossbar by recursive substructuring: joining 2 x 2 blocks, port by port.

A block of cells is known by its port admittance matrix Y: left, right, top and bottom ends of its wires. Two neighbours
join by eliminating the ports they share. The work is that of a few dense matrices of the size of the border, O(N^3) for
the operator of N x N devices, whatever the resistances.
"""

from __future__ import annotations

import numpy as np

from ohmloom._arrays import FloatArray


def operator(g: FloatArray, g_row: float, g_column: float, r_driver: FloatArray, r_sense: FloatArray) -> FloatArray:
    """Currents into the senses per volt on each row [S], axes (batch, word_line, bit_line); far ends are open.

    Parameters
    ----------
    g
        Conductances [S], axes (batch, word_line, bit_line).
    g_row, g_column
        Conductance of one wire segment [S], finite.
    r_driver, r_sense
        Resistances [ohm] beyond the first segment of each row, axes (word_line,), and the last of each column, axes
        (bit_line,); 0 and infinite are allowed.
    """
    _, m, n = g.shape
    y = _whole(_padded(g), g_row, g_column)
    size_m, size_n = _power(m), _power(n)
    # The drivers' and the senses' ports; nothing flows out of the others. Rows of padding stand before the first.
    used = np.concatenate([np.arange(size_m - m, size_m), 2 * size_m + size_n + np.arange(n)])
    connected = np.concatenate([used, size_m + np.arange(size_m - m, size_m), 2 * size_m + np.arange(n)])
    y = _open(y[:, connected[:, None], connected[None, :]], m + n)
    # With resistances R at the ports, V = V_0 - R I and I = Y V give I = (1 + Y R)^-1 Y V_0.
    resistance = np.concatenate([r_driver, r_sense])
    floating = np.isinf(resistance)
    if floating.any():
        order = np.argsort(floating, kind="stable")
        kept = order[: int((~floating).sum())]
        y_kept = _open(y[:, order[:, None], order[None, :]], len(kept))
        y = np.zeros_like(y)
        y[:, kept[:, None], kept[None, :]] = y_kept
    r = np.where(floating, 0.0, resistance)
    into = np.linalg.solve(np.eye(m + n) + y * r, y[:, :, :m])
    # What flows out of the array at a column's end flows into its sense.
    return np.ascontiguousarray(np.swapaxes(-into[:, m:], -1, -2))


def _open(y: FloatArray, kept: int) -> FloatArray:
    """Leave all ports but the first `kept` open: no current flows into them."""
    if kept == y.shape[-1]:
        return y
    inner = y[:, kept:, kept:]
    # A port that nothing connects to any other has no potential of its own; any will do.
    lonely = np.abs(y[:, kept:]).sum(axis=-1) == 0.0
    inner = inner + lonely[..., None] * np.eye(inner.shape[-1])
    return y[:, :kept, :kept] - y[:, :kept, kept:] @ np.linalg.solve(inner, y[:, kept:, :kept])


def _power(size: int) -> int:
    return 1 << max(size - 1, 0).bit_length()


def _padded(g: FloatArray) -> FloatArray:
    """Sides that are powers of two, padded where lines end open: no current flows there."""
    batch, m, n = g.shape
    whole = np.zeros((batch, _power(m), _power(n)))
    whole[:, whole.shape[1] - m :, :n] = g
    return whole


def _whole(g: FloatArray, g_row: float, g_column: float) -> FloatArray:
    """Port admittance of the whole array, axes (batch, port, port), ports left, right, top, bottom."""
    batch, m, n = g.shape
    y = np.zeros((batch, m, n, 4, 4))
    # Left port, one segment, row node (the right port); column node (the top port), one segment, bottom port.
    left, right, top, bottom = range(4)
    y[..., left, left] = g_row
    y[..., left, right] = y[..., right, left] = -g_row
    y[..., right, right] = g_row + g
    y[..., right, top] = y[..., top, right] = -g
    y[..., top, top] = g + g_column
    y[..., top, bottom] = y[..., bottom, top] = -g_column
    y[..., bottom, bottom] = g_column
    a, b = 1, 1  # rows and columns of a block
    while y.shape[1] > 1 or y.shape[2] > 1:
        if y.shape[2] > 1:
            y = _beside(y[:, :, 0::2], y[:, :, 1::2], a, b)
            b *= 2
        if y.shape[1] > 1:
            y = _above(y[:, 0::2], y[:, 1::2], a, b)
            a *= 2
    return y[:, 0, 0]


def _beside(one: FloatArray, two: FloatArray, a: int, b: int) -> FloatArray:
    """Join blocks of a x b cells: the right ports of one are the left ports of two."""
    lefts, rights, tops, bottoms = _ports(a, b)
    order_one = [lefts, tops, bottoms, rights]
    order_two = [rights, tops, bottoms, lefts]
    # Outer ports: left of one; right of two; tops of one and two; bottoms of one and two.
    y = _join(one, two, order_one, order_two, a)
    offset = a + 2 * b
    own = np.arange(offset)
    l1, t1, b1 = own[:a], own[a : a + b], own[a + b :]
    r2, t2, b2 = l1 + offset, t1 + offset, b1 + offset
    final = np.concatenate([l1, r2, t1, t2, b1, b2])
    return y[..., final[:, None], final[None, :]]


def _above(one: FloatArray, two: FloatArray, a: int, b: int) -> FloatArray:
    """Join blocks of a x b cells: the bottom ports of one are the top ports of two."""
    lefts, rights, tops, bottoms = _ports(a, b)
    y = _join(one, two, [lefts, rights, tops, bottoms], [lefts, rights, bottoms, tops], b)
    offset = 2 * a + b
    own = np.arange(offset)
    l1, r1, t1 = own[:a], own[a : 2 * a], own[2 * a :]
    l2, r2, b2 = l1 + offset, r1 + offset, t1 + offset
    final = np.concatenate([l1, l2, r1, r2, t1, b2])
    return y[..., final[:, None], final[None, :]]


def _ports(a: int, b: int) -> list[FloatArray]:
    return np.split(np.arange(2 * a + 2 * b), [a, 2 * a, 2 * a + b])


def _join(one: FloatArray, two: FloatArray, order_one: list[FloatArray], order_two: list[FloatArray],
          shared: int) -> FloatArray:  # fmt: skip
    """Eliminate the last `shared` ports of both, each given as a list of groups; outer ports of one, then of two."""
    first, second = np.concatenate(order_one), np.concatenate(order_two)
    p, q = one[..., first[:, None], first[None, :]], two[..., second[:, None], second[None, :]]
    k = p.shape[-1] - shared
    middle = p[..., k:, k:] + q[..., k:, k:]
    to_one, to_two = p[..., k:, :k], q[..., k:, :k]
    toward = np.concatenate([to_one, to_two], axis=-1)
    y = -np.swapaxes(toward, -1, -2) @ np.linalg.solve(middle, toward)
    y[..., :k, :k] += p[..., :k, :k]
    y[..., k:, k:] += q[..., :k, :k]
    return y
