"""The emulated controller: a die behind ``reset`` and ``step``, as the ideal network is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.errors import ParameterError, expect_number, expect_type
from ohmloom.mapping.die import Die
from ohmloom.mapping.plan import reads_with_reference
from ohmloom.neurocontroller.controller import ACTIONS, checked_sensors
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """What programming and reading cost since the last reset.

    Attributes
    ----------
    events, ideal_events, lost, spurious
        Events written; events that eqs. 10 and 11 ask for on the same spikes; asked for and not (or wrongly)
        written; written and not (or wrongly) asked for.
    charge, programming_energy, read_energy
        Transported charge [C], energy in the devices [J].
    spikes, steps
        Spikes of all neurons; steps of 1/21 timestep.
    reading_time
        Time to read the columns of the widest tile one after the other, the same in every step [s].
    mean_programming_time, worst_programming_time
        Programming time of a step [s]; tiles are programmed side by side.
    most_pulses, pulses
        Of the device that has most; of all.
    """

    events: int
    ideal_events: int
    lost: int
    spurious: int
    charge: float
    programming_energy: float
    read_energy: float
    spikes: int
    steps: int
    reading_time: float
    mean_programming_time: float
    worst_programming_time: float
    most_pulses: int
    pulses: int


class EmulatedController:
    """Runs a network on a die: every synapse is a device that follows its own law, charge by charge.

    Parameters
    ----------
    die
        From `Plan.sample` or `Plan.nominal`.
    perturb
        Relative error of every event's charge; 0 is right. For tests that must notice a wrong charge.

    Raises
    ------
    ParameterError
        If `die` is no Die, or `perturb` no number > -1.

    Examples
    --------
    >>> import numpy as np
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import Network
    >>> network = Network.random(system="HET", rng=np.random.default_rng(1))
    >>> die = place(network, Hardware.load("het_mixed")).sample(seed=7)
    >>> EmulatedController(die).step([0, 0, 0, 0.2, 0.8, 1.0]) in ("forward", "left", "right")
    True
    """

    def __init__(self, die: Die, *, perturb: float = 0.0) -> None:
        from ohmloom.mapping import _kernels

        expect_type("EmulatedController.die", die, Die)
        perturb = expect_number("EmulatedController.perturb", perturb, "a number > -1, at most 1e6")
        if not -1.0 < perturb <= 1e6:
            raise ParameterError(f"EmulatedController.perturb: expected a number > -1, at most 1e6, got {perturb}. "
                                 "Use 0.001 or so.")  # fmt: skip
        self.die = die
        self._kernels = _kernels
        self._fabric, self._order = _fabric(die, perturb)
        self._columns = max((len(tile.columns) for tile in die.plan.tiles), default=1)
        self._last_spike = die.plan.network.readings.last_spike
        n, synapses = self._fabric.neurons, len(self._fabric.sender)
        slots = int(self._fabric.tap.max(initial=1)) + 1
        self._state = _kernels.FabricState(
            np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros((slots, n), dtype=np.bool_),
            np.zeros(1, dtype=np.int64), np.zeros(synapses), np.zeros(synapses), np.zeros(synapses, dtype=np.int64),
            np.zeros((self._fabric.tiles, self._columns, 2)), np.zeros(_kernels.TOTALS),
        )  # fmt: skip
        self._counts = np.zeros(n, dtype=np.int64)
        self.reset()

    def reset(self) -> None:
        """Back to the start of a trial: every device in its programmed state."""
        self._kernels.reset(self._fabric, self._state)
        self._counts[:] = 0

    def step(self, sensors: Sequence[float] | FloatArray) -> str:
        """One timestep of 21 steps; sensors (6,) in [0, 1] in, ``forward``, ``left`` or ``right`` out."""
        values = checked_sensors("EmulatedController.step", sensors)
        action = self._kernels.timestep(self._fabric, self._state, values, self._counts, self._last_spike)
        return ACTIONS[action]

    def spikes(self, sensors: Sequence[float] | FloatArray) -> npt.NDArray[np.bool_]:
        """One single step; which neurons spiked, axes (neuron,). For comparisons step by step."""
        values = checked_sensors("EmulatedController.spikes", sensors)
        spiked = np.zeros(self._fabric.neurons, dtype=np.int64)
        self._kernels.run_steps(self._fabric, self._state, values, spiked, self._last_spike, 1)
        return spiked.astype(np.bool_)

    def begin_timestep(self) -> None:
        """What `step` does before its 21 steps: a network that does not carry its state over starts anew."""
        if not self._fabric.carry:
            self._kernels.reset_activity(self._fabric, self._state)

    @property
    def output_spikes(self) -> IntArray:
        """Spikes of the left and the right output in the last timestep, (2,), each 0 to 21."""
        return self._counts[-2:].copy()

    @property
    def spike_counts(self) -> IntArray:
        """Spikes of every neuron in the last timestep, (neuron,)."""
        return self._counts.copy()

    @property
    def conductances(self) -> FloatArray:
        """Conductance of each synapse's device [S], in the network's order."""
        values: FloatArray = self._in_order(self._state.g)
        return values

    @property
    def states(self) -> FloatArray:
        """State s of each synapse's device, in [0, 1], in the network's order."""
        values: FloatArray = self._in_order(self._state.state)
        return values

    @property
    def weights(self) -> FloatArray:
        """Weights as the periphery reads them, in the network's order: (G - reference) / (G_on - reference)."""
        tile = self._fabric.tile
        gain = self._fabric.gain[tile] * self._fabric.read_voltage
        values: FloatArray = self._in_order((self._state.g - self._fabric.reference[tile]) * gain)
        return values

    @property
    def membranes(self) -> FloatArray:
        """Membrane potentials after resets, (neuron,), normalised."""
        values: FloatArray = self._state.y.copy()
        return values

    @property
    def pulses(self) -> IntArray:
        """Pulses that each synapse's device has had since the last reset, in the network's order."""
        values: IntArray = self._in_order(self._state.pulses)
        return values

    @property
    def ledger(self) -> Ledger:
        """Events, energy and time since the last reset."""
        k, total = self._kernels, self._state.total
        steps = int(total[k.STEPS_DONE])
        return Ledger(
            events=int(total[k.EVENTS]), ideal_events=int(total[k.IDEAL]), lost=int(total[k.LOST]),
            spurious=int(total[k.SPURIOUS]), charge=float(total[k.CHARGE]),
            programming_energy=float(total[k.PROGRAM_ENERGY]), read_energy=float(total[k.READ_ENERGY]),
            spikes=int(total[k.SPIKES]), steps=steps, reading_time=self._columns * self._fabric.read_duration,
            mean_programming_time=float(total[k.BUSY]) / max(steps, 1),
            worst_programming_time=float(total[k.WORST_BUSY]), most_pulses=int(self._state.pulses.max(initial=0)),
            pulses=int(self._state.pulses.sum()),
        )  # fmt: skip

    def restart_from(
        self, *, membranes: FloatArray, weights: FloatArray, spiked: npt.NDArray[np.bool_], ls: IntArray
    ) -> None:
        """Take over another controller's state after a step that ended in a tie.

        Parameters
        ----------
        membranes, spiked, ls
            (neuron,) potentials after resets, which neurons spiked in the step just done, and ls after its decay.
        weights
            (synapse,) in the network's order.
        """
        s = self._state
        s.y[:], s.ls[:] = membranes, ls
        s.ring[(int(s.clock[0]) - 1) % s.ring.shape[0]] = spiked
        devices, tiles = self.die.plan.hardware.devices, self.die.plan.tiles
        for point, place, now in zip(self.die.plan.crosspoints, self._order, self.weights, strict=True):
            if now != weights[point.synapse]:
                kind = tiles[point.tile].kind
                device = devices[kind]
                s.state[place] = device.state_at_weight(_read_weight(device, kind, weights[point.synapse]))
                s.g[place] = device.conductance(s.state[place])

    def _in_order(self, values: Any) -> Any:
        return values[self._order]


def _read_weight(device: Any, kind: str, weight: float) -> float:
    """G/G_on of a device that is read as `weight`."""
    ratio = float(device.conductance(0.0) / device.conductance(1.0))
    read = ratio + weight * (1.0 - ratio) if reads_with_reference(kind) else weight
    return min(max(read, ratio), 1.0)


def _fabric(die: Die, perturb: float) -> tuple[Any, IntArray]:
    """The die as arrays, and where each synapse of the network stands in them."""
    from ohmloom.devices._kernels import LAW_INDEX
    from ohmloom.devices.laws import LAWS
    from ohmloom.mapping import _kernels

    plan, network, hardware = die.plan, die.plan.network, die.plan.hardware
    r, drive, n = network.readings, hardware.drive, network.neurons
    posts = np.array([network.synapses[c.synapse].post for c in plan.crosspoints], dtype=np.int64)
    pres = np.array([network.synapses[c.synapse].pre for c in plan.crosspoints], dtype=np.int64)
    tiles = np.array([c.tile for c in plan.crosspoints], dtype=np.int64)
    rows = np.array([c.row for c in plan.crosspoints], dtype=np.int64)
    order = np.lexsort((rows, tiles, posts))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    cards = hardware.devices
    devices = [cards[tile.kind] for tile in plan.tiles]
    width = max((len(device.parameters) for device in devices), default=1)
    parameters = np.zeros((len(devices), width))
    for t, device in enumerate(devices):
        values = [device.parameters[p.name] for p in LAWS[device.law].parameters]
        parameters[t, : len(values)] = values
    g_on = np.array([float(device.conductance(1.0)) for device in devices])
    g_off = np.array([float(device.conductance(0.0)) for device in devices])
    reference = np.where([tile.has_reference for tile in plan.tiles], g_off, 0.0) if devices else np.zeros(0)
    q_d = np.array([device.charge_scale for device in devices])
    starts = np.searchsorted(posts[order], np.arange(n + 1)).astype(np.int64)

    def sorted_by_receiver(values: Any, dtype: Any) -> Any:
        return np.array(values, dtype=dtype)[order]

    fabric = _kernels.Fabric(
        n, len(devices), starts, pres[order], posts[order], tiles[order],
        sorted_by_receiver([c.column for c in plan.crosspoints], np.int64),
        sorted_by_receiver([c.polarity for c in plan.crosspoints], np.float64),
        sorted_by_receiver([c.tap for c in plan.crosspoints], np.int64),
        die.state[order], (1.0 + perturb) * die.event_charge[order] * q_d[tiles[order]] / MEM_LIFETIME,
        die.threshold[order], np.array([LAW_INDEX[device.law] for device in devices], dtype=np.int64), parameters,
        q_d, reference, 1.0 / (hardware.read.voltage.value * (g_on - reference)),
        np.array([tile.kind in PLASTIC_KINDS for tile in plan.tiles], dtype=np.bool_),
        np.array(drive.volts.phases[0].column, dtype=np.float64),
        _kernels.CURRENT if drive.mode == "current" else _kernels.CHARGE_METERED,
        {"cell": _kernels.CELL, "column": _kernels.COLUMN, "array": _kernels.ARRAY}[drive.parallelism],
        drive.pulse_voltage.value, drive.pulse_duration.value if drive.pulse_duration else 0.0,
        hardware.read.voltage.value, hardware.read.duration.value, r.a, r.b, r.c, r.c_ini, r.y_thresh, r.synapse_gain,
        r.stdp_threshold, r.high_count, r.input_bias, r.clamp, r.carry_state,
    )  # fmt: skip
    return fabric, place
