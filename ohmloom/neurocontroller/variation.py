"""Births and mutations (Sections VI and VII): adapt, redraw, add or remove a neuron, toggle, switch."""

from __future__ import annotations

import math

import numpy as np

from ohmloom.errors import expect_type
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, SYSTEMS
from ohmloom.neurocontroller.network import Adaptation, Network
from ohmloom.neurocontroller.readings import Readings
from ohmloom.neurocontroller.rules import INPUTS, Synapse, legal_pairs

RATE_FLOOR = 1e-4  # eq. 13 with 0 < rate <= 1: a rate that reached 0 could never recover
INITIAL_RANGES = {"mu": 0.25, "psi": 0.5, "omega": 1.0, "tau": 0.25}  # Sections VI-A, VII-A, VII-B
NEW_NEURON_ENABLE_PROBABILITY = 0.5  # Section VII-B

Pairs = dict[tuple[int, int], tuple[str, float]]


def random_network(
    system: str, *, rng: np.random.Generator, hidden: int, enable_probability: float, readings: Readings
) -> Network:
    """A network as at the start of evolution: random polarities, synapses with `enable_probability`."""
    rates = {name: max(float(rng.uniform(0.0, top)), RATE_FLOOR) for name, top in INITIAL_RANGES.items()}
    polarities = tuple(_polarity(rng) for _ in range(hidden))
    enabled: Pairs = {}
    for pair in legal_pairs(hidden, readings.lateral):
        if rng.random() < enable_probability:
            enabled[pair] = _new_synapse(system, rng)
    return _assemble(system, polarities, enabled, readings, Adaptation(**rates))


def mutate(parent: Network, *, rng: np.random.Generator) -> Network:
    """One mutated offspring of `parent`; the parent is not changed (eq. 13 is taken by the child only)."""
    expect_type("mutate.parent", parent, Network)
    expect_type("mutate.rng", rng, np.random.Generator)
    system, readings = parent.system, parent.readings
    rates = {}
    for name in INITIAL_RANGES:
        rate = getattr(parent.adaptation, name)
        if rate is None:
            rate = INITIAL_RANGES[name] / 2
        rates[name] = min(max(rate * math.exp(rng.standard_normal()), RATE_FLOOR), 1.0)

    polarities = list(parent.hidden)
    enabled: Pairs = {(s.pre, s.post): (s.kind, s.weight) for s in parent.synapses}
    if system == "GA":
        for pair in enabled:
            if rng.random() < rates["mu"]:
                enabled[pair] = ("constant", float(rng.random()))
    if rng.random() < rates["psi"]:
        if rng.random() < rates["omega"]:
            enabled = _add_neuron(system, polarities, enabled, readings, rng)
        elif len(polarities) > 1:
            enabled = _remove_neuron(polarities, enabled, rng)
    legal = legal_pairs(len(polarities), readings.lateral)
    for pair, toggle in zip(legal, rng.random(len(legal)) < rates["tau"], strict=True):
        if toggle:
            if pair in enabled:
                del enabled[pair]
            else:
                enabled[pair] = _new_synapse(system, rng)
    if system == "HET":
        for pair, (kind, weight) in list(enabled.items()):
            if rng.random() < rates["mu"]:
                others = [other for other in SYSTEMS["HET"] if other != kind]
                enabled[pair] = (others[int(rng.integers(len(others)))], weight)
    return _assemble(system, tuple(polarities), enabled, readings, Adaptation(**rates))


def _polarity(rng: np.random.Generator) -> str:
    return "excitatory" if rng.random() < 0.5 else "inhibitory"


def _new_synapse(system: str, rng: np.random.Generator) -> tuple[str, float]:
    kinds = SYSTEMS[system]
    if system == "GA":
        return "constant", float(rng.random())
    return kinds[int(rng.integers(len(kinds)))] if len(kinds) > 1 else kinds[0], INITIAL_WEIGHT


def _add_neuron(
    system: str, polarities: list[str], enabled: Pairs, readings: Readings, rng: np.random.Generator
) -> Pairs:
    """Append a hidden neuron; the outputs' indices move up by one."""
    new = INPUTS + len(polarities)
    polarities.append(_polarity(rng))
    moved = {(pre, post + (post >= new)): value for (pre, post), value in enabled.items()}
    for pair in legal_pairs(len(polarities), readings.lateral):
        if new in pair and rng.random() < NEW_NEURON_ENABLE_PROBABILITY:
            moved[pair] = _new_synapse(system, rng)
    return moved


def _remove_neuron(polarities: list[str], enabled: Pairs, rng: np.random.Generator) -> Pairs:
    """Remove a hidden neuron drawn uniformly; all higher indices close up, so lateral delays change."""
    gone = int(rng.integers(len(polarities)))
    del polarities[gone]
    neuron = INPUTS + gone
    return {
        (pre - (pre > neuron), post - (post > neuron)): value
        for (pre, post), value in enabled.items()
        if neuron not in (pre, post)
    }


def _assemble(
    system: str, hidden: tuple[str, ...], enabled: Pairs, readings: Readings, adaptation: Adaptation
) -> Network:
    ordered = sorted(enabled.items(), key=lambda item: (item[0][1], item[0][0]))
    synapses = tuple(Synapse(pre, post, kind, weight) for (pre, post), (kind, weight) in ordered)
    return Network(system=system, hidden=hidden, synapses=synapses, readings=readings, adaptation=adaptation)
