"""Ties: a spike that only rounding decides is counted and mended; a spike that the weights decide is a failure."""

import numpy as np
import pytest

from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, SpikingController, Synapse
from ohmloom.sim.agreement import _Pair
from ohmloom.sim.exact_case import exact_variant

SENSORS = np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture
def pair():
    network = Network(
        system="LIN", hidden=("excitatory", "excitatory"),
        synapses=(Synapse(0, 6, "linear", 0.5), Synapse(7, 6, "linear", 0.5), Synapse(6, 8, "linear", 0.5)),
    )  # fmt: skip
    die = place(network, exact_variant(Hardware.load("het_mixed"), "charge_metered")).nominal()
    return _Pair(SpikingController(network), EmulatedController(die))


def membrane_at_threshold(pair, shortfall):
    """Bring hidden neuron 6 to the edge: the discrete one spikes by one bit, the emulated one falls short."""
    _, state = pair.discrete.kernel_arguments
    # Idle input: y + (0 + 0.3 - 0.05 y) = 1 at y = 0.7 / 0.95; no spike has arrived yet in the first step.
    y = 0.7 / 0.95
    while y + (0.0 + 0.3 - 0.05 * y) <= 1.0:
        y = np.nextafter(y, 2.0)
    state.y[6] = y
    pair.emulated._state.neurons["y"][:] = state.y
    pair.emulated._state.neurons["y"][6] -= shortfall


def test_rounding_is_a_tie_and_both_go_on_from_one_state(pair):
    membrane_at_threshold(pair, 5e-16)
    spiked, emulated = pair._step(SENSORS, 0)
    assert pair.ties == 1
    assert pair.first_divergence is None
    assert (spiked == emulated).all()
    assert (pair.discrete.membranes == pair.emulated.membranes).all()
    for _ in range(40):
        pair._step(SENSORS, 0)
    assert pair.first_divergence is None
    assert pair.emulated.weights == pytest.approx(pair.discrete.weights, abs=1e-12)


def test_a_larger_difference_is_no_tie(pair):
    membrane_at_threshold(pair, 1e-9)
    pair._step(SENSORS, 0)
    assert pair.ties == 0
    assert pair.first_divergence is not None
    assert pair.first_divergence.neuron == 6


def test_weights_that_are_off_by_more_than_a_millionth_allow_no_tie(pair):
    membrane_at_threshold(pair, 5e-16)
    pair.emulated._state.cells["g"][:] *= 1.0 + 1e-5
    pair._step(SENSORS, 0)
    assert pair.ties == 0
    assert pair.first_divergence is not None


def test_restart_takes_over_weights_and_spikes():
    network = Network.random(system="HET", rng=np.random.default_rng(6))
    die = place(network, Hardware.load("het_mixed")).nominal()
    one, other = EmulatedController(die), EmulatedController(die, perturb=0.3)
    spiked, ls = np.zeros(network.neurons, dtype=bool), np.zeros(network.neurons, dtype=np.int64)
    rng = np.random.default_rng(7)
    for sensors in rng.random((30, 6)):
        spiked = one.spikes(sensors)
        other.spikes(sensors)
        ls = np.maximum(np.where(spiked, 3, ls) - 1, 0)
    other.restart_from(membranes=one.membranes, weights=one.weights, spiked=spiked, ls=ls)
    np.testing.assert_allclose(other.weights, one.weights, rtol=0, atol=1e-9)
    assert (other.membranes == one.membranes).all()
