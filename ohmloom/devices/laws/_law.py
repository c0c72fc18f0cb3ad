"""What a law is: a named table of parameters and two small functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

# Floats, arrays and symbols pass through a law alike, so its arguments have no narrower type.
Value = Any
Parameters = Any

# Pairs of parameters, in whichever law has both, of which the first is the smaller.
ORDERED = (("r_on", "r_off"), ("w_min", "w_max"))


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of a law: its unit, bounds (both allowed) and the scale on which it varies.

    A fit holds a parameter that is not `fitted` at its default unless it is asked to free it: a choice between
    forms of the law, or something that voltage and current alone do not determine.

    >>> Parameter(name="r_on", unit="Ohm", default=100.0, lower=1e-3, upper=1e9, scale="log", doc="on").unit
    'Ohm'
    """

    name: str
    unit: str
    default: float
    lower: float
    upper: float
    scale: Literal["log", "linear"]
    doc: str
    fitted: bool = True


@dataclass(frozen=True, kw_only=True)
class Rounds:
    """A conductance that rounds of Newton's rule find, as its parts: emitted code has a loop, and short derivatives.

    Attributes
    ----------
    count
        How many rounds.
    start, advance
        ``(s, v, p) -> u`` and ``(u, s, v, p) -> u``: what is searched for, and one round.
    finish
        ``(u, s, v, p) -> G``.
    balance
        ``(g, s, v, p)`` that is 0 where g = G, whatever the rounds do: G's slopes follow from its own.
    """

    count: int
    start: Callable[[Value, Value, Parameters], Any]
    advance: Callable[[Value, Value, Value, Parameters], Any]
    finish: Callable[[Value, Value, Value, Parameters], Any]
    balance: Callable[[Value, Value, Value, Parameters], Any]


@dataclass(frozen=True, kw_only=True)
class Law:
    """A device law in the canonical state `s = q/q_d` in [0, 1].

    Equation: ``i = conductance(s, v, p) v`` and ``ds/dt = charge_rate(s, v, i, p) / charge_scale(p)``, with
    `p` the parameters in declared order. Current counts positive from the first terminal through the device
    to the second, `v` is the first terminal's voltage above the second's. A sufficient positive voltage raises
    `s`, and with it the conductance.

    Attributes
    ----------
    conductance
        ``(s, v, p) -> G`` in S, positive, rising with `s`.
    charge_rate
        ``(s, v, i, p) -> dq/dt`` in A: the rate of the state charge, before walls.
    charge_scale
        ``(p) -> q_d`` in C: the state charge between the two walls.
    is_fittable
        False for a law that is too long to fit: its exact derivatives would take minutes for each residual.
    rounds
        The parts of a conductance that is found in rounds, else None.
    flux, state_at_flux
        ``(s, p) -> phi`` in Wb, the integral of v that takes the state from 0 to `s`, and its inverse ``(phi, p)
        -> s``. Only an ideal memristor has them, where ``dq/dt = i`` and G depends on `s` alone; else None.

    The functions take floats, arrays and CasADi symbols alike; what `+ - * / **` and comparisons cannot say comes
    from `_functions`. The last two take numbers and arrays only.
    """

    name: str
    parameters: tuple[Parameter, ...]
    conductance: Callable[[Value, Value, Parameters], Any]
    charge_rate: Callable[[Value, Value, Value, Parameters], Any]
    charge_scale: Callable[[Parameters], Any]
    doc: str
    is_fittable: bool = True
    rounds: Rounds | None = None
    flux: Callable[[Value, Parameters], Any] | None = None
    state_at_flux: Callable[[Value, Parameters], Any] | None = None

    @property
    def is_ideal(self) -> bool:
        """Whether ``M = d phi/d q``: the state charge is the transported charge, and nothing else sets G."""
        return self.flux is not None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names in declared order, the order of `p`."""
        return tuple(parameter.name for parameter in self.parameters)


def problems(law: Law, values: Sequence[float]) -> list[tuple[str, str]]:
    """Check parameter `values`, in declared order; returns pairs of a name and "expected ..., got ...."."""
    found = []
    for parameter, value in zip(law.parameters, values, strict=True):
        name, unit, low, high = parameter.name, parameter.unit, parameter.lower, parameter.upper
        if not low <= value <= high:
            rule = f"expected {low:.15g} <= {name} <= {high:.15g} {unit}, got {value:.15g} {unit}."
            found.append((name, f"{rule} {'Raise' if value < low else 'Lower'} it; check its unit."))
    named = dict(zip(law.parameter_names, values, strict=True))
    for low_name, high_name in ORDERED:
        if not found and {low_name, high_name} <= named.keys() and named[low_name] >= named[high_name]:
            unit = law.parameters[law.parameter_names.index(low_name)].unit
            rule = f"expected 0 < {low_name} < {high_name} = {named[high_name]:.15g} {unit}, "
            advice = f"Lower {low_name} or raise {high_name}."
            found.append((low_name, f"{rule}got {named[low_name]:.15g} {unit}. {advice}"))
    return found
