"""The emulated controller: exact on the nominal die, wrong when its charge is, and with a ledger that adds up."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, Readings, SpikingController, Synapse, mutate

SENSORS = (0.0, 0.3, 0.0, 0.2, 0.8, 1.0)


def pair(network, spec="het_mixed", **options):
    return SpikingController(network), EmulatedController(place(network, Hardware.load(spec)).nominal(), **options)


@pytest.mark.parametrize("spec", ["ideal", "het_mixed"])
@pytest.mark.parametrize("system", ["HP", "PEO", "GA", "HET", "LIN"])
def test_every_spike_is_the_discrete_one(system, spec):
    rng = np.random.default_rng(11)
    network = Network.random(system=system, rng=rng)
    for _ in range(3):
        network = mutate(network, rng=rng)
    discrete, emulated = pair(network, spec)
    for sensors in rng.random((60, 6)):
        for _ in range(21):
            assert (discrete.spikes(sensors) == emulated.spikes(sensors)).all()
        np.testing.assert_allclose(emulated.weights, discrete.weights, rtol=0, atol=1e-9)
    assert emulated.ledger.events == sum(discrete.events)


@pytest.mark.parametrize(
    "readings",
    [
        {"lateral": "both"}, {"hidden_delay": "one"}, {"clamp": False, "input_bias": False}, {"carry_state": False},
        {"synapse_gain": 1.0, "high_count": 8},
    ],
)  # fmt: skip
def test_other_readings_are_followed(readings):
    rng = np.random.default_rng(12)
    discrete, emulated = pair(Network.random(system="HET", rng=rng, readings=Readings(**readings)))
    for sensors in rng.random((20, 6)):
        assert discrete.step(sensors) == emulated.step(sensors)
        assert (discrete.spike_counts == emulated.spike_counts).all()


def test_a_thousandth_more_charge_moves_the_weights():
    network = Network.random(system="HET", rng=np.random.default_rng(11))
    discrete, emulated = pair(network, perturb=0.001)
    for _ in range(20):
        discrete.step(SENSORS)
        emulated.step(SENSORS)
    assert np.abs(emulated.weights - discrete.weights).max() > 1e-5


def test_one_positive_event_moves_the_charge_by_a_thousandth():
    """Input 0 always spikes and its receiver follows one step later, so both kinds of event are known."""
    network = Network(system="HP", hidden=("excitatory",), synapses=(Synapse(0, 6, "hp", 0.5),))
    _, emulated = pair(network, "hp_1t1r")
    before = emulated.states[0]
    moved = 0
    for _ in range(21):
        pulses = emulated.pulses[0]
        emulated.spikes((0.9, 0, 0, 0, 0, 0))
        after = emulated.states[0]
        if emulated.pulses[0] > pulses:
            assert abs(abs(after - before) - 0.001) < 1e-12
            moved += 1
        else:
            assert after == before
        before = after
    assert moved > 0


def test_charge_energy_and_time_of_metered_pulses():
    """A metered pulse at V takes the event's charge: energy V q, and time q / (V G) within the change of G."""
    network = Network(system="LIN", hidden=("excitatory",), synapses=(Synapse(0, 6, "linear", 0.5),))
    _, emulated = pair(network)
    device = emulated.die.plan.hardware.devices["linear"]
    emulated.step((0.9, 0, 0, 0, 0, 0))
    ledger = emulated.ledger
    assert ledger.events > 0
    charge = device.charge_scale / 1000
    assert ledger.charge == pytest.approx(ledger.events * charge, rel=1e-12)
    assert ledger.programming_energy == pytest.approx(ledger.charge * 1.0, rel=1e-9)
    g = float(device.conductance(0.5))
    assert ledger.worst_programming_time == pytest.approx(charge / g, rel=0.05)


def test_lost_events_are_counted_when_thresholds_are_too_high():
    plan = place(Network.random(system="HP", rng=np.random.default_rng(2)), Hardware.load("hp_1t1r"))
    hardware = plan.hardware
    high = hardware.drive.threshold.model_copy(update={"value": 0.75})
    wide = hardware.nonidealities.model_copy(update={"threshold": high.model_copy(update={"value": 0.5})})
    die = place(plan.network, hardware.model_copy(update={"nonidealities": wide})).sample(seed=1)
    emulated = EmulatedController(die)
    for _ in range(10):
        emulated.step(SENSORS)
    ledger = emulated.ledger
    assert ledger.lost > 0
    assert ledger.spurious > 0
    assert ledger.events == ledger.ideal_events - ledger.lost + ledger.spurious


def test_reset_brings_everything_back():
    _, emulated = pair(Network.random(system="HET", rng=np.random.default_rng(4)))
    first = [emulated.step(SENSORS) for _ in range(5)], emulated.conductances, emulated.ledger
    emulated.reset()
    assert emulated.ledger.steps == 0
    again = [emulated.step(SENSORS) for _ in range(5)], emulated.conductances, emulated.ledger
    assert first[0] == again[0]
    assert (first[1] == again[1]).all()
    assert first[2] == again[2]


def test_network_without_synapses_runs():
    network = Network(system="HET", hidden=("excitatory",), synapses=())
    discrete, emulated = pair(network)
    assert discrete.step(SENSORS) == emulated.step(SENSORS)


@pytest.mark.parametrize("perturb", [-1.0, float("nan"), float("inf"), 1e7, "a", None, True])
def test_impossible_perturbation_is_refused(perturb):
    with pytest.raises(ParameterError, match=r"EmulatedController\.perturb: expected a number > -1"):
        pair(Network.random(system="HP", rng=np.random.default_rng(1)), perturb=perturb)


def test_sensors_out_of_range_are_refused():
    _, emulated = pair(Network.random(system="HP", rng=np.random.default_rng(1)))
    with pytest.raises(ParameterError, match=r"EmulatedController\.step: expected 6 sensor values in \[0, 1\]"):
        emulated.step((0, 0, 0, 0, 0, 1.5))


def test_a_controller_wants_a_die():
    with pytest.raises(ParameterError, match=r"^EmulatedController\.die: expected Die, got None\."):
        EmulatedController(None)
