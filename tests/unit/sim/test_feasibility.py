"""The study as a whole: retraceable, reproducible, saved and loaded, and able to fail."""

import numpy as np
import pytest

from ohmloom.errors import FileFormatError, ParameterError
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, SpikingController, champion
from ohmloom.sim import Agreement, Arena, Feasibility, agreement, feasibility, run_trial
from ohmloom.sim.exactness import EXACT
from ohmloom.sim.sampling import start_key

NETWORK = Network.random(system="HET", rng=np.random.default_rng(3))
SHORT = Arena(max_timesteps=60)


@pytest.fixture(scope="module")
def study():
    return feasibility(NETWORK, Hardware.load("het_mixed"), dies=3, seed=5, arena=SHORT)


def test_success_is_that_of_the_trials_it_names(study):
    plan = place(NETWORK, Hardware.load("het_mixed"))
    ideal = [run_trial(SpikingController(NETWORK), SHORT, trial_key=start_key(5, d)).solved for d in range(3)]
    built = [
        run_trial(EmulatedController(plan.sample(seed=5, die=d)), SHORT, trial_key=start_key(5, d)).solved
        for d in range(3)
    ]
    assert (study.success.ideal, study.success.hardware) == (np.mean(ideal), np.mean(built))


def test_exactness_is_checked_on_the_nominal_die(study):
    assert study.exactness == dict.fromkeys(EXACT, True)
    assert study.not_applicable == {}


def test_figures_are_complete(study):
    assert [figure.name for figure in study.figures] == [
        "event_fidelity", "weight_divergence", "threshold_margin", "read_error", "disturb", "wake_up",
        "useful_event_range", "time_per_step", "programming_power", "energy_per_timestep", "pulses_per_device",
        "endurance", "yield", "sensitivity", "closed_loop_success",
    ]  # fmt: skip
    assert all(figure.source and figure.detail for figure in study.figures)


def test_peo_pani_is_too_slow(study):
    assert study.verdict == "FAIL"
    assert study.reasons[0].startswith("time_per_step is ")


def test_same_seed_gives_the_same_study(study):
    again = feasibility(NETWORK, Hardware.load("het_mixed"), dies=3, seed=5, arena=SHORT)
    assert again.to_dict() == study.to_dict()


def test_without_dies_there_is_no_success():
    study = feasibility(NETWORK, Hardware.load("ideal"), dies=0, arena=SHORT)
    assert study.success is None
    assert study.figures[-1].status == "NOT_RUN"
    assert study.verdict == "MARGINAL"


def test_save_and_load(study, tmp_path):
    study.save(tmp_path / "report.json")
    assert Feasibility.load(tmp_path / "report.json").to_dict() == study.to_dict()


def test_truncated_study_is_refused(study, tmp_path):
    path = tmp_path / "report.json"
    study.save(path)
    path.write_text(path.read_text()[:200])
    with pytest.raises(FileFormatError, match=r"report\.json: expected JSON"):
        Feasibility.load(path)


@pytest.mark.parametrize("name", ["dies", "seed"])
def test_negative_numbers_are_refused(name):
    with pytest.raises(ParameterError, match=rf"feasibility\.{name}: expected an integer"):
        feasibility(NETWORK, Hardware.load("ideal"), **{name: -1})


def test_card_of_another_ratio_claims_no_equality_with_the_paper():
    hardware = Hardware.load("ideal")
    network = Network.random(system="HP", rng=np.random.default_rng(3))
    other = hardware.model_copy(update={"cards": {**hardware.cards, "hp": "hp_tio2"}})
    study = feasibility(network, other, dies=0, arena=SHORT)
    assert set(study.not_applicable) == {"lattice"}
    assert study.exactness == {name: True for name in EXACT if name != "lattice"}


def test_agreement_can_be_saved_and_loaded(tmp_path):
    result = agreement(NETWORK, Hardware.load("het_mixed"), seed=1, arena=SHORT, perturb=0.2)
    result.save(tmp_path / "a.npz")
    loaded = Agreement.load(tmp_path / "a.npz")
    loaded.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert loaded.first_divergence == result.first_divergence
    assert loaded.ledger == result.ledger
    assert (loaded.trial.path == result.trial.path).all()
    assert (loaded.weights == result.weights).all()


def test_agreement_notices_a_wrong_charge():
    right = agreement(NETWORK, Hardware.load("ideal"), seed=1, arena=SHORT)
    wrong = agreement(NETWORK, Hardware.load("ideal"), seed=1, arena=SHORT, perturb=0.2)
    assert right.exact
    assert right.first_divergence is None
    assert not wrong.exact
    assert wrong.first_divergence is not None
    assert wrong.worst_rms > 1e-3 > right.worst_rms


def test_die_of_another_network_is_refused():
    other = Network.random(system="HET", rng=np.random.default_rng(9))
    die = place(other, Hardware.load("het_mixed")).nominal()
    with pytest.raises(ParameterError, match=r"agreement\.die: expected a die of network"):
        agreement(NETWORK, Hardware.load("het_mixed"), die=die, arena=SHORT)


def test_without_plastic_synapses_only_the_spikes_are_compared():
    network = Network.random(system="GA", rng=np.random.default_rng(3))
    study = feasibility(network, Hardware.load("ideal"), dies=0, arena=SHORT)
    spikes_and_lines = {"network_charge", "wire_limit", "ladder", "column_serial_delay", "kirchhoff"}
    assert study.exactness == dict.fromkeys((name for name in EXACT if name in spikes_and_lines), True)
    assert set(study.not_applicable.values()) == {"no plastic synapse"}


def short(champion_name, hardware):
    network = champion(champion_name)
    return feasibility(network, hardware, dies=0, arena=Arena(task="static", max_timesteps=60))


def status_of(study, name):
    return next(figure.status for figure in study.figures if figure.name == name)


def test_strukov_hardware_fails_on_lost_events_and_then_on_wires():
    study = short("HP", Hardware.load("hp_strukov"))
    assert study.verdict == "FAIL"
    assert study.reasons[0].startswith("event_fidelity is 0.")
    assert study.reasons[1].startswith("read_error is 0.")
    assert all(study.exactness.values())


def test_ten_kilohm_hardware_fails_on_neither():
    study = short("HP", Hardware.load("hp_1t1r"))
    assert status_of(study, "event_fidelity") != "FAIL"
    assert status_of(study, "read_error") != "FAIL"
    assert study.verdict == "MARGINAL"
    assert all(study.exactness.values())


def test_polyaniline_fails_on_time_and_not_on_wires():
    study = short("PEO", Hardware.load("peo_pani"))
    assert study.verdict == "FAIL"
    assert study.reasons[0].startswith("time_per_step is ")
    assert status_of(study, "read_error") == "PASS"
    assert status_of(study, "wake_up") == "PASS"


def test_polyaniline_left_in_place_wakes_up():
    spec = Hardware.load("peo_pani")
    spec = spec.model_copy(update={"array": spec.array.model_copy(update={"disabled": "present"})})
    study = short("PEO", spec)
    assert study.verdict == "FAIL"
    assert status_of(study, "wake_up") == "FAIL"
    assert any(reason.startswith("wake_up is 0.") for reason in study.reasons)
    # TiO2 left in place stays near its off state, where an event moves it least.
    spec = Hardware.load("hp_1t1r")
    spec = spec.model_copy(update={"array": spec.array.model_copy(update={"disabled": "present"})})
    assert status_of(short("HP", spec), "wake_up") != "FAIL"
