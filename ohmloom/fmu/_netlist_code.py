"""A netlist for an FMU: nodes merged, numbered into a band, and described."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ohmloom.circuits._topology import capacitor_tree
from ohmloom.circuits.elements import (
    GROUND,
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    Resistor,
    Simple,
    VoltageSource,
)
from ohmloom.circuits.waveforms import Waveform
from ohmloom.devices import LAWS, Device
from ohmloom.devices._checks import LARGEST_VOLTAGE
from ohmloom.errors import ParameterError
from ohmloom.fmu.description import Block, Description, Variable

LARGEST_CURRENT = 1e6  # A
MOST_NEEDS = 2_000_000  # dependencies that are listed; beyond, everything may depend on everything


@dataclass(frozen=True, kw_only=True)
class Circuit:
    """A netlist with its nodes numbered as netlist.c wants them.

    Attributes
    ----------
    places
        Number of each node by name: the free ones first, ground, then one for each voltage source and each capacitor.
    free, band
        Number of free nodes, and of the matrix's diagonals below the main one.
    sources, capacitors, signs
        Those that hold a voltage; and of both -1 for those with p at ground, else +1.
    charging
        Of each capacitor, kind and place of its current, as an output has them.
    branches
        Number of the current of each voltage source that is controlled, and of each source or capacitor that stands
        between two nodes; it counts as that of a free node.
    links
        ``(to, from, share)`` of what these sources add: see netlist.c.
    """

    places: dict[str, int]
    free: int
    band: int
    sources: tuple[VoltageSource, ...]
    capacitors: tuple[Capacitor, ...]
    signs: tuple[float, ...]
    currents: tuple[CurrentSource, ...]
    resistors: tuple[Resistor, ...]
    memristors: tuple[Memristor, ...]
    cards: tuple[Device, ...]
    branches: dict[str, int]
    links: tuple[tuple[int, int, float], ...]
    charging: tuple[tuple[str, int], ...]
    is_crossbar: bool

    @property
    def holders(self) -> tuple[VoltageSource | Capacitor, ...]:
        """Sources and capacitors, in the order in which they hold places."""
        return (*self.sources, *self.capacitors)


def analyse(where: str, elements: Sequence[Simple], nodes: Iterable[str], *, is_crossbar: bool) -> Circuit:
    """Merge nodes that nothing parts, tell free from held ones, and number them.

    Raises
    ------
    ParameterError
        If there is no memristor, or a capacitor whose voltage others set.
    """
    capacitors, set_by_others = capacitor_tree(elements)
    if set_by_others:
        name, path = next(iter(set_by_others.items()))
        names = ", ".join([*(branch.element.name for branch in path), name])
        raise ParameterError(f"{where}: {name}: expected no loop of capacitors and voltage sources, got {names}. Put a "
                             "resistance into it, or make one of parallel capacitors.")  # fmt: skip
    merged = {node: node for node in (GROUND, *nodes)}

    def root(node: str) -> str:
        while merged[node] != node:
            node = merged[node]
        return node

    for element in elements:
        if isinstance(element, Resistor) and element.resistance == 0.0:
            a, b = root(element.p), root(element.n)
            # Ground stays the name of what is joined to it.
            merged[b if a == GROUND else a] = a if a == GROUND else b
    sources = tuple(e for e in elements if isinstance(e, VoltageSource))
    if is_crossbar:
        sources = tuple(sorted(sources, key=lambda source: source.name[0] != "V"))  # rows before columns
    held: dict[str, int] = {}
    signs = []
    holders: tuple[VoltageSource | Capacitor, ...] = (*sources, *capacitors)
    for holder in holders:
        p, n = root(holder.p), root(holder.n)
        # One that stands between two nodes holds a place of its own, which a source of gain 1 follows.
        held[f"{holder.name}:" if GROUND not in (p, n) else p if n == GROUND else n] = len(held)
        signs.append(-1.0 if p == GROUND else 1.0)
    branches, links = _links(elements, root)
    free = list(dict.fromkeys(r for r in map(root, nodes) if r != GROUND and r not in held)) + branches
    resistors = tuple(e for e in elements if isinstance(e, Resistor) and root(e.p) != root(e.n))
    memristors = tuple(e for e in elements if isinstance(e, Memristor))
    if not memristors:
        raise ParameterError(f"{where}: expected at least one memristor, got none. A crossbar FMU is one of devices.")
    pairs = [(root(e.p), root(e.n)) for e in _pair(resistors, memristors)]
    order, band = (free, 0) if links else _band(free, pairs)
    number_of = {node: k for k, node in enumerate(order)} | {GROUND: len(free)}
    number_of |= {node: len(free) + 1 + k for node, k in held.items()}
    currents = {branch.removesuffix("#"): number_of[branch] for branch in branches}
    return Circuit(
        places={node: number_of[root(node)] for node in merged}, free=len(free), band=band, sources=sources,
        capacitors=tuple(capacitors), signs=tuple(signs),
        currents=tuple(e for e in elements if isinstance(e, CurrentSource)), resistors=resistors,
        memristors=memristors, cards=tuple(dict.fromkeys(m.device for m in memristors)), is_crossbar=is_crossbar,
        branches=currents,
        charging=tuple(("POTENTIAL", currents[c.name]) if c.name in currents else ("HELD", len(sources) + k)
                       for k, c in enumerate(capacitors)),
        links=tuple((number_of[to], number_of[of], share) for to, of, share in links),
    )  # fmt: skip


def _links(elements: Iterable[Simple], root: Any) -> tuple[list[str], list[tuple[str, str, float]]]:
    """Currents that are unknowns, as places, and what each source that is no plain one adds to the current into places.

    Into the place of such a current flows what its equation is not balanced by.
    """
    branches: list[str] = []
    links: list[tuple[str, str, float]] = []
    for e in elements:
        if isinstance(e, VCCS):
            p, n, g = root(e.p), root(e.n), e.transconductance
            ends = ((root(e.control_p), 1.0), (root(e.control_n), -1.0))
            links += [(to, of, out * sign * g) for to, out in ((p, -1.0), (n, 1.0)) for of, sign in ends]
        elif isinstance(e, VCVS) or (isinstance(e, VoltageSource | Capacitor) and GROUND not in (root(e.p), root(e.n))):
            p, n, current = root(e.p), root(e.n), f"{e.name}#"
            branches.append(current)
            links += [(p, current, -1.0), (n, current, 1.0), (current, p, 1.0), (current, n, -1.0)]
            if isinstance(e, VCVS):
                links += [(current, root(e.control_p), -e.gain), (current, root(e.control_n), e.gain)]
            else:
                links.append((current, f"{e.name}:", -1.0))
    return branches, links


def _pair(resistors: Iterable[Resistor], memristors: Iterable[Memristor]) -> list[Resistor | Memristor]:
    return [*resistors, *memristors]


def _band(free: list[str], pairs: list[tuple[str, str]]) -> tuple[list[str], int]:
    """The free nodes in an order that keeps neighbours near each other, and how far apart they are at most."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    index = {node: k for k, node in enumerate(free)}
    both = np.array([(index[p], index[n]) for p, n in pairs if p in index and n in index], dtype=np.int64).reshape(
        -1, 2
    )
    if not both.size:
        return free, 0
    ones = np.ones(len(both))
    graph = coo_array((ones, (both[:, 0], both[:, 1])), shape=(len(free),) * 2).tocsr()
    order = reverse_cuthill_mckee((graph + graph.T).tocsr(), symmetric_mode=True)
    place = np.empty(len(free), dtype=np.int64)
    place[order] = np.arange(len(free))
    return [free[k] for k in order], int(np.abs(place[both[:, 0]] - place[both[:, 1]]).max())


def names_of(circuit: Circuit) -> tuple[list[str], list[str], Any]:
    """Names of the inputs, suffixes of the memristors, and a function from a kind and a suffix to a name."""
    if circuit.is_crossbar:
        inputs = [f"v_{'row' if s.name[0] == 'V' else 'column'}_{s.name[2:]}" for s in circuit.sources]
        return inputs, [m.name[2:] for m in circuit.memristors], lambda kind, suffix: f"{kind}_{suffix}"
    inputs = [f"voltage.{_structured(s.name)}" for s in circuit.sources]
    inputs += [f"current.{_structured(s.name)}" for s in circuit.currents]
    return inputs, [_structured(m.name) for m in circuit.memristors], lambda kind, suffix: f"{kind}.{suffix}"


def _structured(name: str) -> str:
    """A name as FMI's structured naming has it: parts that do not begin like a name in C stand in quotes."""
    return ".".join(part if re.fullmatch(r"[A-Za-z_]\w*", part) else f"'{part}'" for part in name.split("."))


def netlist_description(name: str, label: str, circuit: Circuit) -> tuple[Description, list[tuple[str, int]]]:
    """Variables of a netlist's FMU, and kind and place of each output."""
    inputs, suffixes, named = names_of(circuit)
    charges = [named("q", suffix) for suffix in suffixes]
    scales = [m.device.charge_scale for m in circuit.memristors]
    voltages = [f"voltage.{_structured(c.name)}" for c in circuit.capacitors]
    needs = _needs(circuit, inputs, charges, voltages)

    def output(name: str, unit: str, doc: str, kind: str, place: int, parts: Iterable[int]) -> tuple[Variable, Any]:
        variable = Variable(name=name, kind="output", unit=unit, doc=doc, dependencies=needs(parts),
                            initial_dependencies=None)  # fmt: skip
        return variable, (kind, place)

    outputs = []
    free = circuit.free
    if circuit.is_crossbar:
        for k, source in enumerate(circuit.sources):
            if source.name[0] == "H":
                outputs.append(output(f"i_column_{source.name[2:]}", "A", "current into the sense of this bit line",
                                      "SENSE", k, [free + 1 + k]))  # fmt: skip
    else:
        for node, place in circuit.places.items():
            if node != GROUND:
                outputs.append(output(f"v.{_structured(node)}", "V", "potential against ground", "POTENTIAL", place,
                                      [place]))  # fmt: skip
        told = "current from p to n"
        for k, holder in enumerate(circuit.holders):
            if holder.name not in circuit.branches:
                outputs.append(output(f"i.{_structured(holder.name)}", "A", told, "HELD", k, [free + 1 + k]))
        for branch, place in circuit.branches.items():
            outputs.append(output(f"i.{_structured(branch)}", "A", told, "POTENTIAL", place, [place]))
        for k, (m, suffix) in enumerate(zip(circuit.memristors, suffixes, strict=True)):
            ends = [circuit.places[m.p], circuit.places[m.n]]
            outputs.append(output(named("i", suffix), "A", told, "CURRENT", k, ends))
    values = [(source.voltage, "V", LARGEST_VOLTAGE) for source in circuit.sources]
    values += [(source.current, "A", LARGEST_CURRENT) for source in circuit.currents]
    variables: list[Variable] = list(_parameters(circuit))
    for suffix, m, q_d in zip(suffixes, circuit.memristors, scales, strict=True):
        variables.append(Variable(name=named("q0", suffix), kind="start", unit="C", doc="charge at the start",
                                  start=m.s0 * q_d, low=0.0, high=1e300))  # fmt: skip
    at_start = [name.replace("voltage.", "voltage0.", 1) for name in voltages]
    for name_, c in zip(at_start, circuit.capacitors, strict=True):
        variables.append(Variable(name=name_, kind="start", unit="V", doc="of p above n at the start",
                                  start=_at_start(name_, c.initial, LARGEST_VOLTAGE, "V"), low=-LARGEST_VOLTAGE,
                                  high=LARGEST_VOLTAGE))  # fmt: skip
    for name_, (waveform, unit, limit) in zip(inputs, values, strict=True):
        assert isinstance(waveform, Waveform)
        variables.append(Variable(name=name_, kind="input", unit=unit, doc="of a source, held over a step",
                                  start=_at_start(name_, waveform.value(0.0), limit, unit), low=-limit,
                                  high=limit))  # fmt: skip
    starts = [named("q0", suffix) for suffix in suffixes]
    for q, q0, q_d in zip(charges, starts, scales, strict=True):
        variables.append(Variable(name=q, kind="state", unit="C", doc="state charge, from 0 to q_d", nominal=q_d,
                                  dependencies=(q,), initial_dependencies=(q0,)))  # fmt: skip
    for v, v0 in zip(voltages, at_start, strict=True):
        variables.append(Variable(name=v, kind="state", unit="V", doc="of p above n", nominal=1.0, dependencies=(v,),
                                  initial_dependencies=(v0,)))  # fmt: skip
    own = [needs([circuit.places[m.p], circuit.places[m.n]], k) for k, m in enumerate(circuit.memristors)]
    for q, need in zip(charges, own, strict=True):
        variables.append(Variable(name=f"der({q})", kind="rate", unit="A", doc="0 where q rests at a limit", state=q,
                                  dependencies=need, initial_dependencies=None))  # fmt: skip
    for v, (kind, place) in zip(voltages, circuit.charging, strict=True):
        at = free + 1 + place if kind == "HELD" else place
        variables.append(Variable(name=f"der({v})", kind="rate", unit="V/s", doc="current over capacitance", state=v,
                                  dependencies=needs([at]), initial_dependencies=None))  # fmt: skip
    variables += [variable for variable, _ in outputs]
    for suffix, need in zip(suffixes, own, strict=True):
        for kind in ("q_above_low", "q_below_high"):
            variables.append(Variable(name=named(kind, suffix), kind="indicator", unit="1", dependencies=need,
                                      doc="positive until q reaches or leaves its limit"))  # fmt: skip
    description = Description(name=name, identifier=label, doc=f"{len(charges)} memristors in a circuit", stop_time=1.0,
                              step_size=0.01, variables=tuple(variables))  # fmt: skip
    return description, [place for _, place in outputs]


def _at_start(name: str, value: float, limit: float, unit: str) -> float:
    if not abs(value) <= limit:
        raise ParameterError(f"export_crossbar: {name}: expected at most {limit:g} {unit} at the start, got "
                             f"{value:g} {unit}. Correct the netlist.")  # fmt: skip
    return value


def with_arrays(description: Description) -> Description:
    """A crossbar's variables as arrays: by line, and by crosspoint where each has a device, else by device."""
    names = [v.name for v in description.variables]
    places = [name[3:] for name in names if re.fullmatch(r"q0_\d+_\d+", name)]
    shape = tuple(max(int(place.split("_")[axis]) for place in places) + 1 for axis in (0, 1))
    if [f"{i}_{j}" for i in range(shape[0]) for j in range(shape[1])] != places:
        shape = (len(places),)

    def block(name: str, doc: str, pattern: str, shape: tuple[int, ...] | None = None) -> Block:
        elements = tuple(found for found in names if re.fullmatch(pattern, found))
        return Block(name=name, doc=doc, elements=elements, shape=shape or (len(elements),))

    return replace(description, blocks=(
        block("q0", "charges at the start", r"q0_\d+_\d+", shape),
        block("v_row", "voltages of the word lines' drivers", r"v_row_\d+"),
        block("v_column", "what the bit lines' senses hold", r"v_column_\d+"),
        block("q", "state charges, from 0 to q_d", r"q_\d+_\d+", shape),
        block("der(q)", "0 where a charge rests at a limit", r"der\(q_\d+_\d+\)", shape),
        block("i_column", "currents into the senses of the bit lines", r"i_column_\d+"),
        block("q_from_limits", "positive until a charge reaches or leaves 0, and q_d", r"q_(above_low|below_high)_.*",
              (*shape, 2)),
    ))  # fmt: skip


def _parameters(circuit: Circuit) -> Iterable[Variable]:
    for k, card in enumerate(circuit.cards):
        for p in LAWS[card.law].parameters:
            name = p.name if len(circuit.cards) == 1 else f"card_{k}.{p.name}"
            yield Variable(name=name, kind="parameter", unit=p.unit, doc=f"{card.name}: {p.doc}",
                           start=card.parameters[p.name], low=p.lower, high=p.upper)  # fmt: skip


def _needs(circuit: Circuit, inputs: list[str], charges: list[str], voltages: list[str]) -> Any:
    """A function from nodes to what their potentials and currents depend on; None where that is everything.

    Free nodes that elements join share all that any of them touches; a held node passes nothing on.
    """
    group = list(range(circuit.free))

    def find(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = group[k]
        return k

    ends = [(circuit.places[e.p], circuit.places[e.n]) for e in _pair(circuit.resistors, circuit.memristors)]
    # More than there is: what a source controls does not act back on what controls it.
    ends += [(to, of) for to, of, _ in circuit.links]
    for p, n in ends:
        if p < circuit.free and n < circuit.free:
            group[find(p)] = find(n)
    first = circuit.free + 1
    held_by = [*inputs[: len(circuit.sources)], *voltages]
    touches: dict[int, set[str]] = {}
    at_held: dict[int, set[int]] = {}  # groups and, below 0, lone elements between held nodes
    lone: dict[int, set[str]] = {}

    def join(p: int, n: int, name: str | None) -> None:
        groups = {find(k) for k in (p, n) if k < circuit.free}
        held = {k for k in (p, n) if k >= first}
        for g in groups:
            touches.setdefault(g, set()).update(held_by[k - first] for k in held)
            if name is not None:
                touches[g].add(name)
        for k in held:
            at_held.setdefault(k, set()).update(groups)
            lone.setdefault(k, set()).update(
                {held_by[j - first] for j in held} | ({name} if name and not groups else set())
            )

    for resistor in circuit.resistors:
        join(circuit.places[resistor.p], circuit.places[resistor.n], None)
    for memristor, q in zip(circuit.memristors, charges, strict=True):
        join(circuit.places[memristor.p], circuit.places[memristor.n], q)
    for source, name in zip(circuit.currents, inputs[len(circuit.sources) :], strict=True):
        join(circuit.places[source.p], circuit.places[source.n], name)
    for to, of, _ in circuit.links:
        join(to, of, None)
    everything = len(inputs) + len(charges) + len(voltages)

    def needs(places: Iterable[int], device: int | None = None) -> tuple[str, ...] | None:
        found: set[str] = set() if device is None else {charges[device]}
        for k in places:
            if k < circuit.free:
                found |= touches.get(find(k), set())
            elif k >= first:
                found.add(held_by[k - first])
                # The current into a held node is that of all that touches it; a device has its own.
                if device is None:
                    found |= lone.get(k, set()).union(*(touches.get(g, set()) for g in at_held.get(k, set())))
        if len(found) == everything or len(found) * len(charges) > MOST_NEEDS:
            return None
        return tuple(sorted(found))

    return needs
