"""Compiled entry points: laws by index, and the two pulses that program a cell.

The dispatch is built over `LAWS`, so a new law needs no edit here. Every function takes `law_index` first
(`LAW_INDEX[name]`), and the law's parameters `p` in declared order as any indexable sequence of floats.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from typing import Any

from ohmloom._jit import closure_kernel, inner_kernel, kernel, make_callable
from ohmloom.devices._pulse_kernels import build_pulses
from ohmloom.devices.laws import LAWS, _functions, _shared

LAW_NAMES: tuple[str, ...] = tuple(LAWS)
LAWS_PACKAGE = "ohmloom.devices.laws"
# Laws whose inverse of the flux is a closed form that compiles; the others' is an iteration in NumPy.
CLOSED_INVERSES = ("hp_linear", "linear")
LAW_INDEX: dict[str, int] = {name: index for index, name in enumerate(LAW_NAMES)}


def build_conductance(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled conductances: the first answers to `index`, the second to the next, and so on."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, s: float, v: float, p: Any) -> float:
            return head(s, v, p) if law_index == index else float("nan")

        return last
    tail = build_conductance(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, s: float, v: float, p: Any) -> float:
        return head(s, v, p) if law_index == index else tail(law_index, s, v, p)

    return choose


def build_charge_rate(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled charge rates in the same way."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, s: float, v: float, i: float, p: Any) -> float:
            return head(s, v, i, p) if law_index == index else float("nan")

        return last
    tail = build_charge_rate(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, s: float, v: float, i: float, p: Any) -> float:
        return head(s, v, i, p) if law_index == index else tail(law_index, s, v, i, p)

    return choose


def build_flux(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled fluxes in the same way."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, s: float, p: Any) -> float:
            return head(s, p) if law_index == index else float("nan")

        return last
    tail = build_flux(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, s: float, p: Any) -> float:
        return head(s, p) if law_index == index else tail(law_index, s, p)

    return choose


def build_state_at_flux(functions: Sequence[Callable[..., Any]], index: int = 0) -> Callable[..., float]:
    """Chain compiled inverses of the flux in the same way."""
    head = inner_kernel(functions[0])
    if len(functions) == 1:

        @closure_kernel(str(index))
        def last(law_index: int, phi: float, p: Any) -> float:
            return head(phi, p) if law_index == index else float("nan")

        return last
    tail = build_state_at_flux(functions[1:], index + 1)

    @closure_kernel(str(index))
    def choose(law_index: int, phi: float, p: Any) -> float:
        return head(phi, p) if law_index == index else tail(law_index, phi, p)

    return choose


def no_flux(s: float, p: Any) -> float:
    """What a law that is not ideal has for a flux, and one without a closed form for its inverse."""
    return float("nan")


def no_conductance(s: float, v: float, p: Any) -> float:
    """What a law that is not ideal has where only ideal ones are asked for."""
    return float("nan")


def _teach_helpers() -> None:
    """Let compiled laws call what they share: the functions of `_functions`, and those of each other's modules."""
    for function, numeric in _functions.ELEMENTARY.items():
        make_callable(function, numeric)
    modules = [_shared, *(sys.modules[law.charge_rate.__module__] for law in LAWS.values())]
    helpers = {
        member
        for module in modules
        for member in vars(module).values()
        if inspect.isfunction(member) and member.__module__.startswith(LAWS_PACKAGE)
    }
    for helper in sorted(helpers | set(_functions.COMPOSED), key=lambda f: (f.__module__, f.__qualname__)):
        if helper not in _functions.ELEMENTARY:
            make_callable(helper)


_teach_helpers()
_conductance = build_conductance([law.conductance for law in LAWS.values()])
_ideal_conductance = build_conductance(
    [law.conductance if law.is_ideal else no_conductance for law in LAWS.values()], len(LAWS)
)
_charge_rate = build_charge_rate([law.charge_rate for law in LAWS.values()])
_flux = build_flux([law.flux or no_flux for law in LAWS.values()])
_state_at_flux = build_state_at_flux(
    [(law.state_at_flux if name in CLOSED_INVERSES else None) or no_flux for name, law in LAWS.items()]
)
_metered_pulse, _current_pulse, _voltage_pulse = build_pulses(_conductance, _charge_rate, "laws")


@kernel
def conductance(law_index: int, s: float, v: float, p: Any) -> float:
    """G(s, v) in S; NaN for an index that no law has."""
    return _conductance(law_index, s, v, p)


@kernel
def ideal_conductance(law_index: int, s: float, p: Any) -> float:
    """G(s) in S of an ideal law; NaN for any other, which leaves a kernel smaller than `conductance` would."""
    return _ideal_conductance(law_index + len(LAW_NAMES), s, 0.0, p)


@kernel
def charge_rate(law_index: int, s: float, v: float, i: float, p: Any) -> float:
    """dq/dt in A, before walls; NaN for an index that no law has."""
    return _charge_rate(law_index, s, v, i, p)


@kernel
def flux(law_index: int, s: float, p: Any) -> float:
    """phi(s) in Wb; NaN for a law that is not ideal."""
    return _flux(law_index, s, p)


@kernel
def state_at_flux(law_index: int, phi: float, p: Any) -> float:
    """The s at which the flux is `phi` [Wb], before walls; NaN for a law that has no closed form for it."""
    return _state_at_flux(law_index, phi, p)


@kernel
def metered_pulse(
    law_index: int, s: float, p: Any, q_d: float, voltage: float, charge: float
) -> tuple[float, float, float]:
    """Hold `voltage` [V] until the transported charge is `charge` [C], of the same sign.

    Returns (s at the end, duration in s, energy in J); NaN if voltage and charge differ in sign, so that
    the meter never stops.
    """
    result: tuple[float, float, float] = _metered_pulse(law_index, s, p, q_d, voltage, charge)
    return result


@kernel
def current_pulse(
    law_index: int, s: float, p: Any, q_d: float, current: float, duration: float
) -> tuple[float, float, float]:
    """Hold `current` [A], of either sign, for `duration` [s].

    Returns (s at the end, energy in J, largest abs(v) in V).
    """
    result: tuple[float, float, float] = _current_pulse(law_index, s, p, q_d, current, duration)
    return result


@kernel
def voltage_pulse(law_index: int, s: float, p: Any, q_d: float, voltage: float, duration: float) -> tuple[float, float]:
    """Hold `voltage` [V], of either sign, for `duration` [s].

    Returns (s at the end, transported charge in C).
    """
    result: tuple[float, float] = _voltage_pulse(law_index, s, p, q_d, voltage, duration)
    return result
