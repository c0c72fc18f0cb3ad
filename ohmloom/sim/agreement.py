"""Discrete beside emulated: two controllers on the same sensors, compared at every single step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ohmloom import __version__
from ohmloom._arrays import FloatArray, IntArray, frozen_array, read_arrays, write_arrays
from ohmloom.errors import FileFormatError, ParameterError, UnknownNameError, expect_integer
from ohmloom.mapping import Die, EmulatedController, Hardware, Ledger, place
from ohmloom.mapping.pulses import pulse_of
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS, reads_with_reference
from ohmloom.sim.arena import Arena
from ohmloom.sim.trial import TRIAL_ARRAYS, Trial, draw_trial_key, run_trial

STEPS = 21
MOST_TIES = 5  # on a network without linear synapses
WEIGHT_ERROR = 1e-6
ROUNDING = 8 * np.finfo(np.float64).eps


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """Where two controllers first differ: timestep and step from 0, neuron."""

    timestep: int
    step: int
    neuron: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Agreement:
    """A discrete and an emulated controller over one trial; the discrete one drives the robot.

    Attributes
    ----------
    exact
        Whether every spike of every step is equal, but for few enough ties, and every weight to 1e-6.
    ties
        Steps in which a membrane lay so near the threshold that rounding decides; both then went on from one state.
    first_divergence
        First spike that differs and is no tie, or None.
    spike_agreement, action_agreement
        Fractions of neuron-steps and of timesteps that are equal.
    worst_rms, final_rms, worst_weight_error
        Root mean square of the weights' difference, worst over the timesteps and at the end; largest difference, of
        all steps up to the first divergence and then of the ends of timesteps.
    worst_rms_of, final_rms_of
        The same by kind of synapse.
    at_bounds
        By plastic kind, the fraction of time that emulated devices stand at one end of their range.
    kinds
        Kind of each synapse, in the network's order.
    trial, ledger
        The discrete controller's trial; what the emulated one spent in it.
    disabled_weights
        (cell,) what conducts where no synapse is, at the end of the trial.
    weights, emulated_weights, spikes
        (timestep, synapse) weights after each timestep, of both; (timestep, neuron) spike counts of the discrete one.
    """

    exact: bool
    ties: int
    first_divergence: Divergence | None
    spike_agreement: float
    action_agreement: float
    worst_rms: float
    final_rms: float
    worst_weight_error: float
    worst_rms_of: Mapping[str, float]
    final_rms_of: Mapping[str, float]
    at_bounds: Mapping[str, float]
    kinds: tuple[str, ...]
    trial: Trial
    ledger: Ledger
    weights: FloatArray
    emulated_weights: FloatArray
    spikes: IntArray
    disabled_weights: FloatArray = field(default_factory=lambda: np.zeros(0))
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("weights", "emulated_weights"):
            object.__setattr__(self, name, frozen_array(f"Agreement.{name}", getattr(self, name), _WEIGHT_AXES))
        spikes = frozen_array("Agreement.spikes", self.spikes, ("timestep", "neuron"), dtype=np.int64)
        object.__setattr__(self, "spikes", spikes)
        disabled = frozen_array("Agreement.disabled_weights", self.disabled_weights, ("cell",))
        object.__setattr__(self, "disabled_weights", disabled)

    def save(self, path: Path | str) -> None:
        """Write the comparison with its trial as npz, whole."""
        header = {name: _plain(getattr(self, name)) for name in _SCALARS} | {"provenance": dict(self.provenance)}
        header["first_divergence"] = None if self.first_divergence is None else asdict(self.first_divergence)
        header["ledger"] = asdict(self.ledger)
        header["trial"], arrays = self.trial.to_parts()
        write_arrays(path, "agreement", 1, header, arrays | {name: getattr(self, name) for name in _ARRAYS})

    @classmethod
    def load(cls, path: Path | str) -> Agreement:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError, FileFormatError
            If the file does not exist, or is not a whole comparison.
        """
        header, arrays = read_arrays(path, "agreement", 1, (*_ARRAYS, *TRIAL_ARRAYS))
        try:
            trial = Trial(**header.pop("trial"), **{name: arrays.pop(name) for name in TRIAL_ARRAYS})
            first, ledger = header.pop("first_divergence"), Ledger(**header.pop("ledger"))
            divergence = None if first is None else Divergence(**first)
            kinds = tuple(header.pop("kinds"))
            return cls(trial=trial, first_divergence=divergence, ledger=ledger, kinds=kinds, **header, **arrays)
        except (KeyError, ParameterError, TypeError) as error:
            raise FileFormatError(f"{path}: expected a saved agreement, got {error}. Save it again.") from error

    def _repr_html_(self) -> str:
        cells = "".join(f"<tr><th>{name}</th><td>{getattr(self, name)}</td></tr>" for name in _SCALARS)
        return f"<table><caption>Agreement</caption>{cells}</table>"


_WEIGHT_AXES = ("timestep", "synapse")
_ARRAYS = ("weights", "emulated_weights", "spikes", "disabled_weights")
_SCALARS = (
    "exact", "ties", "spike_agreement", "action_agreement", "worst_rms", "final_rms", "worst_weight_error",
    "worst_rms_of", "final_rms_of", "at_bounds", "kinds",
)  # fmt: skip


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


def agreement(
    network: Network,
    hardware: Hardware,
    *,
    seed: int = 0,
    arena: Arena | None = None,
    die: Die | None = None,
    perturb: float = 0.0,
    trial_key: int | None = None,
    model: Literal["paper", "cards", "flux"] = "paper",
    integrate: bool = False,
    as_wired: bool = False,
) -> Agreement:
    """Run the discrete and the emulated controller side by side in closed loop, on the discrete one's sensors.

    Parameters
    ----------
    network, hardware
        What is compared on what.
    seed, trial_key
        Seed that draws the trial's key, or that key itself.
    arena
        The paper's static arena by default.
    die
        The nominal die by default: every device as its card says.
    perturb
        Relative error of the emulated charge per event; anything but 0 should break the agreement.
    model
        Discrete model: the ``paper``'s lattice; that of the spec's own ``cards``, moved by charge; or theirs moved by
        pulses of fixed voltage (``flux``).
    integrate
        Whether the emulated devices follow their differential equations even where they have closed forms.
    as_wired
        Whether the lines' potentials are solved even where they have no resistance.

    Raises
    ------
    MappingError
        If the network cannot be placed.
    """
    die = place(network, hardware).nominal() if die is None else die
    if die.plan.network.sha256 != network.sha256:
        raise ParameterError(f"agreement.die: expected a die of {network.name}, got one of {die.plan.network.name}. "
                             "Sample it from this network's plan.")  # fmt: skip
    if model not in ("paper", "cards", "flux"):
        raise UnknownNameError.of("agreement.model", model, ["paper", "cards", "flux"])
    pair = _Pair(
        _discrete(network, die.plan.hardware, model),
        EmulatedController(die, perturb=perturb, integrate=integrate, as_wired=as_wired),
    )
    key = (
        draw_trial_key(np.random.default_rng(expect_integer("agreement.seed", seed)))
        if trial_key is None
        else trial_key
    )
    trial = run_trial(pair, arena, trial_key=key)
    has_linear = any(s.kind == "linear" for s in network.synapses)
    rms = np.array(pair.rms) if pair.rms else np.zeros(1)
    return Agreement(
        exact=pair.first_divergence is None
        and (has_linear or pair.ties <= MOST_TIES)
        and pair.worst_error <= WEIGHT_ERROR,
        ties=pair.ties, first_divergence=pair.first_divergence,
        spike_agreement=1.0 - pair.different_spikes / max(pair.steps * network.neurons, 1),
        action_agreement=pair.equal_actions / max(len(pair.rms), 1), worst_rms=float(rms.max()),
        final_rms=float(rms[-1]), worst_weight_error=pair.worst_error,
        worst_rms_of={kind: float(values.max()) for kind, values in pair.rms_of().items()},
        final_rms_of={kind: float(values[-1]) for kind, values in pair.rms_of().items()},
        at_bounds=pair.at_bounds(), kinds=tuple(s.kind for s in network.synapses), trial=trial,
        ledger=pair.emulated.ledger,
        weights=np.array(pair.weights), emulated_weights=np.array(pair.emulated_weights),
        spikes=np.array(pair.spikes), disabled_weights=pair.emulated.disabled_weights,
        provenance={"ohmloom": __version__, "network": network.sha256, "hardware": hardware.sha256, "trial_key": key},
    )  # fmt: skip


def _discrete(network: Network, hardware: Hardware, model: str) -> SpikingController:
    if model == "paper":
        return SpikingController(network)
    if model == "cards":
        return SpikingController(network, cards=hardware.devices)
    plastic = {s.kind for s in network.synapses} & set(PLASTIC_KINDS)
    pulses = {kind: pulse_of(hardware, kind, has_reference=reads_with_reference(kind)).flux for kind in plastic}
    return SpikingController(network, plasticity="flux", cards=hardware.devices, event_flux=pulses)


class _Pair:
    """A controller that runs two, answers with the discrete one's action and keeps count of the differences."""

    def __init__(self, discrete: SpikingController, emulated: EmulatedController) -> None:
        self.network = network = discrete.network
        self.discrete = discrete
        self.emulated = emulated
        self._kinds = np.array([s.kind for s in network.synapses], dtype=object)
        readings, neurons = network.readings, network.neurons
        self._posts = np.array([s.post for s in network.synapses], dtype=np.int64)
        terms = np.bincount(self._posts, minlength=neurons) + 4
        self._floor = ROUNDING * terms * max(1.0, readings.y_thresh)
        self.reset()

    def reset(self) -> None:
        self.discrete.reset()
        self.emulated.reset()
        self.ties = self.different_spikes = self.steps = self.equal_actions = 0
        self.first_divergence: Divergence | None = None
        self.worst_error = 0.0
        self.rms: list[float] = []
        self.weights: list[FloatArray] = []
        self.emulated_weights: list[FloatArray] = []
        self.states: list[FloatArray] = []
        self.spikes: list[IntArray] = []
        self._ls = np.zeros(self.network.neurons, dtype=np.int64)
        self._bound = np.zeros(self.network.neurons)

    def step(self, sensors: FloatArray) -> str:
        from ohmloom.neurocontroller._kernels import classify

        self.discrete.begin_timestep()
        self.emulated.begin_timestep()
        counts, emulated_counts = (np.zeros(self.network.neurons, dtype=np.int64) for _ in range(2))
        for step in range(STEPS):
            spiked, emulated = self._step(sensors, step)
            counts += spiked
            emulated_counts += emulated
        difference = self.emulated.weights - self.discrete.weights
        self.worst_error = max(self.worst_error, float(np.abs(difference).max(initial=0.0)))
        self.rms.append(float(np.sqrt(np.mean(difference**2))) if difference.size else 0.0)
        self.weights.append(self.discrete.weights)
        self.emulated_weights.append(self.emulated.weights)
        self.states.append(self.emulated.states)
        self.spikes.append(counts)
        high = self.network.readings.high_count
        action = classify(counts[-2], counts[-1], high)
        self.equal_actions += action == classify(emulated_counts[-2], emulated_counts[-1], high)
        return ("forward", "left", "right")[action]

    def rms_of(self) -> dict[str, FloatArray]:
        """Root mean square difference of the weights by kind, axes (timestep,)."""
        if not self.rms:
            return {}
        difference = np.array(self.emulated_weights) - np.array(self.weights)
        return {str(k): np.sqrt((difference[:, self._kinds == k] ** 2).mean(axis=1)) for k in np.unique(self._kinds)}

    def at_bounds(self) -> dict[str, float]:
        """Fraction of devices and timesteps at a wall, by plastic kind."""
        found = {}
        for kind in PLASTIC_KINDS:
            of_kind = self._kinds == kind
            if of_kind.any() and self.states:
                s = np.array(self.states)[:, of_kind]
                found[kind] = float(((s <= 0.0) | (s >= 1.0)).mean())
        return found

    def _step(self, sensors: FloatArray, step: int) -> tuple[Any, Any]:
        if self.first_divergence is not None:
            # There are no ties any more, so nobody asks how far each membrane may be off.
            spiked, emulated = self.discrete.spikes(sensors), self.emulated.spikes(sensors)
            self.steps += 1
            self.different_spikes += int(np.count_nonzero(spiked != emulated))
            return spiked, emulated
        r = self.network.readings
        error = np.abs(self.emulated.weights - self.discrete.weights)
        largest = float(error.max(initial=0.0))
        self.worst_error = max(self.worst_error, largest)
        # What the weights' errors can have done to each membrane since its last reset, with the leak.
        inbound = np.bincount(self._posts, weights=error, minlength=self.network.neurons)
        self._bound = (1.0 - r.b) * self._bound + r.synapse_gain * inbound + self._floor
        spiked, emulated = self.discrete.spikes(sensors), self.emulated.spikes(sensors)
        self._ls = np.maximum(np.where(spiked, r.last_spike, self._ls) - 1, 0)
        self.steps += 1
        different = np.flatnonzero(spiked != emulated)
        if different.size:
            # The one that did not spike still shows how far it stayed below the threshold.
            silent = np.where(spiked, self.emulated.membranes, self.discrete.membranes)
            distance = r.y_thresh - silent[different]
            is_tie = largest <= WEIGHT_ERROR and bool((distance <= 2.0 * self._bound[different]).all())
            if is_tie and self.first_divergence is None:
                self.ties += 1
                self.emulated.restart_from(
                    membranes=self.discrete.membranes,
                    weights=self.discrete.weights,
                    spiked=spiked,
                    ls=self._ls,
                )
                emulated = spiked
            else:
                self.different_spikes += different.size
                if self.first_divergence is None:
                    self.first_divergence = Divergence(timestep=len(self.rms), step=step, neuron=int(different[0]))
        self._bound[spiked] = 0.0
        return spiked, emulated
