"""Compiled programming: of which cells a step asks something, what that does to them, how long it takes."""

from __future__ import annotations

from typing import Any

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import inlined_kernel, inner_kernel, kernel
from ohmloom.mapping._cell_kernels import write_pulse
from ohmloom.mapping._fabric import (
    ARRAY,
    BUSY,
    BUSY_LINES,
    CHARGE_TOTAL,
    COLUMN,
    COLUMN_LINE,
    DISABLED_EVENTS,
    EVENTS,
    IDEAL,
    LOST,
    MAY_FIRE,
    PROGRAM_ENERGY,
    ROW,
    SPURIOUS,
    WANTED_DOWN,
    WANTED_UP,
    WORST_BUSY,
    Fabric,
    FabricState,
    Indices,
)
from ohmloom.mapping._wire_kernels import half_select, program_tile
from ohmloom.neurocontroller._kernels import INPUTS


@inlined_kernel
def judge(is_synapse: bool, asked: int, written: float, total: FloatArray) -> int:
    """Enter into the ledger what one cell was asked for and what it did; the pulses that it got."""
    fired = written != 0.0
    if fired:
        total[EVENTS] += 1
    if not is_synapse:
        total[DISABLED_EVENTS] += fired
        return 1 if fired else 0
    wanted = 1.0 if asked & WANTED_UP else -1.0 if asked & WANTED_DOWN else 0.0
    total[IDEAL] += wanted != 0.0
    total[LOST] += wanted != 0.0 and written != wanted
    total[SPURIOUS] += fired and written != wanted
    return 1 if fired else 0


@inlined_kernel
def write_cell(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, phase: FloatArray, levels: FloatArray, pre: int,
    post: int, busy: FloatArray, total: FloatArray,
) -> float:  # fmt: skip
    """All phases on one cell that sees the voltage of its lines; the signed part of an event that was written."""
    written = 0.0
    for p in range(phase.shape[0]):
        row, column, width = levels[p, ROW, pre], levels[p, COLUMN_LINE, post], phase[p]
        level = column - row
        if level == 0.0:
            continue
        strength = abs(level) / constants["event_level"]
        sign, v = 1 if level > 0.0 else -1, strength * constants["pulse_voltage"]
        if cell["series"] > 0.0:
            v /= 1.0 + cell["series"] * now["g"]
        if cell["is_live"] and v > cell["threshold"]:
            duration, charge, energy = write_pulse(pulses, cell, now, tile, constants, sign, strength, width)
            t, side = cell["tile"], 0 if sign > 0 else 1
            if constants["parallelism"] == ARRAY:
                busy[t, 0, side] = max(busy[t, 0, side], duration)
            else:
                busy[t, cell["column"] if constants["parallelism"] == COLUMN else 0, side] += duration
            total[CHARGE_TOTAL] += charge
            total[PROGRAM_ENERGY] += energy
            written += sign * width
        elif constants["counts_half_selects"]:
            total[PROGRAM_ENERGY] += v * v * now["g"] * tile["duration"] * width
            half_select(pulses, cell, now, tile, constants, total, row, column, sign)
    return written


@inlined_kernel
def program_cells(
    pulses: Any, cells: Any, state: Any, tiles: Any, constants: Any, neurons: Any, starts: Indices, table: Any,
    phase: FloatArray, levels: FloatArray, busy: FloatArray, total: FloatArray, clock: IntArray, is_stale: Any,
    asked: IntArray,
) -> None:  # fmt: skip
    """Program cells that see exactly the voltage of their lines, or that are selected one by one."""
    for j in range(INPUTS, neurons.shape[0]):
        post = neurons[j]["ls"]
        anything = 0
        for pre in range(table.shape[0]):
            anything |= table[pre, post]
        if anything == 0:
            continue
        # Counting on instead of branching: nothing foretells of which cell something is asked.
        found = 0
        for k in range(starts[j], starts[j + 1]):
            asked[found] = k
            found += table[neurons[cells[k]["sender"]]["ls"], post] != 0
        for n in range(found):
            k = asked[n]
            cell = cells[k]
            pre = neurons[cell["sender"]]["ls"]
            wanted = table[pre, post]
            tile = tiles[cell["tile"]]
            if tile["family"] < 0:
                continue
            written = 0.0
            if wanted & MAY_FIRE:
                clock[BUSY_LINES] = 1
                is_stale[cell["tile"]] = True
                written = write_cell(
                    pulses, cell, state[k], tile, constants, phase, levels, pre, post, busy, total
                )  # fmt: skip
            state[k]["pulses"] += judge(cell["is_synapse"], wanted, written, total)


@kernel
def program_wired(f: Fabric, s: FabricState) -> None:
    """The waveform on all lines of all tiles at once, through their wires."""
    for t in range(f.tiles.shape[0]):
        if f.tiles[t]["family"] >= 0:
            program_tile(f, s, t)
            s.busy[t, 0, 0] = f.tiles[t]["duration"] * f.phase.sum()
            s.clock[BUSY_LINES] = 1
    for k in range(f.cells.shape[0]):
        cell = f.cells[k]
        if f.tiles[cell["tile"]]["family"] >= 0:
            written = 0.0
            for phase in range(f.phase.shape[0]):
                written += s.lines.fired[phase, k] * f.phase[phase]
            asked = f.table[s.neurons[cell["sender"]]["ls"], s.neurons[cell["receiver"]]["ls"]]
            s.cells[k]["pulses"] += judge(cell["is_synapse"], asked, written, s.total)


@inner_kernel
def account_time(busy: FloatArray, total: FloatArray) -> None:
    """All tiles are programmed side by side at the end of a step; within one, columns side by side."""
    worst = 0.0
    for t in range(busy.shape[0]):
        for column in range(busy.shape[1]):
            worst = max(worst, busy[t, column, 0] + busy[t, column, 1])
            busy[t, column, 0] = busy[t, column, 1] = 0.0
    total[BUSY] += worst
    total[WORST_BUSY] = max(total[WORST_BUSY], worst)
