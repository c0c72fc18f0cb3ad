"""Compiled emulation: spikes on rows, currents into columns, membranes, and pulses through each device's own law.

Nothing is shared with the discrete controller but the membrane equation, the classification of the outputs, and how
events are counted where a law has a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import choose_by_type, inlined_kernel, inner_kernel, kernel
from ohmloom._philox_kernels import normal
from ohmloom.devices._event_kernels import read_weight
from ohmloom.mapping._cell_kernels import count_events, place_at, refresh
from ohmloom.mapping._fabric import (
    BUSY,
    BUSY_LINES,
    FAILED,
    READ_ENERGY,
    SPIKES,
    STEP,
    STEPS_DONE,
    WORST_BUSY,
    DrivenLines,
    Fabric,
    FabricState,
    Indices,
    Lasting,
    LineState,
    NoWires,
    Passing,
    SelectedCells,
    Wires,
)
from ohmloom.mapping._program_kernels import BITS, DOWN, ONE, UP, program_cells, program_wired, words_in
from ohmloom.mapping._wire_kernels import prepare_lines
from ohmloom.neurocontroller._kernels import INPUTS, STEPS, classify, membrane


@kernel
def reset_activity(f: Fabric, s: FabricState) -> None:
    for j in range(s.neurons.shape[0]):
        s.neurons[j]["y"] = f.constants[0]["c_ini"]
    s.ring[:] = 0.0
    s.by_ls[:] = 0
    s.clock[STEP] = 0


@kernel
def reset(f: Fabric, s: FabricState) -> None:
    """Every device back to its programmed state; the ledger too."""
    reset_activity(f, s)
    for k in range(f.cells.shape[0]):
        cell, now, tile = f.cells[k], s.cells[k], f.tiles[f.cells[k]["tile"]]
        now["s"], now["origin"], now["count"] = cell["first_s"], cell["first_origin"], 0.0
        now["belief_origin"], now["belief_count"] = cell["first_belief"], 0.0
        now["pulses"] = 0
        if cell["is_live"]:
            refresh(f.pulses, cell, now, tile)
        else:
            g = cell["fixed_g"]
            now["g"], now["load"] = g, g + tile["reference"]
            now["weight"] = cell["polarity"] * tile["gain"] * read_weight(g, tile["reference"], tile["g_on"])
    s.is_stale[:] = True
    s.total[:] = 0.0
    s.clock[FAILED] = 0
    _reset_lines(s.lines)


@inner_kernel
def age(f: Fabric, s: FabricState) -> None:
    """What one timestep does to every state at rest."""
    decay = f.constants[0]["decay"]
    if decay != 1.0:
        for k in range(f.cells.shape[0]):
            if f.cells[k]["is_live"]:
                place_at(f.pulses, f.cells[k], s.cells[k], f.tiles[f.cells[k]["tile"]], s.cells[k]["s"] * decay)
        s.is_stale[:] = True


@inlined_kernel
def read_column(
    starts: Indices, cells: Any, state: Any, spikes: FloatArray, j: int, now: np.uint64
) -> tuple[float, float]:
    """Column-serial read of one receiver: weighted sum, conductance that its rows drive [S].

    A row is driven if the tap of its shift register holds a spike. Adding 0 for the others changes no bit of the sum,
    and costs less than asking. `spikes` is the ring laid out flat, `now` where this step begins in it, a
    round later: unsigned and never negative, so that no index is asked whether it counts from the end.
    """
    mask = np.uint64(spikes.shape[0] - 1)
    total, conducting = 0.0, 0.0
    for k in range(starts[j], starts[j + 1]):
        spike = spikes[(now - cells[k]["late"]) & mask]
        total += spike * state[k]["weight"]
        conducting += spike * state[k]["load"]
    return total, conducting


@inlined_kernel
def column_squares(
    starts: Indices, cells: Any, state: Any, spikes: FloatArray, j: int, now: np.uint64
) -> float:  # fmt: skip
    """Sum of the squares of what `read_column` adds."""
    mask = np.uint64(spikes.shape[0] - 1)
    squares = 0.0
    for k in range(starts[j], starts[j + 1]):
        part = spikes[(now - cells[k]["late"]) & mask] * state[k]["weight"]
        squares += part * part
    return squares


@inner_kernel
def disturb(f: Fabric, s: FabricState, now: int) -> None:
    """What a step's reads do to the cells that are read: a positive row pulse depresses."""
    part, mask = f.constants[0]["read_disturb"], s.ring.shape[0] - 1
    for k in range(f.cells.shape[0]):
        cell = f.cells[k]
        if cell["is_live"] and s.ring[(now - cell["tap"]) & mask, cell["sender"]] > 0.0:
            tile = f.tiles[cell["tile"]]
            count_events(s.cells[k], tile, -part if cell["polarity"] > 0.0 else part)
            refresh(f.pulses, cell, s.cells[k], tile)
            s.is_stale[cell["tile"]] = True


@inlined_kernel
def sense(constants: Any, neuron: Any, j: int, read: int, total: float, squares: float) -> float:
    """What the periphery makes of a column's current: settling, offset, noise, converter."""
    total = total * constants["settled"] + neuron["offset"]
    if constants["read_noise"] > 0.0:
        total += constants["read_noise"] * math.sqrt(squares) * normal(constants["read_key"], j, read)
    if constants["bits"] > 0 and neuron["full_scale"] > 0.0:
        step = 2.0 * neuron["full_scale"] / (1 << constants["bits"])
        total = min(max(step * math.floor(total / step + 0.5), -neuron["full_scale"]), neuron["full_scale"])
    return total


# Each part takes long to compile: a fabric's types name those that it needs.
def _prepare_reads(wires: Any, f: Fabric, s: FabricState) -> None:
    _PREPARATIONS[type(wires)](wires, f, s)


def _prepare_none(wires: Any, f: Fabric, s: FabricState) -> None:
    pass


def _program(lines: Any, f: Fabric, s: FabricState) -> None:
    _PROGRAMS[type(lines)](lines, f, s)


def _program_selected(lines: Any, f: Fabric, s: FabricState) -> None:
    program_cells(
        f.pulses, f.cells, s.cells, f.tiles, f.constants[0], s.neurons, f.table, f.asking, f.pairs, f.programmed,
        f.phase, f.seen, s.busy, s.total, s.clock, s.is_stale, s.by_ls,
    )  # fmt: skip


def _program_driven(lines: Any, f: Fabric, s: FabricState) -> None:
    program_wired(f, s)


def _age(rest: Any, f: Fabric, s: FabricState) -> None:
    _AGES[type(rest)](rest, f, s)


def _age_not(rest: Any, f: Fabric, s: FabricState) -> None:
    pass


def _age_all(rest: Any, f: Fabric, s: FabricState) -> None:
    age(f, s)


def _disturb(rest: Any, f: Fabric, s: FabricState, now: int) -> None:
    _DISTURBS[type(rest)](rest, f, s, now)


def _disturb_none(rest: Any, f: Fabric, s: FabricState, now: int) -> None:
    pass


def _disturb_read(rest: Any, f: Fabric, s: FabricState, now: int) -> None:
    if f.constants[0]["read_disturb"] > 0.0:
        disturb(f, s, now)


def _reset_lines(lines: Any) -> None:
    _RESETS[type(lines)](lines)


def _reset_none(lines: Any) -> None:
    pass


def _reset_guesses(lines: Any) -> None:
    lines.u[:] = 0.0
    lines.u_program[:] = 0.0


_PREPARATIONS: dict[type, Callable[..., None]] = {NoWires: _prepare_none, Wires: prepare_lines}
_PROGRAMS: dict[type, Callable[..., None]] = {SelectedCells: _program_selected, DrivenLines: _program_driven}
_AGES: dict[type, Callable[..., None]] = {Lasting: _age_not, Passing: _age_all}
_DISTURBS: dict[type, Callable[..., None]] = {Lasting: _disturb_none, Passing: _disturb_read}
_RESETS: dict[type, Callable[..., None]] = {NoWires: _reset_none, LineState: _reset_guesses}
choose_by_type(_prepare_reads, _PREPARATIONS)
choose_by_type(_program, _PROGRAMS)
choose_by_type(_age, _AGES)
choose_by_type(_disturb, _DISTURBS)
choose_by_type(_reset_lines, _RESETS)


@kernel
def run_steps(f: Fabric, s: FabricState, sensors: FloatArray, spiked: IntArray, steps: int) -> None:
    """`steps` steps with constant sensor values; `spiked` (neuron,) counts up with each spike.

    All tiles are programmed side by side at the end of a step, and so are the lines of each.
    """
    neurons, state, ring, total, constants = f.neurons, s.neurons, s.ring, s.total, f.constants[0]
    spikes, count, inputs = ring.reshape(-1), np.uint64(neurons.shape[0]), np.uint64(INPUTS)
    by_ls, words, slots, width = s.by_ls, words_in(count), ring.shape[0], ring.shape[1]
    busy, lines = s.busy, np.uint64(s.busy.shape[0])
    clamp, gain, c, last_spike = constants["clamp"], constants["synapse_gain"], constants["c"], constants["last_spike"]
    read_starts, reads, read_state = f.read_starts, f.reads, s.reads
    energy = constants["read_voltage"] * constants["read_voltage"] * constants["read_duration"]
    for _ in range(steps):
        now, step = s.clock[STEP], int(total[STEPS_DONE])
        begin, slot = np.uint64((now + slots) * width), np.uint64((now & (slots - 1)) * width)
        _prepare_reads(f.wires, f, s)
        fired, spent = 0, total[READ_ENERGY]
        for w in range(words):
            bits: Any = 0
            first, last = w * BITS, min((w + ONE) * BITS, count)
            for j in range(first, last):
                if j < inputs:
                    drive = sensors[j]
                else:
                    weighted, conducting = read_column(read_starts, reads, read_state, spikes, j, begin)
                    squares = 0.0
                    if constants["read_noise"] > 0.0:
                        squares = column_squares(read_starts, reads, read_state, spikes, j, begin)
                    spent += energy * conducting
                    drive = gain * sense(constants, neurons[j], j, step, weighted, squares)
                y = membrane(state[j]["y"], drive, neurons[j]["a"], neurons[j]["b"], clamp)
                above = y > neurons[j]["y_thresh"]
                state[j]["y"] = c if above else y
                spikes[slot + j] = 1.0 if above else 0.0
                if above:
                    bits |= 1 << np.int64(j - first)
                    spiked[j] += 1
                    fired += 1
            # Every other ls decays by 1; what has none left is of ls 0.
            others = ((1 << np.int64(last - first)) - 1) & ~bits
            for ls in range(1, last_spike):
                by_ls[ls, w] = by_ls[ls + 1, w] & others
                others &= ~by_ls[ls, w]
            by_ls[last_spike, w], by_ls[0, w] = bits, others
        total[READ_ENERGY] = spent
        total[SPIKES] += fired
        _disturb(f.rest, f, s, now)
        s.clock[BUSY_LINES] = 0
        _program(f.lines, f, s)
        if s.clock[BUSY_LINES] > 0:
            # Here and not in a function of its own, to which two arrays would be described in every step.
            worst = 0.0
            for line in range(lines):
                worst = max(worst, busy[line, UP] + busy[line, DOWN])
                busy[line, UP] = busy[line, DOWN] = 0.0
            total[BUSY] += worst
            total[WORST_BUSY] = max(total[WORST_BUSY], worst)
        total[STEPS_DONE] += 1
        s.clock[STEP] = now + 1


@kernel
def begin_timestep(f: Fabric, s: FabricState) -> None:
    """What happens before the 21 steps of a timestep."""
    if s.total[STEPS_DONE] > 0:
        _age(f.rest, f, s)
    if not f.constants[0]["carry"]:
        reset_activity(f, s)


@kernel
def timestep(f: Fabric, s: FabricState, sensors: FloatArray, spiked: IntArray) -> int:
    """21 steps; `spiked` (neuron,) becomes the spike counts. Returns the action."""
    begin_timestep(f, s)
    spiked[:] = 0
    run_steps(f, s, sensors, spiked, STEPS)
    last = spiked.shape[0]
    return classify(spiked[last - 2], spiked[last - 1], f.constants[0]["high_count"])
