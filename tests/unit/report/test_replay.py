"""Replay: the three files open, show the data, escape what is not ours, and repeat byte for byte."""

from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from PIL import Image

from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.report._replay_data import ACTIONS, BACKED_OFF, goal_regions, sensor_rays
from ohmloom.report._replay_page import replay_page
from ohmloom.report._replay_png import replay_figure
from ohmloom.report.arena_plot import plot_path
from ohmloom.report.replay import Recording, replay, replay_gif, replay_html, replay_png


@dataclass(frozen=True, kw_only=True)
class StandInTrial:
    path: Any
    st: Any
    sensors: Any
    actions: Any
    output_spikes: Any
    solved: bool = True
    fitness: float = 11900.0
    bumps: int = 1
    task: str = "static"


@dataclass(frozen=True, kw_only=True)
class StandInArena:
    half_width: float = 1.0
    box_half_width: float = 0.4
    lamp: tuple[float, float] = (1.0, 1.0)
    robot_radius: float = 0.032
    goal: float = 1.6
    start_line: float = -1.5
    sensor_points: Any = ((0.015, 0.027), (0.029, 0.007), (0.015, -0.027))
    sensor_bearings: Any = (1.103, 0.0, -1.196)
    ir_range: float = 0.05


ARENA = StandInArena()
BUMP_ROW = 40


def drive(timesteps: int, task: str = "static") -> StandInTrial:
    """North along the wall, one bump, right turn, then east to the corner; then round in a circle."""
    path, actions = [(-0.93, -0.75, np.pi / 2)], []
    for t in range(timesteps):
        x, y, heading = path[-1]
        turning = 400 <= t < 430
        actions.append(2 if turning else 1 if t > 850 else 0)
        heading += -np.pi / 60 if turning else 0.06 if t > 850 else 0.0
        move = -0.02 if t == BUMP_ROW else 0.00384
        path.append((x + move * np.cos(heading), y + move * np.sin(heading), heading))
    rows = np.array(path)
    st = np.arange(timesteps + 1) + 10 * (np.arange(timesteps + 1) > BUMP_ROW)
    near, light = (
        np.clip(1 - np.abs(np.abs(rows[:-1, :2]) - 1) / 0.1, 0, 1),
        np.exp(-np.hypot(*(rows[:-1, :2] - 1).T)),
    )
    wave = 0.5 + 0.5 * np.sin(np.arange(timesteps) / 30)
    sensors = np.stack([near[:, 0], near[:, 1], wave * near[:, 1], light * wave, light, light * (1 - wave)], axis=1)
    outputs = np.stack([8 + 4 * wave, 13 - 4 * wave], axis=1).round().astype(np.int64)
    return StandInTrial(path=rows, st=st, sensors=sensors, actions=np.array(actions), output_spikes=outputs, task=task)


def record(timesteps: int = 120, hidden: int = 9, synapses: int = 24, **changes: Any) -> Recording:
    rng = np.random.default_rng(5)
    neurons = 8 + hidden
    trial = drive(timesteps)
    rate = rng.uniform(0, 21, neurons) * (0.5 + 0.5 * np.sin(np.linspace(0, 9, timesteps)))[:, None]
    spikes = rng.binomial(21, rate / 21)
    weights = np.clip(0.5 + 0.01 * rng.standard_normal((timesteps, synapses)).cumsum(axis=0), 0.01, 1.0)
    kinds = tuple(("hp", "peo_pani", "linear", "constant")[i % 4] for i in range(synapses))
    weights[:, np.array(kinds, dtype=str) == "constant"] = 0.7
    values: dict[str, Any] = {
        "trial": trial,
        "weights": weights,
        "spikes": spikes,
        "network_name": "HET_3",
        "neuron_labels": [
            *["ir_0", "ir_2", "ir_5", "light_0", "light_2", "light_5"],
            *(f"h{i}" for i in range(hidden)),
            "o0",
            "o1",
        ],
        "synapse_labels": [f"s{i}" for i in range(synapses)],
        "synapse_kinds": kinds,
    }
    return Recording(**{**values, **changes})


HOSTILE = "</script><script>alert(1)</script> & $\\frac \u2028 \u4e2d"


class Page(HTMLParser):
    """Collects text per element, and refuses tags that do not close in order."""

    VOID = ("meta", "link", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)
            self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts[self.open[-1]][-1] += data


def page_data(text: str) -> Any:
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert block is not None
    return json.loads(block[1])


def unpacked(packed: dict[str, Any]) -> Any:
    codes = np.frombuffer(base64.b64decode(packed["codes"]), dtype=f"<i{packed['size']}")
    return packed["unit"] * codes.reshape(-1, packed["columns"])


def gif_frames(path: Path, **options: Any) -> list[np.ndarray]:
    replay_gif(record(), ARENA, path, **options)
    with Image.open(path) as image:
        frames = []
        for index in range(image.n_frames):
            image.seek(index)
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    return frames


def test_plotted_path_is_the_data_coloured_by_action() -> None:
    trial = drive(450)
    ax = plot_path(trial, ARENA)
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection) and c.get_gid() == "path")
    runs = lines.get_segments()
    np.testing.assert_array_equal(np.concatenate([run[:-1] for run in runs]), trial.path[:-1, :2])
    np.testing.assert_array_equal(np.concatenate([run[1:] for run in runs]), trial.path[1:, :2])
    colours = [
        tuple(round(255 * c) for c in rgba[:3])
        for run, rgba in zip(runs, np.asarray(lines.get_colors()), strict=True)
        for _ in run[1:]
    ]
    expected = [list(ACTIONS.values())[a] for a in trial.actions]
    expected[BUMP_ROW] = BACKED_OFF
    assert ["#{:02x}{:02x}{:02x}".format(*colour) for colour in colours] == expected


def test_bump_is_marked_where_the_robot_stood_before_it() -> None:
    trial = drive(60)
    (mark,) = (line for line in plot_path(trial, ARENA).lines if line.get_gid() == "bumps")
    np.testing.assert_array_equal(np.array(mark.get_data()).T, trial.path[[BUMP_ROW], :2])
    calm = replace(trial, st=np.arange(61), bumps=0)
    assert [line for line in plot_path(calm, ARENA).lines if line.get_gid() == "bumps"] == []


def test_start_and_end_robot_stand_on_the_ends_of_the_path_with_their_heading() -> None:
    trial = drive(450)
    ax = plot_path(trial, ARENA)
    for name, pose in (("start", trial.path[0]), ("end", trial.path[-1])):
        (body,) = (patch for patch in ax.patches if patch.get_gid() == name)
        np.testing.assert_array_equal(body.get_center(), pose[:2])
        (ahead,) = (line for line in ax.lines if line.get_gid() == f"{name} heading")
        x, y = np.array(ahead.get_data())
        assert np.arctan2(y[1] - y[0], x[1] - x[0]) == pytest.approx(pose[2], rel=1e-9)


def test_plot_path_draws_into_the_given_axes_in_equal_metres() -> None:
    ax = plot_path(drive(10), ARENA)
    assert plot_path(drive(10), ARENA, ax) is ax
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x [m]", "y [m]", 1.0)


def test_goal_regions_follow_the_task() -> None:
    first, second = goal_regions(drive(10, "dynamic"), ARENA)
    assert (first.sum(axis=1) >= 1.6 - 1e-12).all()
    assert (second @ (-1, 1) >= 1.6 - 1e-12).all()
    assert len(goal_regions(drive(10), ARENA)) == 1


def test_rays_turn_with_the_robot() -> None:
    near, far = sensor_rays(np.array([0.5, -0.5, np.pi / 2]), ARENA)
    np.testing.assert_allclose(near[1], [0.5 - 0.007, -0.5 + 0.029], rtol=1e-12)
    np.testing.assert_allclose(far[1] - near[1], [0.0, 0.05], atol=1e-12)
    assert far[0, 0] < near[0, 0]
    assert far[2, 0] > near[2, 0]


def test_figure_shows_median_weight_of_each_kind() -> None:
    recording = record()
    weights = replay_figure(recording, ARENA).subfigs[1].axes[-1]
    lines = {line.get_label(): line.get_ydata() for line in weights.lines}
    for kind, index in recording.kinds.items():
        np.testing.assert_array_equal(lines[f"{kind} ({index.size})"], np.median(recording.weights[:, index], axis=1))


@pytest.mark.parametrize("suffix", [".png", ".gif", ".html"])
def test_same_recording_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    replay(record(30), ARENA, tmp_path / f"a{suffix}")
    replay(record(30), ARENA, tmp_path / f"b{suffix}")
    replay(record(31), ARENA, tmp_path / f"c{suffix}")
    first, again, other = ((tmp_path / f"{name}{suffix}").read_bytes() for name in "abc")
    assert first == again
    assert first != other


def test_png_opens_holds_every_kind_and_carries_no_metadata(tmp_path: Path) -> None:
    replay_png(record(), ARENA, tmp_path / "trial.png")
    with Image.open(tmp_path / "trial.png") as image:
        assert image.width > 1500
        # Only PNG images have a text, and Pillow types what it opens as any image.
        assert not image.text  # type: ignore[attr-defined]
        colours = {"#{:02x}{:02x}{:02x}".format(*c[:3]) for _, c in image.convert("RGB").getcolors(1 << 24) or []}
    assert {"#d55e00", "#b5548f", "#56b4e9", "#0072b2", "#d99a00"} <= colours


@pytest.mark.parametrize(("every", "frames"), [(None, 121), (1, 121), (7, 19), (500, 2)])
def test_gif_has_a_frame_per_interval_and_the_end(tmp_path: Path, every: int | None, frames: int) -> None:
    assert len(gif_frames(tmp_path / "a.gif", every=every)) == frames


def test_gif_of_a_long_trial_stays_within_200_frames(tmp_path: Path) -> None:
    replay(record(1000, synapses=80), ARENA, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        assert 150 < image.n_frames <= 200
        assert image.info["loop"] == 0


def test_gif_trail_grows_and_the_robot_leaves_its_start(tmp_path: Path) -> None:
    frames = gif_frames(tmp_path / "a.gif", every=40)
    blue = [int((np.abs(f[46:486, 12:452] - (0, 114, 178)).sum(axis=2) < 60).sum()) for f in frames]
    assert blue[0] == 0
    assert 0 < blue[1] < blue[2] < blue[3]
    assert (frames[0][300:302] == 255).any()  # paper stays white


def test_gif_refuses_an_interval_below_one(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"^replay_gif\.every: expected at least 1 timestep, got 0\. Use 1 "):
        replay_gif(record(5), ARENA, tmp_path / "a.gif", every=0)
    assert list(tmp_path.iterdir()) == []


def test_page_holds_the_recording() -> None:
    recording = record()
    data = page_data(replay_page(recording, ARENA))
    trial = recording.trial
    np.testing.assert_allclose(unpacked(data["path"]), trial.path, rtol=0, atol=1e-4)
    np.testing.assert_allclose(unpacked(data["sensors"]), trial.sensors, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(unpacked(data["spikes"]), recording.spikes)
    np.testing.assert_array_equal(unpacked(data["outputs"]), trial.output_spikes)
    assert data["actions"] == "".join(map(str, trial.actions))
    assert (data["bumps"], data["extra"]) == ([BUMP_ROW], [[BUMP_ROW, 10]])
    order = [recording.synapse_labels.index(label) for label in data["names"]["synapses"]]
    assert [recording.synapse_kinds[i] for i in order] == data["names"]["kinds"]
    np.testing.assert_allclose(unpacked(data["weights"]), recording.weights[:, order], rtol=0, atol=1e-4)


def test_page_widens_its_unit_rather_than_overflow() -> None:
    weights = np.full((20, 1), 40.0)
    weights[3] = -20.0
    page = replay_page(record(20, weights=weights, synapse_labels=["s"], synapse_kinds=["hp"]), ARENA)
    np.testing.assert_allclose(unpacked(page_data(page)["weights"]), weights, rtol=0, atol=2e-3)


def test_page_shows_hostile_names_as_text() -> None:
    labels = [HOSTILE] * 17
    recording = record(20, network_name=HOSTILE, neuron_labels=labels, synapse_labels=[HOSTILE] * 24)
    text = replay_page(recording, ARENA)
    page = Page(text)
    assert page.open == []
    assert page.texts["h1"] == [HOSTILE]
    assert page.texts["title"][0].startswith(HOSTILE)
    assert len(page.texts["script"]) == 3
    assert page_data(text)["names"]["neurons"] == labels
    block = page.texts["script"][0]
    assert not set("<>&\u2028") & set(block)


def test_page_asks_nothing_of_the_network() -> None:
    text = replay_page(record(20), ARENA)
    assert "default-src 'none'" in text
    links = [value for _, attrs in Page(text).tags for key, value in attrs.items() if key in ("src", "href")]
    assert links == ["data:,"]
    assert "http:" not in text
    assert "https:" not in text


def test_page_of_a_long_trial_is_small(tmp_path: Path) -> None:
    replay_html(record(1000, synapses=80), ARENA, tmp_path / "a.html")
    assert (tmp_path / "a.html").stat().st_size < 500_000


@pytest.mark.parametrize("suffix", [".png", ".gif", ".html"])
def test_odd_names_and_nets_without_synapses_are_drawn(tmp_path: Path, suffix: str) -> None:
    bare = {"weights": np.zeros((12, 0)), "synapse_labels": (), "synapse_kinds": ()}
    for name in (HOSTILE, "", "x" * 4000, "a\nb\x00", "caf\udce9"):
        path = tmp_path / f"a{suffix}"
        replay(record(12, network_name=name, **bare), ARENA, path)
        assert path.stat().st_size > 5000


@pytest.mark.parametrize(("name", "got"), [("a.mp4", "'.mp4'"), ("a", "none")])
def test_replay_refuses_other_suffixes(tmp_path: Path, name: str, got: str) -> None:
    with pytest.raises(ParameterError) as error:
        replay(record(5), ARENA, tmp_path / name)
    expected = f"replay.path: expected a suffix among .gif, .html, .png, got {got}. Name the file like a.html."
    assert str(error.value) == expected
    assert list(tmp_path.iterdir()) == []


def test_replay_takes_the_suffix_in_any_case(tmp_path: Path) -> None:
    replay(record(5), ARENA, str(tmp_path / "a.PNG"))
    with Image.open(io.BytesIO((tmp_path / "a.PNG").read_bytes())) as image:
        assert image.format == "PNG"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"weights": np.zeros((9, 24))},
            r"^Recording\.weights: expected axes \(timestep=10, synapse=24\), got shape",
        ),
        (
            {"spikes": np.zeros((10, 3))},
            r"^Recording\.spikes: expected axes \(timestep=10, neuron=17\), got shape",
        ),
        (
            {"spikes": np.full((10, 17), 22)},
            r"^Recording\.spikes: expected counts from 0 to 21 per timestep, got 22",
        ),
        (
            {"synapse_kinds": ["hp"]},
            r"^Recording\.synapse_kinds: expected 24 kinds, one per synapse label, got 1\.",
        ),
        ({"weights": np.full((10, 24), np.nan)}, r"^Recording\.weights: expected finite numbers"),
    ],
)
def test_recording_refuses_arrays_that_do_not_fit_the_trial(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        record(10, **changes)


def test_recording_offers_the_nearest_kind_and_locks_its_arrays() -> None:
    with pytest.raises(UnknownNameError, match=r"got 'peopani'\. Did you mean 'peo_pani'\?"):
        record(10, synapse_kinds=["peopani"] * 24)
    with pytest.raises(ValueError, match="read-only"):
        record(10).weights[0, 0] = 1.0
