"""From a network to the arrays that the compiled controller runs on."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ohmloom._arrays import IntArray
from ohmloom.neurocontroller import _kernels
from ohmloom.neurocontroller.kinds import LATTICES, PLASTIC_KINDS, charge_levels
from ohmloom.neurocontroller.network import Network
from ohmloom.neurocontroller.rules import INPUTS, OUTPUTS

if TYPE_CHECKING:
    from ohmloom.neurocontroller.device_levels import DeviceEvents

MASK_LIMIT = _kernels.BITS  # neurons that fit the bits of a signed 64-bit integer
NOT_PLASTIC = len(PLASTIC_KINDS)


@cache
def level_tables() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weight, next level up and next level down, axes (kind, level)."""
    levels = [charge_levels(LATTICES[kind]) for kind in PLASTIC_KINDS]
    width = max(map(len, levels))
    weights = np.zeros((len(levels), width))
    up, down = (np.zeros((len(levels), width), dtype=np.int16) for _ in range(2))
    for row, (kind, charges) in enumerate(zip(PLASTIC_KINDS, levels, strict=True)):
        lattice = LATTICES[kind]
        index = {q: level for level, q in enumerate(charges)}
        for level, q in enumerate(charges):
            weights[row, level] = lattice.weight(q)
            up[row, level] = index[min(q + lattice.event, lattice.top)]
            down[row, level] = index[max(q - lattice.event, 0)]
    return weights, up, down


@cache
def start_level(kind: str) -> int:
    """Level of W = 0.5."""
    return charge_levels(LATTICES[kind]).index(LATTICES[kind].start)


@lru_cache(maxsize=16)
def device_tables(events: tuple[DeviceEvents | None, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `level_tables`, for plastic kinds on device cards; a kind that is None has no levels."""
    levels = [None if of_kind is None else of_kind.levels for of_kind in events]
    width = max((len(found.weights) for found in levels if found is not None), default=1)
    # Charges have 3000 levels; 16 bits keep their tables, and the kernels, those of the lattice.
    is_flux = any(of_kind is not None and of_kind.event_flux is not None for of_kind in events)
    weights = np.zeros((len(levels), width))
    up, down = (np.zeros((len(levels), width), dtype=np.int32 if is_flux else np.int16) for _ in range(2))
    for row, found in enumerate(levels):
        if found is not None:
            weights[row, : len(found.weights)] = found.weights
            up[row, : len(found.up)], down[row, : len(found.down)] = found.up, found.down
    return weights, up, down


def wire(network: Network, events: Mapping[str, DeviceEvents] | None = None) -> _kernels.Wiring:
    """Arrays of one network, read only, for the kernels; plastic kinds are the paper's unless `events` are given."""
    r, n = network.readings, network.neurons
    first_output = n - OUTPUTS
    has_masks = r.last_spike == 3 and r.stdp_threshold == 4 and r.weight_at == "arrival"
    masked = has_masks and n <= MASK_LIMIT
    masks = np.zeros((4, n), dtype=np.int64)
    direct, descending, ascending, plastic = masks
    words = np.zeros((4, n, -(-n // MASK_LIMIT) if has_masks and not masked else 0), dtype=np.int64)
    sign = np.array([network.sign(j) for j in range(n)])
    kind = np.full((n, n), NOT_PLASTIC, dtype=np.int8)
    weight = np.zeros((n, n))
    if events is None:
        tables, up, down = level_tables()
    else:
        tables, up, down = device_tables(tuple(events.get(name) for name in PLASTIC_KINDS))
    level = np.zeros((n, n), dtype=up.dtype)
    starts = np.zeros(n + 1, dtype=np.int64)
    senders: list[int] = []
    delays: list[int] = []
    for post, group in enumerate(network.inbound()):
        for k in group:
            synapse = network.synapses[k]
            pre = synapse.pre
            delays.append(network.delay(synapse))
            senders.append(pre)
            weight[post, pre] = sign[pre] * synapse.weight
            is_lateral = pre >= INPUTS and post < first_output and r.hidden_delay == "index"
            word, bit = (0, pre) if masked else divmod(pre, MASK_LIMIT)
            if has_masks:
                target = masks if masked else words[:, :, word]
                target[0 if not is_lateral else 1 if pre > post else 2, post] |= 1 << bit
            if synapse.kind in LATTICES:
                kind[post, pre] = PLASTIC_KINDS.index(synapse.kind)
                if events is None:
                    level[post, pre] = start_level(synapse.kind)
                else:
                    level[post, pre] = events[synapse.kind].levels.start
                    weight[post, pre] = sign[pre] * tables[kind[post, pre], level[post, pre]]
                if has_masks:
                    target[3, post] |= 1 << bit
        starts[post + 1] = len(senders)
    return _kernels.Wiring(
        n, masked, direct, descending, ascending, plastic, words, sign, kind, weight, level,
        starts, np.array(senders, dtype=np.int64), np.array(delays, dtype=np.int64), tables, up, down,
        r.a, r.b, r.c, r.c_ini, r.y_thresh, r.synapse_gain, r.last_spike, r.stdp_threshold, r.high_count,
        r.weight_at == "emission", r.input_bias, r.clamp, r.carry_state,
    )  # fmt: skip


def new_state(wiring: _kernels.Wiring) -> _kernels.ControllerState:
    """State of a network before its first step."""
    n, synapses = wiring.neurons, len(wiring.senders)
    # Masks keep no ring, but the arrays must exist for the compiler.
    words = wiring.words.shape[2]
    slots = 1 if wiring.masked or words else int(wiring.delays.max(initial=1)) + 1
    state = _kernels.ControllerState(
        np.empty(n), np.empty((n, n)), np.empty((n, n), dtype=wiring.up.dtype), np.zeros(1, dtype=np.int64),
        np.zeros((2, n), dtype=np.int64), np.zeros((3, words), dtype=np.int64),
        np.zeros((2, n, words), dtype=np.int64), np.zeros(n, dtype=np.int64), np.zeros((slots, n), dtype=np.bool_),
        np.zeros((slots if wiring.at_emission else 1, synapses)), np.zeros(1, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )  # fmt: skip
    _kernels.reset(wiring, state)
    return state


def synapse_places(network: Network) -> tuple[IntArray, IntArray]:
    """Index of a (post, pre) matrix that gives its entries in the network's order of synapses."""
    ends = np.array([(s.post, s.pre) for s in network.synapses], dtype=np.int64).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]
