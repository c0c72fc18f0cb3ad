"""How far a way of writing departs from the paper's rule: both move weights on the very same spikes.

Left to themselves two controllers part for good after the first spike that differs, whatever caused it; `agreement`
says when. What drive and devices make of an event is seen only where both sides get the same events.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.mapping import Die, EmulatedController
from ohmloom.neurocontroller.kinds import LATTICES, PLASTIC_KINDS
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP

TIMESTEPS = 200  # at most: with some five events a timestep a weight has crossed its range by then


@dataclass(frozen=True, kw_only=True)
class Writing:
    """Root mean square difference of the weights from the paper's rule, worst over the timesteps.

    Attributes
    ----------
    worst, worst_of
        Over all plastic synapses, and by kind.
    timesteps
        How many were compared.
    """

    worst: float
    worst_of: Mapping[str, float]
    timesteps: int


def writing_divergence(die: Die, sensors: FloatArray, *, timesteps: int = TIMESTEPS) -> Writing:
    """Run a die on sensor values, axes (timestep, 6), and the paper's rule on the die's own spikes.

    Raises
    ------
    OperationError
        If the potentials of wires do not converge.
    """
    network, emulated = die.plan.network, EmulatedController(die)
    r, kinds = network.readings, np.array([s.kind for s in network.synapses], dtype=object)
    plastic = np.flatnonzero(np.isin(kinds, PLASTIC_KINDS))
    if not plastic.size:
        return Writing(worst=0.0, worst_of={}, timesteps=0)
    pre = np.array([network.synapses[k].pre for k in plastic])
    post = np.array([network.synapses[k].post for k in plastic])
    lattices = [LATTICES[kinds[k]] for k in plastic]
    charge = np.array([one.start for one in lattices], dtype=np.int64)
    event = np.array([one.event for one in lattices], dtype=np.int64)
    top = np.array([one.top for one in lattices], dtype=np.int64)
    levels = range(r.last_spike + 1)
    rule = np.array([[stdp_sign(a, b, r.stdp_threshold) for b in levels] for a in levels])
    ls = np.zeros(network.neurons, dtype=np.int64)
    squares = []
    for values in sensors[:timesteps]:
        emulated.begin_timestep()
        if not r.carry_state:
            ls[:] = 0
        for _ in range(STEPS_PER_TIMESTEP):
            ls[emulated.spikes(values)] = r.last_spike
            charge = np.clip(charge + rule[ls[pre], ls[post]] * event, 0, top)
            np.maximum(ls - 1, 0, out=ls)
        ruled = np.array([one.weight(int(q)) for one, q in zip(lattices, charge, strict=True)])
        squares.append((emulated.weights[plastic] - ruled) ** 2)
    of_kind = kinds[plastic]
    found = np.array(squares).reshape(-1, len(plastic))
    worst_of = {str(k): _worst(found[:, of_kind == k]) for k in np.unique(of_kind)}
    return Writing(worst=_worst(found), worst_of=worst_of, timesteps=len(found))


def _worst(squares: FloatArray) -> float:
    return float(np.sqrt(squares.mean(axis=1)).max(initial=0.0))
