"""Figures: values by hand, margins, and the rules of status and verdict."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from ohmloom.devices import Device
from ohmloom.mapping import Hardware, Ledger, Quantity, place
from ohmloom.neurocontroller import Network
from ohmloom.sim import figures as f
from ohmloom.sim import figures_array as array
from ohmloom.sim import figures_behaviour as behaviour
from ohmloom.sim import figures_cost as cost
from ohmloom.sim.feasibility import default_dies
from ohmloom.sim.statistics import paired_success
from ohmloom.sim.verdict import study_verdict

HARDWARE = Hardware.load("het_mixed")
LEDGER = Ledger(
    events=300, ideal_events=300, lost=0, spurious=0, charge=3e-7, programming_energy=6.4e-5, read_energy=3.2e-9,
    spikes=1000, steps=210, reading_time=1.1e-6, mean_programming_time=1e-4, worst_programming_time=1e-3,
    most_pulses=5000, pulses=300,
)  # fmt: skip


LEDGERS = {"the nominal die": LEDGER}


def changed(section, **quantities):
    part = getattr(HARDWARE, section)
    return HARDWARE.model_copy(update={section: part.model_copy(update=quantities)})


def sourced(value):
    return Quantity(value=value, source="a data sheet")


def test_time_per_step_is_reading_and_worst_programming():
    figure = cost.time_per_step(changed("drive", pulse_voltage=sourced(1.0)), LEDGERS)
    assert figure.value == pytest.approx(1e-3 + 1.1e-6)
    assert figure.limit == pytest.approx(0.032 / 21)
    assert figure.margin == pytest.approx(1 - figure.value / figure.limit)
    assert figure.status == "PASS"


def test_assumed_voltage_that_decides_makes_it_assumed():
    # At 0.8 V the pulses take 1.75 ms, at 1.4 V 1 ms: on both sides of 1.524 ms.
    slow = {"the nominal die": replace(LEDGER, worst_programming_time=1.4e-3)}
    figure = cost.time_per_step(HARDWARE, slow)
    assert figure.status == "ASSUMED"
    assert "drive.pulse_voltage" in figure.detail


def test_power_is_energy_per_timestep_over_32_ms():
    figure = cost.programming_power(HARDWARE, LEDGERS)
    energy = (6.4e-5 + 3.2e-9 + 1000 * 1.2e-12) / 10
    assert figure.value == pytest.approx(energy / 0.032)
    assert cost.energy_per_timestep(HARDWARE, LEDGERS).value == pytest.approx(energy)
    assert cost.energy_per_timestep(HARDWARE, LEDGERS).margin == pytest.approx(figure.margin)


def test_endurance_and_pulses_are_two_sides_of_one_margin():
    hardware = changed("endurance", pulses=sourced(1e6))
    assert cost.endurance(hardware, LEDGERS).value == 200
    assert cost.endurance(hardware, LEDGERS).status == "ASSUMED"
    pulses = cost.pulses_per_device(hardware, LEDGERS)
    assert (pulses.value, pulses.limit) == (5000, 1000)
    assert pulses.margin < 0


@pytest.mark.parametrize("name", ["hp_tio2_10k", "peo_pani"])
def test_ratio_100_has_the_papers_ninety_events(name):
    # W from 0.1 to 1 on HP: q from 0.9 to 0.99 in steps of 0.00099.
    assert array.useful_events(Device.load(name), is_referenced=False) == pytest.approx(0.09 / 0.00099, abs=0.05)


def test_linear_has_nine_hundred():
    assert array.useful_events(Device.load("linear"), is_referenced=True) == pytest.approx(900, abs=0.1)


def test_strukovs_ratio_has_fewer():
    assert array.useful_events(Device.load("hp_tio2"), is_referenced=False) == pytest.approx(56.6, abs=0.1)


def test_range_of_a_plan_is_that_of_its_worst_kind():
    het = place(Network.random(system="HET", rng=np.random.default_rng(1)), HARDWARE)
    lin = place(Network.random(system="LIN", rng=np.random.default_rng(1)), HARDWARE)
    assert array.useful_event_range(HARDWARE, het).value == pytest.approx(90.9, abs=0.05)
    assert array.useful_event_range(HARDWARE, lin).value == pytest.approx(900, abs=0.1)
    ga = place(Network.random(system="GA", rng=np.random.default_rng(1)), HARDWARE)
    assert array.useful_event_range(HARDWARE, ga).value is None


@pytest.mark.parametrize(
    ("lost", "status"), [(0, "ASSUMED"), (900, "MARGINAL"), (1100, "FAIL")]
)  # spread.threshold is assumed, so it cannot pass
def test_event_fidelity(lost, status):
    figure = behaviour.event_fidelity(HARDWARE, lost, 0, 1_000_000, 20)
    assert figure.value == lost / 1e6
    assert figure.status == status


def test_missing_limit_is_assumed():
    figure = cost.programming_power(changed("limits", programming_power=None), LEDGERS)
    assert (figure.limit, figure.margin, figure.status) == (None, None, "ASSUMED")


def test_success_needs_enough_dies():
    few = behaviour.closed_loop_success(HARDWARE, paired_success([True] * 20, [True] * 20))
    assert few.status == "NOT_RUN"
    assert few.margin is None
    assert "20 dies do not decide; about 73 would" in few.detail
    enough = behaviour.closed_loop_success(Hardware.load("ideal"), paired_success([True] * 73, [True] * 73))
    assert enough.status in ("PASS", "MARGINAL")
    assert enough.margin >= 0


def test_success_on_assumed_spreads_cannot_pass():
    outcome = [True] * 400
    assert behaviour.closed_loop_success(Hardware.load("ideal"), paired_success(outcome, outcome)).status == "PASS"
    assert behaviour.closed_loop_success(HARDWARE, paired_success(outcome, outcome)).status == "ASSUMED"


def test_a_network_that_never_reaches_the_goal_fails():
    figure = behaviour.closed_loop_success(HARDWARE, paired_success([False] * 80, [False] * 80))
    assert figure.status == "FAIL"
    assert "the ideal controller never reached the goal" in figure.detail


def test_no_events_at_all_are_none_lost():
    assert behaviour.event_fidelity(HARDWARE, 0, 0, 0, 20).status == "PASS"
    assert behaviour.event_fidelity(HARDWARE, 0, 5, 0, 20).status == "FAIL"


def test_few_dies_suffice_to_fail():
    figure = behaviour.closed_loop_success(HARDWARE, paired_success([True] * 20, [False] * 20))
    assert figure.status == "FAIL"


def figure(name, status, margin):
    return f.Figure(name=name, value=1.0, unit="s", limit=1.0, margin=margin, source="s", status=status, detail="d.")


def test_verdict_takes_the_worst_status_and_three_reasons():
    found = (
        figure("a", "PASS", 1.0), figure("b", "MARGINAL", 0.1), figure("c", "FAIL", -0.5), figure("d", "FAIL", -2.0),
        figure("e", "ASSUMED", 0.5),
    )  # fmt: skip
    verdict, reasons = study_verdict(found, {"rule_table": True})
    assert verdict == "FAIL"
    # What is only in doubt is no reason for a FAIL.
    assert [reason.split()[0] for reason in reasons] == ["d", "c"]


def test_the_other_form_of_a_figure_is_no_second_reason():
    found = (figure("programming_power", "FAIL", -1.0), figure("energy_per_timestep", "FAIL", -1.0))
    assert [reason.split()[0] for reason in study_verdict(found, {})[1]] == ["programming_power"]


def test_worst_of_all_dies_counts():
    worse = replace(LEDGER, worst_programming_time=9e-3, most_pulses=7000, programming_energy=1e-3)
    ledgers = {**LEDGERS, "die 4": worse}
    assert cost.time_per_step(HARDWARE, ledgers).value == pytest.approx(9e-3 + 1.1e-6)
    assert "on die 4" in cost.time_per_step(HARDWARE, ledgers).detail
    assert cost.pulses_per_device(HARDWARE, ledgers).value == 7000
    assert cost.endurance(HARDWARE, ledgers).value == pytest.approx(1e9 / 7000)
    assert cost.programming_power(HARDWARE, ledgers).value > cost.programming_power(HARDWARE, LEDGERS).value


def test_nothing_is_worn_out_without_pulses():
    still = {"the nominal die": replace(LEDGER, most_pulses=0)}
    assert (cost.endurance(HARDWARE, still).value, cost.endurance(HARDWARE, still).status) == (None, "PASS")


def test_figures_on_assumed_cards_cannot_pass():
    plan = place(Network.random(system="HP", rng=np.random.default_rng(1)), HARDWARE)
    capped = f.capped_by_cards(figure("a", "PASS", 1.0), plan)
    assert capped.status == "ASSUMED"
    assert "hp_tio2_10k.r_on" in capped.detail
    assert f.capped_by_cards(figure("a", "FAIL", -1.0), plan).status == "FAIL"
    ideal = Hardware.load("ideal")
    assert f.capped_by_cards(figure("a", "PASS", 1.0), place(plan.network, ideal)).status == "PASS"


def test_equal_hardware_with_many_discordant_pairs_is_not_decided():
    ideal = [True] * 120 + [False] * 40 + [True] * 20 + [False] * 20
    built = [True] * 120 + [False] * 40 + [False] * 20 + [True] * 20
    figure = behaviour.closed_loop_success(HARDWARE, paired_success(ideal, built))
    assert figure.status == "NOT_RUN"


@pytest.mark.parametrize("status", ["MARGINAL", "ASSUMED", "NOT_RUN"])
def test_anything_but_pass_is_marginal(status):
    assert study_verdict((figure("a", "PASS", 1.0), figure("b", status, 0.1)), {})[0] == "MARGINAL"


def test_only_passes_pass():
    assert study_verdict((figure("a", "PASS", 1.0),), {"network_charge": True}) == ("PASS", ())


def test_broken_exactness_voids_the_study():
    verdict, reasons = study_verdict((figure("a", "PASS", 1.0),), {"network_charge": False})
    assert verdict == "FAIL"
    assert reasons == ("exactness: network_charge does not hold, so the study is void.",)


def test_misfires_are_those_of_a_normal_threshold():
    # Selected cells: an event at 1 V, thresholds of 0.75 V with a spread of 10 %, so 10/3 standard deviations away.
    hardware = HARDWARE.model_copy(
        update={
            "drive": HARDWARE.drive.model_copy(update={"pulse_voltage": sourced(1.0)}),
            "nonidealities": HARDWARE.nonidealities.model_copy(update={"threshold": sourced(0.1)}),
        }
    )
    ledger = replace(LEDGER, ideal_events=10_000)
    lost = 10_000 * norm.sf(0.25 / 0.075)
    figure = array.threshold_margin(hardware, ledger)
    assert figure.value == pytest.approx(lost, rel=1e-9)
    assert figure.status == "FAIL"
    # Half-selected devices see 0.5 V, and write where their threshold is below it.
    driven = replace(ledger, half_selects_row=400, half_selects_column=300, half_selects_both=0)
    more = array.threshold_margin(hardware, driven)
    assert more.value == pytest.approx(lost + 700 * norm.cdf(-0.25 / 0.075), rel=1e-9)
    assert "2 to 1" in more.detail


def test_window_of_the_papers_waveform_is_five_to_four():
    event, others = array.window(Hardware.load("hp_strukov"))
    assert event == pytest.approx(1.0)
    # Row at +3, column at -1 of units of a fifth of a volt; -2 and 0 on one line only.
    assert others == pytest.approx({"row": 0.6, "column": 0.6, "both": 0.8})


def test_disturb_counts_half_selects_of_a_mean_device_and_reads_of_the_busiest():
    hardware = HARDWARE.model_copy(
        update={"nonidealities": HARDWARE.nonidealities.model_copy(
            update={"half_select": sourced(1e-3), "read_disturb": sourced(1e-4)})}
    )  # fmt: skip
    plan = place(Network.random(system="HP", rng=np.random.default_rng(1)), HARDWARE)
    spikes = np.zeros((10, plan.network.neurons), dtype=np.int64)
    spikes[:, plan.network.synapses[0].pre] = 21
    ledger = replace(LEDGER, half_selects_row=30 * len(plan.crosspoints), half_selects_both=12 * len(plan.crosspoints))
    figure = array.disturb(hardware, plan, ledger, spikes)
    assert figure.value == pytest.approx(42 * 1e-3 + 210 * 1e-4)
    # A spec that is silent about a disturb that happens cannot pass, and is told its budget.
    silent = array.disturb(HARDWARE, plan, ledger, spikes)
    assert (silent.value, silent.status) == (0.0, "ASSUMED")
    assert "nonidealities.half_select up to 0.024 of an event" in silent.detail
    assert array.disturb(Hardware.load("ideal"), plan, ledger, spikes).status == "PASS"


def test_yield_is_one_only_where_nothing_is_said_of_faults():
    ideal = Hardware.load("ideal")
    network = Network.random(system="HP", rng=np.random.default_rng(1))
    assert array.yield_(ideal, place(network, ideal), seed=0, dies=0).status == "PASS"
    assert array.yield_(HARDWARE, place(network, HARDWARE), seed=0, dies=0).status == "ASSUMED"
    faulty = ideal.with_values({"nonidealities.stuck_on": 0.003})  # no permutation hides a short
    figure = array.yield_(faulty, place(network, faulty), seed=0, dies=5)
    assert 0.0 < figure.value < array.YIELD_LIMIT
    assert (figure.limit, figure.status) == (array.YIELD_LIMIT, "FAIL")
    lower = faulty.with_values({"limits.yield_": 0.5 * figure.value})
    assert array.yield_(lower, place(network, lower), seed=0, dies=5).status == "PASS"
    assert array.yield_(faulty, place(network, faulty), seed=0, dies=0).status == "NOT_RUN"


def test_sensitivity_is_the_share_of_the_leader_and_never_binds():
    factors = [{"name": "a", "mu_star": 0.3, "source": "assumed: x"}, {"name": "b", "mu_star": 0.1, "source": "y"}]
    found = behaviour.sensitivity({"output": "action agreement", "factors": factors})
    assert found.value == pytest.approx(0.75)
    assert study_verdict((replace(found, status="NOT_RUN"),), {}) == ("PASS", ())
    assert behaviour.sensitivity(None).status == "NOT_RUN"


def test_causes_come_before_symptoms():
    found = (
        figure("closed_loop_success", "FAIL", -50.0), figure("weight_divergence", "FAIL", -40.0),
        figure("threshold_margin", "FAIL", -30.0), figure("read_error", "FAIL", -1.0),
    )  # fmt: skip
    names = [reason.split()[0] for reason in study_verdict(found, {})[1]]
    assert names == ["read_error", "threshold_margin", "closed_loop_success"]


def test_dies_follow_wires_and_what_the_nominal_die_says():
    figure = f.Figure(name="event_fidelity", value=0.5, unit="", limit=0.001, margin=-499.0, source="ours",
                      status=f.FAIL, detail="lost")  # fmt: skip
    assert default_dies(Hardware.load("ideal"), (figure,)) == 200
    assert default_dies(HARDWARE, (figure,)) == 24
    assert default_dies(HARDWARE, (replace(figure, status=f.PASS),)) == 96
