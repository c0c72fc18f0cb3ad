"""One still figure of a trial: the path beside what the robot sensed, fired and learned."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._files import write_atomic
from ohmloom.report._replay_data import (
    IR_COLOUR,
    KINDS,
    LIGHT_COLOUR,
    OUTPUTS,
    SENSORS,
    STEPS,
    ArenaView,
    Recording,
    bump_rows,
)
from ohmloom.report.arena_plot import plot_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def replay_png(recording: Recording, arena: ArenaView, path: Path | str) -> None:
    """Write the still figure: path beside sensors, output spikes and weights over time.

    The same recording gives the same bytes with the same matplotlib.

    Raises
    ------
    OperationError
        If the file cannot be written.
    """
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # A letter of the name that the font lacks is drawn as a box.
        warnings.filterwarnings("ignore", message="Glyph")
        replay_figure(recording, arena).savefig(buffer, format="png", dpi=160, metadata={"Software": None})
    write_atomic(path, buffer.getvalue())


def replay_figure(recording: Recording, arena: ArenaView) -> Figure:
    """Compose the figure that `replay_png` writes; time runs over executed timesteps.

    Grey upright lines are bumps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6.4), layout="constrained")
    cells = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.15))
    left, right = figure.add_subfigure(cells[0]), figure.add_subfigure(cells[1])
    plot_path(recording.trial, arena, left.subplots())
    infrared, light, outputs, weights = right.subplots(4, 1, sharex=True, height_ratios=(2, 2, 1.3, 3))
    sensors = np.asarray(recording.trial.sensors)
    _strips(infrared, sensors[:, :3], "IR", SENSORS[:3], IR_COLOUR, 1.0)
    _strips(light, sensors[:, 3:], "light", SENSORS[3:], LIGHT_COLOUR, 1.0)
    _strips(outputs, np.asarray(recording.trial.output_spikes), "spikes", OUTPUTS, "#0072b2", STEPS)
    _weights_by_kind(weights, recording)
    for axes in (infrared, light, outputs):
        for row in bump_rows(recording.trial):
            axes.axvline(row + 0.5, color="#c4c4c4", linewidth=0.7, zorder=0)
    weights.set(xlim=(0, recording.timesteps), xlabel="executed timestep")
    name = " ".join(recording.network_name.split())
    title = name if len(name) <= 60 else name[:59] + "…"
    figure.suptitle(f"{title}: {recording.summary}", fontsize="medium", parse_math=False)
    return figure


def _strips(axes: Axes, values: FloatArray, what: str, names: tuple[str, ...], colour: str, top: float) -> None:
    """One row per signal: height and colour both give the value, so that a dense signal stays legible."""
    time = np.arange(len(values) + 1)
    for row, name in enumerate(names):
        base = len(names) - 1 - row
        axes.stairs(base + 0.88 * values[:, row] / top, time, baseline=base, fill=True, color=colour, label=name)
        axes.axhline(base, color="#888888", linewidth=0.5)
    short = [name.removeprefix(f"{what} ") for name in names]
    axes.set_yticks(np.arange(len(names))[::-1] + 0.44, short, fontsize="small")
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.05, len(names))
    unit = "0 to 1" if top == 1.0 else f"0 to {STEPS}"
    axes.set_ylabel(f"{what}\n({unit})", fontsize="small")


def _weights_by_kind(axes: Axes, recording: Recording) -> None:
    time = np.arange(recording.timesteps) + 1
    for kind, index in recording.kinds.items():
        values, colour = recording.weights[:, index], KINDS[kind]
        low, high = np.quantile(values, (0.25, 0.75), axis=1)
        axes.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0)
        for edge in (values.min(axis=1), values.max(axis=1)):
            axes.plot(time, edge, color=colour, linewidth=0.7, linestyle=":")
        axes.plot(time, np.median(values, axis=1), color=colour, linewidth=1.8, label=f"{kind} ({index.size})")
    axes.set_ylabel("weight (median,\nquartiles, range)", fontsize="small")
    ends = (recording.weights.min(), recording.weights.max()) if recording.weights.size else (0.0, 1.0)
    axes.set_ylim(min(-0.02, ends[0]), max(1.02, ends[1]))
    if recording.kinds:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False, fontsize="small")
    else:
        axes.text(0.5, 0.5, "no synapses", transform=axes.transAxes, ha="center", va="center")
