"""Pictures of a fit: the lines are the data, axes carry units, and text of other people stays text."""

from __future__ import annotations

import io
import warnings

import numpy as np
import pytest

from ohmloom.devices import Comparison, Device, Fit, Measurement, compare, fit
from ohmloom.devices.fitting.result import ProfileResult
from ohmloom.report.fit_output import save_fit
from ohmloom.report.fit_plot import (
    plot_comparison,
    plot_fit,
    plot_loops,
    plot_profiles,
    plot_residual,
    plot_starts,
)

POINTS = 60


def sweep(name: str, frequency: float, *, resistance: float = 0.0, seed: int = 0) -> Measurement:
    """A loop of hp_tio2_10k with noise of a per cent, its file's frequency noted."""
    t = np.arange(float(POINTS)) / (POINTS * frequency)
    made = Device.load("hp_tio2_10k").simulate(np.sin(2 * np.pi * frequency * t), t, s0=0.3)
    noise = np.random.default_rng(seed).normal(size=POINTS)
    i = made.i + 0.01 * np.abs(made.i).max() * noise
    return Measurement(name=name, t=t, v=made.v + resistance * i, i=i, frequency=frequency,
                       series_resistance=resistance)  # fmt: skip


@pytest.fixture(scope="module")
def joint() -> Fit:
    """Two sweeps and one held out, given from the fastest on, with a profile of everything."""
    sweeps = [sweep("fast", 0.03), sweep("slow $x_1$", 0.003, resistance=1e3, seed=1)]
    return fit(sweeps, "peo_pani_mirror", holdout=[sweep("_kept", 0.01, seed=2)], profile=True, screen=20, starts=2,
               rng=np.random.default_rng(0))  # fmt: skip


@pytest.fixture(scope="module")
def single() -> Fit:
    return fit(sweep("one", 0.01), "hp_linear", screen=20, starts=2, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return compare(sweep("one", 0.01), ["hp_linear", "linear"], screen=10, starts=1, rng=np.random.default_rng(0))


def line(ax, gid):
    return next(found for found in ax.lines if found.get_gid() == gid)


def test_loops_stand_by_frequency_with_measured_dots_and_fitted_line(joint):
    figure = plot_loops(joint)
    assert [ax.get_title() for ax in figure.axes] == ["slow $x_1$\n3 mHz", "_kept\n10 mHz, held out", "fast\n30 mHz"]
    slow, kept, fast = joint.sweeps[1], joint.holdout[0], joint.sweeps[0]
    for ax, curve in zip(figure.axes, (slow, kept, fast), strict=True):
        scale = {"current [uA]": 1e6, "current [mA]": 1e3}[ax.get_ylabel()]
        assert ax.get_xlabel() == "device voltage [V]"
        np.testing.assert_allclose(
            line(ax, "measured").get_xydata(), np.transpose([curve.v, scale * np.array(curve.i)])
        )
        np.testing.assert_allclose(line(ax, "fit").get_ydata(), scale * np.array(curve.i_fit))
        assert f"{curve.relative_rms:.1%}" in ax.get_legend().get_texts()[1].get_text()
    assert [line(ax, "fit").get_linestyle() for ax in figure.axes] == ["-", "--", "-"]


def test_fitted_loop_behind_a_resistor_has_a_voltage_of_its_own(joint):
    curve = joint.sweeps[1]
    source = np.array(curve.v) + 1e3 * np.array(curve.i)
    drawn = line(plot_loops(joint).axes[0], "fit").get_xdata()
    np.testing.assert_allclose(drawn, source - 1e3 * np.array(curve.i_fit))


def test_residual_is_over_the_largest_current_and_a_line_for_each_sweep(joint):
    ax = plot_residual(joint)
    assert ax.get_ylabel() == "residual / max |i| [%]"
    assert ax.get_xlabel() == "time / duration of the sweep"
    for curve in (*joint.sweeps, *joint.holdout):
        i = np.array(curve.i)
        drawn = line(ax, curve.name)
        np.testing.assert_allclose(drawn.get_ydata(), 100 * (np.array(curve.i_fit) - i) / np.abs(i).max())
        np.testing.assert_allclose(drawn.get_xdata()[[0, -1]], [0.0, 1.0])
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["fast, 30 mHz", "slow $x_1$, 3 mHz", " _kept, 10 mHz, held out"]


def test_residual_of_one_sweep_is_over_time(single):
    ax = plot_residual(single)
    assert ax.get_xlabel() == "time [s]"
    np.testing.assert_array_equal(line(ax, "one").get_xdata(), single.sweeps[0].t)


def test_starts_are_sorted_by_where_they_ended(joint):
    ax = plot_starts(joint)
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_yscale()) == ("start, best first", "relative RMS", "log")
    ordered = sorted(joint.starts, key=lambda start: start.after)
    for when in ("before", "after"):
        drawn = {}
        for found in ax.lines:
            if str(found.get_gid()).endswith(when):
                drawn |= {x: (found.get_gid().split()[0], y) for x, y in found.get_xydata().tolist()}
        assert drawn == {k: (start.origin, getattr(start, when)) for k, start in enumerate(ordered, start=1)}
    band = next(patch for patch in ax.patches if patch.get_gid() == "same")
    best = ordered[0].after
    np.testing.assert_allclose([band.get_y(), band.get_y() + band.get_height()], [best, 1.05 * best])


def test_profiles_have_their_limit_interval_and_scale(joint):
    figure = plot_profiles(joint)
    assert len(figure.axes) == len(joint.profiles) == len(joint.fitted) + 2
    for ax, (name, profile) in zip(figure.axes, joint.profiles.items(), strict=True):
        is_parameter = name in joint.fitted
        assert ax.get_xscale() == ("log" if is_parameter else "linear")
        drawn, order = line(ax, "profile"), np.argsort(profile.values)
        np.testing.assert_array_equal(drawn.get_ydata(), np.array(profile.relative_rms)[order])
        np.testing.assert_array_equal(line(ax, "limit").get_ydata(), profile.limit)
        factor = drawn.get_xdata()[-1] / max(profile.values)
        interval = next(patch for patch in ax.patches if patch.get_gid() == "interval")
        ends = np.array([interval.get_x(), interval.get_x() + interval.get_width()])
        limits = [edge if is_open else factor * end for edge, end, is_open in
                  zip(ax.get_xlim(), profile.interval, profile.is_open, strict=True)]  # fmt: skip
        np.testing.assert_allclose(ends, limits, rtol=1e-9)  # a width added again: rounding alone
    r_on = figure.axes[list(joint.profiles).index("r_on")]
    assert r_on.get_xlabel() == "r_on [kOhm]"
    s0 = figure.axes[list(joint.profiles).index("s0 of slow $x_1$")]
    assert s0.get_xlabel() == "state at the start"
    assert s0.get_title().startswith("s0 of slow $x_1$")


def test_open_profile_is_shaded_to_the_edge_and_says_so(single):
    values = np.geomspace(1.0, 1e4, 9)
    open_below = ProfileResult(
        values=tuple(values), relative_rms=(0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.15, 0.3), limit=0.12,
        interval=(1.0, 2e3), is_open=(True, False),
    )  # fmt: skip
    ax = plot_profiles(single.model_copy(update={"profiles": {"r_on": open_below}})).axes[0]
    interval = next(patch for patch in ax.patches if patch.get_gid() == "interval")
    assert interval.get_x() == ax.get_xlim()[0]
    assert ax.get_title() == "r_on\nno lower limit"


def test_fit_without_profiles_says_so(single):
    figure = plot_profiles(single.model_copy(update={"profiles": {}}))
    assert [text.get_text() for text in figure.texts] == ["no profiles: fit with profile=True"]


def test_figure_for_a_paper_has_loops_residual_and_starts(joint, single):
    labels = [ax.get_xlabel() for ax in plot_fit(joint).axes]
    assert labels == ["device voltage [V]"] * 3 + ["time / duration of the sweep", "start, best first"]
    letters = [ax.get_title(loc="left") for ax in plot_fit(single).axes]
    assert letters == ["(a)", "(b)", "(c)"]


def test_no_text_overlaps_text_beside_it(joint):
    """Titles, axis labels and tick labels of the whole figure, once it is laid out."""
    figure = plot_fit(joint)
    figure.savefig(io.BytesIO(), format="png", dpi=100)
    boxes = [text.get_window_extent() for ax in figure.axes for text in
             (ax.title, ax._left_title, ax.xaxis.label, ax.yaxis.label) if text.get_text()]  # fmt: skip
    for k, box in enumerate(boxes):
        # A title of two lines has its panel's letter beside the second, which is shorter than the first.
        assert sum(box.overlaps(other) for other in boxes[k + 1 :]) <= 1
    assert all(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 for box in boxes)


def test_comparison_has_a_loop_for_each_law_and_bars(compared):
    figure = plot_comparison(compared)
    loops, (delta, error) = figure.axes[:-2], figure.axes[-2:]
    for ax, row in zip(loops, compared.ranking, strict=True):
        curve = compared.fits[row.law].sweeps[0]
        assert ax.get_title() == f"{row.law}\nrelative RMS {curve.relative_rms:.1%}"
        np.testing.assert_allclose(line(ax, "fit").get_ydata(), 1e6 * np.array(curve.i_fit))
    assert [bar.get_width() for bar in delta.patches] == [row.delta_bic for row in compared.ranking]
    assert [bar.get_width() for bar in error.patches] == [row.relative_rms for row in compared.ranking]
    assert (delta.get_xlabel(), error.get_xlabel()) == ("delta BIC", "relative RMS, fitted")
    assert [text.get_text() for text in delta.get_yticklabels()] == [row.law for row in compared.ranking]


def test_held_out_error_is_drawn_where_there_is_one(compared):
    ranking = tuple(row.model_copy(update={"holdout_rms": 0.25}) for row in compared.ranking)
    error = plot_comparison(compared.model_copy(update={"ranking": ranking})).axes[-1]
    assert error.get_xlabel() == "relative RMS, held out"
    assert [bar.get_width() for bar in error.patches] == [0.25, 0.25]


def test_same_fit_gives_the_same_bytes_whatever_the_users_style(joint, tmp_path):
    import matplotlib

    paths = save_fit(joint, tmp_path / "a")
    with matplotlib.rc_context({"font.size": 20, "axes.grid": True}):
        again = save_fit(joint, tmp_path / "b")
    assert [path.name for path in paths] == ["device.toml", "fit.json", "fit.png", "fit.pdf", "profiles.png"]
    for one, other in zip(paths, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert b"CreationDate" not in paths[3].read_bytes()
    save_fit(joint.model_copy(update={"profiles": {}}), tmp_path / "b")
    assert not (tmp_path / "b" / "profiles.png").exists()


def test_name_in_letters_that_the_font_lacks_is_drawn(single, tmp_path):
    curve = single.sweeps[0].model_copy(update={"name": "忆阻器"})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_fit(single.model_copy(update={"sweeps": (curve,)}), tmp_path)
    assert (tmp_path / "fit.pdf").stat().st_size > 1000
