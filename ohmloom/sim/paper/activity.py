"""STDP events and weights through a trial, kind by kind (Sections X-B and XI)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP
from ohmloom.sim.arena import Arena
from ohmloom.sim.trial import run_trial

ARRAYS = ("positive", "negative", "weight", "actions")
LONGEST_GAP = 20  # timesteps straight ahead within what is still one turn


@dataclass(frozen=True, kw_only=True, eq=False)
class Activity:
    """One trial of one network.

    Attributes
    ----------
    positive, negative
        (timestep, kind) STDP events; kinds as `PLASTIC_KINDS`.
    weight
        (timestep, kind) mean weight at the end of the timestep; NaN for a kind that the network does not have.
    actions
        (timestep,) 0 forward, 1 left, 2 right.
    """

    positive: IntArray
    negative: IntArray
    weight: FloatArray
    actions: IntArray

    def to_dict(self) -> dict[str, list[Any]]:
        """As lists, None for NaN."""
        found: dict[str, list[Any]] = {name: getattr(self, name).tolist() for name in ARRAYS}
        found["weight"] = [[None if math.isnan(value) else value for value in row] for row in found["weight"]]
        return found

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Activity:
        """From what `to_dict` gave."""
        counts = {name: np.array(table[name], dtype=np.int64) for name in ARRAYS if name != "weight"}
        return cls(weight=np.array(table["weight"], dtype=np.float64), **counts)

    def turn(self) -> tuple[int, int] | None:
        """First and last timestep of the longest turn, or None if the robot never turned."""
        turning = np.flatnonzero(self.actions)
        if not len(turning):
            return None
        parts = np.split(turning, np.flatnonzero(np.diff(turning) > LONGEST_GAP) + 1)
        longest = max(parts, key=len)
        return int(longest[0]), int(longest[-1])


def record_activity(network: Network, arena: Arena, trial_key: int) -> Activity:
    """Run one trial and count its STDP events, timestep by timestep and kind by kind."""
    controller = SpikingController(network)
    trial = run_trial(controller, arena, trial_key=trial_key)
    totals = controller.events
    timesteps = len(trial.actions)
    spikes = np.zeros((timesteps, STEPS_PER_TIMESTEP, network.neurons), dtype=np.bool_)
    weights = np.zeros((timesteps, len(network.synapses)))
    controller.reset()
    for t in range(timesteps):
        controller.begin_timestep()
        for step in range(STEPS_PER_TIMESTEP):
            spikes[t, step] = controller.spikes(trial.sensors[t])
        weights[t] = controller.weights
    signs = event_signs(network, spikes)
    of_kind = [np.array([s.kind == kind for s in network.synapses], dtype=np.bool_) for kind in PLASTIC_KINDS]
    counts = [np.stack([(signs[..., mask] == sign).sum(axis=(1, 2)) for mask in of_kind], axis=1) for sign in (1, -1)]
    # Spikes that were made again must give the events that the controller itself counted.
    assert tuple(int(count.sum()) for count in counts) == totals, "the trial, run again, had other events"
    mean = np.stack(
        [weights[:, mask].mean(axis=1) if mask.any() else np.full(timesteps, np.nan) for mask in of_kind], axis=1
    )
    return Activity(positive=counts[0], negative=counts[1], weight=mean, actions=trial.actions)


def event_signs(network: Network, spikes: np.ndarray) -> np.ndarray:
    """Events by eqs. 10 and 11: spikes (timestep, step, neuron) in, +1, -1 or 0 (timestep, step, synapse) out."""
    readings = network.readings
    flat = spikes if not readings.carry_state else spikes.reshape(1, -1, spikes.shape[2])
    last = np.where(flat, np.arange(flat.shape[1])[:, np.newaxis], -readings.last_spike)
    since = np.arange(flat.shape[1])[:, np.newaxis] - np.maximum.accumulate(last, axis=1)
    ls = np.maximum(readings.last_spike - since, 0).reshape(spikes.shape)
    levels = range(readings.last_spike + 1)
    rule = np.array([[stdp_sign(pre, post, readings.stdp_threshold) for post in levels] for pre in levels])
    pre, post = (np.array([getattr(s, end) for s in network.synapses], dtype=np.int64) for end in ("pre", "post"))
    return rule.astype(np.int8)[ls[..., pre], ls[..., post]]
