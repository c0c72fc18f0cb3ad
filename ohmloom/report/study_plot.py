"""Pictures of a feasibility study: how far its figures are from their limits, success, yield, corners, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom.report._replay_data import INK
from ohmloom.sim import Feasibility, Figure
from ohmloom.sim.figures import MARGINAL_BELOW, NON_INFERIORITY
from ohmloom.sim.statistics import Success, clustered_success, paired_success
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IDEAL_COLOUR, HARDWARE_COLOUR, LOST_COLOUR = "#0072b2", "#d55e00", "#cc79a7"
SERIES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
STATUS_COLOURS: Final = {"PASS": "#17703b", "MARGINAL": "#e69f00", "ASSUMED": "#e69f00", "FAIL": "#c03a2b",
                         "NOT_RUN": "#8a9099"}  # fmt: skip
LIMIT_COLOUR: Final = "#c03a2b"
FARTHEST: Final = 1e4  # times from the limit; what is farther stands at the edge
SMALL: Final = 8
MOST_POINTS, MOST_BOOTSTRAPS = 100, 20  # of a running comparison


def share_of_limit(figure: Figure) -> float | None:
    """How much of its limit a figure uses: above 1 the limit is broken. None where there is no such number.

    >>> low = Figure(name="a", value=2.0, unit="s", limit=4.0, margin=0.5, source="", status="PASS", detail="")
    >>> high = Figure(name="b", value=8.0, unit="events", limit=4.0, margin=1.0, source="", status="PASS", detail="")
    >>> share_of_limit(low), share_of_limit(high)
    (0.5, 0.5)
    """
    value, limit, margin = figure.value, figure.limit, figure.margin
    if value is None or limit is None or margin is None or limit <= 0.0 or value < 0.0:
        return None
    is_low_good = (limit >= value) == (margin >= 0.0)
    if is_low_good:
        return value / limit
    return limit / value if value > 0.0 else np.inf


def plot_margins(figures: Sequence[Figure], ax: Axes | None = None) -> Axes:
    """Draw how much of its limit each figure uses, on a log scale; to the right of 1 the limit is broken."""
    ax = _axes(ax, 6.1, 0.9 + 0.3 * len(figures))
    shares = [(figure, share_of_limit(figure)) for figure in figures]
    known = [(figure, share) for figure, share in shares if share is not None]
    for row, (figure, share) in enumerate(known):
        shown = min(max(share, 1.0 / FARTHEST), FARTHEST)
        colour = STATUS_COLOURS.get(figure.status, INK)
        ax.plot([1.0 / FARTHEST, shown], [row, row], color=colour, linewidth=5, solid_capstyle="butt", alpha=0.45)
        marker = "o" if share == shown else "<" if share < shown else ">"
        ax.plot(shown, row, marker=marker, color=colour, markersize=7, gid=f"share {figure.name}", clip_on=False)
    ax.axvline(1.0, color=LIMIT_COLOUR, linewidth=1.2)
    ax.axvspan(1.0 - MARGINAL_BELOW, 1.0, color="#e69f00", alpha=0.25, linewidth=0)
    ax.set_yticks(range(len(known)), [figure.name for figure, _ in known], fontsize=SMALL + 1)
    ax.set(xscale="log", xlim=(1.0 / FARTHEST, FARTHEST), ylim=(len(known) - 0.4, -0.6))
    ticks = [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4]
    words = ["≤ 0.01 %", "0.1 %", "1 %", "10 %", "limit", "× 10", "× 100", "× 1000", "≥ 10⁴"]
    ax.set_xticks(ticks, words, fontsize=SMALL)
    ax.minorticks_off()
    ax.set_xlabel("used of the limit (beyond it: times the limit)")
    return _bare(ax)


def running_success(study: Feasibility) -> list[Success]:
    """The comparison as it stood after so many dies, at most some hundred times, the last the study's own."""
    dies = sorted({one.die for one in study.dies})
    is_clustered = any(one.start for one in study.dies)
    # A bootstrap takes its time.
    step = max(1, len(dies) // (MOST_BOOTSTRAPS if is_clustered else MOST_POINTS))
    found = []
    for n in sorted({*range(step, len(dies) + 1, step), len(dies)}):
        tried = [one for one in study.dies if one.die <= dies[n - 1]]
        ideal, hardware = [one.ideal for one in tried], [one.hardware for one in tried]
        if is_clustered:
            seed = int(study.provenance.get("seed", 0))
            found.append(clustered_success(ideal, hardware, [one.die for one in tried], seed=seed))
        else:
            found.append(paired_success(ideal, hardware))
    return found


def plot_success(running: Sequence[Success], ax: Axes | None = None) -> Axes:
    """Draw the fractions that reached the goal, with their intervals, as the dies come in."""
    ax = _axes(ax, 5.2, 3.2)
    dies = [one.dies for one in running]
    for name, colour in (("ideal", IDEAL_COLOUR), ("hardware", HARDWARE_COLOUR)):
        bounds = np.array([getattr(one, f"{name}_interval") for one in running])
        ax.fill_between(dies, bounds[:, 0], bounds[:, 1], color=colour, alpha=0.18, linewidth=0)
        ax.plot(dies, [getattr(one, name) for one in running], color=colour, linewidth=2,
                linestyle="-" if name == "ideal" else "--", gid=f"success {name}", label=name)  # fmt: skip
    ax.set(xlim=(0, dies[-1]), ylim=(-0.03, 1.03), xlabel="dies tried", ylabel="reached the goal")
    ax.locator_params(axis="x", integer=True)
    return _legend(ax)


def plot_difference(running: Sequence[Success], ax: Axes | None = None) -> Axes:
    """Draw the paired difference, hardware less ideal, with its interval, as the dies come in."""
    ax = _axes(ax, 5.2, 3.2)
    dies = [one.dies for one in running]
    bounds = 100.0 * np.array([one.interval for one in running])
    ax.fill_between(dies, bounds[:, 0], bounds[:, 1], color=HARDWARE_COLOUR, alpha=0.18, linewidth=0,
                    label="95 % interval")  # fmt: skip
    ax.plot(dies, [100.0 * (one.hardware - one.ideal) for one in running], color=HARDWARE_COLOUR, linewidth=2,
            gid="difference", label="hardware less ideal")  # fmt: skip
    ax.axhline(
        100.0 * NON_INFERIORITY, color=LIMIT_COLOUR, linewidth=1.2, linestyle=":", label="limit of its lower end"
    )
    ax.set(xlim=(0, dies[-1]), xlabel="dies tried", ylabel="difference [points]")
    ax.locator_params(axis="x", integer=True)
    return _legend(ax)


def plot_yield(rows: Sequence[Mapping[str, Any]], ax: Axes | None = None) -> Axes:
    """Draw the share of good dies over the fault rate, with intervals, for each way of repair and number of spares."""
    ax = _axes(ax, 6.4, 3.6)
    series: dict[tuple[str, int, int], list[Mapping[str, Any]]] = {}
    for row in rows:
        series.setdefault((row["repair"], row["spare_rows"], row["spare_columns"]), []).append(row)
    for k, ((repair, spare_rows, spare_columns), members) in enumerate(series.items()):
        members = sorted(members, key=lambda row: row["fault_rate"])
        rate = [100.0 * row["fault_rate"] for row in members]
        low, high = np.array([row["interval"] for row in members], dtype=float).T
        how = "no repair" if repair == "none" else "lines permuted"
        colour = SERIES[k % len(SERIES)]
        ax.plot(rate, [row["value"] for row in members], marker="o", markersize=4, color=colour, linewidth=1.6,
                linestyle="--" if repair == "none" else "-", gid=f"yield {k}",
                label=f"{how}, {spare_rows} + {spare_columns} spare lines")  # fmt: skip
        ax.fill_between(rate, low, high, color=colour, alpha=0.15, linewidth=0)
    ax.set(ylim=(-0.03, 1.03), xlabel="faulty devices [%]", ylabel="dies without a faulty synapse")
    return _legend(ax)


def plot_sensitivity(sensitivity: Mapping[str, Any], ax: Axes | None = None) -> Axes:
    """Draw Morris' mu* of each factor with its interval, the largest on top; the range that was tried beside it."""
    factors = sorted(sensitivity["factors"], key=lambda factor: -factor["mu_star"])
    ax = _axes(ax, 7.4, 1.0 + 0.32 * len(factors))
    for row, factor in enumerate(factors):
        low, high = factor["interval"]
        ax.barh(row, factor["mu_star"], height=0.62, color=IDEAL_COLOUR, alpha=0.75, gid=f"mu_star {factor['name']}")
        ax.plot([low, high], [row, row], color=INK, linewidth=1.4)
    words = [f"{factor['name']}\n{factor_range(factor)}" for factor in factors]
    ax.set_yticks(range(len(factors)), words, fontsize=SMALL)
    ax.set(ylim=(len(factors) - 0.4, -0.6), xlabel=f"mu*: mean change of {sensitivity['output']} over the range")
    ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return _bare(ax)


def plot_sobol(sobol: Sequence[Mapping[str, Any]], ax: Axes | None = None) -> Axes:
    """Draw first-order and total Sobol indices of the leading factors, with intervals."""
    ax = _axes(ax, 6.4, 1.1 + 0.42 * len(sobol))
    for shift, name, words, colour in (
        (-0.18, "first", "first order", IDEAL_COLOUR), (0.18, "total", "total", HARDWARE_COLOUR)
    ):  # fmt: skip
        for row, one in enumerate(sobol):
            low, high = one[f"{name}_interval"]
            ax.barh(row + shift, one[name], height=0.34, color=colour, alpha=0.75, gid=f"{name} {one['name']}",
                    label=words if row == 0 else None)  # fmt: skip
            ax.plot([low, high], [row + shift] * 2, color=INK, linewidth=1.2)
    ax.set_yticks(range(len(sobol)), [one["name"] for one in sobol], fontsize=SMALL)
    ax.set(ylim=(len(sobol) - 0.4, -0.6), xlabel="share of the variance")
    return _legend(ax)


def plot_convergence(rows: Sequence[Mapping[str, Any]], ax: Axes | None = None) -> Axes:
    """Draw mu* of each factor over the number of trajectories."""
    ax = _axes(ax, 7.4, 3.2)
    names = sorted(rows[-1]["mu_star"], key=lambda name: -rows[-1]["mu_star"][name])
    for k, name in enumerate(names):
        ax.plot([row["trajectories"] for row in rows], [row["mu_star"].get(name, np.nan) for row in rows], marker=".",
                linewidth=1.4, color=SERIES[k % len(SERIES)], linestyle=("-", "--", ":")[k // len(SERIES) % 3],
                label=name)  # fmt: skip
    ax.set(xlabel="trajectories", ylabel="mu*")
    # Beside the lines: with many factors there is no room among them.
    return _legend(ax, loc="center left", bbox_to_anchor=(1.0, 0.5))


def plot_events(ideal: npt.NDArray[Any], hardware: npt.NDArray[Any] | None, ax: Axes | None = None) -> Axes:
    """Draw learning events so far over the timesteps.

    Parameters
    ----------
    ideal
        (timestep, 1) events of the ideal network so far.
    hardware
        (timestep, 4) of a die: asked for, written, lost, spurious; or None.
    """
    ax = _axes(ax, 6.1, 3.4)

    def draw(values: npt.NDArray[Any], label: str, **style: Any) -> None:
        ax.plot(np.arange(len(values)) + 1, values, label=label, gid=label, **style)

    draw(ideal[:, 0], "ideal network", color=IDEAL_COLOUR, linewidth=3.4, alpha=0.45)
    if hardware is not None:
        draw(hardware[:, 0], "die: asked for", color=HARDWARE_COLOUR, linewidth=2.4, alpha=0.45)
        draw(hardware[:, 1], "die: written", color=HARDWARE_COLOUR, linewidth=1.3, linestyle="--")
        draw(hardware[:, 2] + hardware[:, 3], "die: lost or spurious", color=LOST_COLOUR, linewidth=1.6)
    longest = max(len(ideal), 0 if hardware is None else len(hardware))
    ax.set(xlim=(0, longest), xlabel="executed timestep", ylabel="learning events so far")
    ax.set_ylim(bottom=0)
    return _legend(ax)


def factor_range(factor: Mapping[str, Any]) -> str:
    """The range that a factor was varied over, with its unit."""
    low, high = (format_quantity(float(factor[end]), factor["unit"]) for end in ("low", "high"))
    return f"{low} to {high}"


def _axes(ax: Axes | None, width: float, height: float) -> Axes:
    from matplotlib.figure import Figure as Canvas

    return Canvas(figsize=(width, height), layout="constrained").add_subplot() if ax is None else ax


def _bare(ax: Axes) -> Axes:
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="x", color="#8a9099", alpha=0.25, linewidth=0.6)
    ax.set_axisbelow(True)
    # Names of factors are other people's text: a $ in one is no formula.
    for text in ax.get_yticklabels():
        text.set_parse_math(False)
    return ax


def _legend(ax: Axes, **place: Any) -> Axes:
    ax.spines[["top", "right"]].set_visible(False)
    legend = ax.legend(frameon=False, fontsize=SMALL, **place)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return ax
