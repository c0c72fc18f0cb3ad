"""What an FMU says of itself: variables, their units and dependencies, as `modelDescription.xml` of FMI 2.0 or 3.0."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Literal
from xml.sax.saxutils import escape, quoteattr

from ohmloom.fmu._units import base_exponents

FmiVersion = Literal[2, 3]
Type = Literal["real", "integer", "boolean"]
Kind = Literal["parameter", "start", "input", "state", "rate", "output", "indicator"]
# The order of the runtime's table of values: a value reference is a place in it, and 0 is the time.
KINDS: tuple[tuple[Kind, ...], ...] = (
    ("parameter", "start"),
    ("input",),
    ("state",),
    ("rate",),
    ("output",),
    ("indicator",),
)
CAUSALITY = {
    "parameter": ("parameter", "tunable"),
    "start": ("parameter", "fixed"),
    "input": ("input", "continuous"),
    "state": ("output", "continuous"),
    "rate": ("local", "continuous"),
    "output": ("output", "continuous"),
    "indicator": ("local", "continuous"),
}
TYPES3 = {"real": "Float64", "integer": "Int32", "boolean": "Boolean"}
TOLERANCE = 1e-8  # of a co-simulation step, in shares of a state's range; as in runtime.c


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One variable of a model.

    Attributes
    ----------
    type
        Only discrete models have other than real ones.
    kind
        ``"start"`` is a parameter that is read at the start alone; ``"rate"`` the derivative of the state `state`.
    start, low, high
        Of parameters and inputs; SI.
    dependencies
        Names of inputs and states that it depends on, for rates, outputs and indicators.
    initial_dependencies
        Names of inputs and parameters that it depends on at the start, for what is calculated. None in either: all.
    """

    name: str
    kind: Kind
    unit: str
    doc: str
    type: Type = "real"
    start: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    nominal: float | None = None
    state: str = ""
    dependencies: tuple[str, ...] | None = ()
    initial_dependencies: tuple[str, ...] | None = ()

    @property
    def is_given(self) -> bool:
        """Whether an importer may set it."""
        return self.kind in ("parameter", "start", "input")


@dataclass(frozen=True, kw_only=True)
class Block:
    """Variables of one kind that stand next to each other, shown as one array of FMI 3.0.

    Attributes
    ----------
    elements
        Their names, in the order of the array, the last axis fastest.
    shape
        Sizes of the axes.
    """

    name: str
    doc: str
    elements: tuple[str, ...]
    shape: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Description:
    """A model's variables, in the order of the runtime's table, and what is said of the whole.

    Attributes
    ----------
    timestep
        In s, of a discrete model, which is for co-simulation alone; None for a continuous one.
    has_derivatives
        Whether the model gives directional and adjoint derivatives.
    blocks
        Variables that are shown as arrays, of FMI 3.0 alone.
    """

    name: str
    identifier: str
    doc: str
    stop_time: float
    step_size: float
    variables: tuple[Variable, ...]
    timestep: float | None = None
    has_derivatives: bool = True
    blocks: tuple[Block, ...] = ()

    def __post_init__(self) -> None:
        """Check the order."""
        places = [next(k for k, kinds in enumerate(KINDS) if v.kind in kinds) for v in self.variables]
        assert places == sorted(places)
        assert len({v.name for v in self.variables}) == len(self.variables)
        names = [v.name for v in self.variables]
        for block in self.blocks:
            first, count = names.index(block.elements[0]), len(block.elements)
            assert tuple(names[first : first + count]) == block.elements
            assert math.prod(block.shape) == count

    def of(self, *kinds: Kind) -> tuple[Variable, ...]:
        """The variables of these kinds, in order."""
        return tuple(v for v in self.variables if v.kind in kinds)

    def to_xml(self, fmi: FmiVersion, token: str) -> str:
        """`modelDescription.xml`; the same description always gives the same text."""
        return _Writer2(self).text(token) if fmi == 2 else _Writer3(self).text(token)


Attributes = dict[str, str | float | int | bool | None]


def _tag(name: str, inner: Iterable[str] = (), /, **attributes: str | float | int | bool | None) -> str:
    words = [name]
    for key, value in attributes.items():
        if value is None:
            continue
        text = (
            ("true" if value else "false")
            if isinstance(value, bool)
            else repr(value)
            if isinstance(value, float)
            else str(value)
        )
        words.append(f"{key.rstrip('_')}={quoteattr(text)}")
    lines = [line for item in inner for line in item.splitlines()]
    if not lines:
        return f"<{' '.join(words)}/>"
    return "\n".join([f"<{' '.join(words)}>", *(f"  {line}" for line in lines), f"</{name}>"])


class _Writer:
    """What both versions have in common."""

    def __init__(self, description: Description) -> None:
        self.d = description
        self.reference = {v.name: k for k, v in enumerate(description.variables, 1)}

    def head(self) -> dict[str, str]:
        return {
            "modelName": self.d.name,
            "description": self.d.doc,
            "license": "Apache-2.0",
            "generationTool": f"ohmloom {version('ohmloom')}",
            "variableNamingConvention": "structured",
        }

    def unit_names(self) -> list[str]:
        return list(dict.fromkeys(v.unit for v in self.d.variables if v.unit != "1"))

    def units(self) -> str:
        names = self.unit_names()
        return self.unit_definitions(names) if names else ""

    def unit_definitions(self, names: Iterable[str]) -> str:
        return _tag("UnitDefinitions", [
            _tag("Unit", [_tag("BaseUnit", (), **base_exponents(unit))], name=unit) for unit in names
        ])  # fmt: skip

    def logs(self) -> str:
        events = _tag("Category", name="logEvents", description="states that reach or leave a limit")
        return _tag("LogCategories", [
            _tag("Category", name="logStatusError", description="why a function failed"),
            *([] if self.d.timestep else [events]),
        ])  # fmt: skip

    def experiment(self) -> str:
        d = self.d
        return _tag("DefaultExperiment", startTime=0.0, stopTime=d.stop_time, stepSize=d.step_size,
                    tolerance=None if d.timestep else TOLERANCE)  # fmt: skip

    def causality(self, v: Variable) -> tuple[str, str]:
        causality, variability = CAUSALITY[v.kind]
        return causality, "discrete" if self.d.timestep and variability == "continuous" else variability

    def initial(self, v: Variable) -> str | None:
        return None if v.kind == "input" else "exact" if v.is_given else "calculated"

    def typed(self, v: Variable) -> Attributes:
        """Attributes that are spelt alike in both versions."""
        if v.type == "boolean":
            return {"start": bool(v.start) if v.is_given else None}
        if v.type == "integer":
            given = {"min": int(v.low), "max": int(v.high), "start": int(v.start)} if v.is_given else {}
            return dict(given)
        return {
            "unit": None if v.unit == "1" else v.unit,
            "min": v.low if v.is_given and math.isfinite(v.low) else None,
            "max": v.high if v.is_given and math.isfinite(v.high) else None,
            "nominal": v.nominal,
            "start": float(v.start) if v.is_given else None,
            "reinit": True if v.kind == "state" else None,
        }

    def numbers(self, names: Iterable[str] | None) -> str | None:
        """Value of an attribute that lists variables; left out where it would list all."""
        if names is None:
            return None
        return " ".join(str(number) for number in sorted({self.reference[name] for name in names}))

    def finish(self, root: str) -> str:
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{root}\n'


class _Writer2(_Writer):
    """FMI 2.0: variables are known by their index, from 1 on, which here equals their value reference."""

    def __init__(self, description: Description) -> None:
        super().__init__(description)
        # Indicators are no variables there.
        self.shown = [v for v in description.variables if v.kind != "indicator"]

    def text(self, token: str) -> str:
        d = self.d
        sources = [_tag("SourceFiles", [_tag("File", name="fmu.c")])]
        common: Attributes = {
            "modelIdentifier": d.identifier,
            "canNotUseMemoryManagementFunctions": True,
            "canGetAndSetFMUstate": True,
            "canSerializeFMUstate": True,
            "providesDirectionalDerivative": d.has_derivatives or None,
        }
        continuous = _tag("ModelExchange", sources, **common, completedIntegratorStepNotNeeded=True)
        root = _tag("fmiModelDescription", [
            *([] if d.timestep else [continuous]),
            _tag("CoSimulation", sources, **common, canHandleVariableCommunicationStepSize=not d.timestep),
            self.units(),
            self.logs(),
            self.experiment(),
            _tag("ModelVariables", map(self.variable, self.shown)),
            _tag("ModelStructure", [
                self.unknowns("Outputs", d.of("state", "output")),
                *([] if d.timestep else [self.unknowns("Derivatives", d.of("rate"))]),
                _tag("InitialUnknowns", [
                    _tag("Unknown", index=self.reference[v.name], dependencies=self.numbers(v.initial_dependencies))
                    for v in d.of("state", "rate", "output")
                ]),
            ]),
        ], fmiVersion="2.0", guid=token, **self.head(), numberOfEventIndicators=len(d.of("indicator")))  # fmt: skip
        return self.finish(root)

    def variable(self, v: Variable) -> str:
        causality, variability = self.causality(v)
        derivative = self.reference[v.state] if v.kind == "rate" else None
        return _tag(
            "ScalarVariable", [_tag(v.type.capitalize(), **self.typed(v), derivative=derivative)], name=v.name,
            valueReference=self.reference[v.name], description=v.doc, causality=causality, variability=variability,
            initial=self.initial(v),
        )  # fmt: skip

    def unknowns(self, name: str, variables: Iterable[Variable]) -> str:
        return _tag(name, [
            _tag("Unknown", index=self.reference[v.name], dependencies=self.numbers(v.dependencies)) for v in variables
        ])  # fmt: skip


class _Writer3(_Writer):
    """FMI 3.0: variables are known by their value reference; indicators and the time are variables.

    An array has the reference of its first element.
    """

    def __init__(self, description: Description) -> None:
        super().__init__(description)
        by_name = {v.name: v for v in description.variables}
        self.block_of = {name: block for block in description.blocks for name in block.elements}
        self.members = {block.name: [by_name[name] for name in block.elements] for block in description.blocks}
        for name, block in self.block_of.items():
            self.reference[name] = self.reference[block.elements[0]]

    def whole(self, *kinds: Kind) -> list[list[Variable]]:
        """Variables of these kinds, those of an array together."""
        found = []
        for v in self.d.of(*kinds):
            block = self.block_of.get(v.name)
            if block is None:
                found.append([v])
            elif v.name == block.elements[0]:
                found.append(self.members[block.name])
        return found

    def text(self, token: str) -> str:
        d = self.d
        common: Attributes = {
            "modelIdentifier": d.identifier,
            "canGetAndSetFMUState": True,
            "canSerializeFMUState": True,
            "providesDirectionalDerivatives": d.has_derivatives or None,
            "providesAdjointDerivatives": d.has_derivatives or None,
        }
        time = _tag("Float64", name="time", valueReference=0, causality="independent", variability="continuous",
                    description="simulation time", unit="s")  # fmt: skip
        structure = [
            *(self.unknown("Output", v) for v in self.whole("state", "output")),
            *(self.unknown("ContinuousStateDerivative", v) for v in self.whole("rate")),
            *(self.unknown("InitialUnknown", v) for v in self.whole("state", "rate", "output")),
            *(self.unknown("EventIndicator", v) for v in self.whole("indicator")),
        ]
        root = _tag("fmiModelDescription", [
            *([] if d.timestep else [_tag("ModelExchange", **common)]),
            _tag("CoSimulation", **common, canHandleVariableCommunicationStepSize=not d.timestep,
                 fixedInternalStepSize=d.timestep),
            self.units(),
            self.logs(),
            self.experiment(),
            _tag("ModelVariables", [time, *map(self.variable, self.whole(*sum(KINDS, ())))]),
            _tag("ModelStructure", structure),
        ], fmiVersion="3.0", instantiationToken=token, **self.head())  # fmt: skip
        return self.finish(root)

    def units(self) -> str:
        return self.unit_definitions(dict.fromkeys(("s", *self.unit_names())))

    def variable(self, group: list[Variable]) -> str:
        v, block = group[0], self.block_of.get(group[0].name)
        causality, variability = self.causality(v)
        derivative = self.reference[v.state] if v.kind == "rate" else None
        typed, sizes = self.typed(v), []
        if block is not None:
            sizes = [_tag("Dimension", start=n) for n in block.shape]
            typed["start"] = " ".join(repr(float(x.start)) for x in group) if v.is_given else None
        return _tag(
            TYPES3[v.type], sizes, name=v.name if block is None else block.name, valueReference=self.reference[v.name],
            description=v.doc if block is None else block.doc, causality=causality, variability=variability,
            initial=self.initial(v), **typed, derivative=derivative,
        )  # fmt: skip

    def unknown(self, name: str, group: list[Variable]) -> str:
        """An array depends on all that one of its elements depends on."""
        needs = [v.initial_dependencies if name == "InitialUnknown" else v.dependencies for v in group]
        listed = None if None in needs else {need for found in needs for need in found or ()}
        return _tag(name, valueReference=self.reference[group[0].name], dependencies=self.numbers(listed))


def build_description(identifier: str) -> str:
    """`sources/buildDescription.xml` of FMI 3.0."""
    root = _tag("fmiBuildDescription", [
        _tag("BuildConfiguration", [
            _tag("SourceFileSet", [_tag("SourceFile", name="fmu.c")], language="C99")
        ], modelIdentifier=identifier)
    ], fmiVersion="3.0")  # fmt: skip
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{root}\n'


def index_page(title: str, paragraphs: Iterable[str], description: Description, notes: dict[str, str]) -> str:
    """`documentation/index.html`: what the model computes, and its variables, with a note on those that have one."""
    rows = [
        f"<tr><td>{escape(v.name)}</td><td>{v.kind}</td><td>{escape(v.unit)}</td>"
        f"<td>{repr(float(v.start)) if v.is_given else ''}</td><td>{escape(v.doc + notes.get(v.name, ''))}</td></tr>"
        for v in description.variables
    ]
    return "\n".join([
        "<!DOCTYPE html>", '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{escape(title)}</title></head><body>",
        f"<h1>{escape(title)}</h1>", *(f"<p>{escape(text)}</p>" for text in paragraphs),
        "<table><tr><th>variable</th><th>kind</th><th>unit</th><th>start</th><th>meaning</th></tr>", *rows,
        "</table>", "</body></html>", "",
    ])  # fmt: skip
