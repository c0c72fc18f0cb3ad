"""Pictures of crossbars: heat maps of devices and potentials, the circuit with its values, pulses of every line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits.crossbar import Crossbar
from ohmloom.circuits.crossbar_read import Read
from ohmloom.errors import ParameterError, UnknownNameError, expect_type
from ohmloom.units import axis_unit, format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ohmloom.circuits.pulses import PulseTrain

What = Literal["conductance", "current", "power", "v_row", "v_column", "v_device", "ir_drop"]
UNITS = {"conductance": "S", "current": "A", "power": "W", "v_row": "V", "v_column": "V", "v_device": "V",
         "ir_drop": "V"}  # fmt: skip
TITLES = {"conductance": "conductance", "current": "current through the device", "power": "power in the device",
          "v_row": "potential of the row's node", "v_column": "potential of the column's node",
          "v_device": "voltage across the device", "ir_drop": "voltage lost in wires, drivers and senses"}  # fmt: skip
# A schematic of more lines is a picture of nothing.
MOST_LINES = 8
WIRE, DEVICE, TERMINAL = "#5a6470", "#c8dbe8", "#c03a2b"


def plot_crossbar(crossbar: Crossbar, v: Any = None, *, what: What = "conductance", ax: Axes | None = None) -> Axes:
    """Draw one value of every crosspoint as a heat map: word lines downwards, bit lines to the right.

    Parameters
    ----------
    crossbar
        One crossbar, no batch.
    v
        Voltages of the rows [V], axes (word_line,), for everything but the conductance.
    what
        ``conductance``, ``current``, ``power``, ``v_row``, ``v_column`` (potentials of the nodes), ``v_device``, or
        ``ir_drop``: by how much the voltage across a device falls short of its driver's, signed as the driver's.
    ax
        Axes to draw into; without it, those of a new figure.

    Raises
    ------
    ParameterError
        If the crossbar is a batch, or voltages are missing or of other axes.
    UnknownNameError
        If there is no such value.
    """
    values = _values(crossbar, v, what)
    if ax is None:
        from matplotlib.figure import Figure

        ax = Figure(figsize=(5.2, 4.2), layout="constrained").add_subplot()
    factor, unit = axis_unit(float(np.abs(values).max(initial=0.0)), UNITS[what])
    signed = bool((values < 0.0).any())
    largest = float(np.abs(values).max(initial=0.0)) * factor or 1.0
    limits = {"vmin": -largest, "vmax": largest, "cmap": "RdBu_r"} if signed else {"cmap": "viridis"}
    image = ax.imshow(values * factor, aspect="auto", interpolation="nearest", **limits)
    colours = ax.figure.colorbar(image, ax=ax)
    colours.set_label(f"{TITLES[what]} [{unit}]")
    ax.set_xlabel("bit line (senses below)")
    ax.set_ylabel("word line (drivers on the left)")
    ax.locator_params(integer=True)
    return ax


def plot_schematic(crossbar: Crossbar, v: Any = None, *, ax: Axes | None = None) -> Axes:
    """Draw the circuit of a small crossbar with its values: wires, devices, drivers and senses.

    Parameters
    ----------
    crossbar
        One crossbar of at most 8 x 8 lines.
    v
        Voltages of the rows [V], axes (word_line,); with them the currents into the senses are written too.

    Raises
    ------
    ParameterError
        If the crossbar is a batch or larger, or `v` has other axes.
    """
    expect_type("plot_schematic", crossbar, Crossbar)
    m, n = crossbar.shape
    if crossbar.conductance.ndim != 2 or max(m, n) > MOST_LINES:
        raise ParameterError(f"plot_schematic: expected one crossbar of at most {MOST_LINES} x {MOST_LINES} lines, got "
                             f"shape {crossbar.conductance.shape}. Use plot_crossbar.")  # fmt: skip
    read = None if v is None else _read("plot_schematic", crossbar, v)
    if ax is None:
        from matplotlib.figure import Figure

        ax = Figure(figsize=(1.6 * n + 2.2, 1.2 * m + 1.4), layout="constrained").add_subplot()
    for i in range(m):
        _line(ax, (-0.9, n - 0.55), (i, i), crossbar.drive == "both", np.isfinite(crossbar.r_driver[i]))
        label = f"row {i}" if v is None else f"row {i}\n{format_quantity(float(np.asarray(v)[i]), 'V')}"
        ax.text(-1.0, i, label, ha="right", va="center", fontsize=8)
    for j in range(n):
        _line(ax, (m - 0.15, -0.45), (j, j), crossbar.sense == "both", np.isfinite(crossbar.r_sense[j]), upright=True)
        current = "" if read is None else f"\n{format_quantity(float(read.current[j]), 'A')}"
        ax.text(j, m + 0.05, f"column {j}{current}", ha="center", va="top", fontsize=8)
    for i, j in np.ndindex(m, n):
        if crossbar.conductance[i, j] > 0.0:
            _device(ax, i, j, format_quantity(float(crossbar.conductance[i, j]), "S"))
    ends = [f"{name} {_range(r)}" for name, r in (("drivers", crossbar.r_driver), ("senses", crossbar.r_sense))]
    ax.set_title(f"segments: rows {format_quantity(crossbar.r_row, 'Ohm')}, columns "
                 f"{format_quantity(crossbar.r_column, 'Ohm')}; {', '.join(ends)}", fontsize=8)  # fmt: skip
    ax.set_xlim(-1.7, n - 0.3)
    ax.set_ylim(m + 0.6, -0.7)
    ax.set_axis_off()
    return ax


def plot_pulses(train: PulseTrain, *, ax: Axes | None = None) -> Axes:
    """Draw the voltage of every row and column over time, one below the other, all to one scale."""
    if ax is None:
        from matplotlib.figure import Figure

        lines = train.v_row.shape[1] + train.v_column.shape[1]
        ax = Figure(figsize=(7.0, 0.35 * lines + 1.2), layout="constrained").add_subplot()
    drives = [(f"row {i}", train.v_row[:, i]) for i in range(train.v_row.shape[1])]
    drives += [(f"column {j}", train.v_column[:, j]) for j in range(train.v_column.shape[1])]
    largest = max((float(np.abs(volts).max()) for _, volts in drives), default=0.0) or 1.0
    factor, unit = axis_unit(float(train.t[-1]), "s")
    for k, (name, volts) in enumerate(drives):
        ax.axhline(-k, color=WIRE, linewidth=0.4)
        ax.plot(
            train.t * factor, 0.42 * volts / largest - k, color="C0" if name.startswith("row") else "C1", linewidth=1.2
        )
    ax.set_yticks([-k for k in range(len(drives))], [name for name, _ in drives])
    ax.set_xlabel(f"time [{unit}]")
    ax.set_title(f"full swing {format_quantity(largest, 'V')}", fontsize=9, loc="right")
    return ax


def _values(crossbar: Crossbar, v: Any, what: str) -> FloatArray:
    expect_type("plot_crossbar", crossbar, Crossbar)
    if what not in UNITS:
        raise UnknownNameError.of("plot_crossbar: what", what, UNITS)
    if crossbar.conductance.ndim != 2:
        raise ParameterError(f"plot_crossbar: expected one crossbar, axes (word_line, bit_line), got shape "
                             f"{crossbar.conductance.shape}. Take one of the batch.")  # fmt: skip
    if what == "conductance":
        return crossbar.conductance
    if v is None:
        raise ParameterError(f"plot_crossbar: v: expected voltages of the rows for {what!r}, got none. Give one per "
                             "word line.")  # fmt: skip
    read = _read("plot_crossbar", crossbar, v)
    across = read.v_row - read.v_column
    found = {"current": read.device_current, "power": read.device_power, "v_row": read.v_row,
             "v_column": read.v_column, "v_device": across,
             "ir_drop": np.asarray(v, dtype=np.float64)[:, None] - across}  # fmt: skip
    return found[what]


def _read(where: str, crossbar: Crossbar, v: Any) -> Read:
    read = crossbar.read(v)
    if read.current.ndim != 1:
        raise ParameterError(f"{where}: v: expected one pattern, axes (word_line={crossbar.shape[0]},), got shape "
                             f"{np.shape(v)}. Take one of them.")  # fmt: skip
    return read


def _line(ax: Axes, along: tuple[float, float], across: tuple[float, float], both: bool, connected: bool, *,
          upright: bool = False) -> None:  # fmt: skip
    x, y = (across, along) if upright else (along, across)
    ax.plot(x, y, color=WIRE, linewidth=1.4, zorder=1)
    ends = (0, 1) if both else (0,)
    for k in ends:
        ax.plot(x[k], y[k], marker="o", color=TERMINAL, markerfacecolor=TERMINAL if connected else "white", zorder=3)


def _device(ax: Axes, i: int, j: int, label: str) -> None:
    """A resistor from the row's node to the column's, drawn aslant beside their crossing."""
    ax.plot([j - 0.45, j], [i, i + 0.45], color=WIRE, linewidth=0.8, zorder=1)
    ax.plot([j - 0.45, j], [i, i + 0.45], linestyle="none", marker=".", color=WIRE, zorder=2)
    ax.text(j - 0.22, i + 0.22, label, ha="center", va="center", fontsize=6.5, zorder=4,
            bbox={"boxstyle": "square,pad=0.25", "facecolor": DEVICE, "edgecolor": WIRE, "linewidth": 0.6})  # fmt: skip


def _range(r: FloatArray) -> str:
    low, high = float(r.min()), float(r.max())
    words = ["floating" if np.isinf(x) else format_quantity(x, "Ohm") for x in (low, high)]
    return words[0] if low == high else f"{words[0]} to {words[1]}"
