"""Parallel lines of a crossbar: the potentials of all their nodes for currents that are put into them.

A line is a chain of equal resistances with a node at each crosspoint, closed at either end by a resistance to a known
voltage, or open. Each node also has the conductance of its device to the other set of lines; the voltage at its other
end is part of what is put in. All lines of a batch are one symmetric tridiagonal system, which LAPACK factors once
(pttrf) and solves for any number of right-hand sides (pttrs).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import OperationError

# Conductance [S] to ground of a line that nothing else holds: no current flows, and its potential is then a number.
HOLD = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Factored lines; axes (..., line, node), where leading axes are a batch.

    Attributes
    ----------
    offset
        Potentials [V] without any current put in, from the terminations alone, axes (pattern, batch, line, node).
    driven
        The currents [A] that the terminations put in, the same axes.
    """

    offset: FloatArray
    driven: FloatArray
    lumped: FloatArray | None
    factors: tuple[Any, Any] | None

    def potential(self, injected: FloatArray) -> FloatArray:
        """Potentials [V] for injected currents [A], all terminations at zero, axes (pattern, batch, line, node)."""
        if self.lumped is not None:
            total = injected.sum(axis=-1) * self.lumped
            return np.ascontiguousarray(np.broadcast_to(total[..., None], injected.shape))
        return _solve(self.factors, injected)


def make_lines(devices: FloatArray, segment: float, ends: FloatArray, held: FloatArray) -> Lines:
    """Factor lines.

    Parameters
    ----------
    devices
        Conductance of each node to the other set of lines [S], axes (batch, line, node).
    segment
        Resistance between neighbouring nodes [ohm]; 0 makes each line one node.
    ends
        Conductance [S] of the terminations before the first node and after the last, axes (line, end=2); 0 for open,
        infinite for none between line and source, where `segment` is 0.
    held
        Voltage [V] of the terminations, axes (pattern, batch, line, end=2); those of one line agree where both have
        infinite conductance.
    """
    shape = (*held.shape[:-1], devices.shape[-1])
    driven = np.zeros(shape)
    if segment == 0.0:
        is_ideal = np.isinf(ends).any(axis=-1)
        finite = np.where(np.isinf(ends), 0.0, ends)
        total = devices.sum(axis=-1) + finite.sum(axis=-1)
        total = np.where(total == 0.0, HOLD, total)
        lumped = np.where(is_ideal, 0.0, 1.0 / total)
        into = (finite * held).sum(axis=-1)
        fixed = np.take_along_axis(
            held, np.broadcast_to(np.isinf(ends).argmax(axis=-1), held.shape[:-1])[..., None], -1
        )
        level = np.where(is_ideal, fixed[..., 0], into * lumped)
        driven[..., 0] = np.where(is_ideal, 0.0, into)
        offset = np.ascontiguousarray(np.broadcast_to(level[..., None], shape))
        return Lines(offset=offset, driven=driven, lumped=lumped, factors=None)
    from scipy.linalg.lapack import dpttrf

    nodes = devices.shape[-1]
    coupling = 1.0 / segment
    diagonal = devices + 2.0 * coupling
    diagonal[..., 0] += ends[:, 0] - coupling
    diagonal[..., -1] += ends[:, 1] - coupling
    # A line that neither a termination nor a device holds.
    diagonal[..., 0] += HOLD * ((devices.sum(axis=-1) + ends.sum(axis=-1)) == 0.0)
    off = np.full(devices.shape, -coupling)
    off[..., -1] = 0.0
    d, e, info = dpttrf(diagonal.ravel(), off.ravel()[: max(diagonal.size - 1, 1)])
    if info != 0:
        raise OperationError(f"Crossbar.read: expected lines whose conductances stand out from rounding, got a "
                             f"singular line (LAPACK pttrf: {info}). Check r_row and r_column.")  # fmt: skip
    driven[..., 0] = ends[:, 0] * held[..., 0]
    driven[..., nodes - 1] += ends[:, 1] * held[..., 1]
    return Lines(offset=_solve((d, e), driven), driven=driven, lumped=None, factors=(d, e))


def _solve(factors: Any, injected: FloatArray) -> FloatArray:
    from scipy.linalg.lapack import dpttrs

    d, e = factors
    # The pattern axis is the one of the right-hand sides.
    x, _ = dpttrs(d, e, injected.reshape(injected.shape[0], -1).T)
    return np.ascontiguousarray(x.T).reshape(injected.shape)
