"""A die: one sampled piece of hardware that carries a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.errors import expect_integer, expect_type
from ohmloom.mapping.importance import column_importance
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.mapping.plan import Plan
from ohmloom.mapping.repair import GOOD, STUCK_OFF, STUCK_ON, Repair, repair, unrepaired

UNFORMED = 3  # beside the faults of `repair`, for which it is one that conducts nothing
REPAIR_STREAM = 50  # beside the streams of EFFECTS


@dataclass(frozen=True, kw_only=True, eq=False)
class Die:
    """One piece of hardware. Arrays with the axis (synapse,) are in the network's order.

    Attributes
    ----------
    plan
        What is placed where.
    seed, index
        Seed and number of the die; None for the nominal one, on which no effect acts.
    state
        (synapse,) initial state s after programming, in [0, 1].
    event_charge
        (synapse,) charge (or flux) of one STDP event, 1 nominally.
    threshold
        (synapse,) threshold voltage [V].
    faults
        For every tile (physical_row, physical_column): 0 good, 1 stuck on, 2 stuck off, 3 unformed.
    repairs
        For every tile where its lines went, and which faults remain under its synapses.
    neuron_threshold, neuron_leak, neuron_bias
        (neuron,) factors of y_thresh, b and a.
    sense_offset
        (neuron,) added to what a receiver's column reads, in units of one synapse of W = 1.
    tile_gain
        (tile,) factors.
    wire_resistance
        Factor of all wires.
    keys
        Effect -> 64-bit key of its counter-based noise.
    """

    plan: Plan
    seed: int | None
    index: int | None
    state: FloatArray
    event_charge: FloatArray
    threshold: FloatArray
    faults: tuple[IntArray, ...]
    repairs: tuple[Repair, ...]
    neuron_threshold: FloatArray
    neuron_leak: FloatArray
    neuron_bias: FloatArray
    sense_offset: FloatArray
    tile_gain: FloatArray
    wire_resistance: float = 1.0
    keys: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        expect_type("Die.plan", self.plan, Plan)
        synapse = f"synapse={len(self.plan.crosspoints)}"
        neuron, tile = f"neuron={self.plan.network.neurons}", f"tile={len(self.plan.tiles)}"
        axes = {
            "state": synapse, "event_charge": synapse, "threshold": synapse, "neuron_threshold": neuron,
            "neuron_leak": neuron, "neuron_bias": neuron, "sense_offset": neuron, "tile_gain": tile,
        }  # fmt: skip
        for name, axis in axes.items():
            object.__setattr__(self, name, frozen_array(f"Die.{name}", getattr(self, name), (axis,)))

    @property
    def residual(self) -> tuple[int, ...]:
        """Synapses that stand on a fault."""
        on = {(t, row, column) for t, one in enumerate(self.repairs) for row, column in one.residual}
        return tuple(point.synapse for point in self.plan.crosspoints if (point.tile, point.row, point.column) in on)


def physical_shape(plan: Plan, t: int) -> tuple[int, int]:
    """Word lines and bit lines of a tile, spare ones included, without the reference column."""
    tile = plan.tiles[t]
    return len(tile.rows) + tile.spare_rows, len(tile.columns) + tile.spare_columns


def nominal(plan: Plan) -> Die:
    """Every device as its card says, every line where it was placed."""
    n, neurons = len(plan.crosspoints), plan.network.neurons
    faults = tuple(np.zeros(physical_shape(plan, t), dtype=np.int64) for t in range(len(plan.tiles)))
    return Die(
        plan=plan, seed=None, index=None, state=np.array([c.state for c in plan.crosspoints]),
        event_charge=np.ones(n), threshold=np.full(n, plan.hardware.drive.threshold.value), faults=faults,
        repairs=tuple(unrepaired(grid, _demand(plan, t)) for t, grid in enumerate(faults)),
        neuron_threshold=np.ones(neurons), neuron_leak=np.ones(neurons), neuron_bias=np.ones(neurons),
        sense_offset=np.zeros(neurons), tile_gain=np.ones(len(plan.tiles)),
    )  # fmt: skip


def sample(plan: Plan, *, seed: int, die: int = 0, is_repaired: bool = True) -> Die:
    """Draw what is sampled at build and program time of one die; streams are keyed by (effect, die).

    Parameters
    ----------
    plan
        What is placed where.
    seed, die
        Integers >= 0. Any worker that knows both draws the same die.
    is_repaired
        Whether lines are permuted, onto spare ones too, so that as little as possible of what the outputs receive
        runs through faults.

    Raises
    ------
    ParameterError
        If `seed` or `die` is no such integer.
    """
    seed, die = expect_integer("Plan.sample.seed", seed), expect_integer("Plan.sample.die", die)
    draw = _Streams(plan, seed, die)
    n, neurons, tiles = len(plan.crosspoints), plan.network.neurons, len(plan.tiles)
    faults = tuple(draw.faults(physical_shape(plan, t), t) for t in range(tiles))
    repairs = []
    for t, grid in enumerate(faults):
        seen, demand = np.where(grid == UNFORMED, STUCK_OFF, grid), _demand(plan, t)
        if is_repaired and seen.any():
            rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(REPAIR_STREAM, die, t)))
            repairs.append(repair(seen, demand, _importance(plan, t), rng=rng))
        else:
            repairs.append(unrepaired(seen, demand))
    return Die(
        plan=plan, seed=seed, index=die, state=_programmed(plan, draw.normal("write_verify", n)),
        # A meter cannot count backwards, nor a threshold be negative.
        event_charge=draw.factor("event_charge", n),
        threshold=plan.hardware.drive.threshold.value * draw.factor("threshold", n),
        faults=faults, repairs=tuple(repairs), neuron_threshold=draw.factor("neuron_threshold", neurons),
        neuron_leak=draw.factor("neuron_leak", neurons), neuron_bias=draw.factor("neuron_bias", neurons),
        sense_offset=draw.normal("sense_offset", neurons), tile_gain=draw.factor("tile_gain", tiles),
        wire_resistance=float(draw.factor("wire_resistance", 1)[0]),
        keys={name: draw.key(name) for name in ("cycle_to_cycle", "read_noise")},
    )  # fmt: skip


class _Streams:
    """One stream an effect, so that an effect leaves the draws of the others as they are."""

    def __init__(self, plan: Plan, seed: int, die: int) -> None:
        self._effects, self._seed, self._die = plan.hardware.nonidealities, seed, die

    def value(self, effect: str) -> float:
        quantity = getattr(self._effects, effect)
        return 0.0 if quantity is None else float(quantity.value)

    def _sequence(self, effect: str, *more: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self._seed, spawn_key=(EFFECTS[effect].stream, self._die, *more))

    def normal(self, effect: str, size: int) -> FloatArray:
        return self.value(effect) * np.random.default_rng(self._sequence(effect)).standard_normal(size)

    def factor(self, effect: str, size: int) -> FloatArray:
        return np.maximum(1.0 + self.normal(effect, size), 0.0)

    def key(self, effect: str) -> int:
        return int(self._sequence(effect).generate_state(1, np.uint64)[0])

    def faults(self, shape: tuple[int, int], tile: int) -> IntArray:
        grid = np.full(shape, GOOD, dtype=np.int64)
        # The last one wins: a cell that never formed cannot be stuck on.
        for effect, fault in (("stuck_off", STUCK_OFF), ("stuck_on", STUCK_ON), ("forming", UNFORMED)):
            uniform = np.random.default_rng(self._sequence(effect, tile)).random(shape)
            grid[uniform < self.value(effect)] = fault
        return grid


def _demand(plan: Plan, t: int) -> IntArray:
    tile = plan.tiles[t]
    wanted = np.zeros((len(tile.rows), len(tile.columns)), dtype=np.int64)
    for point in plan.crosspoints:
        if point.tile == t:
            wanted[point.row, point.column] = 1
    return wanted


def _importance(plan: Plan, t: int) -> FloatArray:
    tile = plan.tiles[t]
    of_columns = column_importance(plan.network)[list(tile.columns)]
    grid: FloatArray = np.broadcast_to(of_columns, (len(tile.rows), len(tile.columns)))
    return grid


def _programmed(plan: Plan, errors: FloatArray) -> FloatArray:
    """States after write-verify with errors in units of G_on, axes (synapse,)."""
    points = plan.crosspoints
    states, wanted = np.array([point.state for point in points]), np.array([point.conductance for point in points])
    of_tile, devices = np.array([point.tile for point in points]), plan.hardware.devices
    for t, tile in enumerate(plan.tiles):
        missed, device = (of_tile == t) & (errors != 0.0), devices[tile.kind]
        g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
        g = np.clip(wanted[missed] + errors[missed] * g_on, g_off, g_on)
        if g.size:
            states[missed] = device.state_at_weight(np.clip(g / g_on, g_off / g_on, 1.0))
    return states
