"""States as (origin, count): an origin of whole events and the number of STDP events since, with its two walls.

In the charge family the origin is a state s and an event moves it by 1/1000; in the flux family it is a flux
[Wb] and an event is a pulse of fixed voltage and width. Counts of whole events are exact, so a device that is followed
event by event and a table of all levels have the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from ohmloom._jit import closure_kernel, inner_kernel, kernel
from ohmloom.devices._kernels import CLOSED_INVERSES, LAW_INDEX, flux, state_at_flux
from ohmloom.devices.laws import LAWS, Law

CHARGE, FLUX = 0, 1
MEM_LIFETIME = 1000  # Howard et al. 2012, section IX: events from one end of the range to the other
INVERSION_ROUNDS = 200
# Of the state. The error after a step is its square, as G'/G is at most 1/s in the laws that are inverted so.
LAST_STEP = 1e-9


def build_slope(laws: Sequence[tuple[int, Law]]) -> Callable[..., float]:
    """Chain the compiled slopes d phi/d s = q_d/G of ideal laws, each with its index; NaN for any other index."""
    if not laws:

        @closure_kernel("none")
        def none(law_index: int, s: float, p: Any) -> float:
            return float("nan")

        return none
    index, law = laws[0]
    charge_scale, conductance = inner_kernel(law.charge_scale), inner_kernel(law.conductance)
    tail = build_slope(laws[1:])

    @closure_kernel(str(index))
    def choose(law_index: int, s: float, p: Any) -> float:
        return charge_scale(p) / conductance(s, 0.0, p) if law_index == index else tail(law_index, s, p)

    return choose


# Only the laws that need it: this chain is compiled into every kernel that follows events.
_slope = build_slope(
    [(LAW_INDEX[name], law) for name, law in LAWS.items() if law.is_ideal and name not in CLOSED_INVERSES]
)


@kernel
def state_at_any_flux(law: int, phi: float, p: Any) -> float:
    """The s at which the flux is `phi` [Wb], 0 <= phi <= phi(1), before clipping; NaN for a law that is not ideal.

    In closed form where that compiles; else by Newton's rule from s = 0 within a bracket, so that the answer depends on
    `phi` alone. A flux that is concave in s, as G rises with it, is approached from below.
    """
    closed = state_at_flux(law, phi, p)
    if not math.isnan(closed):
        return closed
    if math.isnan(_slope(law, 0.0, p)):
        return math.nan
    if phi <= 0.0:
        return 0.0
    if phi >= flux(law, 1.0, p):
        return 1.0
    low, high, s = 0.0, 1.0, 0.0
    for _ in range(INVERSION_ROUNDS):
        excess = flux(law, s, p) - phi
        if excess > 0.0:
            high = s
        else:
            low = s
        after = s - excess / _slope(law, s, p)
        if abs(after - s) <= LAST_STEP * after:
            return after
        s = after if low < after < high else 0.5 * (low + high)
    return s


@kernel
def event_state(
    law: int, family: int, origin: float, count: float, event_flux: float, p: Any, bottom: float, top: float
) -> tuple[float, float, float]:
    """State s after `count` events from `origin`, and the origin and count to go on from.

    `bottom` and `top` are the walls in the family's coordinate: 0 and 1, or phi(0) and phi(1). At a wall s is exactly
    0 or 1, the origin becomes the wall and the count 0. `event_flux` [Wb] is that of one event, and of no
    account in the charge family.
    """
    x = origin + count * event_flux if family == FLUX else origin + count / MEM_LIFETIME
    if x <= bottom:
        return 0.0, bottom, 0.0
    if x >= top:
        return 1.0, top, 0.0
    if family == FLUX:
        return min(max(state_at_any_flux(law, x, p), 0.0), 1.0), origin, count
    return x, origin, count


@kernel
def read_weight(g: float, reference: float, g_on: float) -> float:
    """W = (G - reference)/(G_on - reference), the reference G_off for linear and constant kinds, 0 for memristors."""
    return (g - reference) / (g_on - reference)
