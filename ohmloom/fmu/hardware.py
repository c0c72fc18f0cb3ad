"""A die as a discrete FMU: the emulated controller, where it needs neither wires nor noise."""

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
from ohmloom.fmu.description import Description, FmiVersion
from ohmloom.fmu.discrete import LICENCE, TIMESTEP, runtime_file
from ohmloom.mapping.die import Die

PARAMETERS = ("c", "c_ini", "synapse_gain", "high_count")  # in the order of hardware.c; the rest a die spreads


def export_hardware_controller(
    die: Die, out: Path | str, *, fmi: FmiVersion = 2, platforms: Platforms = "host"
) -> Export:
    """Write a die as an FMU for co-simulation, spike for spike the emulated controller.

    Variables are those of `export_controller`. Devices, their states after programming and their spread, thresholds,
    the waveform, faults, and the spread of neurons, senses and gains are those of the die.

    Parameters
    ----------
    die
        From `Plan.sample` or `Plan.nominal`, of hardware without wire resistance whose events are charges.
    out, fmi, platforms
        As `export_device` has them.

    Raises
    ------
    ParameterError
        If an option is none of these.
    MappingError
        If the die has wires, noise, or a drive that this FMU does not have; names all of them.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_hardware_controller"
    expect_type(f"{where}: die", die, Die)
    path = check_options(where, out, fmi, platforms)
    tables = _tables(where, die)
    network, hardware = die.plan.network, die.plan.hardware
    name = f"{network.name}_{hardware.name}"
    plain = code.controller_description(network, TIMESTEP)
    by_name = {v.name: v for v in plain.variables}
    variables = (*(by_name[name] for name in PARAMETERS), *(v for v in plain.variables if v.kind != "start"))
    description = Description(
        name=name, identifier=identifier(name), doc=f"{plain.doc}, on {hardware.name}", stop_time=plain.stop_time,
        step_size=TIMESTEP, timestep=TIMESTEP, has_derivatives=False, variables=variables,
    )  # fmt: skip
    model = {
        "model.c": code.model_code(code.CONTROLLER.replace("controller.c", "hardware.c").replace("network.c", "die.c"),
                                   description),
        "die.c": tables,
        "law.c": law_text((hardware.devices[tile.kind] for tile in die.plan.tiles), ["conductance"]),
        "hardware.c": runtime_file("hardware.c"),
    }  # fmt: skip
    which = "the nominal die" if die.seed is None else f"die {die.index} of seed {die.seed}"
    paragraphs = [
        f"Network {network.name} (sha256 {network.sha256}) on {hardware.name}, {which}: 21 steps of the network in a "
        "timestep; every synapse is a device that follows its law. See sources/hardware.c and sources/die.c.",
        LICENCE,
    ]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def _tables(where: str, die: Die) -> str:
    """The die as C constants: ``die.c``."""
    from ohmloom.mapping._fabric import CHARGE_METERED, CURRENT, MAY_FIRE, ClosedPulses, NoWires
    from ohmloom.mapping.fabric import build_fabric

    fabric, _, _ = build_fabric(die)
    cells, tiles, neurons, c = fabric.cells, fabric.tiles, fabric.neurons, fabric.constants[0]
    problems = [
        text
        for text, is_there in (
            ("wire resistances", not isinstance(fabric.wires, NoWires)),
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
        raise MappingError(f"{where}: die: expected hardware without wires and noise whose events are charges, got "
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
        f"enum {{ NEURONS = {len(neurons)}, CELLS = {max(len(cells), 1)}, "
        f"SLOTS = {int(cells['tap'].max(initial=1)) + 1}, PHASES = {len(fabric.phase)} }};",
        f"enum {{ LAST_SPIKE = {c['last_spike']}, CLAMP = {int(c['clamp'])}, CARRY_STATE = {int(c['carry'])} }};",
        *(f"#define {name} {number(c[field])}" for name, field in (
            ("EVENT_LEVEL", "event_level"), ("PULSE_VOLTAGE", "pulse_voltage"), ("ASYMMETRY", "asymmetry"))),
        array("int", "first_cell", fabric.starts.tolist(), "by receiver; the next one's is the end"),
        *(array("int", f"cell_{name}", cells[name].tolist()) for name in ("sender", "tile", "tap")),
        array("int", "cell_is_live", live.astype(int).tolist(), "whether events move it"),
        *(array("double", f"cell_{name}", cells[field].tolist(), doc) for name, field, doc in (
            ("polarity", "polarity", ""), ("start", "first_origin", "state"),
            ("fixed", "fixed_g", "S, where no event moves it"),
            ("factor", "factor", "charge of an event, 1 nominally"), ("threshold", "threshold", "V"))),
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
