"""Compiled programming: of which cells a step asks something, what that does to them, how long it takes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import inlined_kernel, kernel, lowest_bit
from ohmloom.mapping._cell_kernels import write_pulse
from ohmloom.mapping._fabric import (
    ARRAY,
    BUSY_LINES,
    CHARGE_TOTAL,
    DISABLED_EVENTS,
    EVENTS,
    IDEAL,
    LOST,
    MAY_FIRE,
    PROGRAM_ENERGY,
    SPURIOUS,
    WANTED_DOWN,
    WANTED_UP,
    WORD,
    Fabric,
    FabricState,
    Indices,
)
from ohmloom.mapping._wire_kernels import half_select, program_tile

# Unsigned as the other indices are, so that none is asked whether it counts from the end.
UP, DOWN = np.uint32(0), np.uint32(1)  # pulses of a busy line
BITS, ONE = np.uint64(WORD), np.uint64(1)


@inlined_kernel
def words_in(count: np.uint64) -> np.uint64:
    """Numbers that hold a bit for each neuron."""
    return (count + BITS - ONE) // BITS


@inlined_kernel
def program_cells(
    pulses: Any, cells: Any, state: Any, tiles: Any, constants: Any, neurons: Any, table: Any, asking: Indices,
    pairs: Indices, programmed: IntArray, phase: FloatArray, seen: FloatArray, busy: FloatArray, total: FloatArray,
    clock: IntArray, is_stale: Any, by_ls: IntArray,
) -> None:  # fmt: skip
    """Program cells that see exactly the voltage of their lines, or that are selected one by one.

    One long function, and sums in local variables: an array that a part of it took would be reference-counted for every
    event.
    """
    count = np.uint64(neurons.shape[0])
    words, voltage = words_in(count), constants["pulse_voltage"]
    events, ideal, lost, spurious, disabled, is_busy = 0, 0, 0, 0, 0, 0
    all_charge, all_energy = total[CHARGE_TOTAL], total[PROGRAM_ENERGY]
    for q in range(asking.shape[0]):
        pre, post = asking[q, 0], asking[q, 1]
        asked = table[pre, post]
        wanted = 1.0 if asked & WANTED_UP else -1.0 if asked & WANTED_DOWN else 0.0
        phases = phase.shape[0] if asked & MAY_FIRE else 0
        row, column, strength, width = seen[0, pre, post, 0], seen[0, pre, post, 1], seen[0, pre, post, 2], phase[0]
        for v in range(words):
            receivers = by_ls[post, v]
            while receivers != 0:
                j = v * BITS + np.uint64(lowest_bit(receivers))
                receivers &= receivers - 1
                for w in range(words):
                    senders = by_ls[pre, w] & programmed[j, w]
                    while senders != 0:
                        pair = j * count + w * BITS + np.uint64(lowest_bit(senders))
                        senders &= senders - 1
                        for k in range(pairs[pair], pairs[pair + ONE]):
                            cell, now = cells[k], state[k]
                            tile = tiles[cell["tile"]]
                            if tile["family"] < 0:
                                continue
                            # All phases; the signed part of an event that was written.
                            written = 0.0
                            for p in range(phases):
                                if phases > 1:
                                    row, column, width = seen[p, pre, post, 0], seen[p, pre, post, 1], phase[p]
                                    strength = seen[p, pre, post, 2]
                                if column == row:
                                    continue
                                sign, at_cell = 1 if column > row else -1, strength * voltage
                                if cell["series"] > 0.0:
                                    at_cell /= 1.0 + cell["series"] * now["g"]
                                if cell["is_live"] and at_cell > cell["threshold"]:
                                    duration, charge, energy = write_pulse(
                                        pulses, cell, now, tile, constants, sign, strength, width
                                    )  # fmt: skip
                                    line, side = cell["line"], UP if sign > 0 else DOWN
                                    if constants["parallelism"] == ARRAY:
                                        busy[line, side] = max(busy[line, side], duration)
                                    else:
                                        busy[line, side] += duration
                                    all_charge += charge
                                    all_energy += energy
                                    written += sign * width
                                elif constants["counts_half_selects"]:
                                    all_energy += at_cell * at_cell * now["g"] * tile["duration"] * width
                                    half_select(pulses, cell, now, tile, constants, total, row, column, sign)
                            if phases:
                                is_busy = 1
                                is_stale[cell["tile"]] = True
                            fired = 1 if written != 0.0 else 0
                            now["pulses"] += fired
                            events += fired
                            if not cell["is_synapse"]:
                                disabled += fired
                            else:
                                ideal += 1 if wanted != 0.0 else 0
                                if written != wanted:
                                    lost += 1 if wanted != 0.0 else 0
                                    spurious += fired
    total[CHARGE_TOTAL], total[PROGRAM_ENERGY] = all_charge, all_energy
    total[EVENTS] += events
    total[IDEAL] += ideal
    total[LOST] += lost
    total[SPURIOUS] += spurious
    total[DISABLED_EVENTS] += disabled
    clock[BUSY_LINES] = is_busy


@inlined_kernel
def judge(is_synapse: bool, asked: int, written: float, total: FloatArray) -> int:
    """Enter into the ledger what one cell was asked for and what it did; the pulses that it got."""
    fired = written != 0.0
    total[EVENTS] += fired
    if not is_synapse:
        total[DISABLED_EVENTS] += fired
        return 1 if fired else 0
    wanted = 1.0 if asked & WANTED_UP else -1.0 if asked & WANTED_DOWN else 0.0
    total[IDEAL] += wanted != 0.0
    total[LOST] += wanted != 0.0 and written != wanted
    total[SPURIOUS] += fired and written != wanted
    return 1 if fired else 0


@kernel
def program_wired(f: Fabric, s: FabricState) -> None:
    """The waveform on all lines of all tiles at once, through their wires."""
    for ls in range(s.by_ls.shape[0]):
        for j in range(s.neurons.shape[0]):
            if s.by_ls[ls, j // WORD] >> j % WORD & 1:
                s.neurons[j]["ls"] = ls
    for t in range(f.tiles.shape[0]):
        if f.tiles[t]["family"] >= 0:
            program_tile(f, s, t)
            s.busy[t, UP] = f.tiles[t]["duration"] * f.phase.sum()
            s.clock[BUSY_LINES] = 1
    for k in range(f.cells.shape[0]):
        cell = f.cells[k]
        if f.tiles[cell["tile"]]["family"] >= 0:
            written = 0.0
            for phase in range(f.phase.shape[0]):
                written += s.lines.fired[phase, k] * f.phase[phase]
            asked = f.table[s.neurons[cell["sender"]]["ls"], s.neurons[cell["receiver"]]["ls"]]
            s.cells[k]["pulses"] += judge(cell["is_synapse"], asked, written, s.total)
