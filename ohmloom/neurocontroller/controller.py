"""The ideal controller: a network's discrete simulation behind ``reset`` and ``step``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.errors import ParameterError, expect_type, shown
from ohmloom.neurocontroller.network import Network
from ohmloom.neurocontroller.rules import INPUTS

if TYPE_CHECKING:
    from ohmloom.devices import Device
    from ohmloom.neurocontroller.device_levels import DeviceEvents

ACTIONS = ("forward", "left", "right")


class SpikingController:
    """Runs a network with the discrete rules of Sections IV and V.

    Parameters
    ----------
    network
        What to run, with its own readings.
    plasticity
        ``charge``: one STDP event moves the charge by q_max / 1000 (eq. 12). ``flux``: it is a pulse of fixed voltage
        and width, which moves the flux by `event_flux`, and the charge by what the device then takes.
    cards
        Kind of synapse -> `Device`, one for each plastic kind of the network; others are left aside, as constant
        synapses have the network's weights. None: with ``charge`` the paper's integer lattice, with ``flux`` its
        normalised cards (``hp_tio2_paper``, ``peo_pani_paper``, ``linear_paper``).
    event_flux
        Kind of synapse -> flux of one event in Wb, > 0, for ``flux``. Default: q_d / 1000 / G at W = 0.5, a pulse that
        is right at the start.
    implementation
        ``compiled``, or ``plain``, which reads like the paper and is equal spike for spike.

    Raises
    ------
    ParameterError
        For another plasticity or implementation; a missing card, or one that cannot hold W = 0.5; with ``flux``, a law
        that has no flux or an event so small that 200000 do not cross the range.

    Examples
    --------
    >>> import numpy as np
    >>> from ohmloom.neurocontroller import Network
    >>> network = Network.random(system="HET", rng=np.random.default_rng(1))
    >>> controller = SpikingController(network)
    >>> controller.step([0, 0, 0, 0.2, 0.8, 1.0]) in ("forward", "left", "right")
    True
    """

    def __init__(
        self,
        network: Network,
        *,
        plasticity: Literal["charge", "flux"] = "charge",
        cards: Mapping[str, Device] | None = None,
        event_flux: Mapping[str, float] | None = None,
        implementation: Literal["compiled", "plain"] = "compiled",
    ) -> None:
        expect_type("SpikingController.network", network, Network)
        if not isinstance(plasticity, str) or plasticity not in ("charge", "flux"):
            raise ParameterError(f"SpikingController.plasticity: expected 'charge' or 'flux', got {shown(plasticity)}. "
                                 "Use one of these.")  # fmt: skip
        if not isinstance(implementation, str) or implementation not in ("compiled", "plain"):
            raise ParameterError(f"SpikingController.implementation: expected 'compiled' or 'plain', "
                                 f"got {shown(implementation)}. Use one of these.")  # fmt: skip
        events = None
        if plasticity == "flux" or cards is not None or event_flux is not None:
            from ohmloom.neurocontroller.device_levels import events_of

            events = events_of(network, plasticity, cards, event_flux)
        self.network = network
        self.plasticity = plasticity
        self.implementation = implementation
        self._run = _Compiled(network, events) if implementation == "compiled" else _Plain(network, events)

    def reset(self) -> None:
        """Back to the start of a trial: membranes, travelling spikes and weights."""
        self._run.reset()

    def step(self, sensors: Sequence[float] | FloatArray) -> str:
        """One timestep of 21 steps.

        Parameters
        ----------
        sensors
            (6,) IR 0, 2, 5, then light 0, 2, 5; each in [0, 1].

        Returns
        -------
        str
            ``forward``, ``left`` or ``right``.

        Raises
        ------
        ParameterError
            If `sensors` is not six numbers in [0, 1].
        """
        return ACTIONS[self._run.timestep(checked_sensors("SpikingController.step", sensors))]

    def spikes(self, sensors: Sequence[float] | FloatArray) -> npt.NDArray[np.bool_]:
        """One single step; which neurons spiked, axes (neuron,). For comparisons step by step."""
        return self._run.step(checked_sensors("SpikingController.spikes", sensors))

    def begin_timestep(self) -> None:
        """What `step` does before its 21 steps: a network that does not carry its state over starts anew."""
        self._run.begin_timestep()

    @property
    def output_spikes(self) -> IntArray:
        """Spikes of the left and the right output in the last timestep, (2,), each 0 to 21."""
        return self._run.spike_counts()[-2:]

    @property
    def spike_counts(self) -> IntArray:
        """Spikes of every neuron in the last timestep, (neuron,)."""
        return self._run.spike_counts()

    @property
    def weights(self) -> FloatArray:
        """Weights in the network's order of synapses, (synapse,), in [0, 1] and without sign."""
        return self._run.weights()

    @property
    def membranes(self) -> FloatArray:
        """Membrane potentials after resets, (neuron,), normalised."""
        return self._run.membranes()

    @property
    def events(self) -> tuple[int, int]:
        """Positive and negative STDP events since the last reset."""
        return self._run.event_totals()

    @property
    def kernel_arguments(self) -> tuple[Any, Any]:
        """Wiring and state for a kernel that runs a whole trial; None, None for the plain implementation."""
        return self._run.kernel_arguments


def checked_sensors(where: str, sensors: Any) -> FloatArray:
    """Sensor values as an array of their own, or an error that says which rule they break.

    A locked or strided array would be another type for the kernels, and compile them once more.
    """
    try:
        values = np.array(sensors, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape != (INPUTS,) or not ((values >= 0.0) & (values <= 1.0)).all():
        raise ParameterError(f"{where}: expected 6 sensor values in [0, 1], got {shown(sensors, 200)}. "
                             "Order: IR 0, 2, 5, light 0, 2, 5.")  # fmt: skip
    return values


class _Compiled:
    def __init__(self, network: Network, events: Mapping[str, DeviceEvents] | None) -> None:
        from ohmloom.neurocontroller import _kernels, wiring

        self._kernels, self._network = _kernels, network
        # Comparisons ask for the weights after every step: where each stands is looked up once.
        self._places = wiring.synapse_places(network)
        self._wiring = wiring.wire(network, events)
        self._state = wiring.new_state(self._wiring)
        self._counts = np.zeros(network.neurons, dtype=np.int64)

    def reset(self) -> None:
        self._kernels.reset(self._wiring, self._state)
        self._counts[:] = 0

    def timestep(self, sensors: FloatArray) -> int:
        return int(self._kernels.timestep(self._wiring, self._state, sensors, self._counts))

    def begin_timestep(self) -> None:
        if not self._wiring.carry:
            self._kernels.reset_activity(self._wiring, self._state)

    def step(self, sensors: FloatArray) -> npt.NDArray[np.bool_]:
        spiked = np.zeros(self._network.neurons, dtype=np.int64)
        self._kernels.run_steps(self._wiring, self._state, sensors, spiked, 1)
        return spiked.astype(np.bool_)

    def spike_counts(self) -> IntArray:
        return self._counts.copy()

    def weights(self) -> FloatArray:
        values: FloatArray = np.abs(self._state.weight[self._places])
        return values

    def membranes(self) -> FloatArray:
        values: FloatArray = self._state.y.copy()
        return values

    def event_totals(self) -> tuple[int, int]:
        return int(self._state.events[0]), int(self._state.events[1])

    @property
    def kernel_arguments(self) -> tuple[Any, Any]:
        return self._wiring, self._state


class _Plain:
    kernel_arguments = (None, None)

    def __init__(self, network: Network, events: Mapping[str, DeviceEvents] | None) -> None:
        from ohmloom.neurocontroller.plain import PlainController

        self._plain = PlainController(network, events)
        self._counts = np.zeros(network.neurons, dtype=np.int64)

    def reset(self) -> None:
        self._plain.reset()
        self._counts[:] = 0

    def timestep(self, sensors: FloatArray) -> int:
        action = self._plain.timestep([float(x) for x in sensors])
        self._counts[:] = self._plain.counts
        return action

    def begin_timestep(self) -> None:
        self._plain.begin_timestep()

    def step(self, sensors: FloatArray) -> npt.NDArray[np.bool_]:
        return np.array(self._plain.step([float(x) for x in sensors]))

    def spike_counts(self) -> IntArray:
        return self._counts.copy()

    def weights(self) -> FloatArray:
        return np.array(self._plain.weights)

    def membranes(self) -> FloatArray:
        return np.array(self._plain.y)

    def event_totals(self) -> tuple[int, int]:
        return sum(e[0] for e in self._plain.events), sum(e[1] for e in self._plain.events)
