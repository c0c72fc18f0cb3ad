"""The paper's figures from our runs: each function draws one and gives it back."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.neurocontroller import LATTICES, Network
from ohmloom.neurocontroller.census import LAYERS
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.rules import INPUTS
from ohmloom.report._replay_data import KINDS
from ohmloom.sim.paper.activity import Activity
from ohmloom.sim.paper.claim_tests import KIND_NAMES
from ohmloom.sim.paper.published import published
from ohmloom.sim.paper.results import Results
from ohmloom.sim.paper.tables import NAMES
from ohmloom.sim.statistics import wilson_of_rate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008); a system of one kind has its kind's colour.
SYSTEMS: Final = {
    "HP": KINDS["hp"], "PEO": KINDS["peo_pani"], "LIN": KINDS["linear"], "GA": KINDS["constant"], "HET": "#009e73",
}  # fmt: skip
EXCITATORY, INHIBITORY = "#f2f2f2", "#555555"  # as in the paper: the darker ones inhibit
SMALL = 8
SMOOTHED = 10  # timesteps, Section XII-A
WIDTH = 8.4  # inches


def figures(results: Results) -> list[tuple[str, str, Callable[[], Figure]]]:
    """Name, caption and drawing of each figure, in the paper's order; our own stand last."""

    def number(name: str) -> float:
        found = re.match(r"figure_(\d+)", name)
        return int(found[1]) if found else math.inf

    return sorted(_drawings(results), key=lambda figure: number(figure[0]))


def _drawings(results: Results) -> Iterator[tuple[str, str, Callable[[], Figure]]]:
    yield "figure_1", "Fig. 1: memristance and weight of each kind against the number of STDP events.", plot_profiles
    for number, task, systems in (
        ("4", "static", ("HP", "PEO", "LIN", "GA")), ("6", "static", ("HET", "PEO", "LIN", "GA")),
        ("12_fitness", "dynamic", ("HET", "GA")),
    ):  # fmt: skip
        yield (f"figure_{number}", f"{_name(number)}: fitness, neurons, connectivity, {task} task; mean over runs, "
               "95 % interval.", partial(plot_course, results, task, systems, COURSE))  # fmt: skip
    for number, systems in (("5", ("HP", "PEO", "LIN", "GA")), ("7", ("HET", "PEO", "LIN", "GA"))):
        yield (f"figure_{number}", f"{_name(number)}: self-adaptive parameters, static task.",
               partial(plot_course, results, "static", systems, ADAPTIVE))  # fmt: skip
    yield "figure_8", "Fig. 8: synapses of each kind in the best HET network.", partial(plot_kinds, results, ("all",))
    yield ("figure_9", "Fig. 9: the same by layer.", partial(plot_kinds, results, LAYERS))
    for number, task in (("10", "static"), ("12_activity", "dynamic")):
        yield (f"figure_{number}", f"{_name(number)}: mean weight and STDP events through a trial, {task} task; best "
               "HET networks that are still under way, mean of the last ten timesteps.",
               partial(plot_activity, results.activities[task]))  # fmt: skip
    for number, task in (("10d", "static"), ("12d", "dynamic")):
        best = results.networks[task, "HET"][results.best_network(task, "HET")]
        yield (f"figure_{number}", f"{_name(number)}: the best HET network of the {task} task; dark neurons inhibit, "
               "colours are kinds of synapse.", partial(plot_topology, best))  # fmt: skip
    if "best" in results.tasks:
        yield ("best_course", "Fitness, neurons, connectivity, static task at the search's best combination; mean over "
               "runs, 95 % interval.",
               partial(plot_course, results, "best", results.tasks["best"], COURSE))  # fmt: skip
    yield ("solve_rates", "Random networks that solve the static task, for each reading of what the paper leaves open, "
           "one at a time; lines: what its numbers imply.", partial(plot_solve_rates, results))  # fmt: skip
    yield ("fresh_starts", "Fitness of each best network, and its success on starts that it has not seen.",
           partial(plot_fresh_starts, results))  # fmt: skip


COURSE: Final = ("best_fitness", "mean_fitness", "nodes", "connectivity")
ADAPTIVE: Final = ("mu", "psi", "omega", "tau")


def _name(number: str) -> str:
    return f"Fig. {number.partition('_')[0]}"


def plot_profiles() -> Figure:
    """Weight and memristance of the three plastic kinds after n positive STDP events from the lowest charge."""
    figure, axes = _grid(1, 2, 3.2)
    for kind in PLASTIC_KINDS:
        lattice = LATTICES[kind]
        charges = np.arange(0, lattice.top + 1, lattice.event)
        weights = np.array([lattice.weight(int(q)) for q in charges])
        for ax, values in zip(axes, (weights, 1.0 / np.maximum(weights, 1e-3)), strict=True):
            ax.plot(np.arange(len(charges)), values, color=KINDS[kind], label=KIND_NAMES[kind])
    axes[0].set(xlabel="positive STDP events", ylabel="weight")
    axes[1].set(xlabel="positive STDP events", ylabel="R_on / weight, in R_on", yscale="log")
    axes[0].legend(frameon=False, fontsize=SMALL)
    return figure


def plot_course(results: Results, task: str, systems: tuple[str, ...], columns: tuple[str, ...]) -> Figure:
    """Columns of the runs' tables against the generation."""
    figure, axes = _grid(2, 2, 5.4)
    for ax, column in zip(axes, columns, strict=True):
        for system in systems:
            values = results.course(task, system, column) * (100.0 if column == "connectivity" else 1.0)
            _band(ax, results.generations(task, system), values, SYSTEMS[system], system)
        ax.set(xlabel="generation", ylabel=NAMES[column])
    axes[0].legend(frameon=False, fontsize=SMALL)
    return figure


def plot_kinds(results: Results, places: tuple[str, ...]) -> Figure:
    """Synapses of each kind in the best HET network of each run against the generation, in each place."""
    figure, axes = _grid(1, len(places), 3.2)
    for ax, place in zip(axes, places, strict=True):
        layers = LAYERS if place == "all" else (place,)
        for kind in PLASTIC_KINDS:
            values = sum(results.course("static", "HET", f"best_{kind}_{name}") for name in layers)
            assert not isinstance(values, int)
            _band(ax, results.generations("static", "HET"), values, KINDS[kind], KIND_NAMES[kind])
        ax.set(xlabel="generation", ylabel="synapses")
        ax.set_title("" if place == "all" else place.replace("_", " - "), fontsize=SMALL + 1)
    axes[0].legend(frameon=False, fontsize=SMALL)
    return figure


def plot_activity(activities: Sequence[Activity]) -> Figure:
    """Weights and STDP events through a trial, mean over networks."""
    figure, axes = _grid(1, 3, 3.2)
    longest = max(len(a.actions) for a in activities)
    for ax, name in zip(axes, ("weight", "positive", "negative"), strict=True):
        for k, kind in enumerate(PLASTIC_KINDS):
            padded = np.full((longest, len(activities)), np.nan)
            for j, a in enumerate(activities):
                values = np.asarray(getattr(a, name)[:, k], dtype=float)
                padded[: len(values), j] = np.nan if np.isnan(a.weight[0, k]) else _trailing(values)
            known = ~np.isnan(padded)
            some = known.any(axis=1)
            mean = np.where(known, padded, 0.0).sum(axis=1)[some] / known.sum(axis=1)[some]
            ax.plot(np.flatnonzero(some), mean, color=KINDS[kind], label=KIND_NAMES[kind], linewidth=1.0)
        ax.set(xlabel="timestep", ylabel="mean weight" if name == "weight" else f"{name} STDP events per timestep")
    axes[0].legend(frameon=False, fontsize=SMALL)
    return figure


def _trailing(values: FloatArray) -> FloatArray:
    """Mean of the last ten values at each place."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    end = np.arange(1, len(values) + 1)
    begin = np.maximum(end - SMOOTHED, 0)
    mean: FloatArray = (total[end] - total[begin]) / (end - begin)
    return mean


def plot_topology(network: Network) -> Figure:
    """Neurons in three columns, synapses between them."""
    figure, (ax,) = _grid(1, 1, 4.6)
    hidden = len(network.hidden)
    outputs = network.neurons - INPUTS - hidden
    places = [
        (column + (0.18 if column == 1 and k % 2 else 0.0), 1.0 - (k + 0.5) / count)
        for column, count in enumerate((INPUTS, hidden, outputs)) for k in range(count)
    ]  # fmt: skip
    for synapse in network.synapses:
        bend = 0.25 if places[synapse.pre][0] // 1 == places[synapse.post][0] // 1 else 0.0
        ax.annotate(
            "", places[synapse.post], places[synapse.pre],
            arrowprops={"arrowstyle": "-", "color": KINDS[synapse.kind], "linewidth": 0.8, "alpha": 0.8,
                        "connectionstyle": f"arc3,rad={bend}"},
        )  # fmt: skip
    for k, (x, y) in enumerate(places):
        colour = INHIBITORY if network.sign(k) < 0.0 else EXCITATORY
        ax.plot([x], [y], "o", markersize=9, markerfacecolor=colour, markeredgecolor="#222222", zorder=3)
        label = network.labels()[k].replace("hidden ", "")
        beside = (-0.05, "right") if k < INPUTS else (0.05, "left")
        ax.text(x + beside[0], y, label, ha=beside[1], va="center", fontsize=SMALL - 1)
    for kind in dict.fromkeys(s.kind for s in network.synapses):
        ax.plot([], [], color=KINDS[kind], label=KIND_NAMES.get(kind, kind))
    ax.legend(frameon=False, fontsize=SMALL, loc="upper right", bbox_to_anchor=(1.0, 1.12), ncols=3)
    ax.set(xlim=(-0.5, 2.5), ylim=(0.0, 1.0), aspect="auto")
    ax.axis("off")
    return figure


def plot_solve_rates(results: Results) -> Figure:
    """P(solve) of random networks, readings from top to bottom, with Wilson intervals."""
    solve = results.experiment.solve
    systems = tuple(next(iter(solve.values())))
    figure, axes = _grid(1, len(systems), 0.3 * len(solve) + 1.2)
    for ax, system in zip(axes, systems, strict=True):
        for row, counts in enumerate(solve.values()):
            count = counts[system]
            rate = count.solved / count.tried
            low, high = wilson_of_rate(rate, count.tried)
            ax.plot([100.0 * low, 100.0 * high], [row, row], color=SYSTEMS[system], linewidth=1.6)
            ax.plot([100.0 * rate], [row], "o", color=SYSTEMS[system], markersize=4)
        ax.axvline(100.0 * published().implied_success[system], color="#222222", linewidth=0.8, linestyle="--")
        ax.set_title(system, fontsize=SMALL + 1)
        ax.set(xlabel="solved [%]", ylim=(len(solve) - 0.5, -0.5), yticks=range(len(solve)))
        ax.set_yticklabels([name.replace("_", " ") for name in solve] if ax is axes[0] else [], fontsize=SMALL)
    return figure


def plot_fresh_starts(results: Results) -> Figure:
    """Fitness against success on fresh starts, a point per run."""
    figure, (ax,) = _grid(1, 1, 3.6)
    for system in results.tasks["static"]:
        fitness, success = results.sample("static", system, "best_fitness"), results.fresh("static", system)
        ax.plot(fitness, 100.0 * success, "o", color=SYSTEMS[system], label=system, alpha=0.8, markersize=4)
    ax.set(xlabel="fitness of the best network", ylabel="success on fresh starts [%]", ylim=(-2.0, 102.0))
    ax.legend(frameon=False, fontsize=SMALL)
    return figure


def _band(ax: Axes, x: FloatArray, values: FloatArray, colour: str, label: str) -> None:
    mean, runs = values.mean(axis=1), values.shape[1]
    ax.plot(x, mean, color=colour, label=label, linewidth=1.2)
    if runs > 1:
        from scipy.stats import t

        half = t.ppf(0.975, runs - 1) * values.std(axis=1, ddof=1) / np.sqrt(runs)
        ax.fill_between(x, mean - half, mean + half, color=colour, alpha=0.15, linewidth=0.0)


def _grid(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(WIDTH, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=SMALL)
        ax.xaxis.label.set_fontsize(SMALL + 1)
        ax.yaxis.label.set_fontsize(SMALL + 1)
    return figure, axes
