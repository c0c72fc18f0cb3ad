"""The arena, and the way that a robot took through it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ohmloom.report._replay_data import (
    ACTIONS,
    BACKED_OFF,
    INK,
    ArenaView,
    TrialView,
    bump_rows,
    goal_regions,
    start_region,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


def plot_path(trial: TrialView, arena: ArenaView, ax: Axes | None = None) -> Axes:
    """Draw the robot's path, coloured by action, in its arena.

    A bump is marked where the robot stood before it; the grey piece that follows is the backing-off.
    Axes in m, equal scales.

    Parameters
    ----------
    trial
        `path` has axes (row, 3) with x [m], y [m], heading [rad]; `actions` has axes (timestep,).
    ax
        Axes to draw into; without it, those of a new figure.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    if ax is None:
        ax = Figure(figsize=(6, 6.6), layout="constrained").add_subplot()
    _draw_arena(trial, arena, ax)

    colours = np.array(list(ACTIONS.values()))[np.asarray(trial.actions, dtype=np.int64)]
    bumps = bump_rows(trial)
    colours[bumps] = BACKED_OFF
    points = np.asarray(trial.path)[:, :2]
    # A line for each run of one colour, not for each timestep: a tenth of the bytes in an SVG.
    begins = np.concatenate(([0], 1 + np.flatnonzero(colours[1:] != colours[:-1]), [len(colours)]))
    runs = [points[a : b + 1] for a, b in itertools.pairwise(begins)]
    drawn = [str(colours[a]) for a in begins[:-1]]
    ax.add_collection(LineCollection(runs, colors=drawn, linewidths=1.8, gid="path", zorder=3))
    handles: list[Artist] = [Line2D([], [], color=colour, label=name) for name, colour in ACTIONS.items()]
    if bumps.size:
        cross: dict[str, Any] = {"marker": "x", "color": INK, "markersize": 7, "markeredgewidth": 1.6}
        ax.plot(*points[bumps].T, linestyle="none", gid="bumps", zorder=5, **cross)
        handles.append(Line2D([], [], linestyle="none", label="bump", **cross))
        handles.append(Line2D([], [], color=BACKED_OFF, label="backed off"))
    _draw_robot(trial.path[0], arena, ax, "white", "start")
    _draw_robot(trial.path[-1], arena, ax, INK, "end")
    round_mark: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgecolor": INK, "markersize": 8}
    handles.append(Line2D([], [], markerfacecolor="white", label="start", **round_mark))
    handles.append(Line2D([], [], markerfacecolor=INK, label="end", **round_mark))
    ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.1),
        ncols=4,
        frameon=False,
        fontsize="small",
    )
    return ax


def _draw_arena(trial: TrialView, arena: ArenaView, ax: Axes) -> None:
    from matplotlib.patches import Polygon, Rectangle

    w, b = arena.half_width, arena.box_half_width
    for region, text in zip(goal_regions(trial, arena), _goal_names(trial), strict=True):
        ax.add_patch(Polygon(region, facecolor="#d9efdf", edgecolor="none", zorder=0))
        _label_corner(ax, region, text)
    start = start_region(arena)
    ax.add_patch(Polygon(start, facecolor="#e4e7ee", edgecolor="none", zorder=0))
    _label_corner(ax, start, "start")
    walls: dict[str, Any] = {"facecolor": "none", "edgecolor": INK, "linewidth": 2.0}
    ax.add_patch(Rectangle((-w, -w), 2 * w, 2 * w, clip_on=False, zorder=2, **walls))
    ax.add_patch(Rectangle((-b, -b), 2 * b, 2 * b, zorder=2, **{**walls, "facecolor": "#d6d6d6"}))
    x, y = (float(value) for value in np.asarray(arena.lamp))
    ax.plot([x], [y], marker="*", markersize=17, color="#f2c200", markeredgecolor=INK,
            clip_on=False, gid="lamp", zorder=6)  # fmt: skip
    ax.annotate("lamp", (x, y), xytext=(-9, 9), textcoords="offset points", ha="right", annotation_clip=False)
    margin = 0.04 * w
    ax.set(xlim=(-w - margin, w + margin), ylim=(-w - margin, w + margin), xlabel="x [m]", ylabel="y [m]")
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    ax.spines[:].set_visible(False)


def _goal_names(trial: TrialView) -> tuple[str, ...]:
    return ("goal 1", "goal 2") if trial.task == "dynamic" else ("goal",)


def _label_corner(ax: Axes, region: npt.NDArray[Any], text: str) -> None:
    x, y = 0.2 * region[0] + 0.8 * region.mean(axis=0)
    ax.text(x, y, text, ha="center", va="center", fontsize="small", color="#555555", zorder=1)


def _draw_robot(pose: npt.NDArray[Any], arena: ArenaView, ax: Axes, fill: str, name: str) -> None:
    from matplotlib.patches import Circle

    x, y, heading = (float(value) for value in pose)
    reach = 2.2 * arena.robot_radius
    ax.add_patch(Circle((x, y), arena.robot_radius, facecolor=fill, edgecolor=INK, gid=name, zorder=4))
    ax.plot([x, x + reach * np.cos(heading)], [y, y + reach * np.sin(heading)], color=INK, linewidth=1.4,
            solid_capstyle="round", gid=f"{name} heading", zorder=4)  # fmt: skip
