"""The discrete controller as a page that reads like the paper (Sections IV and V): slow, and an oracle."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from ohmloom.neurocontroller.kinds import LATTICES
from ohmloom.neurocontroller.network import Network
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP, Readings
from ohmloom.neurocontroller.rules import INPUTS

FORWARD, LEFT, RIGHT = 0, 1, 2


def membrane(y: float, current: float, bias: float, r: Readings) -> tuple[float, bool]:
    """Eq. 3: the next membrane potential, before a reset, and whether it is above the threshold (eq. 4)."""
    y = y + (current + bias - r.b * y)
    if r.clamp and y < 0.0:
        y = 0.0
    return y, y > r.y_thresh


def stdp_sign(ls_pre: int, ls_post: int, threshold: int) -> int:
    """Eqs. 10 and 11: +1, -1 or 0 events for a synapse between neurons with these ls values."""
    if ls_pre + ls_post > threshold:
        return (ls_post > ls_pre) - (ls_pre > ls_post)
    return 0


def classify(spikes: Sequence[int], high_count: int) -> int:
    """Eq. 6 and Section VIII-A: the action for the spike counts of the two outputs."""
    first_high, second_high = spikes[0] >= high_count, spikes[1] >= high_count
    if first_high == second_high:
        return FORWARD
    return LEFT if first_high else RIGHT


class PlainController:
    """Steps a network as the paper describes it: plain numbers, one loop per sentence.

    Plastic kinds move on the paper's lattices, or as `events` says, a `DeviceEvents` per kind.
    """

    def __init__(self, network: Network, events: Mapping[str, Any] | None = None) -> None:
        self.network = network
        self.models: Mapping[str, Any] = LATTICES if events is None else events
        self.is_lattice = events is None
        self.readings = network.readings
        self.inbound = network.inbound()
        self.reset()

    def reset(self) -> None:
        """Everything as at the start of a trial, weights included."""
        self.charges = [self.models[s.kind].start if s.kind in LATTICES else None for s in self.network.synapses]
        self.weights = [
            s.weight if charge is None or self.is_lattice else self.models[s.kind].weight(charge)
            for s, charge in zip(self.network.synapses, self.charges, strict=True)
        ]
        self.events = [[0, 0] for _ in self.network.synapses]
        self.counts = [0] * self.network.neurons
        self._reset_activity()

    def _reset_activity(self) -> None:
        neurons = self.network.neurons
        self.y = [self.readings.c_ini] * neurons
        self.ls = [0] * neurons
        self.now = 0
        self.travelling: dict[int, dict[int, float | None]] = defaultdict(dict)

    def timestep(self, sensors: Sequence[float]) -> int:
        """21 steps with constant sensor values; the action."""
        self.begin_timestep()
        self.counts = [0] * self.network.neurons
        for _ in range(STEPS_PER_TIMESTEP):
            spiked = self.step(sensors)
            self.counts = [count + spike for count, spike in zip(self.counts, spiked, strict=True)]
        return classify(self.counts[-2:], self.readings.high_count)

    def begin_timestep(self) -> None:
        """A network that does not carry its state over starts every timestep anew, weights excepted."""
        if not self.readings.carry_state:
            self._reset_activity()

    def step(self, sensors: Sequence[float]) -> list[bool]:
        """One step, all neurons at once; which neurons spiked."""
        r, synapses = self.readings, self.network.synapses
        arrived = self.travelling.pop(self.now, {})
        spiked = [False] * self.network.neurons
        for j in range(self.network.neurons):
            if j < INPUTS:
                current = sensors[j]
            else:
                total = 0.0
                for k in self.inbound[j]:  # ascending presynaptic index
                    if k in arrived:
                        sent = arrived[k]
                        total += self.network.sign(synapses[k].pre) * (self.weights[k] if sent is None else sent)
                current = r.synapse_gain * total
            bias = r.a if j >= INPUTS or r.input_bias else 0.0
            self.y[j], spiked[j] = membrane(self.y[j], current, bias, r)
            if spiked[j]:
                self.y[j] = r.c
        self._send(spiked)
        self._stdp(spiked)
        self.now += 1
        return spiked

    def _send(self, spiked: list[bool]) -> None:
        for k, synapse in enumerate(self.network.synapses):
            if spiked[synapse.pre]:
                sent = self.weights[k] if self.readings.weight_at == "emission" else None
                self.travelling[self.now + self.network.delay(synapse)][k] = sent

    def _stdp(self, spiked: list[bool]) -> None:
        for j, spike in enumerate(spiked):
            if spike:
                self.ls[j] = self.readings.last_spike
        for k, synapse in enumerate(self.network.synapses):
            sign = stdp_sign(self.ls[synapse.pre], self.ls[synapse.post], self.readings.stdp_threshold)
            charge = self.charges[k]
            if sign and charge is not None:
                model = self.models[synapse.kind]
                self.charges[k] = model.moved(charge, sign)
                self.weights[k] = model.weight(self.charges[k])
                self.events[k][sign < 0] += 1
        self.ls = [max(value - 1, 0) for value in self.ls]
