"""The evolved network: which neurons, which synapses of which kind; reads and writes ``*.net.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ohmloom import __version__
from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, sha256, validate, write_atomic
from ohmloom.errors import (
    FileFormatError,
    ParameterError,
    UnknownNameError,
    expect_integer,
    expect_number,
    expect_type,
)
from ohmloom.neurocontroller.kinds import KINDS, SYSTEMS
from ohmloom.neurocontroller.readings import Readings
from ohmloom.neurocontroller.rules import (
    INPUTS,
    LONGEST_NAME,
    MOST_HIDDEN,
    OUTPUTS,
    Polarity,
    Synapse,
    as_synapses,
    check_name,
    legal_pairs,
    plain,
    problems,
)

INPUT_LABELS = ("IR 0", "IR 2", "IR 5", "light 0", "light 2", "light 5")
INITIAL_HIDDEN = 9  # Section IV-A
FORMAT, VERSION = "ohmloom.network", 1
Kind = Literal["hp", "peo_pani", "linear", "constant"]


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
        The enabled synapses, in any order, which all results keep; births and mutations give them sorted by
        postsynaptic, then presynaptic neuron.
    readings, adaptation
        Settings of the controller, self-adaptive rates.
    provenance
        Where the network came from: plain values, finite numbers only.
    name
        How to call it: at most 100 printable characters.

    Raises
    ------
    ParameterError
        If a field is of a wrong type or breaks a rule; names every synapse that does.
    """

    system: str
    hidden: tuple[str, ...]
    synapses: tuple[Synapse, ...]
    readings: Readings = field(default_factory=Readings)
    adaptation: Adaptation = field(default_factory=Adaptation)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    name: str = "network"

    def __post_init__(self) -> None:
        synapses = as_synapses(self.synapses)
        if synapses is not self.synapses:
            object.__setattr__(self, "synapses", synapses)
        if type(self.hidden) is not tuple:
            expect_type("Network.hidden", self.hidden, list, tuple)
            object.__setattr__(self, "hidden", tuple(self.hidden))
        expect_type("Network.readings", self.readings, Readings)
        expect_type("Network.adaptation", self.adaptation, Adaptation)
        expect_type("Network.provenance", self.provenance, Mapping)
        if self.provenance:
            object.__setattr__(self, "provenance", plain("Network.provenance", self.provenance))
        check_name("Network.name", self.name)
        broken = problems("Network", self.system, self.hidden, self.synapses, self.readings)
        if broken:
            raise ParameterError(*broken)

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
        for name in changes:
            if name not in self.__dataclass_fields__:
                raise UnknownNameError.of("Network.replace", name, self.__dataclass_fields__)
        return replace(self, **changes)

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
            If `rng` is no Generator, `hidden` not from 1 to 1000, or `enable_probability` not in [0, 1].
        """
        from ohmloom.neurocontroller.variation import random_network

        where = "Network.random"
        expect_type(f"{where}.system", system, str)
        if system not in SYSTEMS:
            raise UnknownNameError.of(f"{where}.system", system, SYSTEMS)
        expect_type(f"{where}.rng", rng, np.random.Generator)
        expect_type(f"{where}.readings", readings, Readings, type(None), name="Readings or None")
        hidden = expect_integer(f"{where}.hidden", hidden, 1, MOST_HIDDEN)
        probability = expect_number(f"{where}.enable_probability", enable_probability, "a number in [0, 1]")
        if not 0.0 <= probability <= 1.0:
            raise ParameterError(f"{where}.enable_probability: expected a number in [0, 1], "
                                 f"got {probability}. Correct it.")  # fmt: skip
        return random_network(
            system, rng=rng, hidden=hidden, enable_probability=probability, readings=readings or Readings()
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
        name = Path(path).name.removesuffix(".json").removesuffix(".net")
        name = "".join(c if c.isprintable() else "?" for c in name)[:LONGEST_NAME]
        return cls.from_json(data, str(path), name=name)

    @classmethod
    def from_json(cls, data: bytes, where: str, *, name: str = "network") -> Network:
        """Parse the text of a network file; `where` names it in errors."""
        table = check_format(parse_json(data, where), where, FORMAT, VERSION)
        parsed = validate(_NetworkFile, table, where)
        hidden = tuple(parsed.hidden)
        synapses = tuple(Synapse(s.pre, s.post, s.kind, s.weight) for s in parsed.synapses)
        broken = problems(where, parsed.system, hidden, synapses, parsed.readings)
        try:
            provenance = plain(f"{where}: provenance", parsed.provenance)
            check_name(f"{where}: name", parsed.name or name)
        except ParameterError as error:
            broken += error.problems
        if broken:
            raise FileFormatError(*broken)
        return cls(
            system=parsed.system, hidden=hidden, synapses=synapses, readings=parsed.readings,
            adaptation=parsed.adaptation, provenance=provenance, name=parsed.name or name,
        )  # fmt: skip

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
        text = json.dumps(table, indent=1, allow_nan=False)
        return text.replace(f'{entry}"@"', entry + listed) + "\n"

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
