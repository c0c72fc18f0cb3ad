"""What a user can do with a controller, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.neurocontroller import ACTIONS, Network, SpikingController, Synapse


@pytest.fixture
def network():
    return Network.random(system="HET", rng=np.random.default_rng(6))


@pytest.mark.parametrize("implementation", ["plain", "compiled"])
def test_shapes_and_ranges(network, implementation):
    controller = SpikingController(network, implementation=implementation)
    assert controller.weights.tolist() == [0.5] * len(network.synapses)
    assert controller.output_spikes.tolist() == [0, 0]
    assert controller.step([0, 0, 0, 0.3, 1, 0.2]) in ACTIONS
    assert controller.output_spikes.shape == (2,)
    assert controller.output_spikes.tolist() == controller.spike_counts[-2:].tolist()
    assert controller.spike_counts.shape == controller.membranes.shape == (network.neurons,)
    assert controller.weights.shape == (len(network.synapses),)
    assert controller.weights.min() >= 0
    assert controller.weights.max() <= 1


@pytest.mark.parametrize("implementation", ["plain", "compiled"])
def test_results_are_copies(network, implementation):
    controller = SpikingController(network, implementation=implementation)
    other = SpikingController(network, implementation=implementation)
    for values in (
        controller.weights,
        controller.membranes,
        controller.output_spikes,
        controller.spike_counts,
    ):
        values[:] = 0
    assert [controller.step([0.5] * 6) for _ in range(5)] == [other.step([0.5] * 6) for _ in range(5)]
    assert controller.membranes.tolist() == other.membranes.tolist()


@pytest.mark.parametrize("implementation", ["plain", "compiled"])
def test_weights_are_in_the_order_of_the_network(implementation):
    shuffled = Network(
        system="GA",
        hidden=("inhibitory", "excitatory"),
        synapses=(
            Synapse(6, 9, "constant", 0.9),
            Synapse(3, 7, "constant", 0.2),
            Synapse(0, 6, "constant", 0.4),
        ),
    )
    controller = SpikingController(shuffled, implementation=implementation)
    assert controller.weights.tolist() == [0.9, 0.2, 0.4]


@pytest.mark.parametrize("sensors", [[0] * 5, [0] * 7, [[0] * 6], [0, 0, 0, 0, 0, 1.01], [0, 0, -1e-9, 0, 0, 0],
                                     [0, 0, 0, 0, 0, float("nan")], ["a"] * 6, None])  # fmt: skip
@pytest.mark.parametrize("implementation", ["plain", "compiled"])
def test_sensor_values_are_checked(network, implementation, sensors):
    controller = SpikingController(network, implementation=implementation)
    with pytest.raises(ParameterError, match=r"^SpikingController\.step: expected 6 sensor values in \[0, 1\], got "):
        controller.step(sensors)


def test_unknown_plasticity_and_implementation(network):
    with pytest.raises(ParameterError, match=r"SpikingController\.plasticity: expected .*'charge'.*, got 'magic'"):
        SpikingController(network, plasticity="magic")
    with pytest.raises(
        ParameterError,
        match=r"SpikingController\.implementation: expected 'compiled' or 'plain', got 'fast'\. Use one of these\.",
    ):
        SpikingController(network, implementation="fast")


def test_only_the_compiled_controller_offers_arrays_to_a_kernel(network):
    assert SpikingController(network, implementation="plain").kernel_arguments == (None, None)
    wiring, state = SpikingController(network).kernel_arguments
    assert wiring.neurons == network.neurons
    assert state.y.shape == (network.neurons,)
