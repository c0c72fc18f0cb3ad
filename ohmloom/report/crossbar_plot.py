"""Crossbars: word lines across, bit lines down, a coloured square where a device stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.errors import ParameterError
from ohmloom.mapping import Crosspoint, Plan, Tile, tile_grid
from ohmloom.mapping.grid import DISABLED, FORBIDDEN, PARTNER
from ohmloom.report._replay_data import INK
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEVICE: Final = 0.76  # side of a device's square; lines are 1 apart
FRAME: Final = 0.92  # side of a mark around a device
SECOND: Final = 0.45  # side of the second device of a pair
REFERENCE_GAP: Final = 0.6  # more space between the last bit line and the reference column
LINE_COLOUR, INVERTED_COLOUR, EXCITATORY_COLOUR = "#8a9099", "#c03a2b", "#2a76c6"
ON_DARK, ON_BRIGHT = "#fdfdfd", "#010101"
MOST_INCHES: Final = 12.0


def plot_tile(plan: Plan, tile: int, *, conductances: npt.ArrayLike | None = None, ax: Axes | None = None) -> Axes:
    """Draw one tile as a crossbar: a square for each device, coloured by conductance and weight [S, log scale].

    Each word line carries its sender and the read voltage, negative for an inhibitory sender whose sign is that of
    the voltage; names of inhibitory neurons are red. Each bit line carries its receiver. A crossing without a square
    has no synapse: a dot where the net has none, a cross where none may be. Spare lines are dotted. A number is the
    delay in steps, where it is more than 1. The reference column, if the tile has one, stands apart on the right.

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

    _check_tile("plot_tile", plan, tile)
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
    figure.suptitle(f"{plan.network.name} on {plan.hardware.name}: a spike enters on a row, and every device on it "
                    "adds a current to its column", fontsize=10, parse_math=False)  # fmt: skip
    return figure


def _check_tile(where: str, plan: Plan, tile: int) -> None:
    if not 0 <= tile < len(plan.tiles):
        raise ParameterError(f"{where}.tile: expected an index from 0 to {len(plan.tiles) - 1}, got {tile}. "
                             f"The plan has {len(plan.tiles)} tiles.")  # fmt: skip


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


def _size(tile: Tile) -> tuple[int, int]:
    return len(tile.rows) + tile.spare_rows, len(tile.columns) + tile.spare_columns


def _inches(tile: Tile) -> tuple[float, float]:
    pitch, (rows, columns) = _pitch(tile), _size(tile)
    return max(5.4, 4.0 + pitch * (columns + 2 * tile.has_reference)), max(2.9, 1.9 + pitch * rows)


def _pitch(tile: Tile) -> float:
    return min(0.3, MOST_INCHES / max(_size(tile)))


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
    _draw_others(plan, index, ax)
    partners = np.argwhere(tile_grid(plan, index).cell == PARTNER)
    if len(partners):
        _squares([(int(j), int(i)) for i, j in partners], np.full(len(partners), g_off), norm, ax, "partners",
                 LINE_COLOUR)  # fmt: skip
    _write_taps(points, cells, values, ax)
    _label(plan, tile, ax)
    _draw_bar(tile, (low, high), (g_off, g_on), cells, ax)
    size = f"{len(tile.rows)} word lines × {len(tile.columns)} bit lines, {len(points)} devices"
    size += " + reference" if tile.has_reference else ""
    size += f", spare {tile.spare_rows} + {tile.spare_columns}" if tile.spare_rows or tile.spare_columns else ""
    # Card names are other people's text: a $ in it is no formula.
    ax.set_title(f"{tile.kind}: card {device.name}\n{size}", fontsize=9, parse_math=False)


def plot_tile_values(
    plan: Plan, tile: int, values: npt.ArrayLike, *, label: str, unit: str, marked: tuple[int, ...] = (),
    ax: Axes | None = None,
) -> Axes:  # fmt: skip
    """Draw one tile as `plot_tile` does, its devices coloured by any number from 0 on.

    Parameters
    ----------
    plan, tile
        What is placed where, and the index of the tile.
    values
        Axes (synapse,), in the network's order, in SI; of the synapses on this tile, none is negative.
    label, unit
        What the colour means, and the unit of `values`; ``%`` writes a fraction in percent.
    marked
        Synapses to put a frame around.
    ax
        Axes to draw into; without it, those of a new figure.

    Raises
    ------
    ParameterError
        If there is no such tile, or a value is missing or negative.
    """
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    _check_tile("plot_tile_values", plan, tile)
    made = plan.tiles[tile]
    if ax is None:
        ax = Figure(figsize=_inches(made), layout="constrained").add_subplot()
    given = frozen_array("plot_tile_values.values", values, (f"synapse={len(plan.crosspoints)}",))
    points = [point for point in plan.crosspoints if point.tile == tile]
    shown = given[[point.synapse for point in points]]
    if not (shown >= 0.0).all():
        raise ParameterError(f"plot_tile_values.values: expected numbers >= 0, got {shown.min():g}. Correct them.")
    high = float(shown.max(initial=0.0)) or 1.0
    _draw_lines(made, ax)
    cells = _squares([(point.column, point.row) for point in points], shown, Normalize(0.0, high), ax, "devices", INK,
                     cmap="cividis")  # fmt: skip
    _draw_others(plan, tile, ax)
    for point in points:
        if point.synapse in marked:
            corner = point.column - FRAME / 2, point.row - FRAME / 2
            ax.add_patch(Rectangle(corner, FRAME, FRAME, fill=False, edgecolor=INVERTED_COLOUR, linewidth=2.2,
                                   gid=f"marked {point.synapse}", zorder=4))  # fmt: skip
    _write_taps(points, cells, shown, ax)
    _label(plan, made, ax)
    bar = ax.figure.colorbar(cells, cax=_bar_axes(ax))
    bar.set_label(label, fontsize=8)
    ticks = [float(v) for v in np.linspace(0.0, high, 5)]
    words = [f"{100.0 * v:.2g} %" if unit == "%" else format_quantity(v, unit) for v in ticks]
    bar.set_ticks(ticks, labels=words, fontsize=8)
    ax.set_title(f"{made.kind}: {label}", fontsize=9, parse_math=False)
    return ax


def _bar_axes(ax: Axes) -> Axes:
    share = 1.0 / abs(ax.get_xlim()[1] - ax.get_xlim()[0])  # one pitch, so that the bar is as tall as the tile
    return ax.inset_axes((1.0 + 0.4 * share, 0.0, 0.5 * share, 1.0))


def _draw_bar(tile: Tile, ends: tuple[float, float], range_: tuple[float, float], cells: Any, ax: Axes) -> None:
    (low, high), (g_off, g_on) = ends, range_
    reference = g_off if tile.subtracts_off else 0.0
    bar = ax.figure.colorbar(cells, cax=_bar_axes(ax))
    bar.set_label("conductance, weight W", fontsize=8)
    ticks = [float(g) for g in np.geomspace(low, high, 5)]
    words = [f"{format_quantity(g, 'S')}, W {max(g - reference, 0.0) / (g_on - reference):.2g}" for g in ticks]
    bar.set_ticks(ticks, labels=words, fontsize=8)
    bar.ax.minorticks_off()


def _reference_at(tile: Tile) -> float:
    return len(tile.columns) + tile.spare_columns + REFERENCE_GAP


def _draw_lines(tile: Tile, ax: Axes) -> None:
    (rows, columns), (m, n) = _size(tile), (len(tile.rows), len(tile.columns))
    end = [_reference_at(tile)] if tile.has_reference else []
    right = ([*range(columns), *end])[-1] + 0.5
    line: dict[str, Any] = {"colors": LINE_COLOUR, "linewidth": 0.8, "zorder": 1}
    ax.hlines(np.arange(m), -0.8, right, gid="word lines", **line)
    ax.vlines([*range(n), *end], -0.5, rows - 0.2, gid="bit lines", **line)
    ax.hlines(np.arange(m, rows), -0.8, right, gid="spare word lines", linestyles="dotted", **line)
    ax.vlines(np.arange(n, columns), -0.5, rows - 0.2, gid="spare bit lines", linestyles="dotted", **line)
    mark: dict[str, Any] = {"linestyle": "none", "markersize": 3.5, "color": LINE_COLOUR}
    downs = [*range(columns), *end]
    ax.plot(downs, np.full(len(downs), rows - 0.2), marker="v", **mark)
    ax.plot(np.full(rows, -0.8), np.arange(rows), marker=">", **mark)
    ax.set(xlim=(-1.0, right + 0.1), ylim=(rows + 0.1, -0.7), aspect="equal")


def _draw_others(plan: Plan, index: int, ax: Axes) -> None:
    """Crossings without a synapse."""
    cell = tile_grid(plan, index).cell
    for what, name, marker, size in (
        (DISABLED, "no synapse", "o", 3.5),
        (FORBIDDEN, "forbidden", "x", 4.5),
    ):
        where = np.argwhere(cell == what)
        ax.plot(where[:, 1], where[:, 0], linestyle="none", marker=marker, markersize=size, color=LINE_COLOUR,
                markerfacecolor="white", markeredgewidth=0.7, gid=name, zorder=1.5)  # fmt: skip


def _squares(
    places: Any, values: FloatArray, norm: Any, ax: Axes, name: str, edge: str, *, cmap: str = "viridis"
) -> Any:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    side = SECOND if name == "partners" else DEVICE
    patches = [Rectangle((x - side / 2, y - side / 2), side, side) for x, y in places]
    squares = PatchCollection(patches, norm=norm, cmap=cmap, edgecolor=edge, linewidth=0.5, gid=name, zorder=2)
    squares.set_array(values)
    if name != "devices":
        squares.set_linestyle("--")
    return ax.add_collection(squares)


def _write_taps(points: list[Crosspoint], cells: Any, values: FloatArray, ax: Axes) -> None:
    for point, colour in zip(points, cells.to_rgba(values), strict=True):
        if point.tap > 1:
            # Of black and white, the one with more contrast: at least 4.6 on any colour (WCAG 2.2).
            r, g, b = np.where(colour[:3] <= 0.04045, colour[:3] / 12.92, ((colour[:3] + 0.055) / 1.055) ** 2.4)
            is_dark = 0.2126 * r + 0.7152 * g + 0.0722 * b < 0.179
            ax.text(point.column, point.row, str(point.tap), ha="center", va="center_baseline", fontsize=7,
                    color=ON_DARK if is_dark else ON_BRIGHT, zorder=3)  # fmt: skip


def _label(plan: Plan, tile: Tile, ax: Axes) -> None:
    network, voltage = plan.network, plan.hardware.read.voltage.value
    labels, by_row = network.labels(), plan.hardware.array.signs == "row_polarity"
    size = min(8.0, 60 * _pitch(tile))
    minus = {neuron: by_row and network.sign(neuron) < 0 for neuron in tile.rows}
    words = [
        f"{labels[neuron]}  {'−' if minus[neuron] else '+'}{format_quantity(voltage, 'V')}" for neuron in tile.rows
    ]
    ax.set_yticks(range(len(words) + tile.spare_rows), words + ["spare"] * tile.spare_rows, fontsize=size)
    columns = [float(k) for k in range(_size(tile)[1])]
    names = [
        labels[neuron] + ("" if by_row else f", counted {'+' if sign > 0 else '−'}")
        for neuron, sign in zip(tile.columns, tile.column_signs, strict=True)
    ]
    names += ["spare"] * tile.spare_columns
    if tile.has_reference:
        columns, names = [*columns, _reference_at(tile)], [*names, "reference"]
    ax.set_xticks(columns, names, rotation=90, fontsize=size)
    for neurons, texts in ((tile.rows, ax.get_yticklabels()), (tile.columns, ax.get_xticklabels())):
        for neuron, text in zip(neurons, texts, strict=False):
            text.set_color(INVERTED_COLOUR if network.sign(neuron) < 0 else EXCITATORY_COLOUR)
    ax.set_xlabel("bit lines: receiving neuron", fontsize=8)
    ax.set_ylabel("word lines: sending neuron, read voltage", fontsize=8)
    ax.tick_params(length=0, pad=2)
    ax.spines[:].set_visible(False)


def _legend(plan: Plan) -> list[Any]:
    from matplotlib.lines import Line2D

    def mark(label: str, **style: Any) -> Line2D:
        return Line2D([], [], **{"linestyle": "none", "label": label, **style})

    array = plan.hardware.array
    absent = {"unformed": "never formed", "masked": "behind a closed transistor", "present": "but a device is there"}
    rows = [
        mark("square: a synapse, one device, coloured by its conductance", marker="s", color="#21918c",
             markeredgecolor=INK),
        mark(f"circle: no synapse in this net, {array.disabled} ({absent[array.disabled]})", marker="o",
             color=LINE_COLOUR, markerfacecolor="white", markersize=4),
        mark(f"cross: a pair that no net may connect, {array.disabled}", marker="x", color=LINE_COLOUR, markersize=5),
        mark("driver: puts a voltage on a row while its sender spikes", marker=">", color=LINE_COLOUR),
        mark("sense: takes the current of a column to its receiver", marker="v", color=LINE_COLOUR),
        mark("blue name: excitatory neuron", marker="_", color=EXCITATORY_COLOUR, markersize=9),
    ]  # fmt: skip
    if any(point.tap > 1 for point in plan.crosspoints):
        rows.append(mark("number: delay in steps, where more than 1", marker="$3$", color=INK))
    if any(point.polarity < 0 for point in plan.crosspoints):
        how = "read with inverted voltage" if array.signs == "row_polarity" else "counted − by its column"
        rows.append(mark(f"red name: inhibitory neuron; as a sender {how}", marker="_", color=INVERTED_COLOUR,
                         markersize=9))  # fmt: skip
    if any(tile.has_reference for tile in plan.tiles):
        rows.append(mark("reference: devices at lowest conductance, subtracted", marker="s",
                         color="#440154", markeredgecolor=LINE_COLOUR))  # fmt: skip
    if any(tile.is_differential for tile in plan.tiles):
        rows.append(mark("small square: second device of a pair, at lowest conductance, subtracted", marker="s",
                         color="#440154", markeredgecolor=LINE_COLOUR))  # fmt: skip
    if array.spare_rows or array.spare_columns:
        rows.append(mark("dotted: spare line, for repair", linestyle="dotted", color=LINE_COLOUR))
    return rows
