"""Crossbars: word lines across, bit lines down, a coloured square where a device stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.errors import ParameterError
from ohmloom.mapping import Crosspoint, Plan, Tile
from ohmloom.report._replay_data import INK
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEVICE: Final = 0.76  # side of a device's square; lines are 1 apart
REFERENCE_GAP: Final = 0.6  # more space between the last bit line and the reference column
LINE_COLOUR, INVERTED_COLOUR = "#8a9099", "#c03a2b"
ON_DARK, ON_BRIGHT = "#fdfdfd", "#101010"
MOST_INCHES: Final = 12.0


def plot_tile(plan: Plan, tile: int, *, conductances: npt.ArrayLike | None = None, ax: Axes | None = None) -> Axes:
    """Draw one tile as a crossbar: a square for each device, coloured by conductance [S, log scale].

    Each word line carries its sender and the read voltage, negative and in red for an inhibitory sender; each bit
    line its receiver. A crossing without a square has no device. A number is the delay in steps, where it is more
    than 1. The reference column, if the tile has one, stands apart on the right.

    Parameters
    ----------
    plan, tile
        What is placed where, and the index of the tile.
    conductances
        Axes (synapse,), in the network's order [S]; the plan's initial ones by default.
    ax
        Axes to draw into; without it, those of a new figure.

    Raises
    ------
    ParameterError
        If there is no such tile, or a conductance is missing or not positive.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import Network
    >>> network = Network.random(system="HP", rng=np.random.default_rng(1))
    >>> plot_tile(place(network, Hardware.load("hp_1t1r")), 0).get_xlabel()
    'bit lines: receiving neuron'
    """
    from matplotlib.figure import Figure

    if not 0 <= tile < len(plan.tiles):
        raise ParameterError(f"plot_tile.tile: expected an index from 0 to {len(plan.tiles) - 1}, got {tile}. "
                             f"The plan has {len(plan.tiles)} tiles.")  # fmt: skip
    values = _conductances(plan, conductances)
    if ax is None:
        ax = Figure(figsize=_inches(plan.tiles[tile]), layout="constrained").add_subplot()
    _draw(plan, tile, values, ax)
    return ax


def plot_plan(plan: Plan) -> Figure:
    """Draw all tiles of a plan, with a legend."""
    from matplotlib.figure import Figure

    if not plan.tiles:
        figure = Figure(figsize=(4, 1))
        figure.text(0.5, 0.5, "no synapses, so no tile", ha="center", va="center")
        return figure
    across = min(2, len(plan.tiles))
    down = -(-len(plan.tiles) // across)
    sizes = [_inches(tile) for tile in plan.tiles]
    width, height = max(w for w, _ in sizes), max(h for _, h in sizes)
    figure = Figure(figsize=(across * width, down * height + 0.5), layout="constrained")
    for index in range(len(plan.tiles)):
        _draw(plan, index, _conductances(plan, None), figure.add_subplot(down, across, index + 1))
    figure.legend(handles=_legend(plan), loc="outside lower center", ncols=across, frameon=False, fontsize="small")
    return figure


def _conductances(plan: Plan, given: npt.ArrayLike | None) -> FloatArray:
    """By synapse, whatever the order of the plan's crosspoints."""
    if given is None:
        values = np.zeros(len(plan.crosspoints))
        for point in plan.crosspoints:
            values[point.synapse] = point.conductance
        return values
    checked: FloatArray = frozen_array("plot_tile.conductances", given, (f"synapse={len(plan.crosspoints)}",))
    if not (checked > 0.0).all():
        raise ParameterError(f"plot_tile.conductances: expected numbers > 0 S, got {checked.min():g} S. "
                             "Give conductances, not weights.")  # fmt: skip
    return checked


def _inches(tile: Tile) -> tuple[float, float]:
    pitch, columns = _pitch(tile), len(tile.columns) + 2 * tile.has_reference
    return max(5.0, 3.3 + pitch * columns), max(2.9, 1.9 + pitch * len(tile.rows))


def _pitch(tile: Tile) -> float:
    return min(0.3, MOST_INCHES / max(len(tile.rows), len(tile.columns)))


def _draw(plan: Plan, index: int, conductances: FloatArray, ax: Axes) -> None:
    from matplotlib.colors import LogNorm

    tile = plan.tiles[index]
    points = [point for point in plan.crosspoints if point.tile == index]
    device = plan.hardware.devices[tile.kind]
    g_off, g_on = float(device.conductance(0.0)), float(device.conductance(1.0))
    values = conductances[[point.synapse for point in points]]
    low, high = min(g_off, float(values.min())), max(g_on, float(values.max()))
    norm = LogNorm(low, high)
    _draw_lines(tile, ax)
    cells = _squares([(point.column, point.row) for point in points], values, norm, ax, "devices", INK)
    if tile.has_reference:
        places = [(_reference_at(tile), row) for row in range(len(tile.rows))]
        _squares(places, np.full(len(places), g_off), norm, ax, "reference", LINE_COLOUR)
    _write_taps(points, cells, values, ax)
    _label(plan, tile, points, ax)
    ticks = np.geomspace(low, high, 5)
    share = 1.0 / (abs(ax.get_xlim()[1] - ax.get_xlim()[0]))  # one pitch, so that the bar is as tall as the tile
    bar = ax.figure.colorbar(cells, cax=ax.inset_axes((1.0 + 0.4 * share, 0.0, 0.5 * share, 1.0)))
    bar.set_label("conductance", fontsize=8)
    bar.set_ticks(list(ticks), labels=[format_quantity(float(g), "S") for g in ticks], fontsize=8)
    bar.ax.minorticks_off()
    size = f"{len(tile.rows)} word lines × {len(tile.columns)} bit lines, {len(points)} devices"
    size += " + reference" if tile.has_reference else ""
    # Card names are other people's text: a $ in it is no formula.
    ax.set_title(f"{tile.kind}: card {device.name}\n{size}", fontsize=9, parse_math=False)


def _reference_at(tile: Tile) -> float:
    return len(tile.columns) + REFERENCE_GAP


def _draw_lines(tile: Tile, ax: Axes) -> None:
    rows, columns = len(tile.rows), len(tile.columns)
    downs = [*range(columns), *([_reference_at(tile)] if tile.has_reference else [])]
    line: dict[str, Any] = {"colors": LINE_COLOUR, "linewidth": 0.8, "zorder": 1}
    ax.hlines(np.arange(rows), -0.8, downs[-1] + 0.5, gid="word lines", **line)
    ax.vlines(downs, -0.5, rows - 0.2, gid="bit lines", **line)
    ax.plot(downs, np.full(len(downs), rows - 0.2), linestyle="none", marker="v", markersize=3.5, color=LINE_COLOUR)
    ax.set(xlim=(-0.9, downs[-1] + 0.6), ylim=(rows + 0.1, -0.7), aspect="equal")


def _squares(places: Any, values: FloatArray, norm: Any, ax: Axes, name: str, edge: str) -> Any:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    corners = [(x - DEVICE / 2, y - DEVICE / 2) for x, y in places]
    patches = [Rectangle(corner, DEVICE, DEVICE) for corner in corners]
    squares = PatchCollection(patches, norm=norm, cmap="viridis", edgecolor=edge, linewidth=0.5, gid=name, zorder=2)
    squares.set_array(values)
    if name == "reference":
        squares.set_linestyle("--")
    return ax.add_collection(squares)


def _write_taps(points: list[Crosspoint], cells: Any, values: FloatArray, ax: Axes) -> None:
    for point, colour in zip(points, cells.to_rgba(values), strict=True):
        if point.tap > 1:
            is_dark = float(colour[:3] @ (0.299, 0.587, 0.114)) < 0.55
            ax.text(point.column, point.row, str(point.tap), ha="center", va="center_baseline", fontsize=7,
                    color=ON_DARK if is_dark else ON_BRIGHT, zorder=3)  # fmt: skip


def _label(plan: Plan, tile: Tile, points: list[Crosspoint], ax: Axes) -> None:
    labels, voltage = plan.network.labels(), plan.hardware.read.voltage.value
    polarity = {point.row: point.polarity for point in points}
    size = min(8.0, 60 * _pitch(tile))
    words = [
        f"{labels[neuron]}  {'+' if polarity[row] > 0 else '−'}{format_quantity(voltage, 'V')}"
        for row, neuron in enumerate(tile.rows)
    ]
    ax.set_yticks(range(len(words)), words, fontsize=size)
    for row, text in enumerate(ax.get_yticklabels()):
        if polarity[row] < 0:
            text.set_color(INVERTED_COLOUR)
    columns, names = [float(k) for k in range(len(tile.columns))], [labels[neuron] for neuron in tile.columns]
    if tile.has_reference:
        columns, names = [*columns, _reference_at(tile)], [*names, "reference"]
    ax.set_xticks(columns, names, rotation=90, fontsize=size)
    ax.set_xlabel("bit lines: receiving neuron", fontsize=8)
    ax.set_ylabel("word lines: sending neuron, read voltage", fontsize=8)
    ax.tick_params(length=0, pad=2)
    ax.spines[:].set_visible(False)


def _legend(plan: Plan) -> list[Any]:
    from matplotlib.lines import Line2D

    def mark(label: str, **style: Any) -> Line2D:
        return Line2D([], [], linestyle="none", label=label, **style)

    absent = plan.hardware.array.disabled
    rows = [
        mark("square: a device, coloured by its conductance", marker="s", color="#21918c", markeredgecolor=INK),
        mark(f"crossing without a square: no synapse ({absent})", marker="+", color=LINE_COLOUR, markersize=9),
    ]
    if any(point.tap > 1 for point in plan.crosspoints):
        rows.append(mark("number: delay in steps, where more than 1", marker="$3$", color=INK))
    if any(point.polarity < 0 for point in plan.crosspoints):
        rows.append(mark("red, −: inhibitory sender, read with inverted voltage", marker="_", color=INVERTED_COLOUR,
                         markersize=9))  # fmt: skip
    if any(tile.has_reference for tile in plan.tiles):
        rows.append(mark("reference: devices at lowest conductance, subtracted", marker="s",
                         color="#440154", markeredgecolor=LINE_COLOUR))  # fmt: skip
    return rows
