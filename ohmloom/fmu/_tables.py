"""C text of a model's tables."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable

from ohmloom.fmu.description import Description

ROLES = {"parameter": "TUNABLE", "start": "FIXED", "input": "INPUT"}


def variable_table(description: Description) -> str:
    """The C array `variables`, in the order of value references; time first."""
    is_discrete = description.timestep is not None

    def row(name: str, type_: str, role: str, *numbers: str) -> str:
        return f'    {{"{name}", {type_ + ", " if is_discrete else ""}{role}, {", ".join(numbers)}}},'

    lines = [row("time", "REAL", "TIME", "0.0", "0.0", "0.0")]
    for v in description.variables:
        low, high = (number(x) if v.is_given else "0.0" for x in (v.low, v.high))
        lines.append(row(v.name, v.type.upper(), ROLES.get(v.kind, "CALCULATED"), number(v.start), low, high))
    text = "\n".join(["static const Variable variables[] = {", *lines, "};"])
    if not description.blocks:
        return text
    places = {v.name: k for k, v in enumerate(description.variables, 1)}
    blocks = [f"    {{{places[b.elements[0]]}, {len(b.elements)}}}, /* {b.name} */" for b in description.blocks]
    comment = "/* Arrays: the place of the first element, its value reference, and how many there are. */"
    head = ["static const struct {", "    unsigned int first, size;", "} arrays[] = {"]
    return "\n".join([text, "", comment, *head, *blocks, "};"])


def number(x: float) -> str:
    """`x` as a C constant of the same bits."""
    return repr(float(x)) if math.isfinite(x) else "-INFINITY" if x < 0 else "INFINITY"


def array(kind: str, name: str, values: Iterable[float | int | str], doc: str = "") -> str:
    """A constant C array of numbers or names; one that would be empty gets an entry that nothing reads."""
    words = [number(x) if isinstance(x, float) else str(x) for x in values] or ["0"]
    lines = textwrap.wrap(", ".join(words), 110, initial_indent="    ", subsequent_indent="    ")
    comment = [f"/* {doc} */"] if doc else []
    return "\n".join([*comment, f"static const {kind} {name}[] = {{", *lines, "};"])
