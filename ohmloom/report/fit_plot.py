"""Fits: measured loops with what a law makes of them, residuals, starts and profiles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices import LAWS, Comparison, Fit
from ohmloom.devices.fitting.result import ProfileResult, SweepResult
from ohmloom.report._replay_data import INK
from ohmloom.units import axis_unit, format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of Okabe and Ito (2008), told apart with any colour vision; a sweep has one in all panels.
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
ORIGINS: Final = {"screened": ("#0072b2", "o"), "nominal": ("#d55e00", "s"), "regression": ("#009e73", "^"),
                  "profile": ("#cc79a7", "D")}  # fmt: skip
MEASURED: Final = "#8a9099"
SMALL: Final = 8
PANEL: Final = 2.5  # inches; three fit across two columns of a journal
MOST_ACROSS: Final = 3
MANY_POINTS: Final = 4000  # points of which a vector file would hold a bitmap
SAME: Final = 1.05  # a start within 5 % of the best reached it
# Sweeps whose durations differ by more share no time axis.
ALIKE: Final = 3.0


def plot_fit(fit: Fit) -> Figure:
    """Draw loops, residual and starts of a fit together.

    Examples
    --------
    >>> from ohmloom.devices import Device, Measurement, fit
    >>> t = np.linspace(0.0, 1.0, 60)
    >>> loop = Device.load("hp_tio2").simulate(np.sin(2 * np.pi * t), t, s0=0.3)
    >>> sweep = Measurement(name="loop", t=loop.t, v=loop.v, i=loop.i)
    >>> found = fit(sweep, "hp_linear", rng=np.random.default_rng(0), screen=20)
    >>> [axes.get_xlabel() for axes in plot_fit(found).axes]
    ['device voltage [V]', 'time [s]', 'start, best first']
    """
    from matplotlib.figure import Figure

    curves = (*fit.sweeps, *fit.holdout)
    across = _across(len(curves))
    rows = -(-len(curves) // across)
    if len(curves) == 1:
        figure = Figure(figsize=(3 * PANEL, 1.7 * PANEL), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
        _draw_loop(fit, 0, figure.add_subplot(grid[:, 0]))
        plot_residual(fit, figure.add_subplot(grid[0, 1]))
        plot_starts(fit, figure.add_subplot(grid[1, 1]))
    else:
        figure = Figure(figsize=(3 * PANEL, (rows + 1) * 0.95 * PANEL), layout="constrained")
        grid = figure.add_gridspec(rows + 1, 6)
        width = 6 // across
        for place, k in enumerate(_by_frequency(curves)):
            left = width * (place % across)
            _draw_loop(fit, k, figure.add_subplot(grid[place // across, left : left + width]))
        plot_residual(fit, figure.add_subplot(grid[rows, :4]))
        plot_starts(fit, figure.add_subplot(grid[rows, 4:]))
    for letter, axes in zip("abcdefghijklmnopqrstuvwxyz", figure.axes, strict=False):
        axes.set_title(f"({letter})", loc="left", fontsize=SMALL, fontweight="bold")
    return figure


def plot_loops(fit: Fit) -> Figure:
    """Draw a panel for each sweep, by frequency, then those held out: measured dots and the fitted line.

    The line is the fit's own loop: with a series resistor its device voltage differs from the measured one.
    """
    from matplotlib.figure import Figure

    curves = (*fit.sweeps, *fit.holdout)
    across = _across(len(curves))
    rows = -(-len(curves) // across)
    figure = Figure(figsize=(max(across, 1.5) * PANEL, rows * PANEL), layout="constrained")
    for place, k in enumerate(_by_frequency(curves)):
        _draw_loop(fit, k, figure.add_subplot(rows, across, place + 1))
    return figure


def plot_residual(fit: Fit, ax: Axes | None = None) -> Axes:
    """Draw ``(i_fit - i)/max|i|`` of each sweep in per cent over time; those held out are dashed.

    Time is a share of each sweep's duration where durations differ by more than a factor of 3.
    """
    ax = _axes(ax, (5.0, 2.4))
    curves = (*fit.sweeps, *fit.holdout)
    durations = [curve.t[-1] - curve.t[0] for curve in curves]
    shared = max(durations) <= ALIKE * min(durations)
    factor, unit = axis_unit(max(durations), "s")
    ax.axhline(0.0, color=MEASURED, linewidth=0.8, zorder=1)
    for k, (curve, duration) in enumerate(zip(curves, durations, strict=True)):
        t, i = np.array(curve.t), np.array(curve.i)
        x = t * factor if shared else (t - t[0]) / duration
        label = _legend_text(curve, k >= len(fit.sweeps))
        ax.plot(x, 100.0 * (np.array(curve.i_fit) - i) / np.abs(i).max(), color=_colour(k), linewidth=1.1,
                linestyle="--" if k >= len(fit.sweeps) else "-", label=label, gid=curve.name)  # fmt: skip
    _label(ax, f"time [{unit}]" if shared else "time / duration of the sweep", "residual / max |i| [%]")
    if len(curves) > 1:
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + (0.13 * len(curves)) * (high - low))
        _legend(ax, loc="upper left")
    return ax


def plot_starts(fit: Fit, ax: Axes | None = None) -> Axes:
    """Draw where each start of the search ended, best first: relative RMS, coloured by the start's origin.

    The faint open mark above is the error at the start itself; the band is 5 % over the best, and what ends in it is
    the same fit.
    """
    from matplotlib.ticker import MaxNLocator

    ax = _axes(ax, (3.2, 2.4))
    starts = sorted(fit.starts, key=lambda start: start.after)
    best = starts[0].after
    ax.axhspan(best, SAME * best, color=MEASURED, alpha=0.3, linewidth=0, label="within 5 %", gid="same", zorder=1)
    for origin, (colour, marker) in ORIGINS.items():
        ranks = [k + 1 for k, start in enumerate(starts) if start.origin == origin]
        if not ranks:
            continue
        before, after = ([getattr(starts[k - 1], name) for k in ranks] for name in ("before", "after"))
        ax.vlines(ranks, after, before, color=colour, alpha=0.25, linewidth=1.0, zorder=2)
        ax.plot(ranks, before, marker, color=colour, alpha=0.35, markerfacecolor="white", markersize=4,
                gid=f"{origin} before", zorder=3)  # fmt: skip
        ax.plot(ranks, after, marker, color=colour, markersize=5, label=origin, gid=f"{origin} after", zorder=4)
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.45)
    ax.set_xlim(0.4, len(starts) + 0.6)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    _number_log_axis(ax.yaxis, *ax.get_ylim())
    _label(ax, "start, best first", "relative RMS")
    _legend(ax, loc="upper left", ncols=2, columnspacing=0.8)
    return ax


def plot_profiles(fit: Fit) -> Figure:
    """Draw the profile of each unknown that has one: the best relative RMS for each of its values.

    The dashed line is the 95 % limit; the shaded interval lies under it, and reaches the edge where no limit was
    found. A fit without profiles gives a figure that says so.
    """
    from matplotlib.figure import Figure

    if not fit.profiles:
        figure = Figure(figsize=(4, 1))
        figure.text(0.5, 0.5, "no profiles: fit with profile=True", ha="center", va="center")
        return figure
    across = min(len(fit.profiles), MOST_ACROSS)
    rows = -(-len(fit.profiles) // across)
    figure = Figure(figsize=(max(across, 1.5) * PANEL, rows * 0.9 * PANEL + 0.3), layout="constrained")
    for k, (name, profile) in enumerate(fit.profiles.items()):
        _draw_profile(fit, name, profile, figure.add_subplot(rows, across, k + 1))
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4 if across > 1 else 2, frameon=False,
                  fontsize=SMALL)  # fmt: skip
    return figure


def plot_comparison(comparison: Comparison, sweep: int = 0) -> Figure:
    """Draw one sweep's loop as each law fits it, best law first, and bars of BIC and of the error held out.

    Bars are of ``delta BIC``, 0 for the best law, and of the relative RMS on the sweeps held out, or on the fitted ones
    if none is.
    """
    from matplotlib.figure import Figure

    laws = [row.law for row in comparison.ranking]
    across = min(len(laws), MOST_ACROSS)
    rows = -(-len(laws) // across)
    bars = 0.25 * len(laws) + 0.9
    figure = Figure(figsize=(3 * PANEL, rows * 0.9 * PANEL + bars), layout="constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=(rows * 0.9 * PANEL, bars))
    above, below = halves
    for k, law in enumerate(laws):
        ax = above.add_subplot(rows, across, k + 1)
        _draw_loop(comparison.fits[law], sweep, ax, colour=COLOURS[0])
        curve = (*comparison.fits[law].sweeps, *comparison.fits[law].holdout)[sweep]
        ax.set_title(f"{law}\nrelative RMS {curve.relative_rms:.1%}", fontsize=SMALL)
    above.suptitle(_legend_text(curve, is_held_out=False), fontsize=SMALL + 1, parse_math=False)
    left, right = below.subplots(1, 2, sharey=True)
    held_out = [row.holdout_rms for row in comparison.ranking]
    _draw_bars(left, laws, [row.delta_bic for row in comparison.ranking], "delta BIC", "{:.1f}")
    if all(rms is not None for rms in held_out):
        _draw_bars(right, laws, [rms for rms in held_out if rms is not None], "relative RMS, held out", "{:.3f}")
    else:
        _draw_bars(right, laws, [row.relative_rms for row in comparison.ranking], "relative RMS, fitted", "{:.3f}")
    left.invert_yaxis()
    return figure


def _draw_loop(fit: Fit, k: int, ax: Axes, colour: str | None = None) -> None:
    curve, is_held_out = (*fit.sweeps, *fit.holdout)[k], k >= len(fit.sweeps)
    v, i, i_fit = np.array(curve.v), np.array(curve.i), np.array(curve.i_fit)
    # The source is the same for both, so the fit's own device voltage is v_source - R i_fit.
    v_fit = v + curve.series_resistance * (i - i_fit)
    (volt, voltage), (ampere, current) = axis_unit(_largest(v), "V"), axis_unit(_largest(i), "A")
    for at in (ax.axhline, ax.axvline):
        at(0.0, color=MEASURED, linewidth=0.5, alpha=0.5, zorder=1)
    ax.plot(v * volt, i * ampere, ".", color=MEASURED, markersize=3.5, label="measured", gid="measured",
            rasterized=len(v) > MANY_POINTS, zorder=2)  # fmt: skip
    ax.plot(v_fit * volt, i_fit * ampere, color=colour or _colour(k), linewidth=1.4, gid="fit", zorder=3,
            linestyle="--" if is_held_out else "-", label=f"{fit.law}, {curve.relative_rms:.1%}")  # fmt: skip
    _label(ax, f"device voltage [{voltage}]", f"current [{current}]")
    name = _shorten(curve.name, 30)
    frequency = "" if curve.frequency is None else format_quantity(curve.frequency, "Hz")
    second = ", ".join(text for text in (frequency, "held out" if is_held_out else "") if text)
    if colour is None:
        # Names of sweeps are other people's text: a $ in one is no formula.
        ax.set_title(f"{name}\n{second or ' '}", fontsize=SMALL, parse_math=False)
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.25 * (high - low))
        _legend(ax, loc="upper left")


def _draw_profile(fit: Fit, name: str, profile: ProfileResult, ax: Axes) -> None:
    parameter = next((p for p in LAWS[fit.law].parameters if p.name == name), None)
    order = np.argsort(profile.values, kind="stable")
    x, y = np.array(profile.values)[order], np.array(profile.relative_rms)[order]
    best, error = fit.parameters[name] if parameter else _start_state(fit, name), min(profile.relative_rms)
    # Far beyond the limit nothing is to be seen, and what lies under it would look flat.
    lift = max(profile.limit - error, 1e-3 * profile.limit)
    top = profile.limit + 1.5 * lift
    is_log = parameter is not None and parameter.scale == "log"
    left, right = _window(x[y <= top], profile.interval, is_log=is_log)
    middle = np.sqrt(left * right) if is_log else max(abs(left), abs(right))
    factor, unit = axis_unit(float(middle), parameter.unit) if parameter else (1.0, "")
    if is_log:
        ax.set_xscale("log")
    ax.plot(x * factor, y, "-", color=COLOURS[0], marker=".", markersize=4, linewidth=1.2, gid="profile", zorder=3,
            label="profile")  # fmt: skip
    ax.axhline(profile.limit, color=COLOURS[1], linestyle="--", linewidth=1.0, label="95 % limit", gid="limit")
    ax.plot([best * factor], [error], "o", color=INK, markersize=4, label="fit", gid="fit", zorder=4)
    low = left if profile.is_open[0] else profile.interval[0]
    high = right if profile.is_open[1] else profile.interval[1]
    ax.axvspan(low * factor, high * factor, color=MEASURED, alpha=0.25, linewidth=0, label="95 % interval",
               gid="interval", zorder=1)  # fmt: skip
    ax.set(xlim=(left * factor, right * factor), ylim=(error - 0.35 * lift, top))
    if is_log:
        _number_log_axis(ax.xaxis, left * factor, right * factor)
    else:
        ax.locator_params(axis="x", nbins=4)
    words = {(True, True): "no limits found", (True, False): "no lower limit", (False, True): "no upper limit"}
    shown = name if parameter else _shorten(name, 30)
    title = "\n".join(text for text in (shown, words.get(profile.is_open, "")) if text)
    ax.set_title(title, fontsize=SMALL, parse_math=False)
    of_sweep = "" if parameter else "state at the start"
    _label(ax, f"{name} [{unit}]" if unit else of_sweep or name, "relative RMS")


def _window(seen: FloatArray, interval: tuple[float, float], *, is_log: bool) -> tuple[float, float]:
    """The part of an axis that holds the points `seen` and the interval, with some space."""
    ends = np.array([min(seen.min(), interval[0]), max(seen.max(), interval[1])])
    if is_log:
        ends = np.log(ends)
    space = 0.06 * (ends[1] - ends[0]) or 1e-3 * max(abs(ends[0]), 1.0)
    left, right = ends[0] - space, ends[1] + space
    return (float(np.exp(left)), float(np.exp(right))) if is_log else (float(left), float(right))


def _draw_bars(ax: Axes, laws: list[str], values: list[float], label: str, form: str) -> None:
    bars = ax.barh(range(len(laws)), values, color=COLOURS[0], height=0.65, gid=label)
    ax.bar_label(bars, [form.format(value) for value in values], padding=3, fontsize=SMALL)
    ax.set_yticks(range(len(laws)), laws, fontsize=SMALL)
    ax.margins(x=0.18)
    ax.set_xlim(left=0.0)
    _label(ax, label, "")
    ax.locator_params(axis="x", nbins=5)
    ax.spines[["top", "right"]].set_visible(False)


def _across(panels: int) -> int:
    """Panels beside each other; four stand in a square."""
    return 2 if panels == 4 else min(panels, MOST_ACROSS)


def _by_frequency(curves: Sequence[SweepResult]) -> list[int]:
    """Indices of the sweeps by frequency; those without one last, each in the order given."""
    return sorted(range(len(curves)), key=lambda k: np.inf if curves[k].frequency is None else curves[k].frequency or 0)


def _number_log_axis(axis: Any, low: float, high: float) -> None:
    """Few, plain numbers: decades on a wide range, 1-2-5 on a narrow one, equal steps on a very narrow one."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    decades = np.log10(high / low)
    if decades > 2.5:
        axis.set_major_locator(LogLocator(numticks=5))
    else:
        steps = (1.0, 2.0, 5.0) if decades < 1.5 else (1.0, 3.0)
        first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
        ticks = [step * 10.0**k for k in range(first, last + 1) for step in steps]
        inside = [tick for tick in ticks if low <= tick <= high]
        axis.set_major_locator(FixedLocator(inside) if len(inside) >= 3 else MaxNLocator(4))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _start_state(fit: Fit, name: str) -> float:
    """The fitted start state that the profile `name` ("s0", or "s0 of <sweep>") is of."""
    return next(sweep.s0 for sweep in fit.sweeps if len(fit.sweeps) == 1 or name == f"s0 of {sweep.name}")


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    if ax is not None:
        return ax
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained").add_subplot()


def _label(ax: Axes, x: str, y: str) -> None:
    ax.set_xlabel(x, fontsize=SMALL, parse_math=False)
    ax.set_ylabel(y, fontsize=SMALL, parse_math=False)
    ax.tick_params(labelsize=SMALL)


def _legend(ax: Axes, **options: Any) -> None:
    legend = ax.legend(fontsize=SMALL - 1, frameon=False, handlelength=1.4, borderaxespad=0.2, labelspacing=0.25,
                       **options)  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)


def _legend_text(curve: SweepResult, is_held_out: bool) -> str:
    frequency = "" if curve.frequency is None else f", {format_quantity(curve.frequency, 'Hz')}"
    text = _shorten(curve.name, 34) + frequency + (", held out" if is_held_out else "")
    return f" {text}" if text.startswith("_") else text  # matplotlib leaves out what starts with it


def _shorten(name: str, limit: int) -> str:
    half = (limit - 1) // 2
    return name if len(name) <= limit else f"{name[:half]}…{name[-half:]}"


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max())
