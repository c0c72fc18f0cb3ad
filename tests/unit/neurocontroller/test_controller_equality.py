"""The compiled controller equals the plain one: spikes of all neurons in each step, weights, membranes, events."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.neurocontroller import (
    LATTICES,
    Adaptation,
    Network,
    Readings,
    SpikingController,
    Synapse,
    _kernels,
    mutate,
)
from ohmloom.neurocontroller.wiring import new_state, synapse_places, wire

SYSTEMS = ["HP", "PEO", "LIN", "GA", "HET"]
ALTERNATIVES = [
    {"lateral": "both"},
    {"lateral": "ascending"},
    {"weight_at": "emission"},
    {"weight_at": "emission", "lateral": "both"},
    {"hidden_delay": "one"},
    {"hidden_delay": "one", "weight_at": "emission"},
    {"last_spike": 4},
    {"last_spike": 5, "stdp_threshold": 5},
    {"stdp_threshold": 3},
    {"stdp_threshold": 0},
    {"clamp": False},
    {"carry_state": False},
    {"carry_state": False, "weight_at": "emission"},
    {"carry_state": False, "lateral": "both"},
    {"input_bias": False},
    {"synapse_gain": 1.0},
    {"a": 0.1, "b": 0.2, "c": 0.1, "c_ini": 0.0, "y_thresh": 0.9},
    {"high_count": 6},
]


def sensor_stream(rng, timesteps):
    """Sensor values that dwell, saturate and vanish, as those of the robot do."""
    values = rng.random(6)
    for _ in range(timesteps):
        change = rng.random(6) < 0.2
        values = np.where(change, np.clip(rng.uniform(-0.5, 1.5, 6), 0.0, 1.0), values)
        yield values


def assert_equal_run(network, timesteps, *, seed=5):
    plain, compiled = (SpikingController(network, implementation=i) for i in ("plain", "compiled"))
    total = 0
    for t, sensors in enumerate(sensor_stream(np.random.default_rng(seed), timesteps)):
        if t % 4:
            actions = plain.step(sensors), compiled.step(sensors)
            assert actions[0] == actions[1]
            assert plain.spike_counts.tolist() == compiled.spike_counts.tolist()
            assert plain.output_spikes.tolist() == compiled.output_spikes.tolist()
            total += int(plain.spike_counts[6:].sum())
        else:
            plain.begin_timestep()
            compiled.begin_timestep()
            for step in range(21):
                assert plain.spikes(sensors).tolist() == compiled.spikes(sensors).tolist(), (t, step)
        assert plain.weights.tolist() == compiled.weights.tolist(), t
        assert plain.membranes.tolist() == compiled.membranes.tolist(), t
        assert plain.events == compiled.events, t
    assert total > timesteps  # a silent network would compare nothing
    if network.system != "GA":
        assert min(plain.events) > 0
    return compiled


@pytest.mark.parametrize("system", SYSTEMS)
def test_default_readings(system):
    network = Network.random(system=system, rng=np.random.default_rng(11))
    assert wire(network).masked
    assert_equal_run(network, 200)


@pytest.mark.parametrize("changes", ALTERNATIVES, ids=str)
def test_alternative_readings(changes):
    readings = Readings(**changes)
    for k, system in enumerate(("HET", "LIN")):
        network = Network.random(system=system, rng=np.random.default_rng(20 + k), readings=readings)
        assert_equal_run(network, 40)


@pytest.mark.parametrize("lateral", ["descending", "both"])
def test_grown_network(lateral):
    rng = np.random.default_rng(3)
    network = Network.random(system="HET", rng=rng, readings=Readings(lateral=lateral))
    grow = Adaptation(mu=0.1, psi=1.0, omega=1.0, tau=0.01)
    while len(network.hidden) < 25:
        network = mutate(network.replace(adaptation=grow), rng=rng)
    assert wire(network).masked
    assert_equal_run(network, 12)


@pytest.mark.parametrize("lateral", ["descending", "both"])
def test_more_neurons_than_one_word_has_bits(lateral):
    network = Network.random(system="HET", rng=np.random.default_rng(4), hidden=56, enable_probability=0.3,
                             readings=Readings(lateral=lateral))  # fmt: skip
    assert network.neurons == 64
    assert wire(network).words.shape == (4, 64, 2)
    assert_equal_run(network, 12)


def test_as_many_hidden_neurons_as_a_network_may_have():
    """Spikes wander through all the words, and arrive within one, at its edges and two words further on."""
    rng = np.random.default_rng(4)
    pairs = {(pre, post) for pre in range(6) for post in range(6, 1006) if rng.random() < 0.2}
    pairs |= {(post + distance, post) for distance in (1, 62, 130) for post in range(6, 1006 - distance)}
    pairs |= {(pre, post) for pre in range(6, 1006) for post in (1006, 1007) if rng.random() < 0.1}
    ordered = sorted(pairs, key=lambda pair: (pair[1], pair[0]))
    network = Network(
        system="LIN",
        hidden=tuple(rng.choice(["excitatory", "inhibitory"], 1000).tolist()),
        synapses=tuple(Synapse(pre, post, "linear", 0.5) for pre, post in ordered),
    )
    assert wire(network).words.shape == (4, 1008, 17)
    assert_equal_run(network, 4)


def test_most_neurons_that_masks_hold():
    network = Network.random(system="PEO", rng=np.random.default_rng(4), hidden=54, enable_probability=0.3)
    assert network.neurons == 62
    assert wire(network).masked
    assert_equal_run(network, 12)


@pytest.mark.parametrize("lateral", ["descending", "ascending", "both"])
def test_masked_form_equals_general_form(lateral):
    """The same default rule in both compiled forms, over many timesteps."""
    network = Network.random(system="HET", rng=np.random.default_rng(8), readings=Readings(lateral=lateral))
    runs = [wire(network), wire(network)._replace(masked=False)]
    states = [new_state(w) for w in runs]
    counts = np.zeros((2, network.neurons), dtype=np.int64)
    for sensors in sensor_stream(np.random.default_rng(2), 600):
        actions = [_kernels.timestep(w, s, sensors, c) for w, s, c in zip(runs, states, counts, strict=True)]
        assert actions[0] == actions[1]
        assert counts[0].tolist() == counts[1].tolist()
    assert states[0].y.tolist() == states[1].y.tolist()
    weights = [s.weight[synapse_places(network)] for s in states]
    assert weights[0].tolist() == weights[1].tolist()


@pytest.mark.parametrize("implementation", ["plain", "compiled"])
@pytest.mark.parametrize("changes", [{}, {"weight_at": "emission"}], ids=["masked", "general"])
def test_reset_repeats_the_run(implementation, changes):
    network = Network.random(system="HET", rng=np.random.default_rng(1), readings=Readings(**changes))
    controller = SpikingController(network, implementation=implementation)
    fresh = controller.weights.tolist(), controller.membranes.tolist()
    runs = []
    for _ in range(2):
        actions = [controller.step(s) for s in sensor_stream(np.random.default_rng(0), 15)]
        runs.append((actions, controller.weights.tolist(), controller.membranes.tolist(), controller.events))
        controller.reset()
        assert (controller.weights.tolist(), controller.membranes.tolist()) == fresh
        assert controller.events == (0, 0)
        assert controller.output_spikes.tolist() == [0, 0]
    assert runs[0] == runs[1]
    assert runs[0][1] != fresh[0]


def test_synapses_that_meet_a_wall():
    network = Network.random(system="PEO", rng=np.random.default_rng(11))
    controller = assert_equal_run(network, 60)
    assert controller.weights.min() == LATTICES["peo_pani"].weight(0)
