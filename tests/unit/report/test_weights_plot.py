"""Weights over a trial: the lines are the data; a recording carries an agreement into the replay."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.report import plot_weights, recording_of
from ohmloom.report._replay_data import KINDS
from ohmloom.sim import Feasibility


def test_medians_of_each_kind_are_solid_for_discrete_and_dashed_for_hardware(het_study: Feasibility) -> None:
    check, plan = het_study.agreement, het_study.plan
    assert check is not None
    assert plan is not None
    lines = {line.get_gid(): line for line in plot_weights(check, plan.network).lines if line.get_gid()}
    kinds = np.array([synapse.kind for synapse in plan.network.synapses])
    assert len(lines) == 2 * len(set(kinds))
    for kind in set(kinds):
        for side, data, style in (("discrete", check.weights, "-"), ("hardware", check.emulated_weights, "--")):
            line = lines[f"{kind} {side}"]
            np.testing.assert_array_equal(line.get_ydata(), np.median(data[:, kinds == kind], axis=1))
            assert (line.get_color(), line.get_linestyle()) == (KINDS[kind], style)


def test_band_reaches_from_the_lower_to_the_upper_quartile(het_study: Feasibility) -> None:
    check, plan = het_study.agreement, het_study.plan
    assert check is not None
    assert plan is not None
    bands = {c.get_gid(): c for c in plot_weights(check, plan.network).collections}
    index = [k for k, synapse in enumerate(plan.network.synapses) if synapse.kind == "hp"]
    low, high = np.quantile(check.weights[:, index], (0.25, 0.75), axis=1)
    drawn = {tuple(vertex) for vertex in bands["hp discrete quartiles"].get_paths()[0].vertices}
    for edge in (low, high):
        assert {(t + 1.0, w) for t, w in enumerate(edge)} <= drawn


def test_another_networks_weights_are_refused(het_study: Feasibility, ga_study: Feasibility) -> None:
    assert het_study.agreement is not None
    assert ga_study.plan is not None
    for refuse, where in ((plot_weights, "plot_weights"), (recording_of, "recording_of")):
        with pytest.raises(ParameterError, match=rf"{where}\.network: expected the network that was run, sha256 "):
            refuse(het_study.agreement, ga_study.plan.network)


def test_recording_holds_the_discrete_side_of_the_agreement(het_study: Feasibility) -> None:
    check, plan = het_study.agreement, het_study.plan
    assert check is not None
    assert plan is not None
    network = plan.network
    recording = recording_of(check, network)
    assert recording.trial is check.trial
    np.testing.assert_array_equal(recording.weights, check.weights)
    np.testing.assert_array_equal(recording.spikes, check.spikes)
    assert recording.network_name == network.name
    assert recording.neuron_labels == tuple(network.labels())
    assert recording.synapse_kinds == tuple(synapse.kind for synapse in network.synapses)
    first = network.synapses[0]
    assert recording.synapse_labels[0] == f"{network.labels()[first.pre]} → {network.labels()[first.post]}"
