"""From a die to the arrays that the compiled emulation runs on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.devices import Device
from ohmloom.devices.laws import LAWS
from ohmloom.mapping import _fabric as f
from ohmloom.mapping.die import UNFORMED, Die, physical_shape
from ohmloom.mapping.effects import Effects, widest_tile
from ohmloom.mapping.plan import Plan
from ohmloom.mapping.pulses import pulse_of
from ohmloom.mapping.repair import STUCK_OFF, STUCK_ON
from ohmloom.mapping.waveform import phase_arrays
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.neurocontroller.rules import INPUTS, OUTPUTS

NOT_PLASTIC = -1  # family of a tile whose devices no event moves
MODES = {
    "charge_metered": f.CHARGE_METERED, "current": f.CURRENT, "voltage": f.VOLTAGE, "exact_width": f.EXACT_WIDTH,
}  # fmt: skip
PARALLELISMS = {"cell": f.CELL, "column": f.COLUMN, "array": f.ARRAY}


@dataclass(frozen=True, kw_only=True)
class _Cell:
    """A crosspoint that conducts; `synapse` is None where none is placed."""

    synapse: int | None
    tile: int
    row: int  # physical
    column: int
    sender: int
    receiver: int
    polarity: int
    state: float
    fixed: float | None  # conductance [S] if no event moves it


def build_fabric(
    die: Die, *, perturb: float = 0.0, integrate: bool = False, as_wired: bool = False
) -> tuple[f.Fabric, IntArray, IntArray]:
    """Arrays of a die; where each synapse, in the network's order, and each disabled cell stands in them.

    `perturb` scales the charge of every event by 1 + perturb; `integrate` follows every law's own differential equation
    even where it has a closed form; `as_wired` solves the potentials of lines even where they have no resistance.
    """
    from ohmloom.devices._event_kernels import CHARGE, FLUX, MEM_LIFETIME
    from ohmloom.devices._kernels import LAW_INDEX, flux
    from ohmloom.mapping._cell_kernels import INTEGRATED

    plan, network, hardware = die.plan, die.plan.network, die.plan.hardware
    r, drive, n = network.readings, hardware.drive, network.neurons
    cells = sorted(_cells(die), key=lambda c: (c.receiver, c.sender, c.tile, c.row, c.column))
    cards = hardware.devices
    devices = [cards[tile.kind] for tile in plan.tiles]
    is_plastic = np.array([tile.kind in PLASTIC_KINDS for tile in plan.tiles], dtype=np.bool_)
    parameters = _parameters(devices)
    law = np.array([LAW_INDEX[device.law] for device in devices], dtype=np.int64)
    g_on = np.array([float(device.conductance(1.0)) for device in devices])
    g_off = np.array([float(device.conductance(0.0)) for device in devices])
    reference = np.where([tile.subtracts_off for tile in plan.tiles], g_off, 0.0) if devices else np.zeros(0)
    closed = FLUX if drive.mode == "voltage" else CHARGE
    family = np.array(
        [
            NOT_PLASTIC if not plastic else INTEGRATED if integrate or LAWS[device.law].flux is None else closed
            for plastic, device in zip(is_plastic, devices, strict=True)
        ],
        dtype=np.int64,
    )
    pulses = [pulse_of(hardware, tile.kind, has_reference=tile.subtracts_off) for tile in plan.tiles]

    def coordinate(t: int, s: float) -> float:
        return float(flux(law[t], s, parameters[t])) if family[t] == FLUX else s

    wires = _wires(die, g_off, [c.tile for c in cells], as_wired=as_wired)
    is_selected = drive.parallelism != "array"
    effects = Effects(die)
    synapse = [c.synapse for c in cells]
    events = np.array([1.0 if k is None else die.event_charge[k] for k in synapse])
    threshold = np.array([drive.threshold.value if k is None else die.threshold[k] for k in synapse])
    live = np.array([c.fixed is None for c in cells], dtype=np.bool_)
    other = iter(range(len(plan.crosspoints), len(plan.crosspoints) + len(cells)))
    phase, row_level, column_level = phase_arrays(drive.shape)
    levels = np.stack([row_level, column_level], axis=1)
    counts_half_selects = drive.mode == "voltage" and not is_selected
    lowest = float(threshold[live].min(initial=drive.threshold.value))
    taps = _taps(plan)
    late = f.lateness(taps, np.arange(len(taps))[:, None], len(taps))
    is_driven = drive.mode == "voltage" and not is_selected and isinstance(wires, f.Wires)
    lines = _busy_lines(plan)
    cell = np.zeros(len(cells), dtype=f.CELL_FIELDS)
    series = _series(die, cells) if is_selected else np.zeros(len(cells))
    for k, c in enumerate(cells):
        point = None if c.synapse is None else plan.crosspoints[c.synapse]
        cell[k] = (
            c.sender, c.receiver, c.tile, lines[c.tile] + (c.column if drive.parallelism == "column" else 0),
            c.row + _padding(plan, c.tile), c.column, taps[c.sender, c.receiver], late[c.sender, c.receiver],
            next(other) if c.synapse is None else c.synapse, c.synapse is not None, c.fixed is None, c.polarity,
            c.state, coordinate(c.tile, c.state), c.state if point is None else point.state,
            0.0 if c.fixed is None else c.fixed, (1.0 + perturb) * events[k] * effects.pulse_size, threshold[k],
            series[k],
        )  # fmt: skip
    tiles = np.zeros(len(devices), dtype=f.TILE_FIELDS)
    for t, device in enumerate(devices):
        tiles[t] = (
            law[t], family[t], device.charge_scale, device.charge_scale / MEM_LIFETIME, reference[t], g_on[t],
            die.tile_gain[t], pulses[t].flux, pulses[t].duration, coordinate(t, 0.0), coordinate(t, 1.0),
            parameters[t],
        )  # fmt: skip
    neurons = np.zeros(n, dtype=f.NEURON_FIELDS)
    neurons["a"], neurons["b"], neurons["y_thresh"] = (
        _biases(die),
        r.b * die.neuron_leak,
        r.y_thresh * die.neuron_threshold,
    )
    neurons["offset"], neurons["full_scale"] = die.sense_offset, _full_scale(plan)
    table = _table(plan, lowest, counts_half_selects)
    constants = np.zeros(1, dtype=f.CONSTANT_FIELDS)
    constants[0] = (
        MODES[drive.mode], PARALLELISMS[drive.parallelism], drive.shape.event, drive.pulse_voltage.value,
        counts_half_selects, effects["asymmetry"], effects["metering_delay"],
        effects["cycle_to_cycle"], die.keys.get("cycle_to_cycle", 0), effects["half_select"],
        effects["read_disturb"], effects["read_noise"], die.keys.get("read_noise", 0), effects.bits, effects.settled,
        effects.decay, hardware.read.voltage.value, hardware.read.duration.value, r.last_spike, r.c, r.c_ini,
        r.synapse_gain,
        r.high_count, r.clamp, r.carry_state,
    )  # fmt: skip
    starts = np.searchsorted([c.receiver for c in cells], np.arange(n + 1)).astype(np.uint64)
    reads, read_starts = (cell, starts) if isinstance(wires, f.NoWires) else _reads(die, taps, late, cells)
    fabric = f.Fabric(
        cells=cell, starts=starts, reads=reads, read_starts=read_starts,
        tiles=tiles, neurons=neurons, constants=constants, table=table, asking=np.argwhere(table).astype(np.uint64),
        pairs=_pairs(cells, n),
        programmed=_programmed(cells, family, n), phase=phase, levels=levels,
        seen=_seen(levels, table.shape[0], drive.shape.event),
        wires=wires, pulses=f.AnyPulses() if (family == INTEGRATED).any() else f.ClosedPulses(),
        lines=f.DrivenLines() if is_driven else f.SelectedCells(),
        rest=f.Passing() if effects.decay != 1.0 or effects["read_disturb"] > 0.0 else f.Lasting(),
    )  # fmt: skip
    place = np.empty(len(plan.crosspoints), dtype=np.int64)
    for k, index in enumerate(synapse):
        if index is not None:
            place[index] = k
    return fabric, place, np.flatnonzero(~cell["is_synapse"])


def _parameters(devices: list[Device]) -> FloatArray:
    parameters = np.zeros((len(devices), f.TILE_FIELDS["parameters"].shape[0]))
    for t, device in enumerate(devices):
        values = [device.parameters[p.name] for p in LAWS[device.law].parameters]
        parameters[t, : len(values)] = values
    return parameters


def _cells(die: Die) -> list[_Cell]:
    """Synapses, and what conducts where none is."""
    plan, found = die.plan, []
    array, cards = plan.hardware.array, plan.hardware.devices
    unformed = 0.0 if array.unformed_conductance is None else array.unformed_conductance.value
    taken = {(point.tile, point.row, point.column): point for point in plan.crosspoints}
    for t, tile in enumerate(plan.tiles):
        device, repair, faults = cards[tile.kind], die.repairs[t], die.faults[t]
        g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
        seconds = _second_devices(plan, t)
        of_fault = {STUCK_ON: g_on, STUCK_OFF: g_off, UNFORMED: unformed}
        is_plastic = tile.kind in PLASTIC_KINDS
        programmed = None if is_plastic else device.conductance(die.state)
        for i, sender in enumerate(tile.rows):
            for j, receiver in enumerate(tile.columns):
                row, column = int(repair.rows[i]), int(repair.columns[j])
                fault = int(faults[row, column])
                point = taken.get((t, i, j))
                if point is not None:
                    polarity, state = point.polarity, float(die.state[point.synapse])
                    fixed = of_fault.get(fault)
                    if fixed is None and programmed is not None:
                        fixed = float(programmed[point.synapse])
                elif (i, j) in seconds:
                    continue  # subtracted as a reference, or one of the lines' still conductances
                else:
                    polarity = _row_polarity(plan, sender) * tile.column_signs[j]
                    state, fixed = 0.0, _disabled(array.disabled, fault, of_fault, unformed, g_off, is_plastic)
                    if fixed == 0.0:
                        continue
                found.append(_Cell(
                    synapse=None if point is None else point.synapse, tile=t, row=row, column=column, sender=sender,
                    receiver=receiver, polarity=polarity, state=state, fixed=fixed,
                ))  # fmt: skip
    return found


def _second_devices(plan: Plan, t: int) -> set[tuple[int, int]]:
    """Logical crosspoints of the devices at G_off that make pairs of a tile's synapses."""
    tile = plan.tiles[t]
    if not tile.is_differential:
        return set()
    line = {pair: j for j, pair in enumerate(zip(tile.columns, tile.column_signs, strict=True))}
    points = [point for point in plan.crosspoints if point.tile == t]
    return {(p.row, line[tile.columns[p.column], -tile.column_signs[p.column]]) for p in points}


def _disabled(
    kind: str, fault: int, of_fault: dict[int, float], unformed: float, g_off: float, is_plastic: bool
) -> float | None:
    """Conductance of a crosspoint without a synapse, or None if it is a device that events move."""
    if kind == "masked":
        return 0.0
    if fault == STUCK_ON:
        return of_fault[STUCK_ON]
    if kind == "unformed":
        return unformed
    return of_fault.get(fault, None if is_plastic else g_off)


def _row_polarity(plan: Plan, sender: int) -> int:
    return int(plan.network.sign(sender)) if plan.hardware.array.signs == "row_polarity" else 1


def _taps(plan: Plan) -> IntArray:
    """Steps from a sender's spike to its arrival, axes (sender, receiver), for pairs without a synapse too."""
    network, n = plan.network, plan.network.neurons
    taps = np.ones((n, n), dtype=np.int64)
    if network.readings.hidden_delay == "index":
        hidden = np.arange(INPUTS, n - OUTPUTS)
        taps[np.ix_(hidden, hidden)] = np.maximum(np.abs(hidden[:, None] - hidden[None, :]), 1)
    return taps


def _table(plan: Plan, lowest: float, counts_half_selects: bool) -> Any:
    readings, drive = plan.network.readings, plan.hardware.drive
    size = readings.last_spike + 1
    table = np.zeros((size, size), dtype=np.int8)
    waveform = drive.volts
    for pre in range(size):
        for post in range(size):
            wanted = stdp_sign(pre, post, readings.stdp_threshold)
            table[pre, post] = f.WANTED_UP if wanted > 0 else f.WANTED_DOWN if wanted < 0 else 0
            if waveform.last_spike < size - 1:
                continue  # a network without plastic synapses, whose waveform is never used
            seen = max(abs(phase.column[post] - phase.row[pre]) for phase in waveform.phases)
            if seen > lowest or (counts_half_selects and seen > 0.0):
                table[pre, post] |= f.MAY_FIRE
    return table


def _seen(levels: FloatArray, size: int, event: float) -> FloatArray:
    """Levels of a cell's lines and what it sees, axes (phase, ls_pre, ls_post, [row, column, pulse voltages])."""
    seen = np.zeros((len(levels), size, size, 3))
    # Fewer in a network without plastic synapses, whose waveform is never used.
    known = min(levels.shape[-1], size)
    row, column = levels[:, f.ROW, :known, None], levels[:, f.COLUMN_LINE, None, :known]
    seen[:, :known, :known, 0], seen[:, :known, :known, 1] = row, column
    seen[:, :known, :known, 2] = np.abs(column - row) / event
    return seen


def _busy_lines(plan: Plan) -> list[int]:
    """Where the lines of each tile begin that are programmed side by side: its bit lines, or the tile as one."""
    widths = [physical_shape(plan, t)[1] if plan.hardware.drive.parallelism == "column" else 1
              for t in range(len(plan.tiles))]  # fmt: skip
    return [sum(widths[:t]) for t in range(len(widths))]


def _pairs(cells: list[_Cell], n: int) -> f.Indices:
    """Where the cells of each pair begin, axes (receiver * n + sender,), and the end."""
    return np.searchsorted([c.receiver * n + c.sender for c in cells], np.arange(n * n + 1)).astype(np.uint64)


def _programmed(cells: list[_Cell], family: IntArray, n: int) -> IntArray:
    """Senders of the cells of each receiver that programming reaches, as bits, axes (receiver, word)."""
    found = np.zeros((n, f.words_of(n)), dtype=np.int64)
    for c in cells:
        if family[c.tile] != NOT_PLASTIC:
            found[c.receiver, c.sender // f.WORD] |= 1 << c.sender % f.WORD
    return found


def _biases(die: Die) -> FloatArray:
    r, n = die.plan.network.readings, die.plan.network.neurons
    is_biased = np.ones(n)
    if not r.input_bias:
        is_biased[:INPUTS] = 0.0
    return r.a * is_biased * die.neuron_bias


def _full_scale(plan: Plan) -> FloatArray:
    """Rows that drive a receiver's bit lines, axes (neuron,)."""
    rows = np.zeros(plan.network.neurons)
    for tile in plan.tiles:
        for receiver in set(tile.columns):
            rows[receiver] += len(tile.rows)
    return rows


def _padding(plan: Plan, t: int) -> int:
    return widest_tile(plan)[0] - physical_shape(plan, t)[0]


def _resistances(die: Die) -> dict[str, float]:
    found = die.plan.hardware.wires.resistances
    return {k: v * die.wire_resistance if k in ("r_row", "r_column") else v for k, v in found.items()}


def _series(die: Die, cells: list[_Cell]) -> FloatArray:
    """Resistance of the wires to each cell when it alone is selected [ohm]."""
    wires, shapes = _resistances(die), [physical_shape(die.plan, t)[0] for t in range(len(die.plan.tiles))]
    return np.array(
        [
            wires["r_driver"] + (c.column + 1) * wires["r_row"] + (shapes[c.tile] - c.row) * wires["r_column"]
            + wires["r_sense"] for c in cells
        ],
        dtype=np.float64,
    )  # fmt: skip


def _wires(die: Die, g_off: FloatArray, tile_of_cell: list[int], *, as_wired: bool) -> f.Wires | f.NoWires:
    plan, ohm = die.plan, _resistances(die)
    if not (any(ohm.values()) or as_wired) or not plan.tiles:
        return f.NoWires()
    (m, width), tiles = widest_tile(plan), len(plan.tiles)
    near, far = ohm["r_driver"] + ohm["r_row"], ohm["r_sense"] + ohm["r_column"]
    row_neuron, column_neuron = np.full((tiles, m), -1, dtype=np.int64), np.full((tiles, width), -1, dtype=np.int64)
    reference, still = np.full(tiles, -1, dtype=np.int64), np.zeros((tiles, m, width))
    for t, tile in enumerate(plan.tiles):
        (rows, columns), repair, pad = physical_shape(plan, t), die.repairs[t], _padding(plan, t)
        row_neuron[t, pad + repair.rows] = tile.rows
        column_neuron[t, repair.columns] = tile.columns
        for i, j in _second_devices(plan, t):
            still[t, pad + repair.rows[i], repair.columns[j]] = g_off[t]
        if tile.has_reference:
            reference[t] = columns
            still[t, pad : pad + rows, columns] = g_off[t]
    return f.Wires(
        r_row=ohm["r_row"], r_column=ohm["r_column"], near=np.full(m, math.inf if near == 0.0 else 1.0 / near),
        far=np.full(width, math.inf if far == 0.0 else 1.0 / far), open_row=np.zeros(m), open_column=np.zeros(width),
        row_neuron=row_neuron, column_neuron=column_neuron, reference_column=reference, still=still,
        first_cell=np.searchsorted(np.sort(tile_of_cell), np.arange(tiles + 1)).astype(np.int64),
        of_tile=np.argsort(tile_of_cell, kind="stable").astype(np.int64),
    )  # fmt: skip


def _reads(die: Die, taps: IntArray, late: IntArray, cells: list[_Cell]) -> tuple[Any, f.Indices]:
    """What each receiver's bit lines read from every word line, and where each receiver begins.

    Beside a reference column, word lines that nothing connects with a receiver's bit line stay at 0 V while that is
    read: the reference would be subtracted for nothing.
    """
    plan, found = die.plan, []
    conducting = {(c.tile, c.row, c.column) for c in cells}
    for t, tile in enumerate(plan.tiles):
        repair, pad = die.repairs[t], _padding(plan, t)
        for j, receiver in enumerate(tile.columns):
            for i, sender in enumerate(tile.rows):
                if tile.has_reference and (t, int(repair.rows[i]), int(repair.columns[j])) not in conducting:
                    continue
                polarity = _row_polarity(plan, sender) * tile.column_signs[j]
                entry = (
                    sender,
                    taps[sender, receiver],
                    late[sender, receiver],
                    t,
                    pad + repair.rows[i],
                    repair.columns[j],
                    polarity,
                )
                found.append((receiver, sender, t, entry))
    found.sort(key=lambda one: one[:3])
    reads = np.array([entry for *_, entry in found], dtype=f.READ_FIELDS)
    receivers = [receiver for receiver, *_ in found]
    return reads, np.searchsorted(receivers, np.arange(plan.network.neurons + 1)).astype(np.uint64)
