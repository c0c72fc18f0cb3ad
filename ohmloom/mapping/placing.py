"""Placing a network: which tiles there are, which neuron stands on which line, which device carries which synapse."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices import LAWS, Device
from ohmloom.errors import MappingError, expect_type
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.placement import MOST_SWEEPS, Wires
from ohmloom.mapping.plan import Crosspoint, Plan, ReadErrors, Tile
from ohmloom.mapping.tiling import Tiling, split_demand
from ohmloom.mapping.waveform import check_rule
from ohmloom.neurocontroller import KINDS, Network
from ohmloom.neurocontroller.device_levels import lowest_weight, state_of_weight
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, reads_with_reference

READ_ERROR: Final = 0.01  # without limits.read_error: the limit of the figure of that name
WEIGHT_TOLERANCE: Final = 1e-9  # rounding of G_off/G_on against a weight of exactly that size
DIGITS: Final = 6  # of the errors that a plan keeps, so that its file is the same on every machine

Line = tuple[int, int]  # receiving neuron, sign of its bit line


def place(network: Network, hardware: Hardware) -> Plan:
    """Place every synapse of `network` on a device of its kind.

    Rows are senders and columns receivers. A kind has as many tiles as `array.max_rows`, `array.max_columns` and the
    read error under `limits.read_error` ask for. Lines are in ascending order where wires drop nothing, else in the
    order of least read error that sorting and swaps find. The sender's sign is its row's read polarity, or the sign
    of the bit line (`array.signs`). Lateral delays are taps of the row's shift register while the column is read, or
    skewed clocks (`array.delays`), whose taps are 0.

    Raises
    ------
    MappingError
        Names the kind without a card, the synapse that its device cannot hold or that finds no line, what a driver
        cannot carry, or the reading that this hardware cannot follow.
    ParameterError
        If `network` or `hardware` is of another type.
    """
    return placed(network, hardware)


def placed(network: Network, hardware: Hardware, *, sweeps: int = MOST_SWEEPS) -> Plan:
    """`place` with at most so many swaps of lines in each tile; 0 only sorts them."""
    expect_type("place.network", network, Network)
    expect_type("place.hardware", hardware, Hardware)
    _check_readings(network, hardware)
    _check_kinds(network, hardware)
    _check_compliance(network, hardware)
    _check_widths(network, hardware)
    tiles = [tile for kind in _kinds(network) for tile in _tiles(network, hardware, kind, sweeps)]
    return Plan(
        network=network, hardware=hardware, tiles=tuple(tiles), crosspoints=crosspoints(network, hardware, tiles)
    )


def crosspoints(network: Network, hardware: Hardware, tiles: Sequence[Tile]) -> tuple[Crosspoint, ...]:
    """Where each synapse stands, in the network's order, and in which state.

    Raises
    ------
    MappingError
        Names the synapse that has no line, or more than one place, or a weight that its device cannot hold.
    """
    devices, signs = hardware.devices, hardware.array.signs
    rows = [{neuron: i for i, neuron in enumerate(tile.rows)} for tile in tiles]
    columns = [{line: j for j, line in enumerate(zip(tile.columns, tile.column_signs, strict=True))} for tile in tiles]
    found, taken = [], set()
    for k, synapse in enumerate(network.synapses):
        sign = int(network.sign(synapse.pre))
        line = (synapse.post, 1 if signs == "row_polarity" else sign)
        # A neuron may have lines in several tiles of a kind, but only one tile has this row and this column.
        places = [
            (t, rows[t][synapse.pre], columns[t][line])
            for t, tile in enumerate(tiles)
            if tile.kind == synapse.kind and synapse.pre in rows[t] and line in columns[t]
        ]
        if len(places) != 1 or places[0] in taken:
            raise MappingError(f"{network.name}: synapses[{k}] ({synapse.pre} -> {synapse.post}): expected one "
                               f"crosspoint of the kind {synapse.kind}, got {len(places)}. Place the network "
                               "again.")  # fmt: skip
        taken.add(places[0])
        t, row, column = places[0]
        state = _initial_state(network, devices[synapse.kind], tiles[t], k)
        found.append(Crosspoint(
            synapse=k, tile=t, row=row, column=column, polarity=sign,
            tap=0 if hardware.array.delays == "retimed" else network.delay(synapse), state=state,
            conductance=float(devices[synapse.kind].conductance(state)),
        ))  # fmt: skip
    return tuple(found)


def check_tiles(network: Network, hardware: Hardware, tiles: Sequence[Tile]) -> None:
    """Refuse tiles that `place` could not have made on this hardware, whatever the order of their lines.

    Raises
    ------
    MappingError
        Names the tile and what is wrong with it.
    """
    array = hardware.array
    for t, tile in enumerate(tiles):
        lines = list(zip(tile.columns, tile.column_signs, strict=True))
        is_differential = array.signs == "differential_pair"
        rules = {
            "card": tile.card == hardware.cards.get(tile.kind),
            "rows": 0 < len(set(tile.rows)) == len(tile.rows) <= array.max_rows - array.spare_rows
            and set(tile.rows) <= set(range(network.neurons)),
            "columns": 0 < len(set(lines)) == len(lines) <= array.max_columns - array.spare_columns - tile.has_reference
            and set(lines) <= {(j, sign) for j in range(network.neurons) for sign in (1, -1)},
            "spare": (tile.spare_rows, tile.spare_columns) == (array.spare_rows, array.spare_columns),
            "is_differential": tile.is_differential == is_differential,
            "has_reference": tile.has_reference == (reads_with_reference(tile.kind) and not is_differential),
        }
        for rule, holds in rules.items():
            if not holds:
                raise MappingError(
                    f"tiles[{t}].{rule}: expected what {hardware.name} can build. Place the network again."
                )


def _kinds(network: Network) -> list[str]:
    return [kind for kind in KINDS if any(s.kind == kind for s in network.synapses)]


def _check_readings(network: Network, hardware: Hardware) -> None:
    readings = network.readings
    if readings.weight_at != "arrival":
        raise MappingError(f"{network.name}: readings.weight_at: expected 'arrival', got {readings.weight_at!r}. "
                           "A column is read when the spike arrives; evolve with weight_at = 'arrival'.")  # fmt: skip
    if hardware.array.delays == "retimed":
        for key, wanted in (("lateral", "descending"), ("hidden_delay", "index")):
            got = getattr(readings, key)
            if got != wanted:
                raise MappingError(f"{network.name}: readings.{key}: expected {wanted!r} with array.delays = "
                                   f"'retimed' of {hardware.name}, got {got!r}. Clocks skewed by a neuron's index "
                                   "give only delays of i_s - i_r; use array.delays = 'column_serial'.")  # fmt: skip
    if any(s.kind != "constant" for s in network.synapses):
        check_rule(hardware.drive.volts, hardware.drive.threshold.value, readings)


def _check_kinds(network: Network, hardware: Hardware) -> None:
    problems = []
    for kind in KINDS:
        users = [k for k, s in enumerate(network.synapses) if s.kind == kind]
        if users and kind not in hardware.cards:
            synapse = network.synapses[users[0]]
            problems.append(
                f"{hardware.name}: cards.{kind}: expected a device card, got none, but {len(users)} synapses of "
                f"{network.name} need one, first synapses[{users[0]}] ({synapse.pre} -> {synapse.post}). "
                f"Add a card for {kind}, or use a spec that has one."
            )
    if problems:
        raise MappingError(*problems)


def _check_compliance(network: Network, hardware: Hardware) -> None:
    """Refuse pulses that a driver cannot carry: the current into G_on, or the voltage of a current into G_off."""
    drive, devices = hardware.drive, hardware.devices
    for kind in _kinds(network):
        if kind == "constant":
            continue
        device = devices[kind]
        g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
        if drive.mode == "current" and drive.pulse_duration is not None:
            current = device.charge_scale / MEM_LIFETIME / drive.pulse_duration.value
            volts = current / g_off
        else:
            volts = drive.pulse_voltage.value
            current = volts * g_on
        for name, got, unit in (("current", current, "A"), ("voltage", volts, "V")):
            limit = getattr(drive, f"compliance_{name}")
            if limit is not None and got > limit.value:
                raise MappingError(f"{hardware.name}: drive.compliance_{name}: expected at least {got:.3g} {unit}, "
                                   f"which a pulse puts on {device.name} of the kind {kind}, got {limit.value:g} "
                                   f"{unit}. Use another card, or a lower or longer pulse.")  # fmt: skip


def _check_widths(network: Network, hardware: Hardware) -> None:
    """Refuse pulses whose width no closed form gives."""
    for kind in _kinds(network):
        device = hardware.devices[kind]
        if hardware.drive.mode == "exact_width" and kind != "constant" and LAWS[device.law].flux is None:
            raise MappingError(f"{hardware.name}: drive.mode: expected 'charge_metered' or 'voltage' for the kind {kind}, "
                               f"since no closed form gives the width of its pulses (card {device.name}, law "
                               f"{device.law}), got 'exact_width'. Use one of these.")  # fmt: skip


class _Demand(NamedTuple):
    """What decides the tiles of a kind, hashable: the same network is placed more than once in a command."""

    conductance: bytes
    shape: tuple[int, int]
    most: tuple[int, int]
    limit: float
    wires: tuple[tuple[str, float], ...]
    reference: float | None
    spare: tuple[int, int]
    sweeps: int


@lru_cache(maxsize=64)
def _split(demand: _Demand) -> Tiling:
    g: FloatArray = np.frombuffer(demand.conductance).reshape(demand.shape)
    return split_demand(
        g, max_rows=demand.most[0], max_columns=demand.most[1], limit=demand.limit, wires=Wires(**dict(demand.wires)),
        reference=demand.reference, spare=demand.spare, sweeps=demand.sweeps,
    )  # fmt: skip


def _tiles(network: Network, hardware: Hardware, kind: str, sweeps: int) -> list[Tile]:
    array, device = hardware.array, hardware.devices[kind]
    g_off = float(device.conductance(0.0))
    is_differential = array.signs == "differential_pair"
    has_reference = reads_with_reference(kind) and not is_differential
    spare = (array.spare_rows, array.spare_columns)
    _check_room(network, hardware, kind, has_reference)
    rows, lines, g = _demand(network, hardware, kind)
    limit = READ_ERROR if hardware.limits.read_error is None else hardware.limits.read_error.value
    tiling = _split(_Demand(
        g.tobytes(), (len(rows), len(lines)), (array.max_rows, array.max_columns), limit,
        tuple(hardware.wires.resistances.items()), g_off if has_reference else None, spare, sweeps,
    ))  # fmt: skip
    tiles = []
    for block in tiling.blocks:
        order = block.order
        errors = [float(f"{x:.{DIGITS}g}") for x in (order.identity, order.sorted_, order.refined, block.read_error)]
        tiles.append(Tile(
            kind=kind, card=hardware.cards[kind], rows=tuple(rows[i] for i in block.rows),
            columns=tuple(lines[j][0] for j in block.columns),
            column_signs=tuple(lines[j][1] for j in block.columns), has_reference=has_reference, spare_rows=spare[0],
            spare_columns=spare[1], is_differential=is_differential,
            read_error=ReadErrors(given=errors[0], sorted=errors[1], refined=errors[2], built=errors[3],
                                  swaps=order.swaps, limit=limit),
        ))  # fmt: skip
    return tiles


def _demand(network: Network, hardware: Hardware, kind: str) -> tuple[list[int], list[Line], FloatArray]:
    """Senders, bit lines and the largest conductance of each device, axes (sender, line)."""
    device, signs = hardware.devices[kind], hardware.array.signs
    members = [(k, s) for k, s in enumerate(network.synapses) if s.kind == kind]
    rows = sorted({s.pre for _, s in members})
    used: set[Line] = set()
    for _, synapse in members:
        sign = int(network.sign(synapse.pre))
        used |= {(synapse.post, 1 if signs == "row_polarity" else sign)}
        used |= {(synapse.post, -sign)} if signs == "differential_pair" else set()
    lines = sorted(used, key=lambda line: (line[0], -line[1]))
    g = np.zeros((len(rows), len(lines)))
    differential = Tile(kind=kind, card="", rows=(), columns=(), has_reference=False, is_differential=True)
    for k, synapse in members:
        i, sign = rows.index(synapse.pre), int(network.sign(synapse.pre))
        j = lines.index((synapse.post, 1 if signs == "row_polarity" else sign))
        # A programmed device stays where it is; a plastic one may get to G_on.
        state = 1.0
        if kind == "constant":
            is_pair = signs == "differential_pair"
            plain = Tile(kind=kind, card="", rows=(), columns=(), has_reference=reads_with_reference(kind))
            state = _initial_state(network, device, differential if is_pair else plain, k)
        g[i, j] = float(device.conductance(state))
        if signs == "differential_pair":
            g[i, lines.index((synapse.post, -sign))] = float(device.conductance(0.0))
    return rows, lines, g


def _check_room(network: Network, hardware: Hardware, kind: str, has_reference: bool) -> None:
    array = hardware.array
    beside = {"rows": array.spare_rows, "columns": array.spare_columns + has_reference}
    for name, others in beside.items():
        most = getattr(array, f"max_{name}")
        if most <= others:
            k, first = next((k, s) for k, s in enumerate(network.synapses) if s.kind == kind)
            what = "spare rows" if name == "rows" else "spare columns and the reference column"
            raise MappingError(f"{hardware.name}: array.max_{name}: expected at least {others + 1} for the {kind} "
                               f"tile of {network.name}, one line beside the {what}, got {most}; synapses[{k}] "
                               f"({first.pre} -> {first.post}) is the first without a line. Enlarge the "
                               "array.")  # fmt: skip


def _initial_state(network: Network, device: Device, tile: Tile, k: int) -> float:
    synapse = network.synapses[k]
    lowest = lowest_weight(device, has_reference=tile.subtracts_off)
    if synapse.weight < lowest * (1.0 - WEIGHT_TOLERANCE):
        raise MappingError(
            f"{network.name}: synapses[{k}].weight: expected at least G_off/G_on = {lowest:g} of the card "
            f"{device.name!r}, got {synapse.weight}. Use a card with a larger ratio."
        )
    return state_of_weight(device, synapse.weight, has_reference=tile.subtracts_off)
