"""Compiled emulation: line voltages, column currents, charge integrators, and pulses through each device's own law.

Weights and charges here are conductances and coulombs; nothing is shared with the discrete controller but the membrane
equation and the classification of the outputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import copy_flat, kernel
from ohmloom.devices._kernels import conductance, current_pulse, metered_pulse
from ohmloom.neurocontroller._kernels import INPUTS, STEPS, classify, membrane

CELL, COLUMN, ARRAY = 0, 1, 2
CHARGE_METERED, CURRENT = 0, 1
# Entries of Fabric state's `total`.
EVENTS, LOST, SPURIOUS, IDEAL, CHARGE, PROGRAM_ENERGY, READ_ENERGY, SPIKES, STEPS_DONE, BUSY, WORST_BUSY = range(11)
TOTALS = 11


class Fabric(NamedTuple):
    """One die, read only. Synapses are sorted by receiver, then tile, then row."""

    neurons: int
    tiles: int
    starts: IntArray  # (receiver + 1,)
    sender: IntArray  # (synapse,)
    receiver: IntArray
    tile: IntArray
    column: IntArray  # (synapse,) index of the bit line within its tile
    polarity: FloatArray
    tap: IntArray
    first_state: FloatArray
    event_charge: FloatArray  # (synapse,) [C]
    threshold: FloatArray  # (synapse,) [V]
    law: IntArray  # (tile,)
    parameters: FloatArray  # (tile, parameter)
    charge_scale: FloatArray  # (tile,) q_d [C]
    reference: FloatArray  # (tile,) conductance that is subtracted [S]
    gain: FloatArray  # (tile,) 1 / (V_read (G_on - reference)) [1/A]
    is_plastic: npt.NDArray[np.bool_]  # (tile,)
    levels: FloatArray  # (ls,) line voltage [V]
    drive: int
    parallelism: int
    pulse_voltage: float
    pulse_duration: float
    read_voltage: float
    read_duration: float
    a: float
    b: float
    c: float
    c_ini: float
    y_thresh: float
    synapse_gain: float
    stdp_threshold: int
    high_count: int
    input_bias: bool
    clamp: bool
    carry: bool


class FabricState(NamedTuple):
    """What changes while a die runs."""

    y: FloatArray  # (neuron,)
    ls: IntArray  # (neuron,)
    ring: npt.NDArray[np.bool_]  # (slot, neuron) shift registers of the rows
    clock: IntArray  # [step]
    state: FloatArray  # (synapse,) s
    g: FloatArray  # (synapse,) [S]
    pulses: IntArray  # (synapse,)
    busy: FloatArray  # (tile, column, polarity) programming time of this step [s]
    total: FloatArray  # (TOTALS,)


@kernel
def reset_activity(f: Fabric, s: FabricState) -> None:
    s.y[:] = f.c_ini
    s.ls[:] = 0
    s.ring[:] = False
    s.clock[0] = 0


@kernel
def reset(f: Fabric, s: FabricState) -> None:
    """Every device back to its programmed state; the ledger too."""
    reset_activity(f, s)
    copy_flat(s.state, f.first_state)
    for k in range(f.sender.shape[0]):
        t = f.tile[k]
        s.g[k] = conductance(f.law[t], s.state[k], 0.0, f.parameters[t])
    s.pulses[:] = 0
    s.total[:] = 0.0


@kernel
def read_column(
    starts: IntArray, sender: IntArray, tile: IntArray, polarity: FloatArray, tap: IntArray, reference: FloatArray,
    gain: FloatArray, voltage: float, ring: npt.NDArray[np.bool_], now: int, g: FloatArray, receiver: int,
) -> tuple[float, float]:  # fmt: skip
    """Column-serial read of one receiver: sum over its tiles of (column - reference current) * gain.

    Each row is driven at its polarity if the tap of its shift register holds a spike. Returns the weighted sum and
    the power drawn from the rows [W].
    """
    slots = ring.shape[0]
    total, power = 0.0, 0.0
    current, subtracted, open_tile = 0.0, 0.0, -1
    for k in range(starts[receiver], starts[receiver + 1]):
        if tile[k] != open_tile:
            if open_tile >= 0:
                total += (current - subtracted) * gain[open_tile]
            current, subtracted, open_tile = 0.0, 0.0, tile[k]
        sent = now - tap[k]
        if sent >= 0 and ring[sent % slots, sender[k]]:
            v = polarity[k] * voltage
            current += v * g[k]
            subtracted += v * reference[open_tile]
            power += voltage * voltage * (g[k] + reference[open_tile])
    if open_tile >= 0:
        total += (current - subtracted) * gain[open_tile]
    return total, power


@kernel
def _program(f: Fabric, s: FabricState) -> None:
    """Two-part spikes on rows and columns: every device above its threshold gets one event through its own law."""
    levels, law, parameters, q_d = f.levels, f.law, f.parameters, f.charge_scale
    sender, receiver, tiles, columns = f.sender, f.receiver, f.tile, f.column
    threshold, event_charge, is_plastic = f.threshold, f.event_charge, f.is_plastic
    ls, state, g, busy, total, pulses = s.ls, s.state, s.g, s.busy, s.total, s.pulses
    limit = f.stdp_threshold
    busy[:] = 0.0
    for k in range(sender.shape[0]):
        t = tiles[k]
        if not is_plastic[t]:
            continue
        pre, post = ls[sender[k]], ls[receiver[k]]
        v = levels[post] - levels[pre]
        fired = 1 if v > threshold[k] else (-1 if v < -threshold[k] else 0)
        wanted = 0
        if pre + post > limit and pre != post:
            wanted = 1 if post > pre else -1
        total[IDEAL] += wanted != 0
        total[LOST] += wanted != 0 and fired != wanted
        total[SPURIOUS] += fired != 0 and fired != wanted
        if fired == 0:
            continue
        charge = fired * event_charge[k]
        if f.drive == CHARGE_METERED:
            state[k], duration, energy = metered_pulse(
                law[t], state[k], parameters[t], q_d[t], fired * f.pulse_voltage, charge
            )
        else:
            duration = f.pulse_duration
            state[k], energy, _ = current_pulse(law[t], state[k], parameters[t], q_d[t], charge / duration, duration)
        g[k] = conductance(law[t], state[k], 0.0, parameters[t])
        side = 0 if fired > 0 else 1
        if f.parallelism == ARRAY:
            busy[t, 0, side] = max(busy[t, 0, side], duration)
        elif f.parallelism == COLUMN:
            busy[t, columns[k], side] += duration
        else:
            busy[t, 0, side] += duration
        pulses[k] += 1
        total[EVENTS] += 1
        total[CHARGE] += abs(charge)
        total[PROGRAM_ENERGY] += energy


@kernel
def _account_time(busy: FloatArray, total: FloatArray) -> None:
    """All tiles are programmed side by side at the end of a step; within one, columns side by side."""
    worst = 0.0
    for t in range(busy.shape[0]):
        for column in range(busy.shape[1]):
            worst = max(worst, busy[t, column, 0] + busy[t, column, 1])
    total[BUSY] += worst
    total[WORST_BUSY] = max(total[WORST_BUSY], worst)
    total[STEPS_DONE] += 1


@kernel
def run_steps(f: Fabric, s: FabricState, sensors: FloatArray, spiked: IntArray, last_spike: int, steps: int) -> None:
    """`steps` steps with constant sensor values; `spiked` (neuron,) counts up with each spike."""
    slots = s.ring.shape[0]
    neurons, a, b, c, clamp, gain = f.neurons, f.a, f.b, f.c, f.clamp, f.synapse_gain
    starts, sender, tile, polarity, tap = f.starts, f.sender, f.tile, f.polarity, f.tap
    reference, tile_gain, voltage = f.reference, f.gain, f.read_voltage
    y_all, ls, ring, g, total = s.y, s.ls, s.ring, s.g, s.total
    input_bias = a if f.input_bias else 0.0
    for _ in range(steps):
        now = s.clock[0]
        for j in range(neurons):
            if j < INPUTS:
                y = membrane(y_all[j], sensors[j], input_bias, b, clamp)
            else:
                weighted, power = read_column(
                    starts, sender, tile, polarity, tap, reference, tile_gain, voltage, ring, now, g, j
                )
                total[READ_ENERGY] += power * f.read_duration
                y = membrane(y_all[j], gain * weighted, a, b, clamp)
            above = y > f.y_thresh
            y_all[j] = c if above else y
            ring[now % slots, j] = above
            if above:
                ls[j] = last_spike
                spiked[j] += 1
                total[SPIKES] += 1
        _program(f, s)
        _account_time(s.busy, total)
        for j in range(neurons):
            if ls[j] > 0:
                ls[j] -= 1
        s.clock[0] = now + 1


@kernel
def timestep(f: Fabric, s: FabricState, sensors: FloatArray, spiked: IntArray, last_spike: int) -> int:
    """21 steps; `spiked` (neuron,) becomes the spike counts. Returns the action."""
    if not f.carry:
        reset_activity(f, s)
    spiked[:] = 0
    run_steps(f, s, sensors, spiked, last_spike, STEPS)
    return classify(spiked[f.neurons - 2], spiked[f.neurons - 1], f.high_count)
