"""Where a network's synapses are: how many of each kind by layer, by neuron type and by sensor (Section XI)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ohmloom.neurocontroller.kinds import KINDS
from ohmloom.neurocontroller.network import Network
from ohmloom.neurocontroller.rules import INPUTS, Synapse

LAYERS: Final = ("input_hidden", "hidden_hidden", "hidden_output")
INFRARED: Final = 3  # the first inputs; the others are light sensors (Section VIII)
Place = Callable[[Network, Synapse], bool]


def layer(network: Network, synapse: Synapse) -> str:
    """Layers that a synapse joins: ``input_hidden``, ``hidden_hidden`` or ``hidden_output``."""
    if synapse.pre < INPUTS:
        return LAYERS[0]
    return LAYERS[1] if synapse.post < INPUTS + len(network.hidden) else LAYERS[2]


def _polarity(network: Network, neuron: int) -> str | None:
    hidden = neuron - INPUTS
    return network.hidden[hidden] if 0 <= hidden < len(network.hidden) else None


def _joins(layers: str) -> Place:
    return lambda network, synapse: layer(network, synapse) == layers


def _is_at(end: str, polarity: str) -> Place:
    return lambda network, synapse: _polarity(network, getattr(synapse, end)) == polarity


# Each place that the paper counts synapses in. Inputs and outputs have no type of their own there.
PLACES: Final[dict[str, Place]] = {
    "all": lambda network, synapse: True,
    **{name: _joins(name) for name in LAYERS},
    "pre_excitatory": _is_at("pre", "excitatory"),
    "pre_inhibitory": _is_at("pre", "inhibitory"),
    "post_excitatory": _is_at("post", "excitatory"),
    "post_inhibitory": _is_at("post", "inhibitory"),
    "infrared": lambda network, synapse: synapse.pre < INFRARED,
    "light": lambda network, synapse: INFRARED <= synapse.pre < INPUTS,
}


def count_synapses(network: Network, place: str) -> dict[str, int]:
    """Synapses of each kind in one of `PLACES`.

    Examples
    --------
    >>> import numpy as np
    >>> network = Network.random(system="GA", rng=np.random.default_rng(1))
    >>> counts = [count_synapses(network, name)["constant"] for name in LAYERS]
    >>> sum(counts) == len(network.synapses)
    True
    """
    is_there = PLACES[place]
    found = [synapse.kind for synapse in network.synapses if is_there(network, synapse)]
    return {kind: found.count(kind) for kind in KINDS}
