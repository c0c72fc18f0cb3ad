"""The report: everything is in it, nothing hostile gets out of it, and it repeats byte for byte."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from ohmloom.errors import OperationError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network
from ohmloom.report import report_page, write_report
from ohmloom.report._page_maps import device_errors, device_rows, device_values, end_conductances, hover
from ohmloom.report._page_run import die_run, ideal_run
from ohmloom.report._page_words import percent, success_line, verdict_line
from ohmloom.sim import Arena, Feasibility, feasibility
from ohmloom.sim.statistics import paired_success
from ohmloom.units import format_quantity

COMMAND = "ohmloom evaluate net.json --hardware het_mixed --dies 3 --seed 1"
SECTIONS = ("verdict", "figures", "replay", "success", "yield", "crossbars", "weights", "exactness", "assumed", "spec",
            "cards", "not-modelled", "reproduce")  # fmt: skip
HOSTILE = "<script>alert(1)</script>&\"' $x$"


class Page(HTMLParser):
    """Text by section, ids, tags, and references to ids."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.images: list[str] = []
        self._open = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        if "id" in given:
            self.ids.append(given["id"] or "")
        if tag == "image":
            self.images.append(given["xlink:href"] or "")
        if tag == "section":
            self._open = given.get("id") or ""

    def handle_data(self, data: str) -> None:
        joined = f"{self.sections.get(self._open, '')} {data}"
        self.sections[self._open] = " ".join(joined.split())


@pytest.fixture(scope="module")
def het_page(het_study: Feasibility) -> str:
    return report_page(het_study, command=COMMAND)


@pytest.fixture(scope="module")
def ga_page(ga_study: Feasibility) -> str:
    return report_page(ga_study, command=COMMAND)


def test_every_section_is_there_with_something_in_it(het_page: str, ga_page: str) -> None:
    for text, wanted in ((het_page, SECTIONS), (ga_page, tuple(name for name in SECTIONS if name != "yield"))):
        sections = Page(text).sections
        assert tuple(name for name in sections if name) == wanted
        assert all(len(sections[name]) > 40 for name in wanted)


def test_verdict_comes_first_with_every_reason(het_study: Feasibility, het_page: str) -> None:
    verdict = Page(het_page).sections["verdict"]
    assert verdict.startswith(f"Verdict: {het_study.verdict}")
    assert het_study.reasons
    for reason in het_study.reasons:
        assert reason.replace(" ", "") in verdict.replace(" ", "")


@pytest.mark.parametrize("which", ["het", "ga"])
def test_every_figure_has_name_value_limit_status_source_and_detail(which: str, request: pytest.FixtureRequest) -> None:
    study: Feasibility = request.getfixturevalue(f"{which}_study")
    shown = Page(request.getfixturevalue(f"{which}_page")).sections["figures"]
    ends = [shown.index(f" {figure.name} ") for figure in study.figures] + [len(shown)]
    for k, figure in enumerate(study.figures):
        row = shown[ends[k] : ends[k + 1]]
        value = "–" if figure.value is None else format_quantity(figure.value, figure.unit)
        limit = "–" if figure.limit is None else format_quantity(figure.limit, figure.unit)
        assert row.startswith(f" {figure.name} {value} {limit} ")
        assert figure.status.replace("_", " ") in row
        assert figure.source in row
        assert " ".join(figure.detail.split()) in row


def test_margins_stand_in_percent(het_study: Feasibility, het_page: str) -> None:
    power = next(figure for figure in het_study.figures if figure.name == "programming_power")
    assert power.margin is not None
    assert percent(power.margin, sign=True) in Page(het_page).sections["figures"]


def test_success_box_has_counts_intervals_and_p(het_study: Feasibility, het_page: str) -> None:
    success, shown = het_study.success, Page(het_page).sections["success"]
    assert success is not None
    assert success_line(success) in shown
    assert f"n = {success.n}" in shown
    assert f"p = {success.p:.3g}" in shown
    for low, high in (success.ideal_interval, success.hardware_interval):
        assert f"{percent(low)} to {percent(high)}" in shown


def test_study_without_dies_says_so_instead_of_a_success_box(ga_page: str) -> None:
    page = Page(ga_page)
    assert page.sections["success"].count("No die was sampled") == 1
    assert "McNemar" not in page.sections["success"]
    assert "no die was sampled" in page.sections["replay"]


def test_success_is_put_into_plain_words() -> None:
    assert "Neither" in success_line(paired_success([False] * 90, [False] * 90))
    assert "not worse than the ideal network by more than 5 points" in success_line(
        paired_success([True] * 90, [True] * 90)
    )
    assert "less often than the ideal network" in success_line(paired_success([True] * 90, [False] * 90))
    undecided = success_line(paired_success([True] * 5, [True] * 5))
    assert "not shown that the hardware is good enough: from 5 starts" in undecided
    assert "73 starts would show it" in undecided


def test_exactness_shows_what_holds_and_what_does_not_apply(ga_study: Feasibility, ga_page: str) -> None:
    shown = Page(ga_page).sections["exactness"]
    for name in ga_study.exactness:
        assert f"holds {name}" in shown
    assert "not applicable rule_table no plastic synapse" in shown


def test_broken_exactness_voids_the_study_in_words(ga_study: Feasibility) -> None:
    broken = replace(ga_study, exactness={**ga_study.exactness, "lattice": False}, verdict="FAIL")
    sections = Page(report_page(broken, command=COMMAND)).sections
    assert "does not hold lattice" in sections["exactness"]
    assert "The study is void" in sections["verdict"]
    assert "void" not in verdict_line(ga_study)


def test_each_assumed_value_stands_with_its_range_and_nothing_else_does(het_study: Feasibility, het_page: str) -> None:
    assert het_study.plan is not None
    shown = Page(het_page).sections["assumed"]
    quantities = het_study.plan.hardware.quantities()
    assert any(q.is_assumed for q in quantities.values())
    for name, quantity in quantities.items():
        assert (name in shown) == quantity.is_assumed
    assert "drive.pulse_voltage 1 V 800 mV to 1.4 V assumed: 1 V as in Strukov" in shown
    assert "hp_tio2_10k: r_on 10 kOhm" in shown


def test_spec_and_cards_stand_with_every_source(het_study: Feasibility, het_page: str) -> None:
    assert het_study.plan is not None
    sections = Page(het_page).sections
    for name, quantity in het_study.plan.hardware.quantities().items():
        assert name in sections["spec"]
        assert quantity.source in sections["spec"]
    assert "drive.parallelism column definition: one charge meter a column" in sections["spec"]
    for tile in het_study.plan.tiles:
        device = het_study.plan.hardware.devices[tile.kind]
        assert device.sha256 in sections["cards"]
        for source in (device.source, *device.sources.values()):
            assert source in sections["cards"]
    assert "Not used by this network: constant." in sections["cards"]


def test_reproduction_has_command_seed_digests_and_version(het_study: Feasibility, het_page: str) -> None:
    shown = Page(het_page).sections["reproduce"]
    assert COMMAND in shown
    for value in het_study.provenance.values():
        assert str(value) in shown
    assert all(item in Page(het_page).sections["not-modelled"] for item in het_study.not_modelled)


def test_pictures_show_both_paths_and_four_maps_of_each_tile(het_study: Feasibility, het_page: str) -> None:
    assert het_study.plan is not None
    # Margins, two paths, two curves of success, yield, four maps a tile, weights, events.
    assert het_page.count("<svg ") == 1 + 2 + 2 + 1 + 4 * len(het_study.plan.tiles) + 2
    crossbars = Page(het_page).sections["crossbars"]
    for neuron in het_study.plan.tiles[0].columns:
        assert het_study.plan.network.labels()[neuron] in crossbars


def test_conductances_after_the_trial_are_read_as_the_weights_at_its_end(het_study: Feasibility) -> None:
    plan, check = het_study.plan, het_study.agreement
    assert plan is not None
    assert check is not None
    g = end_conductances(plan, check)
    for point in plan.crosspoints:
        device, tile = plan.hardware.devices[plan.tiles[point.tile].kind], plan.tiles[point.tile]
        g_off, g_on = float(device.conductance(0.0)), float(device.conductance(1.0))
        reference = g_off if tile.has_reference else 0.0
        weight = (g[point.synapse] - reference) / (g_on - reference)
        assert weight == pytest.approx(check.emulated_weights[-1, point.synapse], rel=1e-12, abs=1e-12)
        # The walls of the device, with rounding.
        assert g_off * (1 - 1e-9) <= g[point.synapse] <= g_on * (1 + 1e-9)


def test_map_of_read_errors_has_the_figure_as_its_worst(het_study: Feasibility) -> None:
    assert het_study.plan is not None
    figure = next(figure for figure in het_study.figures if figure.name == "read_error")
    assert figure.value is not None
    assert figure.value > 0.0
    # The plan keeps six digits of its errors.
    assert device_errors(het_study.plan).max() == pytest.approx(figure.value, rel=1e-5)


def test_trials_that_are_run_again_are_those_of_the_study(het_study: Feasibility) -> None:
    ideal, die, check = ideal_run(het_study), die_run(het_study), het_study.agreement
    assert ideal is not None
    assert die is not None
    assert check is not None
    np.testing.assert_array_equal(ideal.recording.weights, check.weights)
    np.testing.assert_array_equal(ideal.recording.spikes, check.spikes)
    outcome = het_study.dies[0]
    assert die.pulses.max() == outcome.most_pulses
    asked, written, lost, spurious = (int(count) for count in die.events[-1])
    assert (lost, spurious) == (outcome.lost, outcome.spurious)
    assert written == asked - lost + spurious
    assert (np.diff(die.events, axis=0) >= 0).all()


def test_a_die_that_is_not_the_studys_is_noticed(het_study: Feasibility) -> None:
    trial = het_study.hardware_trial
    assert trial is not None
    other = replace(het_study, hardware_trial=replace(trial, path=trial.path + 0.01))
    with pytest.raises(AssertionError, match="another path"):
        die_run(other)


def test_every_crossing_tells_what_it_is(het_study: Feasibility) -> None:
    plan = het_study.plan
    assert plan is not None
    known = device_values(het_study, None)
    assert known is not None
    rows, maps = device_rows(plan, known), hover(het_study, known)
    assert [row["synapse"] for row in rows] == [
        f"{plan.network.labels()[s.pre]} → {plan.network.labels()[s.post]}" for s in plan.network.synapses
    ]
    for index, tile in enumerate(plan.tiles):
        cells = maps[index]["cells"]
        assert len(cells) == (len(tile.rows) + tile.spare_rows) * len(maps[index]["x"])
        assert sum(bool(values) for _, _, _, values in cells) == sum(p.tile == index for p in plan.crosspoints)


def test_page_asks_nothing_of_the_network_and_runs_its_own_scripts_only(het_page: str) -> None:
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', het_page)
    assert policy is not None
    assert re.fullmatch(
        r"default-src 'none'; script-src( 'sha256-[A-Za-z0-9+/=]+'){3}; style-src 'unsafe-inline'; img-src data:",
        policy[1],
    )
    page = Page(het_page)
    assert not {"iframe", "object", "embed", "form", "img"} & set(page.tags)
    assert all(source.startswith("data:image/png;base64,") for source in page.images)
    addresses = set(re.findall(r"https?:[^\"\s)]+", het_page))
    assert addresses == {"http://www.w3.org/2000/svg"}  # a name, never fetched
    assert "@import" not in het_page


def test_ids_of_the_pictures_do_not_collide(het_page: str) -> None:
    ids = Page(het_page).ids
    assert len(ids) == len(set(ids))
    wanted = re.findall(r'(?:url\(#|href="#)([^)"]+)', het_page)
    assert wanted
    assert set(wanted) <= set(ids)


def test_hostile_names_are_shown_as_text(tmp_path: Path) -> None:
    shipped = Hardware.load("hp_1t1r")
    quoted = "'''" + HOSTILE.replace("'", "") + "'''"
    card = shipped.devices["hp"]
    card.save(tmp_path / "card.toml")
    text = (tmp_path / "card.toml").read_text().replace(f'"{card.name}"', quoted).replace(f'"{card.source}"', quoted)
    (tmp_path / "card.toml").write_text(text)
    spec = (Path(__file__).parents[3] / "ohmloom/mapping/specs/hp_1t1r.toml").read_text()
    spec = spec.replace('"hp_tio2_10k"', '"card.toml"').replace('"hp_1t1r"', quoted)
    spec = re.sub(r'source = "assumed: well below the threshold"', f"source = {quoted}", spec)
    (tmp_path / "hw.toml").write_text(spec)
    hardware = Hardware.load(tmp_path / "hw.toml")
    assert hardware.devices["hp"].name == HOSTILE.replace("'", "")
    network = Network.random(system="HP", rng=np.random.default_rng(1)).replace(name=HOSTILE)
    arena = Arena.paper().replace(max_timesteps=60)
    study = feasibility(network, hardware, dies=1, arena=arena)
    text = report_page(study, command=HOSTILE)
    page = Page(text)
    assert page.tags.count("script") == Page(report_page(study, command="")).tags.count("script") == 6
    assert HOSTILE in page.sections["reproduce"]
    for section in ("spec", "cards", "crossbars"):
        assert HOSTILE.replace("'", "") in page.sections[section]


def test_name_with_bytes_that_no_text_file_can_hold_is_written(ga_study: Feasibility, tmp_path: Path) -> None:
    odd = replace(ga_study, provenance={**ga_study.provenance, "network": "net\udcff \u4e2d"})
    write_report(odd, tmp_path / "report.html", command=COMMAND)
    assert "net? \u4e2d" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_same_study_gives_the_same_bytes_whatever_the_callers_style(
    het_study: Feasibility, het_page: str, tmp_path: Path
) -> None:
    import matplotlib

    with matplotlib.rc_context({"font.size": 20.0, "svg.fonttype": "path", "axes.facecolor": "red"}):
        write_report(het_study, tmp_path / "report.html", command=COMMAND)
        assert matplotlib.rcParams["font.size"] == 20.0
    assert (tmp_path / "report.html").read_bytes() == het_page.encode()


def test_report_of_full_trials_stays_under_three_megabytes(
    make_study: Callable[..., Feasibility], tmp_path: Path
) -> None:
    study = make_study("HET", "het_mixed", 1, timesteps=4000)
    write_report(study, tmp_path / "report.html", command=COMMAND)
    assert study.agreement is not None
    assert len(study.agreement.trial.actions) > 2000
    assert (tmp_path / "report.html").stat().st_size < 3_000_000


def test_loaded_study_is_reported_without_paths_maps_and_weights(het_study: Feasibility, tmp_path: Path) -> None:
    het_study.save(tmp_path / "report.json")
    text = report_page(Feasibility.load(tmp_path / "report.json"), command=COMMAND)
    sections = Page(text).sections
    # What follows from the numbers in the file is drawn: margins, success, difference, yield.
    assert text.count("<svg ") == 4
    for name in ("replay", "crossbars", "weights", "assumed", "spec", "cards"):
        assert "loaded from a file" in sections[name]
    assert het_study.reasons[0].replace(" ", "") in sections["verdict"].replace(" ", "")


def test_net_without_synapses_gets_a_report() -> None:
    network = Network.random(system="HP", rng=np.random.default_rng(0)).replace(synapses=())
    hardware = Hardware.load("hp_1t1r")
    assert not place(network, hardware).tiles
    study = feasibility(network, hardware, dies=1, arena=Arena.paper().replace(max_timesteps=60))
    assert "there is no tile" in Page(report_page(study, command=COMMAND)).sections["crossbars"]


def test_report_that_cannot_be_written_is_an_operation_error(ga_study: Feasibility, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OperationError, match=r"expected a file that can be written"):
        write_report(ga_study, tmp_path / "file" / "report.html", command=COMMAND)
