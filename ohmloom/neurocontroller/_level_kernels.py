"""The levels that events of one sign reach from one state, in one call."""

from __future__ import annotations

from typing import Any

from ohmloom._arrays import FloatArray
from ohmloom._jit import kernel
from ohmloom.devices._event_kernels import event_state, read_weight
from ohmloom.devices._kernels import conductance


@kernel
def follow(
    law: int, family: int, origin: float, sign: float, event_flux: float, p: Any, bottom: float, top: float,
    reference: float, g_on: float, weights: FloatArray,
) -> int:  # fmt: skip
    """Read weights after 0, 1, 2, ... events from `origin`, into `weights`; returns how many there are to a wall."""
    for k in range(weights.shape[0]):
        s, _, count = event_state(law, family, origin, sign * k, event_flux, p, bottom, top)
        if count != sign * k:
            return k
        weights[k] = read_weight(conductance(law, s, 0.0, p), reference, g_on)
    return len(weights)
