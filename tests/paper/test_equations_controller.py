"""Sections IV to VIII of the paper, equation by equation, on both implementations where there are two."""

from __future__ import annotations

import math

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
    plain,
)
from ohmloom.sim import Arena
from ohmloom.sim._arena_kernels import RobotState, judge


@pytest.fixture(params=["plain", "compiled"])
def implementation(request):
    return request.param


def lone_input(implementation, **readings):
    network = Network(system="HP", hidden=("excitatory",), synapses=(), readings=Readings(**readings))
    return SpikingController(network, implementation=implementation)


@pytest.mark.parametrize(("current", "y0"), [(0.0, 0.5), (0.3, 0.123), (0.05, 0.9)])
def test_eq_3_the_membrane_gains_input_and_bias_and_leaks(implementation, current, y0):
    controller = lone_input(implementation, c_ini=y0, y_thresh=10.0)
    y = y0
    for _ in range(15):
        controller.spikes([current] * 6)
        y = y + (current + 0.3 - 0.05 * y)
        assert controller.membranes[0] == pytest.approx(y, rel=1e-14)


def test_eq_3_starts_at_c_ini_and_is_clamped_at_zero(implementation):
    assert lone_input(implementation).membranes.tolist() == [0.5] * 9
    inhibited = Network(system="GA", hidden=("excitatory", "inhibitory"), readings=Readings(synapse_gain=1.0),
                        synapses=(Synapse(0, 7, "constant", 1.0), Synapse(7, 6, "constant", 1.0)))  # fmt: skip
    controller = SpikingController(inhibited, implementation=implementation)
    membranes = []
    for _ in range(60):
        controller.spikes([1, 0, 0, 0, 0, 0])
        membranes.append(controller.membranes[6])
    assert min(membranes) == 0.0


def test_eq_4_a_spike_needs_more_than_the_threshold_and_resets_to_c(implementation):
    exactly = lone_input(implementation, a=0.5, b=0.0, c_ini=0.5)
    assert not exactly.spikes([0.0] * 6)[0]
    assert exactly.membranes[0] == 1.0
    above = lone_input(implementation, a=0.5, b=0.0, c_ini=0.5 + 2**-52, c=0.125)
    assert above.spikes([0.0] * 6)[0]
    assert above.membranes[0] == 0.125


def test_eq_5_the_delay_inside_the_hidden_layer_is_the_distance_of_the_indices():
    network = Network(system="HP", hidden=("excitatory",) * 9, synapses=())
    for sender in range(6, 15):
        for receiver in range(6, sender):
            assert network.delay(Synapse(sender, receiver, "hp", 0.5)) == sender - receiver
        assert network.delay(Synapse(sender, 15, "hp", 0.5)) == 1
    assert all(network.delay(Synapse(i, 14, "hp", 0.5)) == 1 for i in range(6))
    lateral = {(pre, post) for pre, post in network.legal if pre >= 6 and post < 15}
    assert lateral == {(pre, post) for pre in range(6, 15) for post in range(6, pre)}


@pytest.mark.parametrize("spikes", range(22))
def test_eq_6_half_of_the_window_makes_an_output_high(spikes):
    is_high = spikes >= 21 / 2
    assert plain.classify((spikes, 0), Readings().high_count) == (plain.LEFT if is_high else plain.FORWARD)
    assert _kernels.classify(0, spikes, Readings().high_count) == (_kernels.RIGHT if is_high else _kernels.FORWARD)


@pytest.mark.parametrize(("equation", "ls_pre", "ls_post", "sign"), [
    ("10", 2, 3, 1), ("11", 3, 2, -1), ("neither", 3, 3, 0), ("neither", 1, 3, 0), ("neither", 3, 1, 0),
    ("neither", 0, 3, 0), ("neither", 2, 2, 0),
])  # fmt: skip
def test_eqs_10_and_11_only_spikes_one_step_apart_count(equation, ls_pre, ls_post, sign):
    assert plain.stdp_sign(ls_pre, ls_post, Readings().stdp_threshold) == sign


def test_eqs_10_and_11_pre_before_post_strengthens_and_post_before_pre_weakens(implementation):
    # Gain 2: one spike over W = 0.5 lifts the receiver over its threshold.
    readings = Readings(a=0.0, b=0.0, c_ini=0.0, y_thresh=0.9, synapse_gain=2.0)
    network = Network(system="HP", hidden=("excitatory",), readings=readings, synapses=(Synapse(0, 6, "hp", 0.5),))
    controller = SpikingController(network, implementation=implementation)
    for sensor in (1, 0, 0, 0):
        controller.spikes([sensor, 0, 0, 0, 0, 0])
    assert controller.events == (1, 0)
    assert controller.weights[0] > 0.5
    controller.reset()
    for sensor in (1, 0, 1, 0):  # the sensor's second spike comes one step after neuron 6
        controller.spikes([sensor, 0, 0, 0, 0, 0])
    assert controller.events[1] == 1


@pytest.mark.parametrize("kind", ["hp", "peo_pani"])
def test_eq_12_one_event_is_a_thousandth_of_q_max(kind):
    lattice = LATTICES[kind]
    assert lattice.event * 1000 == lattice.top
    assert lattice.event / lattice.unit == pytest.approx(0.99 / 1000, rel=1e-12)
    assert lattice.weight(0) == pytest.approx(0.01, rel=1e-12)
    assert lattice.weight(lattice.start) == pytest.approx(0.5, rel=1e-12)
    assert lattice.weight(lattice.top) == pytest.approx(1.0, rel=1e-12)


def test_eq_13_rates_are_multiplied_by_log_normal_numbers():
    parent = Network.random(system="HP", rng=np.random.default_rng(0)).replace(
        adaptation=Adaptation(mu=0.01, psi=0.01, omega=0.01, tau=0.01)
    )
    children = [mutate(parent, rng=np.random.default_rng(seed)).adaptation for seed in range(600)]
    logs = np.log([[c.mu, c.psi, c.omega, c.tau] for c in children]) - math.log(0.01)
    # Four rates of 600 children; 0.01 is over 4.6 standard deviations from both limits.
    assert np.mean(logs) == pytest.approx(0.0, abs=0.1)
    assert np.std(logs) == pytest.approx(1.0, abs=0.06)
    # Independent of each other.
    assert np.abs(np.corrcoef(logs.T) - np.eye(4)).max() < 0.2


def test_eq_13_a_rate_never_leaves_its_range():
    for value in (1e-4, 1.0):
        parent = Network.random(system="HP", rng=np.random.default_rng(0)).replace(
            adaptation=Adaptation(mu=value, psi=value, omega=value, tau=value)
        )
        found = [mutate(parent, rng=np.random.default_rng(seed)).adaptation.omega for seed in range(60)]
        assert min(found) >= 1e-4
        assert max(found) <= 1.0
        assert value in found  # about half of the factors lead beyond the limit


@pytest.mark.parametrize(("x", "y", "st", "fitness"), [
    (-0.75, -0.75, 1, 1000 / 3.1 - 1), (0.0, 0.6, 300, 700.0), (0.59, 0.96, 200, 9800.0), (0.66, 0.95, 700, 11800.0),
    (-0.9, -0.9, 300, 1e-6),
])  # fmt: skip
def test_eq_14_distance_to_the_goal_less_the_time(x, y, st, fitness):
    robot = RobotState(np.array([x, y, 0.0]), np.array([st, 0, 0, st, 0]), np.array([1e-6]))
    judge(Arena.paper().world(), robot, np.uint64(0))
    assert robot.best[0] == pytest.approx(fitness, rel=1e-12)
