"""The emulated controller: a die behind ``reset`` and ``step``, as the ideal network is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.errors import OperationError, ParameterError, expect_number, expect_type
from ohmloom.mapping._fabric import FAILED, STEP, Wires, as_bits, empty_state
from ohmloom.mapping.die import Die
from ohmloom.mapping.ledger import Ledger
from ohmloom.mapping.plan import Plan
from ohmloom.neurocontroller.controller import ACTIONS, checked_sensors
from ohmloom.neurocontroller.device_levels import state_of_weight
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP


class EmulatedController:
    """Runs a network on a die: every synapse is a device that follows its own law, charge by charge.

    Parameters
    ----------
    die
        From `Plan.sample` or `Plan.nominal`.
    perturb
        Relative error of every event's charge; 0 is right. For tests that must notice a wrong charge.
    integrate
        Follow every law's own differential equation, even where it has a closed form. For tests of these forms.
    as_wired
        Solve the potentials of the lines even where they have no resistance. Changes nothing but the time it takes; for
        comparisons that shall run the very code that wires run.

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

    def __init__(self, die: Die, *, perturb: float = 0.0, integrate: bool = False, as_wired: bool = False) -> None:
        from ohmloom.circuits._crossbar_kernels import SCRATCH
        from ohmloom.mapping import _kernels
        from ohmloom.mapping.fabric import build_fabric

        expect_type("EmulatedController.die", die, Die)
        perturb = expect_number("EmulatedController.perturb", perturb, "a number > -1, at most 1e6")
        if not -1.0 < perturb <= 1e6:
            raise ParameterError(f"EmulatedController.perturb: expected a number > -1, at most 1e6, got {perturb}. "
                                 "Use 0.001 or so.")  # fmt: skip
        self.die = die
        self._kernels = _kernels
        self._fabric, self._order, self._disabled = build_fabric(
            die, perturb=perturb, integrate=integrate, as_wired=as_wired
        )
        self._is_wired = isinstance(self._fabric.wires, Wires)
        self._state = empty_state(self._fabric, slots=self._longest_tap() + 1, scratch=SCRATCH)
        self._counts = np.zeros(len(self._fabric.neurons), dtype=np.int64)
        self.reset()

    def reset(self) -> None:
        """Back to the start of a trial: every device in its programmed state."""
        self._kernels.reset(self._fabric, self._state)
        self._counts[:] = 0

    def step(self, sensors: Sequence[float] | FloatArray) -> str:
        """One timestep of 21 steps; sensors (6,) in [0, 1] in, ``forward``, ``left`` or ``right`` out.

        Raises
        ------
        ParameterError
            If `sensors` is not six numbers in [0, 1].
        OperationError
            If the potentials of the wires do not converge.
        """
        values = checked_sensors("EmulatedController.step", sensors)
        from ohmloom.neurocontroller._kernels import classify

        self._kernels.begin_timestep(self._fabric, self._state)
        self._counts[:] = 0
        self._kernels.run_steps(self._fabric, self._state, values, self._counts, STEPS_PER_TIMESTEP)
        self.check_solved()
        left, right = self._counts[-2:]
        return ACTIONS[classify(left, right, int(self._fabric.constants[0]["high_count"]))]

    def spikes(self, sensors: Sequence[float] | FloatArray) -> npt.NDArray[np.bool_]:
        """One single step; which neurons spiked, axes (neuron,). For comparisons step by step."""
        values = checked_sensors("EmulatedController.spikes", sensors)
        spiked = np.zeros(len(self._fabric.neurons), dtype=np.int64)
        self._kernels.run_steps(self._fabric, self._state, values, spiked, 1)
        self.check_solved()
        return spiked.astype(np.bool_)

    def begin_timestep(self) -> None:
        """What `step` does before its 21 steps: devices age, and a network that does not carry its state starts
        anew."""
        self._kernels.begin_timestep(self._fabric, self._state)

    def check_solved(self) -> None:
        """Refuse numbers from wires whose potentials did not converge.

        Raises
        ------
        OperationError
            If any solve since the last reset did not converge.
        """
        if self._state.clock[FAILED]:
            raise OperationError("EmulatedController: expected the potentials of the wires to converge, got "
                                 f"{self._state.clock[FAILED]} "
                                 "solves that did not. Check the resistances of wires and devices.")  # fmt: skip

    @property
    def kernel_arguments(self) -> tuple[Any, Any]:
        """Die and state for a kernel that runs a whole trial; None, None where wires take far longer than the calls."""
        return (None, None) if self._is_wired else (self._fabric, self._state)

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
        values: FloatArray = self._in_order(self._state.cells["g"])
        return values

    @property
    def states(self) -> FloatArray:
        """State s of each synapse's device, in [0, 1], in the network's order."""
        values: FloatArray = self._in_order(self._state.cells["s"])
        return values

    @property
    def weights(self) -> FloatArray:
        """Weights of the devices, in the network's order: (G - reference) / (G_on - reference)."""
        values: FloatArray = self._in_order(self._weights_of_cells())
        return values

    @property
    def disabled_weights(self) -> FloatArray:
        """Weights of what conducts at crosspoints without a synapse, (cell,); none where they are masked."""
        return self._weights_of_cells()[self._disabled]

    @property
    def read_weights(self) -> FloatArray:
        """Weights as read through wires and gains, without noise, in the network's order."""
        from ohmloom.mapping._wire_kernels import update_reads

        f, s = self._fabric, self._state
        if not self._is_wired:
            values: FloatArray = self._in_order(np.abs(s.cells["weight"]))
            return values
        update_reads(f, s)
        self.check_solved()
        place = {(r["tile"], r["row"], r["column"]): k for k, r in enumerate(f.reads)}
        cells = f.cells[self._order]
        read = [place[c["tile"], c["row"], c["column"]] for c in cells]
        seen: FloatArray = np.abs(s.reads["weight"][read])
        return seen

    @property
    def membranes(self) -> FloatArray:
        """Membrane potentials after resets, (neuron,), normalised."""
        values: FloatArray = self._state.neurons["y"].copy()
        return values

    @property
    def pulses(self) -> IntArray:
        """Pulses that each synapse's device has had since the last reset, in the network's order."""
        values: IntArray = self._in_order(self._state.cells["pulses"])
        return values

    @property
    def ledger(self) -> Ledger:
        """Events, energy and time since the last reset."""
        from ohmloom.mapping import _fabric as k

        total, pulses = self._state.total, self._state.cells["pulses"]
        steps = int(total[k.STEPS_DONE])
        return Ledger(
            events=int(total[k.EVENTS]), ideal_events=int(total[k.IDEAL]), lost=int(total[k.LOST]),
            spurious=int(total[k.SPURIOUS]), charge=float(total[k.CHARGE_TOTAL]),
            programming_energy=float(total[k.PROGRAM_ENERGY]), read_energy=float(total[k.READ_ENERGY]),
            spikes=int(total[k.SPIKES]), steps=steps, reading_time=reading_time(self.die.plan),
            mean_programming_time=float(total[k.BUSY]) / max(steps, 1),
            worst_programming_time=float(total[k.WORST_BUSY]), most_pulses=int(pulses.max(initial=0)),
            pulses=int(pulses.sum()), disabled_events=int(total[k.DISABLED_EVENTS]),
            half_selects_row=int(total[k.HALF_ROW]), half_selects_column=int(total[k.HALF_COLUMN]),
            half_selects_both=int(total[k.HALF_BOTH]),
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
        from ohmloom.mapping._cell_kernels import place_at

        s = self._state
        s.neurons["y"] = membranes
        for before in range(1, len(s.by_ls)):
            s.by_ls[before] = as_bits(np.asarray(ls) == before - 1)
        s.ring[(int(s.clock[STEP]) - 1) % s.ring.shape[0], : spiked.size] = spiked
        devices, tiles = self.die.plan.hardware.devices, self.die.plan.tiles
        for point, place, now in zip(self.die.plan.crosspoints, self._order, self.weights, strict=True):
            if now != weights[point.synapse]:
                tile = tiles[point.tile]
                state = state_of_weight(
                    devices[tile.kind], float(weights[point.synapse]), has_reference=tile.subtracts_off
                )
                f = self._fabric
                place_at(f.pulses, f.cells[place], s.cells[place], f.tiles[point.tile], state)

    def _in_order(self, values: Any) -> Any:
        return values[self._order]

    def _weights_of_cells(self) -> FloatArray:
        values: FloatArray = (self._state.cells["g"] - self._of_tile("reference")) / self._span()
        return values

    def _span(self) -> FloatArray:
        """Conductance between W = 0 (or no device) and W = 1, (cell,)."""
        span: FloatArray = self._of_tile("g_on") - self._of_tile("reference")
        return span

    def _of_tile(self, name: str) -> Any:
        return self._fabric.tiles[name][self._fabric.cells["tile"]]

    def _longest_tap(self) -> int:
        return int(self._fabric.reads["tap"].max(initial=1))


def reading_time(plan: Plan) -> float:
    """Time to read all columns in one step [s]: one after the other through their taps, or all at once if retimed."""
    hardware = plan.hardware
    converter = hardware.converter
    one = hardware.read.duration.value
    if converter is not None and converter.duration is not None:
        one += converter.duration.value
    if hardware.array.delays == "retimed":
        return one
    return one * max((len(tile.columns) for tile in plan.tiles), default=1)
