"""A die as a discrete FMU: the emulated controller, where events are charges and nothing is noisy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ohmloom.devices.emit import identifier
from ohmloom.errors import MappingError, expect_type
from ohmloom.fmu import _discrete_code as code
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu._netlist_model import law_text
from ohmloom.fmu._tables import array, number
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import Description, FmiVersion, Variable
from ohmloom.fmu.discrete import LICENCE, TIMESTEP, runtime_file
from ohmloom.mapping.die import Die

PARAMETERS = ("c", "c_ini", "synapse_gain", "high_count")  # in the order of hardware.c; the rest a die spreads


def export_hardware_controller(
    die: Die,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
    timestep: float = TIMESTEP,
    arrays: bool = False,
) -> Export:
    """Write a die as an FMU for co-simulation, spike for spike the emulated controller.

    Variables are those of `export_controller`. Devices, their states after programming and their spread, thresholds,
    the waveform, faults, wires that columns are read through, and the spread of neurons, senses and gains are those of
    the die.

    Parameters
    ----------
    die
        From `Plan.sample` or `Plan.nominal`, of hardware whose events are charges on selected cells.
    out, fmi, platforms
        As `export_device` has them.
    timestep, arrays
        As `export_controller` has them.

    Raises
    ------
    ParameterError
        If an option is none of these.
    MappingError
        If the die has noise, ageing, or a drive that this FMU does not have; names all of them.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_hardware_controller"
    expect_type(f"{where}: die", die, Die)
    path = check_options(where, out, fmi, platforms, arrays=arrays)
    parts = die_parts(where, die)
    network, hardware = die.plan.network, die.plan.hardware
    name = f"{network.name}_{hardware.name}"
    plain = code.controller_description(network, timestep)
    variables = (*die_parameters(die), *(v for v in plain.variables if v.kind != "start"))
    description = Description(
        name=name, identifier=identifier(name), doc=f"{plain.doc}, on {hardware.name}", stop_time=plain.stop_time,
        step_size=timestep, timestep=timestep, has_derivatives=False, variables=variables,
    )  # fmt: skip
    description = code.with_arrays(description) if arrays else description
    template = code.CONTROLLER.replace("controller.c", "hardware.c").replace("network.c", "die.c")
    model = {**parts, "model.c": code.model_code(template, description)}
    which = "the nominal die" if die.seed is None else f"die {die.index} of seed {die.seed}"
    paragraphs = [
        f"Network {network.name} (sha256 {network.sha256}) on {hardware.name}, {which}: 21 steps of the network in a "
        "timestep; every synapse is a device that follows its law. See sources/hardware.c and sources/die.c.",
        LICENCE,
    ]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def die_parameters(die: Die) -> tuple[Variable, ...]:
    """In the order of hardware.c: the readings that a die does not spread."""
    by_name = {v.name: v for v in code.controller_parameters(die.plan.network)}
    return tuple(by_name[name] for name in PARAMETERS)


def die_parts(where: str, die: Die) -> dict[str, str]:
    """The C files of a die's controller but ``model.c``.

    Raises
    ------
    MappingError
        If the die needs what they do not have.
    """
    devices = die.plan.hardware.devices
    return {
        "die.c": _tables(where, die),
        "law.c": law_text((devices[tile.kind] for tile in die.plan.tiles), ["conductance"]),
        "hardware.c": runtime_file("hardware.c"),
    }


def _tables(where: str, die: Die) -> str:
    """The die as C constants: ``die.c``."""
    from ohmloom.mapping._fabric import CHARGE_METERED, CURRENT, MAY_FIRE, ClosedPulses, Wires
    from ohmloom.mapping.fabric import build_fabric

    fabric, _, _ = build_fabric(die)
    cells, tiles, neurons, c = fabric.cells, fabric.tiles, fabric.neurons, fabric.constants[0]
    wires, reads = fabric.wires, fabric.reads
    problems = [
        text
        for text, is_there in (
            (
                "wires between ideal lines",
                isinstance(wires, Wires) and not (wires.r_row > 0.0 and wires.r_column > 0.0),
            ),
            ("laws without a closed form", not isinstance(fabric.pulses, ClosedPulses)),
            ("a drive by voltage", c["mode"] not in (CHARGE_METERED, CURRENT)),
            ("a metering delay", c["metering_delay"] != 0.0),
            ("cycle-to-cycle noise", c["cycle_to_cycle"] != 0.0),
            ("read noise", c["read_noise"] != 0.0),
            ("read disturb", c["read_disturb"] != 0.0),
            ("a converter", c["bits"] != 0),
            ("reads that do not settle", c["settled"] != 1.0),
            ("devices that age", c["decay"] != 1.0),
        )
        if is_there
    ]
    if problems:
        raise MappingError(f"{where}: die: expected hardware without noise whose events are charges, got "
                           f"{', '.join(problems)} in {die.plan.hardware.name}. Run it here, by "
                           "EmulatedController.")  # fmt: skip
    live = cells["is_live"] & (tiles["family"][cells["tile"]] >= 0) if len(cells) else cells["is_live"]
    size = fabric.table.shape[0]
    dispatch = [
        "/* S, of a tile's devices. */",
        "static double conductance(int tile, double s)",
        "{",
        "    switch (tile) {",
    ]
    for t, tile in enumerate(die.plan.tiles):
        device = die.plan.hardware.devices[tile.kind]
        case = "default:" if t == len(die.plan.tiles) - 1 else f"case {t}:"
        dispatch += [f"    {case}", f"        return {device.law}_conductance(s, 0.0, tile_p_{t});"]
    if not die.plan.tiles:
        dispatch += ["    default:", "        return s;"]
    dispatch += ["    }", "}"]

    def square(name: str, kind: str, values: Any) -> str:
        rows = ", ".join(
            "{" + ", ".join(number(x) if kind == "double" else str(int(x)) for x in row) + "}" for row in values
        )
        return f"static const {kind} {name}[][{size}] = {{{rows}}};"

    parts = [
        f"/* {identifier(die.plan.network.name)} on {identifier(die.plan.hardware.name)}. */",
        '#include "law.c"',
        f"enum {{ NEURONS = {len(neurons)}, CELLS = {max(len(cells), 1)}, READS = {max(len(reads), 1)}, "
        f"SLOTS = {int(reads['tap'].max(initial=1)) + 1}, PHASES = {len(fabric.phase)} }};",
        f"enum {{ LAST_SPIKE = {c['last_spike']}, CLAMP = {int(c['clamp'])}, CARRY_STATE = {int(c['carry'])} }};",
        *(f"#define {name} {number(c[field])}" for name, field in (
            ("EVENT_LEVEL", "event_level"), ("PULSE_VOLTAGE", "pulse_voltage"), ("ASYMMETRY", "asymmetry"))),
        array("int", "first_cell", fabric.starts.tolist(), "by receiver; the next one's is the end"),
        *(array("int", f"cell_{name}", cells[name].tolist()) for name in ("sender", "tile")),
        array("int", "first_read", fabric.read_starts.tolist(), "what columns read, likewise"),
        *(array("int", f"read_{name}", reads[name].tolist()) for name in ("sender", "tap")),
        array("double", "read_polarity", reads["polarity"].tolist()),
        *_wire_tables(fabric),
        array("int", "cell_is_live", live.astype(int).tolist(), "whether events move it"),
        *(array("double", f"cell_{name}", cells[field].tolist(), doc) for name, field, doc in (
            ("start", "first_origin", "state"),
            ("fixed", "fixed_g", "S, where no event moves it"),
            ("factor", "factor", "charge of an event, 1 nominally"), ("threshold", "threshold", "V"),
            ("series", "series", "Ohm of the wires to it"))),
        *(array("double", f"tile_{name}", tiles[field].tolist(), doc) for name, field, doc in (
            ("gain", "gain", ""), ("reference", "reference", "S that is subtracted"), ("on", "g_on", "S"))),
        *(array("double", f"tile_p_{t}", [float(x) for x in die.plan.hardware.devices[tile.kind].parameters.values()])
          for t, tile in enumerate(die.plan.tiles)),
        *(array("double", f"neuron_{name}", neurons[field].tolist()) for name, field in (
            ("a", "a"), ("b", "b"), ("threshold", "y_thresh"), ("offset", "offset"))),
        array("double", "phase_width", fabric.phase.tolist(), "of the waveform's phases, in pulses"),
        square("row_level", "double", fabric.levels[:, 0, :size]),
        square("column_level", "double", fabric.levels[:, 1, :size]),
        square("may_fire", "int", (np.asarray(fabric.table) & MAY_FIRE) != 0),
        *dispatch,
        "",
    ]  # fmt: skip
    return "\n".join(parts)


def _wire_tables(fabric: Any) -> list[str]:
    """Lines of all tiles, padded to the largest, where there are wires."""
    from ohmloom.mapping._fabric import Wires

    w = fabric.wires
    if not isinstance(w, Wires):
        return ["#define HAS_WIRES 0"]
    tiles, rows, columns = w.still.shape
    is_read = (w.column_neuron >= 0) | (np.arange(columns) == w.reference_column[:, None])
    still = ", ".join(
        "{" + ", ".join("{" + ", ".join(map(number, line)) + "}" for line in tile) + "}" for tile in w.still
    )
    flags = ", ".join("{" + ", ".join(str(int(x)) for x in line) + "}" for line in is_read)
    return [
        "#define HAS_WIRES 1",
        f"enum {{ TILES = {tiles}, ROWS = {rows}, COLUMNS = {columns}, NODES = {2 * rows * columns}, "
        f"BAND = {2 * min(rows, columns)} }};",
        "/* S: of a segment of a row and of a column, of a driver and of a sense with theirs. */",
        *(f"#define {name} {number(g)}" for name, g in (("ROW_G", 1.0 / w.r_row), ("COLUMN_G", 1.0 / w.r_column),
                                                       ("DRIVER_G", w.near[0]), ("SENSE_G", w.far[0]))),
        f"static const double still[][{rows}][{columns}] = {{{still}}};",
        f"static const int column_is_read[][{columns}] = {{{flags}}};",
        array("int", "reference_column", w.reference_column.tolist(), "-1 where a tile has none"),
        *(array("int", f"cell_{name}", fabric.cells[name].tolist()) for name in ("row", "column")),
        *(array("int", f"read_{name}", fabric.reads[name].tolist()) for name in ("row", "column")),
        array("int", "read_tile_of", fabric.reads["tile"].tolist()),
    ]  # fmt: skip
