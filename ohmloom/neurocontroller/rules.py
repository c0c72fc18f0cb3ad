"""What a network may be: synapses, legal pairs of neurons, plain provenance, and the errors that name what is not."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from ohmloom.errors import ParameterError, UnknownNameError, expect_integer, expect_number, expect_type, shown
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, SYSTEMS
from ohmloom.neurocontroller.readings import Readings

INPUTS, OUTPUTS = 6, 2  # IR 0, 2, 5, then light 0, 2, 5; left and right output
MOST_HIDDEN = 1000  # the kernels hold matrices of neurons by neurons
LONGEST_NAME = 100
Polarity = Literal["excitatory", "inhibitory"]
POLARITIES = get_args(Polarity)


class Synapse(NamedTuple):
    """One enabled synapse; neurons are inputs 0..5, hidden 6..5+H, outputs 6+H and 7+H."""

    pre: int
    post: int
    kind: str
    weight: float


@lru_cache(maxsize=64)
def legal_pairs(hidden: int, lateral: str) -> tuple[tuple[int, int], ...]:
    """Legal (pre, post) pairs, sorted by post, then pre.

    >>> len(legal_pairs(9, "descending")), len(legal_pairs(9, "both"))
    (108, 144)
    """
    first_output = INPUTS + hidden
    pairs = []
    for post in range(INPUTS, first_output + OUTPUTS):
        for pre in range(first_output):
            if _why_illegal(pre, post, hidden, lateral) is None:
                pairs.append((pre, post))
    return tuple(pairs)


def _why_illegal(pre: int, post: int, hidden: int, lateral: str) -> str | None:
    """The rule that a synapse breaks, or None."""
    first_output, neurons = INPUTS + hidden, INPUTS + hidden + OUTPUTS
    if not (0 <= pre < neurons and 0 <= post < neurons):
        return f"neurons 0 to {neurons - 1}"
    if post < INPUTS:
        return "a hidden neuron or an output as postsynaptic neuron"
    if pre >= first_output:
        return "an input or a hidden neuron as presynaptic neuron"
    if pre < INPUTS and post >= first_output:
        return "no synapse from an input to an output"
    if pre == post:
        return "no synapse from a neuron to itself"
    if pre >= INPUTS and post < first_output:
        if lateral == "descending" and pre < post:
            return "lateral synapses from a higher to a lower index (readings.lateral = 'descending')"
        if lateral == "ascending" and pre > post:
            return "lateral synapses from a lower to a higher index (readings.lateral = 'ascending')"
    return None


def as_synapses(synapses: Any) -> tuple[Synapse, ...]:
    """`synapses` itself if it is as it should be, else with plain tuples and numbers made right."""
    expect_type("Network.synapses", synapses, tuple, list)
    if type(synapses) is tuple and all(
        type(s) is Synapse and type(s.pre) is type(s.post) is int and type(s.weight) is float for s in synapses
    ):
        return synapses
    return tuple(_as_synapse(f"Network.synapses[{k}]", entry) for k, entry in enumerate(synapses))


def _as_synapse(where: str, entry: Any) -> Synapse:
    if not isinstance(entry, tuple | list) or len(entry) != len(Synapse._fields):
        raise ParameterError(f"{where}: expected a Synapse(pre, post, kind, weight), got {shown(entry)}. "
                             "Pass a Synapse.")  # fmt: skip
    pre, post, kind, weight = entry
    expect_type(f"{where}.kind", kind, str)
    # Their ranges are checked with the network's rules.
    pre, post = (expect_integer(f"{where}.{name}", v, -(2**62)) for name, v in (("pre", pre), ("post", post)))
    return Synapse(pre, post, kind, expect_number(f"{where}.weight", weight, "a number in [0, 1]"))


def plain(where: str, value: Any, depth: int = 0) -> Any:
    """A copy of `value` in plain types that a JSON file can hold; numpy's scalars become Python's."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | str):
        return value
    if depth < 32 and isinstance(value, Mapping):
        for key in value:
            expect_type(f"{where}: a key", key, str)
        return {key: plain(where, item, depth + 1) for key, item in value.items()}
    if depth < 32 and isinstance(value, list | tuple):
        return [plain(where, item, depth + 1) for item in value]
    if isinstance(value, int) and value.bit_length() <= 1024:
        return value
    if isinstance(value, float):
        return expect_number(where, value)
    raise ParameterError(f"{where}: expected text, finite numbers, lists and tables of them, got {shown(value)}. "
                         "Convert it.")  # fmt: skip


def check_name(where: str, name: Any) -> None:
    if not isinstance(name, str) or not name.isprintable() or len(name) > LONGEST_NAME:
        raise ParameterError(
            f"{where}: expected at most {LONGEST_NAME} printable characters, got {shown(name)}. Use a plain name."
        )


@lru_cache(maxsize=64)
def _legal_set(hidden: int, lateral: str) -> frozenset[tuple[int, int]]:
    return frozenset(legal_pairs(hidden, lateral))


def problems(
    where: str, system: str, hidden: tuple[str, ...], synapses: tuple[Synapse, ...], readings: Readings
) -> list[str]:
    """The rules that a network breaks; quick for a good one, since evolution makes thousands."""
    joint = "." if where == "Network" else ": "
    expect_type(f"{where}{joint}system", system, str)
    if system not in SYSTEMS:
        raise UnknownNameError.of(f"{where}{joint}system", system, SYSTEMS)
    if not 1 <= len(hidden) <= MOST_HIDDEN or not all(p in POLARITIES for p in hidden):
        return [f"{where}{joint}hidden: expected 'excitatory' or 'inhibitory' for 1 to {MOST_HIDDEN} neurons, "
                f"got {shown(hidden)}. Correct it."]  # fmt: skip
    found: list[str] = []
    legal, allowed = _legal_set(len(hidden), readings.lateral), SYSTEMS[system]
    seen: dict[tuple[int, int], int] = {}
    for k, (pre, post, kind, weight) in enumerate(synapses):
        if (pre, post) not in legal or (pre, post) in seen or kind not in allowed:
            found += _synapse_problems(f"{where}{joint}synapses[{k}]", synapses[k], len(hidden), system, readings, seen)
        elif not (weight == INITIAL_WEIGHT or (kind == "constant" and 0.0 <= weight <= 1.0)):
            rule = "a number in [0, 1]" if kind == "constant" else f"{INITIAL_WEIGHT} for a plastic synapse"
            advice = "Correct it" if kind == "constant" else f"Set it to {INITIAL_WEIGHT}"
            found.append(f"{where}{joint}synapses[{k}].weight: expected {rule}, got {weight}. {advice}.")
        seen[pre, post] = k
    return found


def _synapse_problems(
    where: str, synapse: Synapse, hidden: int, system: str, readings: Readings, seen: Mapping[tuple[int, int], int]
) -> list[str]:
    problems = []
    pair = f"{synapse.pre} -> {synapse.post}"
    rule = _why_illegal(synapse.pre, synapse.post, hidden, readings.lateral)
    if rule is not None:
        problems.append(f"{where}: expected {rule}, got {pair}. Remove it.")
    first = seen.get((synapse.pre, synapse.post))
    if first is not None:
        problems.append(f"{where}: expected each pair of neurons once, got {pair}, "
                        f"which synapses[{first}] is too. Remove one.")  # fmt: skip
    if synapse.kind not in SYSTEMS[system]:
        rule = f"{' or '.join(SYSTEMS[system])} in a {system} network"
        problems.append(f"{where}.kind: expected {rule}, got {shown(synapse.kind)}. Change the kind or the system.")
    return problems
