"""Small chains of neurons whose spike steps are worked out by hand, on both implementations.

With a = b = c_ini = 0 a membrane holds what has arrived since its last spike, so that the sums can be done in the head.
"""

from __future__ import annotations

import pytest

from ohmloom.neurocontroller import Network, Readings, SpikingController, Synapse

COUNTING = {"a": 0.0, "b": 0.0, "c_ini": 0.0, "y_thresh": 0.9}


@pytest.fixture(params=["plain", "compiled"])
def implementation(request):
    return request.param


def chain(*pairs, hidden=("excitatory",) * 3, system="GA", weight=1.0, **readings):
    kind = {"GA": "constant", "LIN": "linear"}[system]
    return Network(
        system=system,
        hidden=hidden,
        synapses=tuple(Synapse(pre, post, kind, weight) for pre, post in pairs),
        readings=Readings(**(COUNTING | readings)),
    )


def spike_steps(network, implementation, inputs, steps=12):
    """Steps (from 1) at which each neuron spikes; `inputs` maps an input to the steps at which its sensor is 1."""
    controller = SpikingController(network, implementation=implementation)
    found = {}
    for step in range(1, steps + 1):
        spiked = controller.spikes([1.0 if step in inputs.get(j, ()) else 0.0 for j in range(6)])
        for neuron in spiked.nonzero()[0].tolist():
            found.setdefault(neuron, []).append(step)
    return found


def test_eq_5_one_step_between_layers_and_the_distance_inside_the_hidden_layer(implementation):
    network = chain((0, 8), (8, 6), (6, 9), synapse_gain=1.0)
    # 0 spikes at 1; 8 one step later; 6 two more (8 - 6); the output one more.
    assert spike_steps(network, implementation, {0: [1]}) == {0: [1], 8: [2], 6: [4], 9: [5]}


def test_neighbours_in_the_hidden_layer_are_one_step_apart(implementation):
    network = chain((0, 8), (8, 7), (7, 6), (6, 10), synapse_gain=1.0)
    assert spike_steps(network, implementation, {0: [1]}) == {0: [1], 8: [2], 7: [3], 6: [4], 10: [5]}


def test_spikes_on_the_way_follow_each_other(implementation):
    network = chain((0, 8), (8, 6), synapse_gain=1.0)
    expected = {0: [1, 2, 4], 8: [2, 3, 5], 6: [4, 5, 7]}
    assert spike_steps(network, implementation, {0: [1, 2, 4]}) == expected


def test_hidden_delay_one(implementation):
    network = chain((0, 8), (8, 6), (6, 9), synapse_gain=1.0, hidden_delay="one")
    assert spike_steps(network, implementation, {0: [1]}) == {0: [1], 8: [2], 6: [3], 9: [4]}


def test_ascending_lateral_synapses_have_the_same_distance(implementation):
    network = chain((0, 6), (6, 8), (8, 9), synapse_gain=1.0, lateral="ascending")
    assert spike_steps(network, implementation, {0: [1]}) == {0: [1], 6: [2], 8: [4], 9: [5]}


def test_a_loop_of_both_directions_keeps_a_spike_alive(implementation):
    network = chain((0, 8), (8, 6), (6, 8), synapse_gain=1.0, lateral="both")
    assert spike_steps(network, implementation, {0: [1]}) == {0: [1], 8: [2, 6, 10], 6: [4, 8, 12]}


@pytest.mark.parametrize(("gain", "first"), [(1.0, 2), (0.5, 3), (0.25, 5), (0.125, 9)])
def test_gain_says_how_many_spikes_reach_the_threshold(implementation, gain, first):
    # The input spikes in every step; gain * n first exceeds 0.9 with the n-th arrival, and arrivals begin at step 2.
    network = chain((0, 6), synapse_gain=gain)
    assert spike_steps(network, implementation, {0: range(1, 13)})[6][0] == first


def test_default_gain_is_a_quarter():
    assert Readings().synapse_gain == 0.25


def test_an_inhibitory_neuron_subtracts(implementation):
    # 7 spikes at 2 and inhibits 6 from step 3 on, where it cancels input 0.
    network = chain((0, 6), (1, 7), (7, 6), hidden=("excitatory", "inhibitory"), synapse_gain=1.0)
    assert spike_steps(network, implementation, {0: [1, 2, 3], 1: [1, 2]}) == {
        0: [1, 2, 3], 1: [1, 2], 6: [2], 7: [2, 3],
    }  # fmt: skip


@pytest.mark.parametrize(("clamp", "first"), [(True, 4), (False, 5)])
def test_clamp_forgets_inhibition_below_zero(implementation, clamp, first):
    # Inhibition arrives at step 3 and excitation from step 4: -1 + 1 = 0 without the clamp, so one more is needed.
    network = chain((0, 6), (1, 7), (7, 6), hidden=("excitatory", "inhibitory"), synapse_gain=1.0, clamp=clamp)
    assert spike_steps(network, implementation, {0: range(3, 13), 1: [1]})[6][0] == first


@pytest.mark.parametrize(("weight_at", "steps"), [("arrival", [2]), ("emission", [2, 5])])
def test_which_weight_a_travelling_spike_brings(implementation, weight_at, steps):
    # 6 spikes at 2 and 8 at 3, so the synapse 8 -> 6 falls from 0.500 to 0.499 at the end of step 3, while the spike
    # that 8 sent at 3 is under way. It arrives at 5 with 2 * 0.499 < 0.999 or with 2 * 0.500 > 0.999.
    network = chain((0, 8), (1, 6), (8, 6), system="LIN", weight=0.5, synapse_gain=2.0, weight_at=weight_at,
                    y_thresh=0.999)  # fmt: skip
    assert spike_steps(network, implementation, {0: [2], 1: [1]})[6] == steps


def test_an_event_of_the_linear_kind_moves_the_weight_by_a_thousandth(implementation):
    network = chain((0, 6), (6, 9), system="LIN", weight=0.5, synapse_gain=2.0)
    controller = SpikingController(network, implementation=implementation)
    for step in range(1, 4):
        controller.spikes([float(step == 1), 0, 0, 0, 0, 0])
    # 0 at step 1, 6 at 2, 9 at 3: each synapse has one positive event.
    assert controller.weights.tolist() == [0.501, 0.501]
    assert controller.events == (2, 0)


def test_last_spike_widens_the_window(implementation):
    # Input at 1 and 4, 6 at 2. (ls_pre, ls_post) with last_spike 3: (2, 3) +, (1, 2), (3, 1).
    # With last_spike 4: (3, 4) +, (2, 3) +, (4, 2) -.
    for last_spike, events in ((3, (1, 0)), (4, (2, 1))):
        network = chain((0, 6), system="LIN", weight=0.5, synapse_gain=2.0, last_spike=last_spike)
        controller = SpikingController(network, implementation=implementation)
        for step in range(1, 5):
            controller.spikes([float(step in (1, 4)), 0, 0, 0, 0, 0])
        assert controller.events == events


def test_carry_state(implementation):
    # Two sensor values of 0.5 make a spike only if the first is remembered into the next timestep.
    for carry_state, counts in ((True, [0, 1]), (False, [0, 0])):
        network = chain(carry_state=carry_state, y_thresh=21 * 0.03, synapse_gain=1.0)
        controller = SpikingController(network, implementation=implementation)
        found = []
        for _ in range(2):
            controller.step([0.02, 0, 0, 0, 0, 0])
            found.append(int(controller.spike_counts[0]))
        assert found == counts
