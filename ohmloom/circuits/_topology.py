"""What is wrong with a circuit before any number is known: nodes that float, loops of ideal voltages."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ohmloom.circuits.elements import (
    GROUND,
    VCVS,
    Capacitor,
    CurrentSource,
    Resistor,
    Simple,
    VoltageSource,
    nodes_of,
)
from ohmloom.errors import ParameterError

MOST_NAMED = 8


class Branch(NamedTuple):
    """An element as a step of a path, and +1 if the path runs from its p to its n, else -1."""

    element: Simple
    sign: float


class Forest:
    """Branches without a loop: tells the path between two nodes, if there is one."""

    def __init__(self) -> None:
        self._steps: dict[str, list[tuple[str, Branch]]] = {}

    def add(self, element: Simple) -> None:
        self._steps.setdefault(element.p, []).append((element.n, Branch(element, 1.0)))
        self._steps.setdefault(element.n, []).append((element.p, Branch(element, -1.0)))

    def path(self, begin: str, end: str) -> list[Branch] | None:
        """Branches from `begin` to `end`, None where they are not joined."""
        came: dict[str, tuple[str, Branch] | None] = {begin: None}
        queue = deque([begin])
        while queue:
            node = queue.popleft()
            for other, branch in self._steps.get(node, []):
                if other not in came:
                    came[other] = node, branch
                    queue.append(other)
        if end not in came:
            return None
        path: list[Branch] = []
        step = came[end]
        while step is not None:
            path.append(step[1])
            step = came[step[0]]
        return path[::-1]


def is_ideal(element: Simple) -> bool:
    """Whether `element` fixes a voltage by itself."""
    return isinstance(element, VoltageSource | VCVS) or (isinstance(element, Resistor) and element.resistance == 0.0)


def check_topology(elements: Sequence[Simple], *, is_dc: bool) -> None:
    """Refuse floating nodes and loops of ideal voltages.

    Raises
    ------
    ParameterError
        Names every floating group of nodes, and the elements of every loop.
    """
    if not elements:
        raise ParameterError("Netlist.elements: expected at least one element, got none. Add one.")
    found = _floating(elements, is_dc=is_dc) + _loops(elements)
    if found:
        raise ParameterError(*found)


def capacitor_tree(elements: Sequence[Simple]) -> tuple[list[Capacitor], dict[str, list[Branch]]]:
    """The capacitors whose voltages are states, and for each other one, by name, the path that fixes its voltage.

    Raises
    ------
    ParameterError
        If a capacitor stands across a controlled voltage source.
    """
    forest = Forest()
    for element in elements:
        if is_ideal(element):
            forest.add(element)
    tree, links = [], {}
    for element in elements:
        if not isinstance(element, Capacitor):
            continue
        path = forest.path(element.p, element.n)
        if path is None:
            forest.add(element)
            tree.append(element)
            continue
        controlled = [branch.element.name for branch in path if isinstance(branch.element, VCVS)]
        if controlled:
            raise ParameterError(
                f"Netlist.elements: expected a resistance between {element.name} and the controlled source "
                f"{controlled[0]} that sets its voltage, got none. Put a small one in series."
            )
        links[element.name] = path
    return tree, links


def _floating(elements: Sequence[Simple], *, is_dc: bool) -> list[str]:
    groups: dict[str, set[str]] = {GROUND: {GROUND}}
    for element in elements:
        for node in nodes_of(element):
            groups.setdefault(node, {node})
        if isinstance(element, CurrentSource) or (is_dc and isinstance(element, Capacitor)):
            continue
        a, b = groups[element.p], groups[element.n]
        if a is not b:
            a |= b
            groups.update(dict.fromkeys(b, a))
    seen: list[set[str]] = []
    found = []
    for group in groups.values():
        if GROUND in group or any(group is other for other in seen):
            continue
        seen.append(group)
        how = "a path for direct current" if is_dc else "a path"
        found.append(f"Netlist.elements: expected {how} from every node to '0', got none from {_list(sorted(group))}. "
                     "Connect it to ground, by a large resistor if by nothing else.")  # fmt: skip
    return found


def _loops(elements: Sequence[Simple]) -> list[str]:
    forest, found = Forest(), []
    for element in elements:
        if not is_ideal(element):
            continue
        path = forest.path(element.p, element.n)
        if path is None:
            forest.add(element)
            continue
        names = [*(branch.element.name for branch in path), element.name]
        found.append(f"Netlist.elements: expected no loop of voltage sources and zero resistances, got {_list(names)}. "
                     "Put a resistance into it.")  # fmt: skip
    return found


def _list(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
