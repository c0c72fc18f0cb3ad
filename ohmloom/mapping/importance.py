"""How much of what the outputs receive runs through each synapse: what a repair gives up last."""

from __future__ import annotations

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.neurocontroller import Network
from ohmloom.neurocontroller.rules import OUTPUTS

LEAST = 1e-3  # also of a synapse that leads to no output: it costs nothing to repair it where that is free


def neuron_influence(network: Network) -> FloatArray:
    """Share of the outputs' input that a spike of each neuron is, weights being equal; axes (neuron,).

    An output counts 1. What a neuron counts is shared among the synapses into it, and each sender counts what its
    synapses do. Signals that go round are followed as often as there are neurons.
    """
    n = network.neurons
    share = np.zeros((n, n))  # (sender, receiver)
    for synapse in network.synapses:
        share[synapse.pre, synapse.post] = 1.0
    share /= np.maximum(share.sum(axis=0), 1.0)
    outputs = np.zeros(n)
    outputs[-OUTPUTS:] = 1.0
    influence = outputs
    for _ in range(n):
        influence = outputs + share @ influence
        influence[-OUTPUTS:] = 1.0
    return influence


def column_importance(network: Network) -> FloatArray:
    """What a device on each receiver's bit line counts, (neuron,), at least `LEAST`, and at most 1.

    A device where no synapse should be counts as much, since it adds to the same sum.

    Examples
    --------
    >>> from ohmloom.neurocontroller import champion
    >>> importance = column_importance(champion("GA"))
    >>> bool(importance[-2:].max() > importance[6:-2].mean())
    True
    """
    influence = neuron_influence(network)
    inputs = np.zeros(network.neurons)
    for synapse in network.synapses:
        inputs[synapse.post] += 1.0
    return np.clip(influence / np.maximum(inputs, 1.0), LEAST, 1.0)
