"""An array with wires: what a column reads per volt on every row, and what every cell sees while all lines are
driven."""

from __future__ import annotations

from typing import Any

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import choose_by_type, inlined_kernel, kernel
from ohmloom.circuits._crossbar_kernels import solve_potentials
from ohmloom.mapping._cell_kernels import count_events, event_size, law_conductance, move, refresh
from ohmloom.mapping._fabric import (
    CHARGE_TOTAL,
    COLUMN_LINE,
    FAILED,
    HALF_BOTH,
    HALF_COLUMN,
    HALF_ROW,
    PROGRAM_ENERGY,
    ROW,
    Fabric,
    FabricState,
    LineState,
    Wires,
)

TOLERANCE = 1e-11  # of the energy norm: read errors of one in a million keep four digits
IDLE = 1e-15  # [V] below which a cell sees nothing


@inlined_kernel
def fill_grid(f: Fabric, s: FabricState, t: int) -> None:
    """Conductances of a tile by line."""
    grid, still, wires = s.lines.grid[t], f.wires.still[t], f.wires
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            grid[i, j] = still[i, j]
    for place in range(wires.first_cell[t], wires.first_cell[t + 1]):
        k = wires.of_tile[place]
        grid[f.cells[k]["row"], f.cells[k]["column"]] = s.cells[k]["g"]


@inlined_kernel
def _solve(wires: Wires, lines: LineState, g: FloatArray, u: FloatArray) -> int:
    """Potentials for the lines' voltages; 1 if they did not converge."""
    rows, columns = (wires.r_row, wires.near, wires.open_row), (wires.r_column, wires.open_column, wires.far)
    rounds = solve_potentials(
        g, lines.source, rows, columns, lines.v_row, lines.v_column, u, lines.w, lines.work, TOLERANCE, True
    )
    return 1 if rounds < 0 else 0


@inlined_kernel
def find_transfer(f: Fabric, s: FabricState, t: int) -> None:
    """Current into each bit line per volt on each word line; by reciprocity, one solve a bit line."""
    fill_grid(f, s, t)
    wires, lines = f.wires, s.lines
    grid, transfer, w, v_column = lines.grid[t], lines.transfer[t], lines.w, lines.v_column
    lines.v_row[:] = 0.0
    for column in range(grid.shape[1]):
        if wires.column_neuron[t, column] < 0 and wires.reference_column[t] != column:
            continue
        v_column[:] = 0.0
        v_column[column] = 1.0
        u = lines.u[t, column]
        s.clock[FAILED] += _solve(wires, lines, grid, u)
        for i in range(grid.shape[0]):
            current = 0.0
            for j in range(grid.shape[1]):
                current += grid[i, j] * (w[i, j] - u[i, j])
            transfer[i, column] = current


@inlined_kernel
def _enter_reads(reads: Any, state: Any, tiles: Any, transfer: FloatArray, reference: IntArray, stale: Any) -> None:
    """Weights as the columns of stale tiles read them."""
    for k in range(reads.shape[0]):
        read = reads[k]
        t = read["tile"]
        if stale[t]:
            tile = tiles[t]
            g = transfer[t, read["row"], read["column"]]
            subtracted = transfer[t, read["row"], reference[t]] if reference[t] >= 0 else 0.0
            weight = (g - subtracted) / (tile["g_on"] - tile["reference"])
            state[k]["weight"] = read["polarity"] * tile["gain"] * weight
            state[k]["load"] = g + subtracted


def prepare_lines(wires: Any, f: Fabric, s: FabricState) -> None:
    """What all columns read, for the conductances of now; a form that is compiled into its callers."""
    is_any = False
    for t in range(f.tiles.shape[0]):
        if s.is_stale[t]:
            find_transfer(f, s, t)
            is_any = True
    if is_any:
        _enter_reads(f.reads, s.reads, f.tiles, s.lines.transfer, f.wires.reference_column, s.is_stale)
        s.is_stale[:] = False


@kernel
def update_reads(f: Fabric, s: FabricState) -> None:
    """The same, for callers in Python."""
    _prepare(f.wires, f, s)


def _prepare(wires: Any, f: Fabric, s: FabricState) -> None:
    prepare_lines(wires, f, s)


choose_by_type(_prepare, {Wires: prepare_lines})


@inlined_kernel
def _hold_lines(f: Fabric, s: FabricState, t: int, phase: int) -> bool:
    """Put the levels of a phase on all lines; whether any is other than 0."""
    wires, v_row, v_column = f.wires, s.lines.v_row, s.lines.v_column
    unit = f.constants[0]["pulse_voltage"] / f.constants[0]["event_level"]
    is_driven = False
    for i in range(v_row.shape[0]):
        neuron = wires.row_neuron[t, i]
        v_row[i] = unit * f.levels[phase, ROW, s.neurons[neuron]["ls"]] if neuron >= 0 else 0.0
        is_driven |= v_row[i] != 0.0
    for j in range(v_column.shape[0]):
        neuron = wires.column_neuron[t, j]
        v_column[j] = unit * f.levels[phase, COLUMN_LINE, s.neurons[neuron]["ls"]] if neuron >= 0 else 0.0
        is_driven |= v_column[j] != 0.0
    return is_driven


@inlined_kernel
def program_tile(f: Fabric, s: FabricState, t: int) -> None:
    """All lines of a tile at once; `fired` says which cells switched, and in which direction.

    A cell that switches takes the flux that it sees in the middle of its pulse, which costs a second solve and is of
    second order; whether it switches is decided by the voltage at the start.
    """
    wires, lines = f.wires, s.lines
    fired, w, grid = lines.fired, lines.w, lines.grid[t]
    first, last = wires.first_cell[t], wires.first_cell[t + 1]
    fill_grid(f, s, t)
    for phase in range(f.phase.shape[0]):
        for place in range(first, last):
            fired[phase, wires.of_tile[place]] = 0
        if not _hold_lines(f, s, t, phase):
            continue
        u, duration = lines.u_program[t, phase], f.tiles[t]["duration"] * f.phase[phase]
        s.clock[FAILED] += _solve(wires, lines, grid, u)
        any_fired = False
        for place in range(first, last):
            k = wires.of_tile[place]
            cell = f.cells[k]
            v = w[cell["row"], cell["column"]] - u[cell["row"], cell["column"]]
            if cell["is_live"] and abs(v) > cell["threshold"]:
                fired[phase, k] = 1 if v > 0.0 else -1
                any_fired = True
            elif abs(v) > IDLE:
                s.total[PROGRAM_ENERGY] += v * v * s.cells[k]["g"] * duration
                row, column = (
                    f.levels[phase, ROW, s.neurons[cell["sender"]]["ls"]],
                    f.levels[phase, COLUMN_LINE, s.neurons[cell["receiver"]]["ls"]],
                )
                half_select(
                    f.pulses, cell, s.cells[k], f.tiles[t], f.constants[0], s.total, row, column, 1 if v > 0.0 else -1
                )
        if any_fired:
            _advance(f, s, t, phase, u)
            fill_grid(f, s, t)
    s.is_stale[t] = True


@inlined_kernel
def _advance(f: Fabric, s: FabricState, t: int, phase: int, u: FloatArray) -> None:
    wires, lines, width = f.wires, s.lines, f.phase[phase]
    fired, w, grid, middle = lines.fired, lines.w, lines.grid[t], lines.middle
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            middle[i, j] = grid[i, j]
    for place in range(wires.first_cell[t], wires.first_cell[t + 1]):
        k = wires.of_tile[place]
        if fired[phase, k] != 0:
            now, i, j = s.cells[k], f.cells[k]["row"], f.cells[k]["column"]
            before, origin, count = now["s"], now["origin"], now["count"]
            move(
                f.pulses,
                s.cells[k],
                f.tiles[t],
                f.constants[0],
                w[i, j] - u[i, j],
                0.5 * width * event_size(f.cells[k], s.cells[k], f.constants[0], fired[phase, k]),
            )
            middle[i, j] = law_conductance(f.pulses, f.tiles[t]["law"], now["s"], f.tiles[t]["parameters"])
            now["s"], now["origin"], now["count"] = before, origin, count
    s.clock[FAILED] += _solve(wires, lines, middle, u)
    for place in range(wires.first_cell[t], wires.first_cell[t + 1]):
        k = wires.of_tile[place]
        if fired[phase, k] != 0:
            i, j = f.cells[k]["row"], f.cells[k]["column"]
            v = w[i, j] - u[i, j]
            charge = move(
                f.pulses,
                s.cells[k],
                f.tiles[t],
                f.constants[0],
                v,
                width * event_size(f.cells[k], s.cells[k], f.constants[0], fired[phase, k]),
            )
            refresh(f.pulses, f.cells[k], s.cells[k], f.tiles[t])
            s.total[CHARGE_TOTAL] += charge
            s.total[PROGRAM_ENERGY] += charge * abs(v)


@inlined_kernel
def half_select(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, total: FloatArray, row: float, column: float, sign: int
) -> None:
    """Enter a pulse below the threshold, and what it does; `row` and `column` are the levels of its lines."""
    total[HALF_BOTH if row != 0.0 and column != 0.0 else HALF_ROW if row != 0.0 else HALF_COLUMN] += 1
    if constants["half_select"] > 0.0 and cell["is_live"]:
        count_events(now, tile, sign * constants["half_select"])
        refresh(pulses, cell, now, tile)
