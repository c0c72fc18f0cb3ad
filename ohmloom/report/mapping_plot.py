"""Pictures that explain a mapping: how a spike becomes a current, how a pair is written, what each line does when."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import ParameterError
from ohmloom.mapping import Crosspoint, Plan, Schedule, event_table
from ohmloom.mapping.passage import pulse
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.report._replay_data import INK
from ohmloom.report.crossbar_plot import EXCITATORY_COLOUR, INVERTED_COLOUR, LINE_COLOUR
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UP, DOWN, NOTHING = "#1b7f4b", "#b3541e", "#e9ebee"
MOST_SLOTS: Final = 60  # of a picture; later ones are left out, and the title says so


def plot_example(plan: Plan) -> Figure:
    """One synapse of a plan, worked out in numbers: read, written, and all pairs of ls.

    Raises
    ------
    ParameterError
        If the plan has no synapse.
    """
    from matplotlib.figure import Figure

    if not plan.crosspoints:
        raise ParameterError(
            "plot_example.plan: expected a plan with synapses, got none. Place a network that has some."
        )
    point = _chosen(plan)
    is_plastic = plan.tiles[point.tile].kind in PLASTIC_KINDS
    figure = Figure(figsize=(13.5, 4.6) if is_plastic else (6.4, 4.6), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.15, 1.25, 1.0)) if is_plastic else [figure.add_subplot()]
    _draw_read(plan, point, axes[0])
    if is_plastic:
        _draw_write(plan, point, axes[1])
        _draw_pairs(plan, axes[2])
    return figure


def plot_schedule(schedule: Schedule, tile: int = 0, *, steps: int = 2, ax: Axes | None = None) -> Axes:
    """What every line of a tile is held at, slot after slot, in the first steps in which a pair is written.

    Slots are drawn equally wide, whatever their length; the words below say what happens, and how long it takes.

    Parameters
    ----------
    schedule, tile
        What happens, and the index of the tile.
    steps
        How many steps to draw.
    ax
        Axes to draw into; without it, those of a new figure.

    Raises
    ------
    ParameterError
        If there is no such tile.
    """
    from matplotlib.figure import Figure

    plan = schedule.plan
    if not 0 <= tile < len(plan.tiles):
        raise ParameterError(f"plot_schedule.tile: expected an index from 0 to {len(plan.tiles) - 1}, got {tile}. "
                             f"The plan has {len(plan.tiles)} tiles.")  # fmt: skip
    made, labels = plan.tiles[tile], plan.network.labels()
    mine = [slot for slot in schedule.slots if slot.tile == tile]
    written = [slot.step for slot in mine if slot.action == "write" and slot.selected]
    begin = min(written or [slot.step for slot in mine if slot.rows] or [0])
    wanted = [slot for slot in mine if begin <= slot.step < begin + steps]
    slots = wanted[:MOST_SLOTS]
    rows, columns = len(made.rows), len(made.columns)
    volts: FloatArray = np.zeros((rows + columns + 1, max(len(slots), 1)))
    for k, slot in enumerate(slots):
        for i, v in slot.rows:
            volts[i, k] = v
        for j, v in slot.columns:
            volts[rows + 1 + j, k] = v
    if ax is None:
        size = (min(14.0, 3.6 + 0.21 * len(slots)), min(12.0, 2.6 + 0.19 * (rows + columns)))
        ax = Figure(figsize=size, layout="constrained").add_subplot()
    most = max(float(np.abs(volts).max()), 1e-12)
    picture = ax.imshow(volts, cmap="RdBu_r", vmin=-most, vmax=most, aspect="auto", interpolation="none")
    for k, slot in enumerate(slots):
        if slot.action == "write":
            for i, j in slot.selected:
                ax.plot([k, k], [i, rows + 1 + j], color=INK, linewidth=0.6, marker="o", markersize=3)
        if k and slot.step != slots[k - 1].step:
            ax.axvline(k - 0.5, color=INK, linewidth=1.2)
    bar = ax.figure.colorbar(picture, ax=ax, shrink=0.6, pad=0.01)
    bar.set_label("voltage of the line / V", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    names = [f"row: {labels[n]}" for n in made.rows] + [""] + [f"column: {labels[n]}" for n in made.columns]
    ax.set_yticks(range(len(names)), names, fontsize=7)
    ax.set_xticks(range(len(slots)), [_slot_words(slot, labels, made) for slot in slots], rotation=90, fontsize=6)
    ax.axhline(rows, color=LINE_COLOUR, linewidth=0.8, linestyle=":")
    left = "" if len(slots) == len(wanted) else f", the first {len(slots)} of {len(wanted)} slots"
    beside = ", columns side by side" if plan.hardware.drive.parallelism == "column" else ""
    ax.set_title(f"Tile {tile} ({made.kind}), steps {begin} to {begin + steps - 1}{left}: columns are read one by one, "
                 f"then pairs are written{beside};\ndots joined by a line: row and column of a written device",
                 fontsize=9)  # fmt: skip
    ax.tick_params(length=0)
    return ax


def _slot_words(slot: Any, labels: list[str], tile: Any) -> str:
    time = format_quantity(slot.duration, "s")
    if slot.action == "read":
        column = next((j for _, j in slot.selected), None)
        return f"read {labels[tile.columns[column]] if column is not None else ''}, {time}"
    if len(slot.selected) != 1:
        return f"write {len(slot.selected)} devices, {time}"
    ((i, j),) = slot.selected
    is_up = dict(slot.columns).get(j, 0.0) > dict(slot.rows).get(i, 0.0)
    return f"write one {'up' if is_up else 'down'}, {time}"


def _chosen(plan: Plan) -> Crosspoint:
    """A plastic synapse with a delay, if there is one: it shows most."""
    return max(plan.crosspoints, key=lambda p: (plan.tiles[p.tile].kind in PLASTIC_KINDS, 1 < p.tap <= 4, -p.synapse))


def _draw_read(plan: Plan, point: Crosspoint, ax: Axes) -> None:
    """One row, one column, one device, and the numbers on the way."""
    network, hardware, tile = plan.network, plan.hardware, plan.tiles[point.tile]
    synapse, labels = network.synapses[point.synapse], network.labels()
    by_row = hardware.array.signs == "row_polarity"
    volts = hardware.read.voltage.value * (point.polarity if by_row else 1)
    current = volts * point.conductance
    off, weight = tile.subtracts_off, _weight(plan, point, point.state)
    colour = INVERTED_COLOUR if point.polarity < 0 else EXCITATORY_COLOUR
    ax.plot([0.0, 5.4], [3.0, 3.0], color=LINE_COLOUR, linewidth=2)
    ax.plot([4.0, 4.0], [4.0, 0.3], color=LINE_COLOUR, linewidth=2)
    ax.plot(4.0, 0.2, marker="v", markersize=12, color=LINE_COLOUR)
    ax.plot(0.0, 3.0, marker=">", markersize=12, color=colour)
    ax.add_patch(_box(3.65, 2.65, 0.7))
    gain = network.readings.synapse_gain
    delay = "in the next step" if point.tap == 1 else f"{point.tap} steps later: tap {point.tap} of its shift register"
    if hardware.array.delays == "retimed":
        delay = "when the skewed clock of its receiver comes to it"
    formula = "(G − G_off)\n        / (G_on − G_off)" if off else "G / G_on"
    time = hardware.read.duration.value
    sign = "−" if point.polarity < 0 else "+"
    words = [
        (0.0, 4.75, f"1  {labels[synapse.pre]} spikes. Its row is driven {delay},", colour),
        (0.25, 4.35, f"at {format_quantity(volts, 'V')} for {format_quantity(time, 's')}.", colour),
        (0.3, 3.25, f"row of {labels[synapse.pre]}", LINE_COLOUR),
        (4.15, 0.55, f"column of {labels[synapse.post]}", LINE_COLOUR),
        (4.3, 0.15, "sense", LINE_COLOUR),
        (4.5, 3.35, f"2  the device ({tile.kind}):\\n    G = {format_quantity(point.conductance, 'S')}", INK),
        (4.3, 1.5, f"3  the column carries\\n    I = V G = {format_quantity(current, 'A')}", INK),
        (0.0, 1.75, f"4  read as a weight:\\n    W = {formula}\\n       = {weight:.3g}", INK),
        (0.0, -0.55, f"5  {labels[synapse.post]}: membrane {sign} {gain:g} × {weight:.3g} = "
                     f"{sign} {gain * weight:.3g}; above {network.readings.y_thresh:g} it spikes", INK),
    ]  # fmt: skip
    for x, y, text, ink in words:
        ax.text(x, y, text.replace("\\n", "\n"), fontsize=8, color=ink, va="center", parse_math=False)
    ax.set(xlim=(-0.4, 7.6), ylim=(-1.0, 5.1))
    ax.set_title("How a spike becomes a current", fontsize=10)
    ax.axis("off")


def _weight(plan: Plan, point: Crosspoint, state: float) -> float:
    """As the periphery reads it."""
    tile = plan.tiles[point.tile]
    device = plan.hardware.devices[tile.kind]
    off = float(device.conductance(0.0)) if tile.subtracts_off else 0.0
    return (float(device.conductance(state)) - off) / (float(device.conductance(1.0)) - off)


def _box(x: float, y: float, side: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), side, side, facecolor="#21918c", edgecolor=INK, zorder=3)


def _draw_write(plan: Plan, point: Crosspoint, ax: Axes) -> None:
    """Row, column and device through the steps around a pair: the sender spikes in step 1, the receiver in step 2."""
    hardware, drive = plan.hardware, plan.hardware.drive
    device = hardware.devices[plan.tiles[point.tile].kind]
    waveform, last = drive.volts, plan.network.readings.last_spike
    t, row, column = [], [], []
    for step in range(last + 3):
        ls = [max(last - (step - spiked), 0) if step >= spiked else 0 for spiked in (1, 2)]
        at = float(step)
        for phase in waveform.phases:
            width = phase.duration / waveform.duration
            t += [at, at + width]
            row += [phase.row[ls[0]]] * 2
            column += [phase.column[ls[1]]] * 2
            at += width
    unit, threshold, end = drive.pulse_voltage.value, drive.threshold.value, t[-1]
    base, seen = -1.2 * unit, np.subtract(column, row)
    for height, values, name, colour in (
        (3.0 * unit, np.array(row), "row: its sender spikes in step 1", EXCITATORY_COLOUR),
        (1.5 * unit, np.array(column), "column: its receiver spikes in step 2", "#6a4c93"),
        (base, seen, "device: sees column − row", INK),
    ):
        ax.plot([0.0, end], [height, height], color=LINE_COLOUR, linewidth=0.5)
        ax.plot(t, height + values, color=colour, linewidth=1.6)
        ax.text(end + 0.15, height, name, fontsize=8, color=colour, va="center")
    for side, colour in ((1, UP), (-1, DOWN)):
        level = base + side * threshold
        ax.plot([0.0, end], [level, level], color=colour, linewidth=0.8, linestyle="--")
        words = f"above {format_quantity(side * threshold, 'V')}: up" if side > 0 else "below the opposite: down"
        ax.text(end + 0.15, level, words, fontsize=7, color=colour, va="center")
    written = np.abs(seen) > threshold
    ax.fill_between(t, base, base + seen, where=list(written), color=UP, alpha=0.4, linewidth=0)
    done = pulse(device, point.state, 1, hardware)
    before, after = (_weight(plan, point, state) for state in (point.state, done.state))
    ax.text(0.0, -3.0 * unit, f"Above the threshold: one event up. W goes from {before:.3g} to {after:.3g} "
            f"in {format_quantity(done.duration, 's')}.\nThe other way round, receiver first, it is one event down.",
            fontsize=8, va="center")  # fmt: skip
    ax.set(xlim=(-0.1, t[-1] + 4.6), ylim=(-3.4 * unit, 4.1 * unit), yticks=[], xticks=range(last + 3))
    ax.set_xlabel("step (each with its own read, then this pulse)", fontsize=8)
    ax.set_title(f"How a pair is written ({drive.waveform} waveform)", fontsize=10)
    ax.tick_params(labelsize=8)
    ax.spines[["left", "right", "top"]].set_visible(False)


def _draw_pairs(plan: Plan, ax: Axes) -> None:
    """Voltage of the device for every pair of ls, and what it does."""
    drive = plan.hardware.drive
    table = event_table(drive.volts, drive.threshold.value)
    size = len(table)
    colours = {1: UP, 0: NOTHING, -1: DOWN}
    for pre in range(size):
        for post in range(size):
            seen = [phase.column[post] - phase.row[pre] for phase in drive.volts.phases]
            most = max(seen, key=abs)
            sign = int(np.sign(table[pre][post]))
            ax.add_patch(_cell(post, pre, colours[sign]))
            word = {1: "\nup", 0: "", -1: "\ndown"}[sign]
            ax.text(post, pre, f"{most:+.2g} V{word}" if most else "0 V", ha="center", va="center", fontsize=8,
                    color="white" if sign else INK)  # fmt: skip
    names = [f"{ls}" + {size - 1: "\nspikes\nnow", size - 2: "\none step\nago", 0: "\nlong\nago"}.get(ls, "")
             for ls in range(size)]  # fmt: skip
    ax.set_xticks(range(size), names, fontsize=8)
    ax.set_yticks(range(size), [name.replace("\n", " ") for name in names], fontsize=8)
    ax.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5, -0.5), aspect="equal")
    ax.set_xlabel("ls of the receiver (column)", fontsize=8)
    ax.set_ylabel("ls of the sender (row)", fontsize=8)
    ax.set_title("All pairs: only spikes one step apart write", fontsize=10)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)


def _cell(x: int, y: int, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.48, y - 0.48), 0.96, 0.96, facecolor=colour)
