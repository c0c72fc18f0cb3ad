"""`ohmloom paper` on the smallest run that has all its parts, and the statistics that judge it."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from ohmloom.cli import main
from ohmloom.errors import SettingsConflictError
from ohmloom.neurocontroller import Network, Readings, SpikingController
from ohmloom.report.paper_page import save_paper
from ohmloom.sim import Arena, run_trial
from ohmloom.sim.evolution import EvolutionSettings, evolve
from ohmloom.sim.paper import claim_tests
from ohmloom.sim.paper.activity import Activity, record_activity
from ohmloom.sim.paper.claims import CLAIMS, QUESTIONS, examine, examine_at_best
from ohmloom.sim.paper.compare import Difference, holm, rank_test, resampled_p, welch
from ohmloom.sim.paper.experiment import Count, PaperSettings, run_paper, stages
from ohmloom.sim.paper.published import published
from ohmloom.sim.paper.readings import ALTERNATIVES, candidates, deviance
from ohmloom.sim.paper.results import MEASURES, Results
from ohmloom.sim.paper.tables import claims_table, tables
from ohmloom.sim.work import open_work

TINY = PaperSettings(repeats=2, generations=1, population=3, random_networks=4, fresh_starts=2, candidates=2, seed=4)

TABLES = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII")


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    seen = []
    folder = tmp_path_factory.mktemp("paper") / "run"
    experiment = run_paper(TINY, out=folder, stage=lambda name, done, whole: seen.append((name, done, whole)))
    return experiment, seen


@pytest.fixture(scope="module")
def results(finished):
    return Results(finished[0])


def test_every_stage_is_announced_and_ends_whole(finished):
    _, seen = finished
    assert [*dict.fromkeys(name for name, _, _ in seen)] == stages(TINY)
    last = {name: (done, whole) for name, done, whole in seen}
    assert all(done == whole for done, whole in last.values())


def test_a_run_resumes_to_the_same_bytes_with_two_workers(finished, tmp_path):
    experiment, _ = finished
    part = tmp_path / "run"
    shutil.copytree(experiment.out, part)
    for unit in sorted((part / "units").glob("*/0*.json"))[::3]:
        unit.unlink()
    (part / "runs" / "static_HP" / "networks" / "HP_1.net.json").unlink()
    with open_work(workers=2) as work:
        again = run_paper(TINY, out=part, work=work)
    assert contents(part) == contents(experiment.out)
    assert (again.solve, again.fresh, again.search) == (experiment.solve, experiment.fresh, experiment.search)


def test_another_size_in_the_same_folder_is_refused(finished):
    with pytest.raises(SettingsConflictError, match=r"settings\.fresh_starts: expected 3, got 2"):
        run_paper(TINY.model_copy(update={"fresh_starts": 3}), out=finished[0].out)


def test_the_default_reading_is_counted_as_the_plain_loop_counts(finished):
    """The first chunk of one system, network by network, against a loop of `run_trial`."""
    rng = np.random.default_rng(np.random.SeedSequence(TINY.seed, spawn_key=(8001, 1, 0)))
    solved = 0
    for _ in range(TINY.random_networks):
        network = Network.random(system="PEO", rng=rng)
        key = int(rng.integers(0, 2**64, dtype=np.uint64))
        solved += run_trial(SpikingController(network), Arena.paper(), trial_key=key).solved
    assert finished[0].solve["default"]["PEO"] == Count(solved=solved, tried=TINY.random_networks)


def test_pages_hold_every_table_of_the_paper_and_a_line_per_claim(results, tmp_path):
    paths = save_paper(results, examine(results), tmp_path, command="ohmloom paper --out <b>x</b>")
    names = {os.path.relpath(path, tmp_path) for path in paths}
    assert {
        f"tables/table_{n}.csv" for n in ["I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII"]
    } <= names
    assert {f"figures/figure_{n}.svg" for n in (1, 4, 5, 6, 7, 8, 9, 10, "10d", "12_activity", "12d")} <= names
    assert "figures/best_course.svg" in names
    page = (tmp_path / "paper.html").read_text()
    assert "&lt;b&gt;x&lt;/b&gt;" in page
    assert "<b>x</b>" not in page
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.S)
    assert all(
        f'id="table_{n}"' in page for n in ["I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI", "XII"]
    )
    lines = (tmp_path / "index.md").read_text().splitlines()
    assert sum(line.startswith("| IX-A |") for line in lines) == 12
    # Each table has its link, in the form that repositories make of headings.
    headings = [line[3:] for line in (tmp_path / "tables.md").read_text().splitlines() if line.startswith("## ")]
    links = [f"[{title}](tables.md#{re.sub('[^a-z0-9 -]', '', title.lower()).replace(' ', '-')})" for title in headings]
    assert links == [line[2:] for line in lines if line.startswith("- [")]
    assert len(set(links)) == len(links)
    assert len(links) >= 12
    numbers = [int(n) for n in re.findall(r"^## Figure (\d+)", (tmp_path / "figures.md").read_text(), flags=re.M)]
    assert numbers == sorted(numbers)


def test_no_claim_is_judged_from_two_runs(results):
    assert {finding.verdict for finding in examine(results)} == {"cannot be tested here"}
    assert len(claims_table(examine(results)).rows) == len(examine(results)) >= len(CLAIMS)


def test_claims_about_the_static_task_are_examined_at_the_best_combination_too(finished, tmp_path):
    # The search of so small a run ends at the default; other evolutions stand in for those at its best.
    experiment, others = finished[0], {}
    for system in ("HP", "PEO", "LIN", "GA", "HET"):
        settings = EvolutionSettings(system=system, repeats=2, generations=1, population=3, axle=0.1, seed=9)
        others["best", system] = evolve(settings, out=tmp_path / system)
    networks = [Network.load(repeat.network) for repeat in others["best", "HET"].repeats]
    arena = others["best", "HET"].settings.arena()
    recorded = tuple(record_activity(one, arena, int(one.provenance["trial_key"])) for one in networks)
    results = Results(replace(experiment, evolutions=experiment.evolutions | others,
                              activity=experiment.activity | {"best": recorded}))  # fmt: skip
    table = next(table for table in tables(results) if table.name == "best_claims")
    found = {row[1]: row[4] for row in table.rows}
    assert set(found) == {f.claim for claim in CLAIMS if claim.task == "static" for f in claim.examine(results)}
    for claim, pair in (("PEO-PANI networks become fitter than linear ones", ("PEO", "LIN")),
                        ("mixed networks become fitter than GA ones", ("HET", "GA"))):  # fmt: skip
        there, here = (results.compare_systems(task, "best_fitness")[pair].value for task in ("best", "static"))
        assert found[claim].startswith(claim_tests.short(there, "+"))
        assert there != here
    assert results.at_best.activities["static"] == recorded


def test_activity_is_recorded_for_mixed_networks_of_every_task(results):
    assert set(results.activities) == set(results.tasks)
    for task in results.tasks:
        evolution = results.experiment.evolutions[task, "HET"]
        network = Network.load(evolution.repeats[1].network)
        recorded = record_activity(network, evolution.settings.arena(), int(network.provenance["trial_key"]))
        assert results.activities[task][1].to_dict() == recorded.to_dict()


def test_without_evolutions_at_the_best_no_claim_is_examined_there(finished):
    experiment = finished[0]
    evolutions = {key: evolution for key, evolution in experiment.evolutions.items() if key[0] != "best"}
    results = Results(replace(experiment, evolutions=evolutions))
    assert results.at_best is None
    assert examine_at_best(results) == []
    assert not any(table.name.startswith(("best", "table_best")) for table in tables(results))


def test_questions_name_claims_that_exist(results):
    known = {finding.claim for finding in examine(results)}
    assert {claim for claims in QUESTIONS.values() for claim in claims} <= known


def test_samples_come_from_the_runs_own_files(results):
    evolution = results.experiment.evolutions["static", "LIN"]
    assert results.sample("static", "LIN", "best_fitness").tolist() == [r.best_fitness for r in evolution.repeats]
    networks = [Network.load(r.network) for r in results.experiment.evolutions["static", "HET"].repeats]
    in_all = [sum(s.kind == "hp" for s in network.synapses) for network in networks]
    assert results.counts("static", "all")["hp"].tolist() == in_all
    by_layer = sum(results.course("static", "HET", f"best_hp_{name}")[-1]
                   for name in ("input_hidden", "hidden_hidden", "hidden_output"))  # fmt: skip
    assert by_layer.tolist() == in_all


def test_tables_show_the_papers_numbers_beside_ours(results):
    by_name = {table.name: table for table in tables(results)}
    means = by_name["table_II"]
    assert means.rows[1] == ("", "paper", "526.1 (992.4)", "17.0 (34.6)", "14.7 (32.5)", "77.6 (130.0)")
    assert len(means.rows) == 2 * len(MEASURES)
    assert by_name["table_I"].rows[4][-1] == "0.027"
    assert by_name["random_networks"].rows[0][1:] == ("0.09%", "1.04%", "1.12%", "0.42%", "2.46%")
    assert len(by_name["random_networks"].rows) == 1 + len(ALTERNATIVES)


def test_the_papers_p_values_follow_from_its_means_as_welch_tests():
    """Its Table I is Welch's test of thirty runs; the tolerance is the rounding of what is printed."""
    means = published().means["static"]["performance"]
    for pair in ("HP-PEO", "HP-LIN", "PEO-GA", "LIN-GA", "HET-GA", "HET-LIN", "HET-PEO"):
        first, second = (means[system] for system in pair.split("-"))
        found = stats.ttest_ind_from_stats(*first, 30, *second, 30, equal_var=False).pvalue
        assert found == pytest.approx(published().tests["static"]["performance"][pair], abs=0.012)


@pytest.mark.parametrize("settings", [{}, {"carry_state": False, "last_spike": 4, "stdp_threshold": 5}])
def test_activity_counts_the_events_of_the_plain_controller(settings):
    network = Network.random(system="HET", rng=np.random.default_rng(3), readings=Readings(**settings))
    arena = Arena.paper().replace(max_timesteps=12)
    found = record_activity(network, arena, 5)
    plain = SpikingController(network, implementation="plain")
    events = []
    run_trial(plain, arena, trial_key=5, on_timestep=lambda _: events.append(plain.events))
    assert found.positive.sum(axis=1).cumsum().tolist() == [positive for positive, _ in events]
    assert found.negative.sum(axis=1).cumsum().tolist() == [negative for _, negative in events]
    kinds = np.array([s.kind for s in network.synapses])
    assert found.weight[-1, 0] == pytest.approx(plain.weights[kinds == "hp"].mean(), rel=1e-14)


def test_the_turn_is_the_longest_stretch_that_is_not_straight():
    actions = np.zeros(400, dtype=np.int64)
    actions[10:15] = 1
    actions[100:180:2] = 2
    empty = np.zeros((400, 3))
    activity = Activity(positive=empty.astype(int), negative=empty.astype(int), weight=empty, actions=actions)
    assert activity.turn() == (100, 178)
    assert Activity.from_dict(json.loads(json.dumps(activity.to_dict()))).turn() == (100, 178)


def test_welch_agrees_with_scipy_and_its_interval_with_p():
    rng = np.random.default_rng(1)
    a, b = rng.normal(0.0, 1.0, 12), rng.normal(1.0, 3.0, 30)
    found = welch(a, b)
    assert found.p == pytest.approx(stats.ttest_ind(a, b, equal_var=False).pvalue, rel=1e-12)
    assert (found.interval[0] < 0.0 < found.interval[1]) == (found.p > 0.05)
    assert welch(np.ones(5), np.ones(5)).p == 1.0
    assert welch(np.ones(5), np.zeros(5)).p == 0.0


def test_holm_is_monotone_and_leaves_nan_alone():
    found = holm([0.04, math.nan, 0.01, 0.02])
    assert found[2:] == pytest.approx([0.03, 0.04])
    assert found[0] == pytest.approx(0.04)
    assert math.isnan(found[1])


def test_censored_runs_count_as_later_and_never_as_a_number():
    late = np.array([40.0, 60.0, np.nan, np.nan, np.nan, np.nan])
    early = np.array([1.0, 2.0, 2.0, 3.0, 5.0, 8.0])
    p, is_later = rank_test(late, early, (100.0, 100.0))
    assert is_later
    assert p < 0.01
    assert not rank_test(early, late, (100.0, 100.0))[1]
    assert math.isnan(rank_test(np.full(3, np.nan), np.full(3, np.nan), (9.0, 9.0))[0])


def test_five_of_thirty_runs_often_miss_what_thirty_show():
    rng = np.random.default_rng(2)
    a, b = rng.normal(0.0, 1.0, 30), rng.normal(0.9, 1.0, 30)
    median, share = resampled_p(a, b, 5, np.random.default_rng(1))
    assert welch(a, b).p < 0.01 < median
    assert 0.05 < share < 0.7


def test_deviance_is_least_at_what_the_paper_implies():
    exact = {"GA": Count(solved=42, tried=10_000), "HP": Count(solved=9, tried=10_345)}
    assert deviance(exact) < 0.01
    assert deviance({"GA": Count(solved=0, tried=10_000), "HP": Count(solved=9, tried=10_345)}) > 50.0


def test_candidates_do_not_repeat_and_the_first_is_the_default():
    drawn = candidates(40, np.random.default_rng(0))
    assert drawn[0] == {}
    assert all(drawn.count(one) == 1 for one in drawn)


@pytest.mark.parametrize(
    ("value", "p", "sign", "verdict"),
    [(1.0, 0.01, 1, "reproduces"), (-1.0, 0.01, 1, "does not reproduce"), (1.0, 0.2, 1, "does not reproduce"),
     (1.0, 0.2, 0, "reproduces"), (1.0, 0.01, 0, "does not reproduce"), (1.0, math.nan, 1, "cannot be tested here")],
)  # fmt: skip
def test_a_claim_needs_the_papers_sign_and_a_small_p(value, p, sign, verdict):
    difference = Difference(n=(30, 30), value=value, interval=(0.0, 2.0), p=p, effect=0.5, p_holm=p)
    assert claim_tests._finding("X", "claim", "test", difference, sign).verdict == verdict
    few = Difference(n=(4, 30), value=value, interval=(0.0, 2.0), p=p, effect=0.5, p_holm=p)
    assert claim_tests._finding("X", "claim", "test", few, sign).verdict == "cannot be tested here"


def test_commands_know_a_papers_folder(finished, tmp_path, capsys):
    folder = tmp_path / "run"
    shutil.copytree(finished[0].out, folder)
    words = ["paper", "--out", str(folder), "--repeats", "2", "--generations", "1", "--random-networks", "4",
             "--candidates", "2", "--fresh-starts", "2", "--seed", "4", "--workers", "1"]  # fmt: skip
    with pytest.raises(SystemExit) as stopped:
        main([*words, "--best"])
    assert stopped.value.code == 2
    assert "settings.population: expected 100, got 3" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stopped:
        main(["work", str(folder), "--shard", "2/2", "--workers", "1"])
    assert stopped.value.code == 0
    with pytest.raises(SystemExit):
        main(["status", str(folder)])
    shown = capsys.readouterr().out
    assert "static_HET: repeats: 2 of 2" in shown
    assert shown.endswith("not finished\n")
