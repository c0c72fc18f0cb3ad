"""What a simulated device did over time."""

from __future__ import annotations

import html
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array, read_arrays, write_arrays
from ohmloom.errors import FileFormatError, ParameterError
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMAT = "ohmloom.trace"
VERSION = 1
ARRAYS = ("t", "v", "i", "q", "s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """Voltage, current and state of one device, axes (time,), SI.

    Attributes
    ----------
    t, v, i
        Time in s, voltage in V, current in A, positive into the first terminal.
    q, s
        State charge ``q = s q_d`` in C (not the integral of `i`, which goes on at a wall) and state in [0,
        1].
    provenance
        JSON text: the version, device card, digests and settings that made this trace.

    Raises
    ------
    ParameterError
        If an array is not finite, has other axes, or differs in length.

    Examples
    --------
    >>> from ohmloom.devices import Device
    >>> trace = Device.load("hp_tio2").simulate([0.0, 1.0, 0.0], [0.0, 0.5, 1.0], s0=0.2)
    >>> trace.s.shape, bool(trace.s[-1] > 0.2)
    ((3,), True)
    """

    t: FloatArray
    v: FloatArray
    i: FloatArray
    q: FloatArray
    s: FloatArray
    provenance: str = "{}"

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ARRAYS:
            array = frozen_array(f"Trace.{name}", getattr(self, name), ("time",))
            object.__setattr__(self, name, array)
            if array.shape != self.t.shape:
                raise ParameterError(
                    f"Trace.{name}: expected axes (time,) as long as t, {self.t.size}, got {array.size}. "
                    "Give one value per time."
                )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the loop: current over voltage, both with their units; returns the axes."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").subplots()
        ax.plot(self.v, self.i)
        ax.set_xlabel("voltage [V]")
        ax.set_ylabel("current [A]")
        return ax

    def save(self, path: str | Path) -> None:
        """Write all arrays and the provenance as npz: the same trace always gives the same bytes."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        write_arrays(path, "trace", VERSION, {"provenance": json.loads(self.provenance)}, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Trace:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If it is not a whole trace file.
        """
        header, arrays = read_arrays(path, "trace", VERSION, ARRAYS)
        try:
            provenance = json.dumps(header.get("provenance", {}), sort_keys=True)
            return cls(**arrays, provenance=provenance)
        except ParameterError as error:
            raise FileFormatError(f"{path}: {error}") from error

    def _repr_html_(self) -> str:
        name = json.loads(self.provenance).get("device", "device")
        rows = [
            ("device", str(name)),
            ("points", str(self.t.size)),
            ("duration", format_quantity(float(self.t[-1] - self.t[0]) if self.t.size else 0.0, "s")),
            ("largest voltage", format_quantity(float(np.abs(self.v).max(initial=0.0)), "V")),
            ("largest current", format_quantity(float(np.abs(self.i).max(initial=0.0)), "A")),
        ]
        cells = "".join(f"<tr><th>{html.escape(key)}</th><td>{html.escape(value)}</td></tr>" for key, value in rows)
        return f"<table>{cells}</table>"
