"""What a replay shows: one trial, its recording, and the arena it happened in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.errors import ParameterError, UnknownNameError

if TYPE_CHECKING:
    from ohmloom.neurocontroller import Network
    from ohmloom.sim import Agreement

# Colours of Okabe and Ito (2008), told apart with any colour vision; actions and kinds share none.
ACTIONS: Final = {"forward": "#0072b2", "left": "#e69f00", "right": "#009e73"}
KINDS: Final = {"hp": "#d55e00", "peo_pani": "#b5548f", "linear": "#56b4e9", "constant": "#808080"}
SENSORS: Final = ("IR 0 left", "IR 2 front", "IR 5 right", "light 0 left", "light 2 front", "light 5 right")
OUTPUTS: Final = ("output 0", "output 1")
IR_COLOUR: Final = "#d62728"
LIGHT_COLOUR: Final = "#d99a00"
INK: Final = "#222222"
BACKED_OFF: Final = "#9a9a9a"
STEPS: Final = 21  # per timestep, the paper's section on control


class TrialView(Protocol):
    """The part of a trial that is drawn; rows of `path` and `st` are one more than timesteps."""

    @property
    def path(self) -> npt.NDArray[Any]: ...  # (row, 3): x [m], y [m], heading [rad]
    @property
    def st(self) -> npt.NDArray[Any]: ...  # (row,)
    @property
    def sensors(self) -> npt.NDArray[Any]: ...  # (timestep, 6), in [0, 1]
    @property
    def actions(self) -> npt.NDArray[Any]: ...  # (timestep,): 0 forward, 1 left, 2 right
    @property
    def output_spikes(self) -> npt.NDArray[Any]: ...  # (timestep, 2)
    @property
    def solved(self) -> bool: ...
    @property
    def fitness(self) -> float: ...
    @property
    def bumps(self) -> int: ...
    @property
    def task(self) -> str: ...


class ArenaView(Protocol):
    """The part of an arena that is drawn; lengths in m, bearings in rad, counter-clockwise from ahead."""

    @property
    def half_width(self) -> float: ...
    @property
    def box_half_width(self) -> float: ...
    @property
    def lamp(self) -> npt.ArrayLike: ...  # (2,)
    @property
    def robot_radius(self) -> float: ...
    @property
    def goal(self) -> float: ...
    @property
    def start_line(self) -> float: ...
    @property
    def sensor_points(self) -> npt.ArrayLike: ...  # (sensor, 2): forward, left
    @property
    def sensor_bearings(self) -> npt.ArrayLike: ...  # (sensor,)
    @property
    def ir_range(self) -> float: ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One trial with what went on inside its network, ready to be drawn.

    Parameters
    ----------
    trial
        Path, sensors, actions and outcome.
    weights
        Axes (timestep, synapse): weight at the end of each timestep, dimensionless.
    spikes
        Axes (timestep, neuron): spikes of each neuron in each timestep, 0 to 21.
    network_name
        Any text; every picture shows it as text.
    neuron_labels, synapse_labels, synapse_kinds
        One entry per neuron or synapse; kinds are ``hp``, ``peo_pani``, ``linear`` or ``constant``.

    Raises
    ------
    ParameterError
        If an array does not have one row per timestep of the trial, or a label is missing.
    """

    trial: TrialView
    weights: FloatArray
    spikes: IntArray
    network_name: str
    neuron_labels: tuple[str, ...]
    synapse_labels: tuple[str, ...]
    synapse_kinds: tuple[str, ...]

    def __post_init__(self) -> None:
        timesteps = len(self.trial.actions)
        if timesteps < 1:
            raise ParameterError(
                "Recording.trial: expected at least 1 timestep, got 0. Run the trial before drawing it."
            )
        # A name made from a file's may hold bytes that no text file can.
        object.__setattr__(self, "network_name", self.network_name.encode(errors="replace").decode())
        for name in ("neuron_labels", "synapse_labels", "synapse_kinds"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for kind in self.synapse_kinds:
            if kind not in KINDS:
                raise UnknownNameError.of("Recording.synapse_kinds", kind, KINDS)
        neurons, synapses = len(self.neuron_labels), len(self.synapse_labels)
        if len(self.synapse_kinds) != synapses:
            raise ParameterError(
                f"Recording.synapse_kinds: expected {synapses} kinds, one per synapse label, "
                f"got {len(self.synapse_kinds)}. Give each synapse a kind."
            )
        time = f"timestep={timesteps}"
        weights = frozen_array("Recording.weights", self.weights, (time, f"synapse={synapses}"))
        spikes = frozen_array("Recording.spikes", self.spikes, (time, f"neuron={neurons}"), dtype=np.int64)
        if spikes.size and not (spikes.min() >= 0 and spikes.max() <= STEPS):
            raise ParameterError(
                f"Recording.spikes: expected counts from 0 to {STEPS} per timestep, got "
                f"{spikes.min()} to {spikes.max()}. Sum the spikes over the steps of one timestep."
            )
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "spikes", spikes)

    @property
    def timesteps(self) -> int:
        """Executed timesteps, bump penalties not counted."""
        return len(self.trial.actions)

    @property
    def kinds(self) -> dict[str, IntArray]:
        """Indices of the synapses of each kind that occurs, in the order of `KINDS`."""
        return kind_indices(self.synapse_kinds)

    @property
    def summary(self) -> str:
        """The outcome in one line."""
        trial = self.trial
        outcome = "solved" if trial.solved else "not solved"
        bumps = f"{trial.bumps} bump" + ("" if trial.bumps == 1 else "s")
        return (
            f"{trial.task} task, {outcome}, fitness {trial.fitness:.6g}, {self.timesteps} timesteps "
            f"({int(trial.st[-1])} counted), {bumps}"
        )


def recording_of(agreement: Agreement, network: Network) -> Recording:
    """The discrete side of an agreement, ready to be drawn by `replay`.

    Raises
    ------
    ParameterError
        If `network` is not the one that was run.
    """
    check_network("recording_of.network", agreement, network)
    labels = network.labels()
    return Recording(
        trial=agreement.trial,
        weights=agreement.weights,
        spikes=agreement.spikes,
        network_name=network.name,
        neuron_labels=tuple(labels),
        synapse_labels=tuple(f"{labels[s.pre]} → {labels[s.post]}" for s in network.synapses),
        synapse_kinds=tuple(s.kind for s in network.synapses),
    )


def check_network(where: str, agreement: Agreement, network: Network) -> None:
    """Refuse a network other than the one that an agreement ran."""
    ran, given = agreement.provenance["network"], network.sha256
    if ran != given:
        raise ParameterError(
            f"{where}: expected the network that was run, sha256 {ran[:12]}, got {given[:12]}. Pass that one."
        )


def kind_indices(kinds: Sequence[str]) -> dict[str, IntArray]:
    """Indices of the synapses of each kind that occurs, in the order of `KINDS`."""
    names = np.array(kinds, dtype=str)
    found = {kind: np.flatnonzero(names == kind) for kind in KINDS}
    return {kind: index for kind, index in found.items() if index.size}


def bump_rows(trial: TrialView) -> IntArray:
    """Timesteps that ended in a bump: the only ones that count for more than one."""
    return np.flatnonzero(np.diff(trial.st) > 1)


def goal_regions(trial: TrialView, arena: ArenaView) -> list[FloatArray]:
    """Corner triangles, axes (corner, 2) [m]: the goal, and the dynamic task's second one."""
    w, c = arena.half_width, arena.goal - arena.half_width
    first = np.array([(w, w), (c, w), (w, c)])
    return [first, first * (-1.0, 1.0)] if trial.task == "dynamic" else [first]


def start_region(arena: ArenaView) -> FloatArray:
    """Corner triangle in which trials start, axes (corner, 2) [m]."""
    w, c = arena.half_width, arena.start_line + arena.half_width
    return np.array([(-w, -w), (-w, c), (c, -w)])


def sensor_rays(pose: npt.NDArray[Any], arena: ArenaView) -> tuple[FloatArray, FloatArray]:
    """Both ends of the IR rays of a robot at `pose` (x, y, heading), at full range; axes (sensor, 2) [m]."""
    x, y, heading = (float(value) for value in pose)
    forward, left = np.asarray(arena.sensor_points, dtype=np.float64).T
    cos, sin = np.cos(heading), np.sin(heading)
    near = np.stack([x + cos * forward - sin * left, y + sin * forward + cos * left], axis=-1)
    angle = heading + np.asarray(arena.sensor_bearings, dtype=np.float64)
    return near, near + arena.ir_range * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
