"""What a netlist is made of. Current counts positive from the node `p` through the element to the node `n`.

So a voltage source that delivers power has a negative current, as in SPICE, and a current source takes its current out
of `p` and puts it into `n`. Node "0" is ground.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ohmloom.circuits.waveforms import Waveform, as_waveform
from ohmloom.devices import Device
from ohmloom.errors import ParameterError, UnknownNameError, expect_number, expect_type, shown

if TYPE_CHECKING:
    from ohmloom.circuits.netlist import Netlist

GROUND = "0"
NODE_FIELDS = ("p", "n", "control_p", "control_n")
# A dot joins the names of a subcircuit and of its parts.
NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")


@dataclass(frozen=True, kw_only=True)
class Resistor:
    """``i = v/resistance`` [ohm]; 0 joins its nodes, and its current is still known."""

    name: str
    p: str
    n: str
    resistance: float

    def __post_init__(self) -> None:
        _check(self)
        _number(self, "resistance", "Ohm", low=0.0, is_low_allowed=True)


@dataclass(frozen=True, kw_only=True)
class Capacitor:
    """``i = capacitance dv/dt`` [F], with the voltage `initial` [V] at t = 0 of a transient; open at DC."""

    name: str
    p: str
    n: str
    capacitance: float
    initial: float = 0.0

    def __post_init__(self) -> None:
        _check(self)
        _number(self, "capacitance", "F", low=0.0)
        _number(self, "initial", "V")


@dataclass(frozen=True, kw_only=True)
class VoltageSource:
    """An ideal source: `voltage` [V] of `p` above `n`, a number or a `Waveform`."""

    name: str
    p: str
    n: str
    voltage: float | Waveform

    def __post_init__(self) -> None:
        _check(self)
        object.__setattr__(self, "voltage", as_waveform(f"{self.name}.voltage", self.voltage, "V"))


@dataclass(frozen=True, kw_only=True)
class CurrentSource:
    """An ideal source: `current` [A] out of node `p`, through the source, into node `n`; a number or a `Waveform`."""

    name: str
    p: str
    n: str
    current: float | Waveform

    def __post_init__(self) -> None:
        _check(self)
        object.__setattr__(self, "current", as_waveform(f"{self.name}.current", self.current, "A"))


@dataclass(frozen=True, kw_only=True)
class Memristor:
    """A `Device` between `p`, its first terminal, and `n`, with the state `s0` at t = 0; `clip` walls."""

    name: str
    p: str
    n: str
    device: Device
    s0: float

    def __post_init__(self) -> None:
        _check(self)
        expect_type(f"{self.name}.device", self.device, Device)
        s0 = expect_number(f"{self.name}.s0", self.s0, "a state, 0 <= s0 <= 1")
        if not 0.0 <= s0 <= 1.0:
            raise ParameterError(f"{self.name}.s0: expected a state, 0 <= s0 <= 1, got {s0:g}. Correct it.")
        object.__setattr__(self, "s0", s0)


@dataclass(frozen=True, kw_only=True)
class VCVS:
    """Voltage-controlled voltage source: ``v(p) - v(n) = gain (v(control_p) - v(control_n))``."""

    name: str
    p: str
    n: str
    control_p: str
    control_n: str
    gain: float

    def __post_init__(self) -> None:
        _check(self)
        _number(self, "gain", "V/V")


@dataclass(frozen=True, kw_only=True)
class VCCS:
    """Voltage-controlled current source: ``i = transconductance (v(control_p) - v(control_n))`` [S], from p to n."""

    name: str
    p: str
    n: str
    control_p: str
    control_n: str
    transconductance: float

    def __post_init__(self) -> None:
        _check(self)
        _number(self, "transconductance", "S")


@dataclass(frozen=True, kw_only=True)
class Subcircuit:
    """A copy of another netlist: its ports, by name, on nodes of this one.

    Its element R1 is called ``name.R1`` in results, and its inner node mid ``name.mid``.
    """

    name: str
    netlist: Netlist
    nodes: Mapping[str, str]

    def __post_init__(self) -> None:
        from ohmloom.circuits.netlist import Netlist

        check_name("Subcircuit.name", self.name)
        expect_type(f"{self.name}.netlist", self.netlist, Netlist)
        expect_type(f"{self.name}.nodes", self.nodes, Mapping, name="nodes by port")
        for port, node in self.nodes.items():
            if port not in self.netlist.ports:
                raise UnknownNameError.of(f"{self.name}.nodes", str(port), self.netlist.ports)
            check_node(f"{self.name}.nodes[{port}]", node)
        missing = [port for port in self.netlist.ports if port not in self.nodes]
        if missing:
            raise ParameterError(f"{self.name}.nodes: expected a node for each port of {self.netlist.name}, got "
                                 f"none for {', '.join(missing)}. Connect it.")  # fmt: skip
        object.__setattr__(self, "nodes", MappingProxyType(dict(self.nodes)))


Simple = Resistor | Capacitor | VoltageSource | CurrentSource | Memristor | VCVS | VCCS
Element = Simple | Subcircuit
ELEMENTS: dict[str, type[Element]] = {
    "resistor": Resistor,
    "capacitor": Capacitor,
    "voltage_source": VoltageSource,
    "current_source": CurrentSource,
    "memristor": Memristor,
    "vcvs": VCVS,
    "vccs": VCCS,
    "subcircuit": Subcircuit,
}


def nodes_of(element: Element) -> list[str]:
    """All nodes that `element` names, in order."""
    if isinstance(element, Subcircuit):
        return list(element.nodes.values())
    return [getattr(element, field) for field in NODE_FIELDS if hasattr(element, field)]


def check_name(where: str, name: object) -> None:
    """Refuse what SPICE would not read as one word."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise ParameterError(f"{where}: expected letters, digits and _, got {shown(name)}. Rename it.")


def check_node(where: str, node: object) -> None:
    """Refuse what is no name of a node, or what SPICE takes for ground."""
    check_name(where, node)
    if str(node).lower() == "gnd":
        raise ParameterError(f"{where}: expected '0' for ground, got {node!r}. Rename it.")


def _check(element: Any) -> None:
    kind = type(element).__name__
    check_name(f"{kind}.name", element.name)
    for field in NODE_FIELDS:
        if hasattr(element, field):
            check_node(f"{element.name}.{field}", getattr(element, field))
    if element.p == element.n:
        raise ParameterError(f"{element.name}.n: expected another node than p, got {element.n!r} for both. "
                             "Remove the element, or correct a node.")  # fmt: skip


def _number(element: Any, field: str, unit: str, *, low: float | None = None, is_low_allowed: bool = False) -> None:
    where = f"{element.name}.{field}"
    rule = f"a finite number in {unit}"
    if low is not None:
        rule = f"{low:g} {unit} or more" if is_low_allowed else f"a number above {low:g} {unit}"
    number = expect_number(where, getattr(element, field), rule)
    if low is not None and (number < low or (number == low and not is_low_allowed)):
        raise ParameterError(f"{where}: expected {rule}, got {number:g} {unit}. Correct it.")
    object.__setattr__(element, field, number)
