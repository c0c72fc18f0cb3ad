"""A general circuit: resistors, capacitors, sources, memristors of any law, subcircuits; solved here or by ngspice."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ohmloom.circuits._topology import check_topology
from ohmloom.circuits.elements import (
    ELEMENTS,
    NODE_FIELDS,
    Element,
    Simple,
    Subcircuit,
    check_name,
    check_node,
    nodes_of,
)
from ohmloom.errors import ParameterError, expect_integer, expect_number, expect_type

if TYPE_CHECKING:
    from ohmloom._arrays import FloatArray
    from ohmloom.circuits.netlist_trace import NetlistTrace, OperatingPoint

MOST_POINTS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class Netlist:
    """Elements between named nodes; node "0" is ground.

    Attributes
    ----------
    elements
        `Resistor`, `Capacitor`, `VoltageSource`, `CurrentSource`, `Memristor`, `VCVS`, `VCCS` and `Subcircuit`, each
        with a name of its own; SPICE ignores the case of letters, so names differ by more.
    ports
        Nodes that a `Subcircuit` of this netlist connects; only these, and ground, are shared.
    t_end
        Duration of a transient [s] unless `simulate` is told otherwise; None if the netlist has none of its own.
    name
        How to call it.

    Raises
    ------
    ParameterError
        If a name stands twice, or a port is a node of no element.

    Examples
    --------
    >>> from ohmloom.circuits import Resistor, VoltageSource
    >>> divider = Netlist(elements=(
    ...     VoltageSource(name="V1", p="in", n="0", voltage=3.0),
    ...     Resistor(name="R1", p="in", n="out", resistance=2e3),
    ...     Resistor(name="R2", p="out", n="0", resistance=1e3),
    ... ))
    >>> point = divider.dc()
    >>> round(point.v["out"], 12), round(point.i["R1"], 12)
    (1.0, 0.001)
    """

    elements: tuple[Element, ...]
    ports: tuple[str, ...] = ()
    t_end: float | None = None
    name: str = "netlist"

    def __post_init__(self) -> None:
        """Check names, and that the parts are elements."""
        for field in ("elements", "ports"):
            expect_type(f"Netlist.{field}", getattr(self, field), tuple, list)
            object.__setattr__(self, field, tuple(getattr(self, field)))
        check_name("Netlist.name", self.name)
        for element in self.elements:
            expect_type("Netlist.elements", element, *ELEMENTS.values(), name="elements")
        if self.t_end is not None:
            object.__setattr__(self, "t_end", _duration("Netlist.t_end", self.t_end))
        for port in self.ports:
            check_node("Netlist.ports", port)
        found = _twice("Netlist.elements", "element", (element.name for element in self.elements))
        found += _twice("Netlist.ports", "port", self.ports)
        nodes = {node for element in self.elements for node in nodes_of(element)}
        found += _variants(nodes)
        found += [
            f"Netlist.ports: expected nodes of its elements other than '0', got {port!r}. Remove it, or connect it."
            for port in self.ports
            if port not in nodes or port == "0"
        ]
        if found:
            raise ParameterError(*found)

    @cached_property
    def flat(self) -> tuple[Simple, ...]:
        """The elements with subcircuits replaced by their parts, whose names and inner nodes are prefixed by theirs."""
        parts: list[Simple] = []
        for element in self.elements:
            if not isinstance(element, Subcircuit):
                parts.append(element)
                continue
            for inner in element.netlist.flat:
                nodes: dict[str, Any] = {
                    field: _outer(element, getattr(inner, field)) for field in NODE_FIELDS if hasattr(inner, field)
                }
                parts.append(replace(inner, name=f"{element.name}.{inner.name}", **nodes))
        found = _twice("Netlist.elements", "element", (part.name for part in parts))
        if found:
            raise ParameterError(*found)
        return tuple(parts)

    @property
    def nodes(self) -> tuple[str, ...]:
        """All nodes but ground, subcircuits included, in the order in which elements name them."""
        named = dict.fromkeys(node for element in self.flat for node in nodes_of(element))
        return tuple(node for node in named if node != "0")

    def dc(self, t: float = 0.0) -> OperatingPoint:
        """Node voltages and element currents with the sources held at the time `t`, capacitors open, memristors at s0.

        Raises
        ------
        ParameterError
            If nodes float, or ideal sources form a loop; names them.
        OperationError
            If Newton's iteration does not settle; no numbers are returned.
        """
        from ohmloom.circuits._netlist_transient import solve_dc

        time = expect_number("Netlist.dc: t", t, "a time in s")
        check_topology(self.flat, is_dc=True)
        return solve_dc(self, time)

    def simulate(
        self, t_end: float | None = None, *, points: int | None = None, t: Any = None, max_step: float | None = None
    ) -> NetlistTrace:
        """Follow the circuit from capacitors at their `initial` voltages and memristors at their `s0`.

        States are integrated to about 1e-9 between the sources' corners; memristors stop exactly at their walls.

        Parameters
        ----------
        t_end
            Duration in s; the netlist's own by default.
        points
            Number of evenly spaced times, 0 and `t_end` included; 1001 by default.
        t
            The times in s themselves, from 0 or later, rising, instead of `t_end` and `points`.
        max_step
            Longest step of the integrator [s]. Corners are never stepped over, so it is seldom needed.

        Raises
        ------
        ParameterError
            If an argument breaks these rules, nodes float, ideal sources form a loop, or `max_step` is longer than an
            edge.
        OperationError
            If the integration fails; no numbers are returned.
        """
        from ohmloom.circuits._netlist_transient import simulate

        times = self._times(t_end, points, t)
        check_topology(self.flat, is_dc=False)
        step = None if max_step is None else self.check_step("Netlist.simulate", max_step)
        return simulate(self, times, step)

    def to_spice(
        self,
        path: str | Path | None = None,
        *,
        t_end: float | None = None,
        max_step: float | None = None,
        relative_tolerance: float = 1e-6,
    ) -> str:
        """The netlist as a deck for ngspice, also written to `path` if one is given; see `spice.deck`."""
        from ohmloom._files import write_atomic
        from ohmloom.circuits.spice import deck

        text = deck(self, t_end=t_end, max_step=max_step, relative_tolerance=relative_tolerance)
        if path is not None:
            write_atomic(path, text)
        return text

    def save(self, path: str | Path) -> None:
        """Write a ``*.netlist.json``; device cards that are not shipped are written beside it."""
        from ohmloom.circuits.netlist_file import save

        save(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> Netlist:
        """Read a ``*.netlist.json``.

        Raises
        ------
        MissingFileError
            If it, or a device card that it names, does not exist.
        FileFormatError
            If it breaks a rule; every problem is named with file, field and value.
        """
        from ohmloom.circuits.netlist_file import load

        return load(path)

    def check_step(self, where: str, max_step: float) -> float:
        """`max_step` as a float, refused where it is longer than an edge of a source."""
        step = _duration(f"{where}: max_step", max_step)
        for element in self.flat:
            waveform: Any = getattr(element, "voltage", getattr(element, "current", None))
            if waveform is not None and waveform.shortest_edge() < step:
                edge = waveform.shortest_edge()
                raise ParameterError(f"{where}: max_step: expected at most {edge:g} s, the shortest edge"
                                     f" of {element.name}, got {step:g} s. Shorten it.")  # fmt: skip
        return step

    def duration(self, where: str, t_end: float | None) -> float | None:
        """`t_end` as given, or else the netlist's own."""
        return self.t_end if t_end is None else _duration(f"{where}: t_end", t_end)

    def _times(self, t_end: float | None, points: int | None, t: Any) -> FloatArray:
        import numpy as np

        from ohmloom._arrays import frozen_array

        where = "Netlist.simulate"
        if t is not None:
            if t_end is not None or points is not None:
                raise ParameterError(f"{where}: t: expected either t, or t_end and points, got both. Leave one out.")
            times: FloatArray = frozen_array(f"{where}: t", t, ("time",))
            if times.size < 1 or times[0] < 0.0 or not (np.diff(times) > 0.0).all() or times[-1] == 0.0:
                raise ParameterError(f"{where}: t: expected times in s from 0 or later on, each above the last, got "
                                     f"{times.size} of them. Sort them and drop repeats.")  # fmt: skip
            return times
        end = self.duration(where, t_end)
        if end is None:
            raise ParameterError(f"{where}: t_end: expected a duration in s, got none. Give one.")
        count = expect_integer(f"{where}: points", 1001 if points is None else points, 2, MOST_POINTS)
        return np.linspace(0.0, end, count)

    def _repr_html_(self) -> str:
        counts = Counter(type(element).__name__ for element in self.flat)
        rows = [("name", self.name), ("nodes", str(len(self.nodes))), *((k, str(n)) for k, n in counts.items())]
        cells = "".join(f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td></tr>" for a, b in rows)
        return f"<table>{cells}</table>"


def _outer(instance: Subcircuit, node: str) -> str:
    return node if node == "0" else instance.nodes.get(node, f"{instance.name}.{node}")


def _twice(where: str, what: str, names: Iterable[str]) -> list[str]:
    counts = Counter(name.lower() for name in names)
    return [
        f"{where}: expected each {what}'s name once, whatever its case, got {name!r} {count} times. Rename one."
        for name, count in counts.items()
        if count > 1
    ]


def _variants(nodes: set[str]) -> list[str]:
    counts = Counter(node.lower() for node in nodes)
    return [
        f"Netlist.elements: expected nodes that differ by more than case, got "
        f"{' and '.join(sorted(n for n in nodes if n.lower() == node))}. Rename one."
        for node, count in counts.items()
        if count > 1
    ]


def _duration(where: str, value: Any) -> float:
    number = expect_number(where, value, "a time above 0 s")
    if number <= 0.0:
        raise ParameterError(f"{where}: expected a time above 0 s, got {number:g} s. Correct it.")
    return number
