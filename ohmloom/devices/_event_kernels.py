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
from ohmloom.devices._kernels import CLOSED_INVERSES, flux, ideal_conductance, state_at_flux
from ohmloom.devices.laws import LAWS

CHARGE, FLUX = 0, 1
MEM_LIFETIME = 1000  # Howard et al. 2012, section IX: events from one end of the range to the other
INVERSION_ROUNDS = 200
# Of the state. The error after a step is its square, as G'/G is at most 1/s in the laws that are inverted so.
LAST_STEP = 1e-9


def build_charge_scale(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled charge scales: the first answers to `index`, the second to the next, and so on."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, p: Any) -> float:
            return head(p) if law_index == index else float("nan")

        return last
    tail = build_charge_scale(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, p: Any) -> float:
        return head(p) if law_index == index else tail(law_index, p)

    return choose


def no_scale(p: Any) -> float:
    """What a law has that is never inverted here."""
    return float("nan")


# Only where it is needed: what is compiled here is compiled into every kernel that follows events.
_charge_scale = build_charge_scale(
    [law.charge_scale if law.is_ideal and name not in CLOSED_INVERSES else no_scale for name, law in LAWS.items()]
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
    q_d = _charge_scale(law, p)
    if math.isnan(q_d):
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
        # d flux/d s = q_d/G.
        after = s - excess * ideal_conductance(law, s, p) / q_d
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
