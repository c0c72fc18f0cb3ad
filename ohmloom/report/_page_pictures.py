"""The pictures of the report: paths, crossbars, weights."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from ohmloom._arrays import FloatArray
from ohmloom.report._page_svg import page_svg
from ohmloom.report._page_words import outcome
from ohmloom.report.arena_plot import plot_path
from ohmloom.report.crossbar_plot import plot_tile
from ohmloom.report.weights_plot import plot_weights
from ohmloom.sim import Agreement, Arena, Feasibility, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ohmloom.mapping import Plan

Picture = tuple[str, Markup]  # caption, SVG


def paths(study: Feasibility) -> list[Picture]:
    """The ideal controller's path and, if a die was sampled, that die's from the same start."""
    if study.agreement is None:
        return []
    found = [("Ideal network", study.agreement.trial), ("One sampled die", study.hardware_trial)]
    return [
        (f"{name}, {outcome(trial)}.", page_svg(partial(_path, trial), f"path{k}", f"Path: {name}"))
        for k, (name, trial) in enumerate(found)
        if trial is not None
    ]


def tiles(study: Feasibility) -> list[tuple[str, list[Picture]]]:
    """For each tile its name, and its crossbar as programmed and after the trial."""
    if (plan := study.plan) is None:
        return []
    states: list[tuple[str, str, FloatArray | None]] = [("As programmed", "a", None)]
    if study.agreement is not None:
        states.append(("After one trial, without spread", "b", end_conductances(plan, study.agreement)))
    found = []
    for k, tile in enumerate(plan.tiles):
        label = f"Crossbar of the {tile.kind} tile"
        views = [(when, page_svg(partial(_tile, plan, k, g), f"tile{k}{key}", label)) for when, key, g in states]
        found.append((f"{tile.kind} tile", views))
    return found


def weights(study: Feasibility) -> Markup | None:
    """Weights over the trial, discrete and hardware."""
    plan, agreement = study.plan, study.agreement
    if plan is None or agreement is None:
        return None
    return page_svg(
        lambda: _drawn((6.1, 3.6), lambda ax: plot_weights(agreement, plan.network, ax)),
        "weights", "Weights over the trial",
    )  # fmt: skip


def end_conductances(plan: Plan, agreement: Agreement) -> FloatArray:
    """Conductances at the end of the emulated trial, (synapse,) [S]: G = W (G_on - reference) + reference."""
    last = agreement.emulated_weights[-1]
    values = np.empty(len(last))
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        device = plan.hardware.devices[tile.kind]
        reference = float(device.conductance(0.0)) if tile.has_reference else 0.0
        values[point.synapse] = last[point.synapse] * (float(device.conductance(1.0)) - reference) + reference
    return values


def _path(trial: Trial) -> Figure:
    settings = trial.provenance.get("arena")
    return _drawn((4.6, 5.1), lambda ax: plot_path(trial, Arena.paper() if settings is None else Arena(**settings), ax))


def _tile(plan: Plan, index: int, conductances: FloatArray | None) -> Figure:
    figure = plot_tile(plan, index, conductances=conductances).get_figure(root=True)
    assert figure is not None
    return figure


def _drawn(inches: tuple[float, float], draw: Callable[[Axes], Axes]) -> Figure:
    """Small figures have letters that stay legible on a phone."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=inches, layout="constrained")
    draw(figure.add_subplot())
    return figure
