"""The evolved network: which neurons, which synapses of which kind; reads and writes ``*.net.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from pydantic import AfterValidator, Field

from ohmloom import __version__
from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, sha256, validate, write_atomic
from ohmloom.errors import FileFormatError, ParameterError, UnknownNameError
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, KINDS, SYSTEMS
from ohmloom.neurocontroller.readings import Readings

INPUTS, OUTPUTS = 6, 2  # IR 0, 2, 5, then light 0, 2, 5; left and right output
INPUT_LABELS = ("IR 0", "IR 2", "IR 5", "light 0", "light 2", "light 5")
INITIAL_HIDDEN = 9  # Section IV-A
FORMAT, VERSION = "ohmloom.network", 1
Kind = Literal["hp", "peo_pani", "linear", "constant"]
Polarity = Literal["excitatory", "inhibitory"]


class Synapse(NamedTuple):
    """One enabled synapse; neurons are inputs 0..5, hidden 6..5+H, outputs 6+H and 7+H."""

    pre: int
    post: int
    kind: str
    weight: float


class Adaptation(StrictModel):
    """Self-adaptive rates (Section VI-A, VII), each in (0, 1]."""

    mu: float | None = Field(default=None, gt=0.0, le=1.0)
    psi: float | None = Field(default=None, gt=0.0, le=1.0)
    omega: float | None = Field(default=None, gt=0.0, le=1.0)
    tau: float | None = Field(default=None, gt=0.0, le=1.0)


class _SynapseEntry(StrictModel):
    pre: int
    post: int
    kind: Kind
    weight: float = Field(ge=0.0, le=1.0)


def _exactly(count: int, value: int) -> int:
    # Literal[6] would accept 6.0.
    if value != count:
        raise ValueError(count)
    return value


class _NetworkFile(StrictModel):
    name: str | None = None
    system: Literal["HP", "PEO", "LIN", "GA", "HET"]
    readings: Readings = Readings()
    inputs: Annotated[int, AfterValidator(partial(_exactly, INPUTS))]
    hidden: list[Polarity] = Field(min_length=1)
    outputs: Annotated[int, AfterValidator(partial(_exactly, OUTPUTS))]
    synapses: list[_SynapseEntry]
    adaptation: Adaptation = Adaptation()
    provenance: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Network:
    """A spiking network of 6 inputs, H hidden neurons and 2 outputs (Section IV).

    Attributes
    ----------
    system
        ``HP``, ``PEO``, ``LIN``, ``GA`` or ``HET``: which kinds its synapses may have.
    hidden
        ``excitatory`` or ``inhibitory`` for each hidden neuron.
    synapses
        The enabled synapses, sorted by postsynaptic, then presynaptic neuron.
    readings, adaptation, provenance, name
        Settings of the controller, self-adaptive rates, where the network came from, how to call it.
    """

    system: str
    hidden: tuple[str, ...]
    synapses: tuple[Synapse, ...]
    readings: Readings = field(default_factory=Readings)
    adaptation: Adaptation = field(default_factory=Adaptation)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    name: str = "network"

    @property
    def neurons(self) -> int:
        """Number of neurons, inputs and outputs included."""
        return INPUTS + len(self.hidden) + OUTPUTS

    def sign(self, neuron: int) -> float:
        """-1.0 for an inhibitory hidden neuron, else 1.0."""
        hidden = neuron - INPUTS
        return -1.0 if 0 <= hidden < len(self.hidden) and self.hidden[hidden] == "inhibitory" else 1.0

    def delay(self, synapse: Synapse) -> int:
        """Steps from a spike of the presynaptic neuron to its arrival (eq. 5)."""
        first_output = INPUTS + len(self.hidden)
        is_lateral = synapse.pre >= INPUTS and synapse.post < first_output
        return abs(synapse.pre - synapse.post) if is_lateral and self.readings.hidden_delay == "index" else 1

    def inbound(self) -> list[list[int]]:
        """For each neuron the indices of its inbound synapses, ascending by presynaptic neuron."""
        groups: list[list[int]] = [[] for _ in range(self.neurons)]
        for k in sorted(range(len(self.synapses)), key=lambda k: self.synapses[k].pre):
            groups[self.synapses[k].post].append(k)
        return groups

    def labels(self) -> list[str]:
        """A name for each neuron, in order."""
        hidden = [f"hidden {i} ({'+' if p == 'excitatory' else '-'})" for i, p in enumerate(self.hidden)]
        return [*INPUT_LABELS, *hidden, "out left", "out right"]

    @cached_property
    def legal(self) -> tuple[tuple[int, int], ...]:
        """All legal (pre, post) pairs, sorted by post, then pre."""
        return legal_pairs(len(self.hidden), self.readings.lateral)

    @property
    def connectivity(self) -> float:
        """Enabled synapses as a fraction of the legal ones."""
        return len(self.synapses) / len(self.legal)

    def replace(self, **changes: Any) -> Network:
        """Copy with some fields changed; the new network is checked."""
        changed = replace(self, **changes)
        _check(changed, "Network")
        return changed

    @classmethod
    def random(
        cls,
        *,
        system: str,
        rng: np.random.Generator,
        hidden: int = INITIAL_HIDDEN,
        enable_probability: float = 0.5,
        readings: Readings | None = None,
    ) -> Network:
        """A network as at the start of evolution (Sections VI and VII).

        Raises
        ------
        UnknownNameError
            If `system` is not one of HP, PEO, LIN, GA, HET.
        ParameterError
            If `hidden` is less than 1 or `enable_probability` is not in [0, 1].
        """
        from ohmloom.neurocontroller.variation import random_network

        if system not in SYSTEMS:
            raise UnknownNameError.of("Network.random.system", system, SYSTEMS)
        if hidden < 1:
            raise ParameterError(f"Network.random.hidden: expected at least 1, got {hidden}. Raise it.")
        if not 0.0 <= enable_probability <= 1.0:
            raise ParameterError(f"Network.random.enable_probability: expected a number in [0, 1], "
                                 f"got {enable_probability}. Correct it.")  # fmt: skip
        return random_network(
            system,
            rng=rng,
            hidden=hidden,
            enable_probability=enable_probability,
            readings=readings or Readings(),
        )

    @classmethod
    def load(cls, path: Path | str) -> Network:
        """Read a ``*.net.json`` file.

        Raises
        ------
        MissingFileError
            If there is no such file.
        FileFormatError
            If it is not a network of this version, or breaks a rule; names every field that does.
        """
        data = read_bytes(path, "network")
        return cls.from_json(data, str(path), name=Path(path).name.removesuffix(".json").removesuffix(".net"))

    @classmethod
    def from_json(cls, data: bytes, where: str, *, name: str = "network") -> Network:
        """Parse the text of a network file; `where` names it in errors."""
        table = check_format(parse_json(data, where), where, FORMAT, VERSION)
        parsed = validate(_NetworkFile, table, where)
        network = cls(
            system=parsed.system,
            hidden=tuple(parsed.hidden),
            synapses=tuple(Synapse(s.pre, s.post, s.kind, s.weight) for s in parsed.synapses),
            readings=parsed.readings,
            adaptation=parsed.adaptation,
            provenance=parsed.provenance,
            name=parsed.name or name,
        )
        _check(network, where)
        return network

    def to_json(self) -> str:
        """The text of the network's file: complete readings, one synapse a line."""
        table: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "system": self.system,
        }
        table |= {"readings": self.readings.model_dump(), "inputs": INPUTS, "hidden": list(self.hidden)}
        table |= {
            "outputs": OUTPUTS,
            "synapses": "@",
            "adaptation": self.adaptation.model_dump(exclude_none=True),
        }
        table["provenance"] = {"ohmloom": __version__, **self.provenance}
        rows = ",\n  ".join(json.dumps(s._asdict()) for s in self.synapses)
        # A newline and one space stand only before the table's own keys, so no value is mistaken for this.
        entry = '\n "synapses": '
        listed = f"[\n  {rows}\n ]" if rows else "[]"
        return json.dumps(table, indent=1).replace(f'{entry}"@"', entry + listed) + "\n"

    def save(self, path: Path | str) -> None:
        """Write the network's file, whole or not at all."""
        write_atomic(path, self.to_json())

    @property
    def sha256(self) -> str:
        """Digest of what determines the network's behaviour (not of its name or provenance)."""
        return sha256(self.replace(name="", provenance={}, adaptation=Adaptation()).to_json().encode())

    def _repr_html_(self) -> str:
        from html import escape

        kinds = {kind: sum(s.kind == kind for s in self.synapses) for kind in KINDS}
        rows = {"system": self.system, "hidden": len(self.hidden), "synapses": len(self.synapses), **kinds}
        cells = "".join(f"<tr><th>{key}</th><td>{value}</td></tr>" for key, value in rows.items())
        return f"<table><caption>{escape(self.name)}</caption>{cells}</table>"


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


def _check(network: Network, where: str) -> None:
    if network.system not in SYSTEMS:
        raise UnknownNameError.of(f"{where}.system", network.system, SYSTEMS)
    problems = []
    if not network.hidden or not {*network.hidden} <= {*get_args(Polarity)}:
        problems.append(f"{where}.hidden: expected 'excitatory' or 'inhibitory' for at least one neuron, "
                        f"got {network.hidden}. Correct it.")  # fmt: skip
    seen: dict[tuple[int, int], int] = {}
    allowed = SYSTEMS[network.system]
    for k, synapse in enumerate(network.synapses):
        field_name = f"{where}: synapses[{k}]"
        rule = _why_illegal(synapse.pre, synapse.post, len(network.hidden), network.readings.lateral)
        if rule is not None:
            problems.append(f"{field_name}: expected {rule}, got {synapse.pre} -> {synapse.post}. Remove it.")
        if (synapse.pre, synapse.post) in seen:
            first = seen[synapse.pre, synapse.post]
            pair = f"{synapse.pre} -> {synapse.post}"
            problems.append(f"{field_name}: expected each pair of neurons once, got {pair}, "
                            f"which synapses[{first}] is too. Remove one.")  # fmt: skip
        seen[synapse.pre, synapse.post] = k
        if synapse.kind not in allowed:
            rule = f"{' or '.join(allowed)} in a {network.system} network"
            problems.append(f"{field_name}.kind: expected {rule}, got {synapse.kind!r}. "
                            "Change the kind or the system.")  # fmt: skip
        elif synapse.kind != "constant" and synapse.weight != INITIAL_WEIGHT:
            problems.append(f"{field_name}.weight: expected {INITIAL_WEIGHT} for a plastic synapse, "
                            f"got {synapse.weight}. Set it to {INITIAL_WEIGHT}.")  # fmt: skip
        elif not 0.0 <= synapse.weight <= 1.0:
            problems.append(f"{field_name}.weight: expected a number in [0, 1], got {synapse.weight}. Correct it.")
    if problems:
        raise FileFormatError(*problems)
