"""The pictures of a study as files for papers, SVG and PDF."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ohmloom._files import write_atomic
from ohmloom.report import study_plot as plots
from ohmloom.report._page_maps import device_values, tile_views
from ohmloom.report._page_run import DieRun, Run, arena_of
from ohmloom.report._page_svg import figure_files, figure_of
from ohmloom.report.arena_plot import plot_path
from ohmloom.report.weights_plot import plot_weights
from ohmloom.sim import Feasibility

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_figures(study: Feasibility, folder: Path, *, ideal: Run | None, die: DieRun | None) -> list[Path]:
    """Write every picture of the report to a folder, each as SVG and as PDF; their paths."""
    paths = []
    for name, draw in figures(study, ideal=ideal, die=die):
        for form, picture in figure_files(draw):
            paths.append(folder / f"{name}.{form}")
            write_atomic(paths[-1], picture)
    return paths


def figures(
    study: Feasibility, *, ideal: Run | None, die: DieRun | None
) -> Iterator[tuple[str, Callable[[], Figure]]]:  # fmt: skip
    """Name of each picture that this study has, and how it is drawn."""
    plan, check = study.plan, study.agreement
    yield "margins", partial(_of, plots.plot_margins, study.figures)
    if len(study.dies) > 1:
        running = plots.running_success(study)
        yield "success", partial(_of, plots.plot_success, running)
        yield "difference", partial(_of, plots.plot_difference, running)
    if study.yield_:
        yield "yield", partial(_of, plots.plot_yield, study.yield_)
    if study.sensitivity and study.sensitivity["factors"]:
        yield "sensitivity", partial(_of, plots.plot_sensitivity, study.sensitivity)
        if study.sensitivity["sobol"]:
            yield "sobol", partial(_of, plots.plot_sobol, study.sensitivity["sobol"])
        if len(study.sensitivity["convergence"]) > 1:
            yield "convergence", partial(_of, plots.plot_convergence, study.sensitivity["convergence"])
    if check is not None and plan is not None:
        yield "path_ideal", partial(_of, plot_path, check.trial, arena_of(check.trial))
        yield "weights", partial(_of, plot_weights, check, plan.network)
    if study.hardware_trial is not None:
        yield "path_hardware", partial(_of, plot_path, study.hardware_trial, arena_of(study.hardware_trial))
    if ideal is not None:
        yield "events", partial(_of, plots.plot_events, ideal.events, None if die is None else die.events)
    known = device_values(study, die)
    if plan is not None and known is not None:
        for k in range(len(plan.tiles)):
            for key, _, draw in tile_views(plan, k, known):
                yield f"tile_{k}_{key}", draw


def _of(plot: Callable[..., Any], *data: Any) -> Figure:
    return figure_of(plot(*data))
