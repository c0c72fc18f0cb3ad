"""What a read of a crossbar gives, and how well it obeys Kirchhoff's current law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ohmloom._arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One set of lines: resistance of a segment, terminations (line, end=2) [S], and what they hold [V]."""

    segment: float
    ends: FloatArray
    held: FloatArray

    def violation(self, x: FloatArray, device: FloatArray) -> float:
        """Largest sum of currents out of a node, or of a line without resistance; axes (..., line, node)."""
        finite = np.where(np.isinf(self.ends), 0.0, self.ends)
        terminal = finite * (np.stack([x[..., 0], x[..., -1]], axis=-1) - self.held)
        if self.segment == 0.0:
            total = device.sum(axis=-1) + terminal.sum(axis=-1)
            return float(np.abs(np.where(np.isinf(self.ends).any(axis=-1), 0.0, total)).max())
        out, along = device.copy(), np.diff(x, axis=-1) / self.segment
        out[..., :-1] -= along
        out[..., 1:] += along
        out[..., 0] += terminal[..., 0]
        out[..., -1] += terminal[..., 1]
        return float(np.abs(out).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class Read:
    """What a read of a crossbar gives; leading axes are those of conductances and voltages, broadcast.

    Attributes
    ----------
    current
        Into the sense of each column [A], axes (..., bit_line).
    v_row, v_column
        Potential of each crosspoint's node on its row and on its column [V], axes (..., word_line, bit_line).
    device_current
        Through each device, from row to column [A], the same axes.
    iterations
        Of the conjugate gradients; 0 where no line needs any.
    """

    current: FloatArray
    v_row: FloatArray
    v_column: FloatArray
    device_current: FloatArray
    iterations: int
    _sides: tuple[Side, Side]

    @cached_property
    def residual(self) -> float:
        """Largest violation of Kirchhoff's current law at any node, over the largest current in any device."""
        turned = np.swapaxes(self.v_column, -1, -2), -np.swapaxes(self.device_current, -1, -2)
        worst = max(self._sides[0].violation(self.v_row, self.device_current), self._sides[1].violation(*turned))
        largest = float(np.abs(self.device_current).max())
        return worst / largest if largest > 0.0 else worst

    @property
    def device_power(self) -> FloatArray:
        """Power in each device [W], axes (..., word_line, bit_line)."""
        return self.device_current * (self.v_row - self.v_column)
