"""The pictures of the report: paths, weights, events."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from markupsafe import Markup

from ohmloom.report._page_run import DieRun, Run, arena_of
from ohmloom.report._page_svg import page_svg
from ohmloom.report._page_words import outcome
from ohmloom.report.arena_plot import plot_path
from ohmloom.report.study_plot import plot_events
from ohmloom.report.weights_plot import plot_weights
from ohmloom.sim import Feasibility, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def weights(study: Feasibility) -> Markup | None:
    """Weights over the trial, discrete and hardware."""
    plan, agreement = study.plan, study.agreement
    if plan is None or agreement is None:
        return None
    return page_svg(
        lambda: _drawn((6.1, 3.6), lambda ax: plot_weights(agreement, plan.network, ax)),
        "weights", "Weights over the trial",
    )  # fmt: skip


def events(ideal: Run | None, die: DieRun | None) -> tuple[Markup, str] | None:
    """Learning events over the trial, of the ideal network and of a die; with it, what is to be seen."""
    if ideal is None:
        return None
    hardware = None if die is None else die.events
    svg = page_svg(
        lambda: _drawn((6.1, 3.6), lambda ax: plot_events(ideal.events, hardware, ax)), "events", "Learning events"
    )
    if hardware is None:
        return svg, "Learning events of the ideal network; no die was sampled."
    asked, written, lost, spurious = (int(count) for count in hardware[-1])
    return svg, (f"Learning events so far, each controller in its own trial from the same start. On die {die.die} "
                 f"{asked:,} were asked for and {written:,} written; {lost:,} lost, {spurious:,} spurious."
                 if die is not None else "")  # fmt: skip


def _path(trial: Trial) -> Figure:
    return _drawn((4.6, 5.1), lambda ax: plot_path(trial, arena_of(trial), ax))


def _drawn(inches: tuple[float, float], draw: Callable[[Axes], Axes]) -> Figure:
    """Small figures have letters that stay legible on a phone."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=inches, layout="constrained")
    draw(figure.add_subplot())
    return figure
