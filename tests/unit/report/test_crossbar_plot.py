"""Crossbar pictures: what is drawn is what the plan says, cell by cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from ohmloom.errors import ParameterError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network, champion
from ohmloom.report import plot_plan, plot_tile, plot_tile_values
from ohmloom.sim import Feasibility


def squares(ax: Any, gid: str) -> dict[tuple[float, float], float]:
    """Centre (column, row) of each square of a collection -> its value."""
    (found,) = [c for c in ax.collections if c.get_gid() == gid]
    centres = [path.get_extents() for path in found.get_paths()]
    places = [((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2) for box in centres]
    return {(round(x, 9), round(y, 9)): float(g) for (x, y), g in zip(places, found.get_array(), strict=True)}


@pytest.mark.parametrize("index", [0, 1, 2])
def test_each_device_is_a_square_at_its_crosspoint_with_its_conductance(het_study: Feasibility, index: int) -> None:
    plan = het_study.plan
    assert plan is not None
    wanted = {(p.column, p.row): p.conductance for p in plan.crosspoints if p.tile == index}
    assert squares(plot_tile(plan, index), "devices") == wanted


def test_given_conductances_are_taken_by_synapse(ga_study: Feasibility) -> None:
    plan = ga_study.plan
    assert plan is not None
    g = 1e-6 * (1.0 + np.arange(len(plan.crosspoints)))
    wanted = {(p.column, p.row): g[p.synapse] for p in plan.crosspoints}
    assert squares(plot_tile(plan, 0, conductances=g), "devices") == pytest.approx(wanted)


def test_lines_are_labelled_with_neurons_and_read_voltage(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    labels = plan.network.labels()
    ax = plot_tile(plan, 0)
    rows = [text.get_text() for text in ax.get_yticklabels()]
    signs = ["−" if plan.network.sign(neuron) < 0 else "+" for neuron in plan.tiles[0].rows]
    assert {"+", "−"} == set(signs)
    assert rows == [f"{labels[n]}  {s}100 mV" for n, s in zip(plan.tiles[0].rows, signs, strict=True)]
    assert [text.get_text() for text in ax.get_xticklabels()] == [labels[n] for n in plan.tiles[0].columns]
    assert len({text.get_color() for text in ax.get_yticklabels()}) == 2
    senders = {text.get_text().split("  ")[0]: text.get_color() for text in ax.get_yticklabels()}
    receivers = {text.get_text(): text.get_color() for text in ax.get_xticklabels()}
    both = set(senders) & set(receivers)
    assert both
    assert all(senders[name] == receivers[name] for name in both)


def test_crossings_without_a_synapse_say_why(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    ax, tile, legal = plot_tile(plan, 0), plan.tiles[0], set(plan.network.legal)
    synapses = {(p.column, p.row) for p in plan.crosspoints if p.tile == 0}
    drawn = {
        line.get_gid(): {(int(x), int(y)) for x, y in line.get_xydata()}
        for line in ax.lines
        if line.get_gid() in ("no synapse", "forbidden")
    }
    places = {(j, i): (pre, post) for i, pre in enumerate(tile.rows) for j, post in enumerate(tile.columns)}
    assert drawn["forbidden"] == {place for place, pair in places.items() if pair not in legal}
    assert drawn["no synapse"] == set(places) - drawn["forbidden"] - synapses


def test_spare_lines_and_second_devices_look_different() -> None:
    hardware = Hardware.load("hp_1t1r")
    array = {"spare_rows": 2, "spare_columns": 1, "signs": "differential_pair"}
    plan = place(champion("GA"), hardware.model_copy(update={"array": hardware.array.model_copy(update=array)}))
    ax, tile = plot_tile(plan, 0), plan.tiles[0]
    lines = {c.get_gid(): len(c.get_segments()) for c in ax.collections if "lines" in str(c.get_gid())}
    assert lines["spare word lines"] == 2
    assert lines["spare bit lines"] == 1
    assert [text.get_text() for text in ax.get_yticklabels()][-2:] == ["spare", "spare"]
    assert len(squares(ax, "partners")) == len(squares(ax, "devices"))
    assert ax.get_xticklabels()[0].get_text().endswith(("counted +", "counted −"))
    entries = " ".join(text.get_text() for text in plot_plan(plan).legends[0].get_texts())
    assert "spare line" in entries
    assert "second device of a pair" in entries
    assert len(tile.rows) + 2 == len(ax.get_yticklabels())


def test_delays_of_more_than_one_step_are_written_in_the_cells(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    for index in range(len(plan.tiles)):
        ax = plot_tile(plan, index)
        written = {tuple(text.get_position()): text.get_text() for text in ax.texts}
        wanted = {(p.column, p.row): str(p.tap) for p in plan.crosspoints if p.tile == index and p.tap > 1}
        assert wanted
        assert written == wanted


def test_reference_column_stands_apart_at_the_lowest_conductance(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    index = next(k for k, tile in enumerate(plan.tiles) if tile.has_reference)
    tile, ax = plan.tiles[index], plot_tile(plan, index)
    cells = squares(ax, "reference")
    g_off = float(plan.hardware.devices[tile.kind].conductance(0.0))
    assert sorted(row for _, row in cells) == list(range(len(tile.rows)))
    assert min(column for column, _ in cells) > len(tile.columns)
    assert set(cells.values()) == {g_off}
    assert ax.get_xticklabels()[-1].get_text() == "reference"
    assert not [c for c in plot_tile(plan, 0).collections if c.get_gid() == "reference"]


def test_title_names_kind_card_and_size(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    tile = plan.tiles[1]
    title = plot_tile(plan, 1).get_title()
    for part in (tile.kind, "card peo_pani", f"{len(tile.rows)} word lines × {len(tile.columns)} bit lines"):
        assert part in title


def test_colour_scale_is_logarithmic_from_lowest_to_highest_conductance(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    ax = plot_tile(plan, 0)
    (cells,) = [c for c in ax.collections if c.get_gid() == "devices"]
    assert (cells.norm.vmin, cells.norm.vmax) == pytest.approx((1e-6, 1e-4))
    assert cells.norm(1e-5) == pytest.approx(0.5)
    (bar,) = ax.child_axes
    assert [text.get_text() for text in bar.get_yticklabels()] == [
        "1 uS, W 0.01", "3.16 uS, W 0.032", "10 uS, W 0.1", "31.6 uS, W 0.32", "100 uS, W 1"
    ]  # fmt: skip


def test_plot_draws_into_the_given_axes(het_study: Feasibility) -> None:
    from matplotlib.figure import Figure

    assert het_study.plan is not None
    ax = Figure().add_subplot()
    assert plot_tile(het_study.plan, 0, ax=ax) is ax


def test_plan_shows_every_tile_with_a_legend(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    figure = plot_plan(plan)
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert [title.split(":")[0] for title in titles] == [tile.kind for tile in plan.tiles]
    entries = " ".join(text.get_text() for text in figure.legends[0].get_texts())
    for word in ("device", "unformed", "delay", "inhibitory", "reference", "driver", "sense"):
        assert word in entries
    figure.savefig("/dev/null", format="svg")


def test_net_without_synapses_has_a_picture_that_says_so() -> None:
    network = Network.random(system="HP", rng=np.random.default_rng(0), enable_probability=0.0).replace(synapses=())
    figure = plot_plan(place(network, Hardware.load("hp_1t1r")))
    assert [text.get_text() for text in figure.texts] == ["no synapses, so no tile"]


def test_wrong_tile_and_wrong_conductances_are_refused(ga_study: Feasibility) -> None:
    plan = ga_study.plan
    assert plan is not None
    n = len(plan.crosspoints)
    with pytest.raises(ParameterError, match=r"plot_tile\.tile: expected an index from 0 to 0, got 1"):
        plot_tile(plan, 1)
    with pytest.raises(ParameterError, match=rf"plot_tile\.conductances: expected axes \(synapse={n}\)"):
        plot_tile(plan, 0, conductances=np.ones(n - 1))
    with pytest.raises(ParameterError, match=r"plot_tile\.conductances: expected numbers > 0 S, got 0 S"):
        plot_tile(plan, 0, conductances=np.zeros(n))


def test_any_number_colours_the_devices_and_the_worst_are_framed() -> None:
    plan = place(champion("HET"), Hardware.load("het_mixed"))
    values = 10.0 * np.arange(len(plan.crosspoints))
    here = [point for point in plan.crosspoints if point.tile == 1]
    ax = plot_tile_values(plan, 1, values, label="pulses", unit="pulses", marked=(here[2].synapse,))
    assert squares(ax, "devices") == {(p.column, p.row): values[p.synapse] for p in here}
    (frame,) = [patch for patch in ax.patches if str(patch.get_gid()).startswith("marked")]
    x, y = frame.get_xy()
    assert (x + frame.get_width() / 2, y + frame.get_height() / 2) == pytest.approx((here[2].column, here[2].row))
    with pytest.raises(ParameterError, match=r"plot_tile_values\.tile: expected an index from 0 to 1, got 2"):
        plot_tile_values(plan, 2, values, label="", unit="1")
    with pytest.raises(ParameterError, match=r"plot_tile_values\.values: expected numbers >= 0, got -1"):
        plot_tile_values(plan, 1, values * 0.0 - 1.0, label="", unit="1")


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_delays_stand_out_from_the_colour_of_their_device(share: float) -> None:
    plan = place(champion("HET"), Hardware.load("het_mixed"))
    values = np.full(len(plan.crosspoints), share)
    values[[p.synapse for p in plan.crosspoints if p.tap == 1]] = 1.0
    ax = plot_tile_values(plan, 1, values, label="", unit="1")
    (cells,) = [c for c in ax.collections if c.get_gid() == "devices"]
    colours = {(p.column, p.row): rgba for p, rgba in zip(
        [p for p in plan.crosspoints if p.tile == 1], cells.to_rgba(cells.get_array()), strict=True)}  # fmt: skip
    assert ax.texts

    def luminance(rgba: Any) -> float:
        rgb = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in rgba[:3]]
        return float(np.dot(rgb, (0.2126, 0.7152, 0.0722)))

    for text in ax.texts:
        pair = sorted([luminance(to_rgba(text.get_color())), luminance(colours[text.get_position()])])
        assert (pair[1] + 0.05) / (pair[0] + 0.05) >= 4.5
