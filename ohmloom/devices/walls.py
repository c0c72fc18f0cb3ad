"""Soft walls: the state slows down before an end of its range instead of stopping at it."""

from __future__ import annotations

from typing import Any, Literal

from ohmloom.devices.laws._functions import exp, larger

Walls = Literal["clip", "soft"]
WALLS: tuple[Walls, ...] = ("clip", "soft")
# Share of the state's range over which a soft wall slows it. Source: the study of fits that this project began with,
# where collocation could handle walls that fade over it, and no hard ones; it has no physical origin.
SOFT_WIDTH = 0.02


def soften(s: Any, rate: Any) -> Any:
    """`rate` of the state `s`, faded where it points at a wall: exponentially, over `SOFT_WIDTH` of the range.

    A rising rate is multiplied by ``(1 - e^(-(1 - s)/d))/(1 - e^(-1/d))``, a falling one by ``(1 - e^(-s/d))/(1 -
    e^(-1/d))``, d the width: 0 at the wall ahead, 1 at the wall behind. A state between the walls never reaches one,
    and a state near one leaves it at full speed. Floats, arrays and CasADi symbols alike; past a wall the
    factor stays 0.

    >>> soften(1.0, 3.0), soften(1.0, -3.0), round(soften(0.98, 1.0), 3)
    (0.0, -3.0, 0.632)
    """
    rising = (rate > 0.0) * _fading(1.0 - s)
    falling = (rate < 0.0) * _fading(s)
    return rate * (rising + falling)


def _fading(distance: Any) -> Any:
    return (1.0 - exp(-larger(distance, 0.0) / SOFT_WIDTH)) / (1.0 - exp(-1.0 / SOFT_WIDTH))
