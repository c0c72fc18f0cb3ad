"""Parts of a study beside its figures: writing, yield curves, lifetime, requirements, comparison, workers."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network
from ohmloom.sim import Arena, agreement, feasibility
from ohmloom.sim import figures_array as array
from ohmloom.sim.comparison import not_built, rank_studies, why_not_built
from ohmloom.sim.inversion import Lever, Needs, least_change, requirements
from ohmloom.sim.lifetime import lifetime, weight_errors
from ohmloom.sim.sampling import sample_dies, start_key
from ohmloom.sim.sensitivity import Stream, action_agreement, declared_spreads, screen
from ohmloom.sim.verdict import all_ledgers, of_whole_trial
from ohmloom.sim.writing import writing_divergence
from ohmloom.sim.yield_study import yield_curves

SHORT = Arena(max_timesteps=30)
NETWORK = Network.random(system="HP", rng=np.random.default_rng(3), hidden=4)
IDEAL = Hardware.load("ideal")
SPREAD = IDEAL.with_values({"nonidealities.event_charge": 0.1, "nonidealities.write_verify": 0.02})


@pytest.fixture(scope="module")
def plan():
    return place(NETWORK, SPREAD)


@pytest.fixture(scope="module")
def check():
    return agreement(NETWORK, IDEAL, arena=SHORT, trial_key=start_key(0, 0))


def test_what_writes_exactly_does_not_diverge_from_the_rule_on_its_spikes(check):
    die = place(NETWORK, IDEAL).nominal()
    assert writing_divergence(die, check.trial.sensors).worst < 1e-9
    # Every event 5 % too large: it shows although both sides have the same spikes.
    wrong = replace(die, event_charge=np.full(len(die.event_charge), 1.05))
    assert writing_divergence(wrong, check.trial.sensors).worst > 1e-3


def test_yield_falls_with_the_rate_and_rises_with_repair(plan):
    points = yield_curves(plan, dies=20, seed=1, rates=(0.0, 0.02, 0.3), spares=((0, 0), (2, 2)))
    of = {(p.fault_rate, p.repair, p.spare_rows): p.value for p in points}
    assert of[0.0, "none", 0] == of[0.0, "permuted", 0] == 1.0
    assert of[0.02, "none", 0] <= of[0.02, "permuted", 0] <= of[0.02, "permuted", 2]
    assert of[0.02, "none", 0] < of[0.02, "permuted", 2]
    assert of[0.3, "permuted", 0] < of[0.02, "permuted", 0]
    assert all(p.interval[0] <= p.value <= p.interval[1] and p.n == 20 for p in points)


def test_yield_without_repair_is_the_formula(plan):
    # One tile: no synapse on a fault, no other crosspoint stuck on; 400 dies leave 0.025.
    point = yield_curves(plan, dies=400, seed=2, rates=(0.01,), spares=())[0]
    (tile,) = plan.tiles
    enabled, cells = len(plan.crosspoints), len(tile.rows) * len(tile.columns)
    assert point.value == pytest.approx(0.99**enabled * 0.999 ** (cells - enabled), abs=0.1)


def test_lifetime_is_wear_and_decay_by_hand(plan, check):
    hardware = SPREAD.with_values({"nonidealities.retention": 1e4, "endurance.pulses": 1e6})
    aged = replace(plan, hardware=hardware)
    rows = lifetime(aged, check.ledger)
    row = next(row for row in rows if row["trial"] == 1000)
    seconds = 1000 * check.ledger.steps / 21 * 0.032
    assert row["wear"] == pytest.approx(1000 * check.ledger.most_pulses / 1e6)
    assert row["hours"] == pytest.approx(seconds / 3600)
    # W = 0.01 / (1 - q), q = 0.98 at W = 0.5, for every HP device of the paper's card.
    expected = 0.5 - 0.01 / (1 - 0.98 * np.exp(-seconds / 1e4))
    assert row["mean_weight_error"] == pytest.approx(expected, rel=1e-6)
    assert weight_errors(aged, 0.0).max() == 0.0
    assert lifetime(plan, check.ledger)[0]["mean_weight_error"] is None


def test_beginning_of_a_trial_is_scaled_to_the_whole(check):
    seen, ledger = len(check.trial.actions), check.ledger
    whole = of_whole_trial(check, 3 * seen)
    assert (whole.most_pulses, whole.ideal_events, whole.steps) == (
        3 * ledger.most_pulses, 3 * ledger.ideal_events, 3 * ledger.steps,
    )  # fmt: skip
    assert whole.programming_energy == pytest.approx(3 * ledger.programming_energy)
    assert whole.worst_programming_time == ledger.worst_programming_time
    assert of_whole_trial(check, seen) == ledger
    names = list(all_ledgers(check, sample_dies(place(NETWORK, IDEAL), SHORT, dies=0, seed=0), 3 * seen))
    assert names == [f"the nominal die (scaled from {seen} timesteps)"]


def test_least_change_is_where_the_margin_reaches_twenty_percent():
    rising = Lever(parameter="x", unit="s", now=1.0, end=1e4, margin=lambda x: x / 10.0 - 0.8)
    assert least_change(rising) == pytest.approx(10.0, rel=0.006)
    falling = Lever(parameter="x", unit="s", now=1.0, end=0.0, margin=lambda x: 0.3 - x)
    assert least_change(falling) == pytest.approx(0.1, rel=0.006)
    assert least_change(replace(rising, end=5.0)) is None


def needs(network, hardware, check):
    plan = place(network, hardware)
    return Needs(plan=plan, arena=SHORT, seed=0, check=check, sampled=sample_dies(plan, SHORT, dies=0, seed=0))


def test_read_error_needs_a_resistance_that_indeed_passes(check):
    hardware = IDEAL.with_values({"wires.r_row": 10.0, "wires.r_column": 10.0})
    hardware = hardware.model_copy(
        update={"cards": {**hardware.cards, "hp": "hp_tio2"},
                "drive": hardware.drive.model_copy(update={"parallelism": "column"})}
    )  # fmt: skip
    case = needs(NETWORK, hardware, check)
    figure = array.read_error(hardware, case.plan)
    assert figure.status == "FAIL"
    rows = {row["parameter"]: row for row in requirements((figure,), case)}
    assert set(rows) == {"devices.hp.r_on", "wires.r_row"}
    passing = hardware.with_values(dict.fromkeys(("wires.r_row", "wires.r_column"), rows["wires.r_row"]["needed"]))
    assert array.read_error(passing, place(NETWORK, passing)).margin == pytest.approx(0.2, abs=0.01)
    # The error goes with r / R_on, so that both ways ask for the same ratio.
    r_on = rows["devices.hp.r_on"]
    assert r_on["now"] == 100.0
    assert r_on["needed"] / 100.0 == pytest.approx(10.0 / rows["wires.r_row"]["needed"], rel=0.02)
    assert r_on["sentence"].startswith("read_error passes if devices.hp.r_on >= ")
    assert "(now 100 Ohm)" in r_on["sentence"]


def test_thresholds_spread_that_is_needed_gives_less_than_one_misfire(check):
    hardware = IDEAL.with_values({"nonidealities.threshold": 0.3})
    figure = array.threshold_margin(hardware, check.ledger)
    assert figure.status == "FAIL"
    (row,) = requirements((figure,), needs(NETWORK, hardware, check))
    narrower = hardware.with_values({row["parameter"]: row["needed"]})
    assert array.threshold_margin(narrower, check.ledger).value == pytest.approx(0.8, rel=0.1)


def test_passing_figures_need_nothing(check):
    figure = array.threshold_margin(IDEAL, check.ledger)
    assert requirements((figure,), needs(NETWORK, IDEAL, check)) == ()


def test_spreads_are_the_declared_ones_with_their_ranges():
    found = {factor.name: factor for factor in declared_spreads(Hardware.load("hp_1t1r"))}
    assert set(found) == {
        "wires.r_row", "wires.r_column", "nonidealities.write_verify", "nonidealities.event_charge",
        "nonidealities.threshold",
    }  # fmt: skip
    assert (found["nonidealities.event_charge"].low, found["nonidealities.event_charge"].high) == (0.001, 0.05)
    without = found["nonidealities.write_verify"]
    assert (without.low, without.high) == (0.0, 0.04)
    assert without.source.startswith("assumed: no range in the spec")
    assert declared_spreads(IDEAL) == ()


def test_without_spread_hardware_acts_as_the_ideal_controller(plan):
    stream = Stream.of(plan, SHORT, seed=0)
    assert action_agreement(place(NETWORK, IDEAL), stream, seed=0) == 1.0
    noisy = replace(plan, hardware=SPREAD.with_values({"nonidealities.neuron_threshold": 0.5}))
    assert action_agreement(noisy, stream, seed=0) < 1.0


def test_screening_finds_the_spread_that_matters(plan):
    # A threshold spread of up to 50 % of y_thresh beside a charge error that is next to nothing.
    hardware = IDEAL.with_values({"nonidealities.neuron_threshold": 0.25, "nonidealities.event_charge": 1e-9})
    found = screen(replace(plan, hardware=hardware), SHORT, trajectories=6, base=8)
    assert [factor["name"] for factor in found["factors"]] == [
        "nonidealities.neuron_threshold", "nonidealities.event_charge",
    ]  # fmt: skip
    assert found["factors"][0]["mu_star"] > 0.0 == found["factors"][1]["mu_star"]
    assert [row["trajectories"] for row in found["convergence"]] == [5, 6]
    assert found["sobol"][0]["total"] > found["sobol"][1]["total"] == pytest.approx(0.0)
    assert screen(replace(plan, hardware=hardware), SHORT, trajectories=6, base=8, workers=2) == found


def test_workers_change_nothing(plan):
    alone = sample_dies(plan, SHORT, dies=3, seed=4, starts=2)
    together = sample_dies(plan, SHORT, dies=3, seed=4, starts=2, workers=2)
    assert together.outcomes == alone.outcomes
    assert together.ledgers == alone.ledgers
    assert together.success == alone.success


def test_more_starts_leave_the_first_as_they_were(plan):
    one, two = (sample_dies(plan, SHORT, dies=2, seed=4, starts=k) for k in (1, 2))
    assert [o for o in two.outcomes if o.start == 0] == list(one.outcomes)
    assert len({o.trial_key for o in two.outcomes}) == 4
    assert (two.success.n, two.success.dies) == (4, 2)


def test_full_study_has_every_part():
    study = feasibility(NETWORK, SPREAD, dies=2, arena=Arena(max_timesteps=10), study="full")
    assert [one["name"] for one in study.corners] == ["typical", "slow", "noisy", "faulty", "worst"]
    assert study.corners[0]["verdict"] == study.verdict
    assert study.corners[0]["success"] == asdict(study.success)
    faulty = study.corners[3]["figures"]
    assert next(figure["value"] for figure in faulty if figure["name"] == "yield") < 1.0
    assert study.sensitivity["trajectories"] == 40
    assert next(f for f in study.figures if f.name == "sensitivity").status != "NOT_RUN"
    assert study.lifetime[0]["trial"] == 1
    assert study.provenance["study"] == "full"
    assert {row["figure"] for row in study.requirements} <= {f.name for f in study.figures}


def test_unknown_study_and_no_starts_are_refused():
    with pytest.raises(UnknownNameError, match=r"feasibility\.study"):
        feasibility(NETWORK, IDEAL, study="fall")
    with pytest.raises(ParameterError, match=r"feasibility\.starts: expected an integer"):
        feasibility(NETWORK, IDEAL, starts=0)


def test_comparison_ranks_by_verdict_and_lists_what_cannot_be_built_last():
    strukov = Hardware.load("hp_strukov")
    fails = feasibility(NETWORK, IDEAL.with_values({"limits.useful_event_range": 500.0}), dies=0, arena=SHORT)
    better = feasibility(NETWORK, IDEAL, dies=0, arena=SHORT)
    peo = Hardware.load("peo_pani")
    reason = why_not_built(NETWORK, peo)
    assert reason == "no card for hp"
    assert why_not_built(NETWORK, strukov) is None
    rows = rank_studies([not_built(NETWORK, peo, reason), fails, better])
    assert [(row["rank"], row["verdict"]) for row in rows] == [
        (1, "MARGINAL"), (2, "FAIL"), (None, "CANNOT BE BUILT"),
    ]  # fmt: skip
    assert rows[1]["failing"] == ["useful_event_range"]
