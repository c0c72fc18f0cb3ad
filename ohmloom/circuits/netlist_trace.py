"""What a netlist did: node voltages, element currents, states and charges of memristors, by name."""

from __future__ import annotations

import html
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array, read_arrays, write_arrays
from ohmloom._files import write_atomic
from ohmloom.errors import FileFormatError, ParameterError, UnknownNameError, shown
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VERSION = 1
PARTS = {"v": "node", "i": "element", "s": "memristor", "q": "memristor"}
V = TypeVar("V")


class ByName(Mapping[str, V]):
    """Values by name, in order; an unknown name is told with the nearest known one."""

    def __init__(self, where: str, values: Mapping[str, V]) -> None:
        self._where = where
        self._values = dict(values)

    def __getitem__(self, name: str) -> V:
        if name not in self._values:
            raise UnknownNameError.of(self._where, str(name), self._values)
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __repr__(self) -> str:
        return repr(self._values)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoint:
    """Node voltages `v` [V] and element currents `i` [A, from p to n] by name.

    `residual` is the largest violation of Kirchhoff's current law at any node, over the largest current.
    """

    v: Mapping[str, float]
    i: Mapping[str, float]
    residual: float


@dataclass(frozen=True, kw_only=True, eq=False)
class NetlistTrace:
    """A transient, SI; every array has axes (time,).

    Attributes
    ----------
    t
        Times in s.
    v, i
        Voltage of each node against ground, current through each element from p to n, by name.
    s, q
        State in [0, 1] and state charge ``s q_d`` in C of each memristor, by name.
    residual
        Largest violation of Kirchhoff's current law at any node and time, over the largest current.
    provenance
        JSON text: version, engine, netlist and settings.

    Raises
    ------
    ParameterError
        If an array is not finite, has other axes, or differs in length.
    """

    t: FloatArray
    v: Mapping[str, FloatArray]
    i: Mapping[str, FloatArray]
    s: Mapping[str, FloatArray]
    q: Mapping[str, FloatArray]
    residual: float
    provenance: str = "{}"

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        object.__setattr__(self, "t", frozen_array("NetlistTrace.t", self.t, ("time",)))
        for part in PARTS:
            where = f"NetlistTrace.{part}"
            arrays = {}
            for name, values in getattr(self, part).items():
                arrays[name] = frozen_array(f"{where}[{name}]", values, ("time",))
                if arrays[name].shape != self.t.shape:
                    raise ParameterError(f"{where}[{name}]: expected axes (time,) as long as t, {self.t.size}, got "
                                         f"{arrays[name].size}. Give one value per time.")  # fmt: skip
            object.__setattr__(self, part, ByName(where, arrays))

    def at(self, t: Any) -> NetlistTrace:
        """The same at other times `t` [s], by straight lines; they lie within the trace's own.

        Raises
        ------
        ParameterError
            If a time lies outside.
        """
        times: FloatArray = frozen_array("NetlistTrace.at: t", t, ("time",))
        low, high = float(self.t[0]), float(self.t[-1])
        # The last time of a simulation is t_end but for rounding.
        slack = 1e-12 * (high - low)
        outside = (times < low - slack) | (times > high + slack)
        if outside.any():
            raise ParameterError(f"NetlistTrace.at: t: expected times from {low:g} s to {high:g} s, got "
                                 f"{times[outside][0]:g} s. Simulate for longer.")  # fmt: skip
        parts: dict[str, Any] = {
            part: {name: np.interp(times, self.t, values) for name, values in getattr(self, part).items()}
            for part in PARTS
        }
        return NetlistTrace(t=times, **parts, residual=self.residual, provenance=self.provenance)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the node voltages over time, with their units; returns the axes."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").subplots()
        for name, values in self.v.items():
            ax.plot(self.t, values, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("voltage [V]")
        if self.v:
            ax.legend(title="node")
        return ax

    def save(self, path: str | Path) -> None:
        """Write everything as npz: the same trace always gives the same bytes."""
        header: dict[str, Any] = {part: list(getattr(self, part)) for part in PARTS}
        header |= {"provenance": json.loads(self.provenance), "residual": self.residual}
        write_arrays(path, "netlist_trace", VERSION, header, {"t": self.t, **{p: self._table(p) for p in PARTS}})

    @classmethod
    def load(cls, path: str | Path) -> NetlistTrace:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If it is not a whole file of a netlist's trace.
        """
        header, arrays = read_arrays(path, "netlist_trace", VERSION, ("t", *PARTS))
        parts: dict[str, Any] = {}
        for part in PARTS:
            names = header.get(part)
            if not isinstance(names, list) or arrays[part].shape != (arrays["t"].size, len(names)):
                raise FileFormatError(f"{path}: {part}: expected axes (time, {PARTS[part]}) with a name for each, got "
                                      f"shape {arrays[part].shape}. Make the trace again.")  # fmt: skip
            parts[part] = {str(name): arrays[part][:, k] for k, name in enumerate(names)}
        residual = header.get("residual")
        if not isinstance(residual, float | int):
            raise FileFormatError(f"{path}: residual: expected a number, got {shown(residual)}. Make the trace again.")
        try:
            provenance = json.dumps(header.get("provenance", {}), sort_keys=True)
            return cls(t=arrays["t"], **parts, residual=float(residual), provenance=provenance)
        except ParameterError as error:
            raise FileFormatError(f"{path}: {error}") from error

    def write_csv(self, path: str | Path) -> None:
        """Write a table with columns t, v(node), i(element), s(memristor), q(memristor), SI, to the last bit."""
        names = ["t", *(f"{part}({name})" for part in PARTS for name in getattr(self, part))]
        table = np.column_stack([self.t, *(self._table(part) for part in PARTS)])
        head = ["# t in s, v in V, i in A from p to n, s in [0, 1], q in C", ",".join(names)]
        write_atomic(path, "\n".join([*head, *(",".join(map(repr, row)) for row in table.tolist()), ""]))

    def _table(self, part: str) -> FloatArray:
        columns = list(getattr(self, part).values())
        return np.column_stack(columns) if columns else np.zeros((self.t.size, 0))

    def _repr_html_(self) -> str:
        rows = [
            ("points", str(self.t.size)),
            ("duration", format_quantity(float(np.ptp(self.t)) if self.t.size else 0.0, "s")),
            *((PARTS[part], ", ".join(getattr(self, part))) for part in ("v", "i")),
        ]
        cells = "".join(f"<tr><th>{html.escape(a)}</th><td>{html.escape(b)}</td></tr>" for a, b in rows)
        return f"<table>{cells}</table>"
