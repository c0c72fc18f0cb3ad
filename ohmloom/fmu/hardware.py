"""A die as a discrete FMU: the emulated controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ohmloom.devices import LAWS
from ohmloom.devices.emit import identifier
from ohmloom.errors import expect_type
from ohmloom.fmu import _discrete_code as code
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu._flux_code import INVERSES, flux_code
from ohmloom.fmu._law_code import law_text
from ohmloom.fmu._tables import array, number
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import Description, FmiVersion, Variable
from ohmloom.fmu.discrete import LICENCE, TIMESTEP, runtime_file
from ohmloom.mapping.die import Die
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS

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
    the waveform, faults, wires, noise of events and reads, disturb by reads, ageing, converters, and the spread of
    neurons, senses and gains are those of the die.

    Parameters
    ----------
    die
        From `Plan.sample` or `Plan.nominal`.
    out, fmi, platforms
        As `export_device` has them.
    timestep, arrays
        As `export_controller` has them.

    Raises
    ------
    ParameterError
        If an option is none of these.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_hardware_controller"
    expect_type(f"{where}: die", die, Die)
    path = check_options(where, out, fmi, platforms, arrays=arrays)
    parts = die_parts(die)
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
        "timestep; every synapse is a device that follows its law. See sources/fmu.c, parts hardware.c and die.c.",
        LICENCE,
    ]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def die_parameters(die: Die) -> tuple[Variable, ...]:
    """In the order of hardware.c: the readings that a die does not spread."""
    by_name = {v.name: v for v in code.controller_parameters(die.plan.network)}
    return tuple(by_name[name] for name in PARAMETERS)


def die_parts(die: Die) -> dict[str, str]:
    """The C files of a die's controller but ``model.c``."""
    devices = die.plan.hardware.devices
    laws = [devices[tile.kind].law for tile in die.plan.tiles]
    integrated = {law for tile, law in zip(die.plan.tiles, laws, strict=True)
                  if tile.kind in PLASTIC_KINDS and LAWS[law].flux is None}  # fmt: skip
    return {
        "die.c": _tables(die),
        "law.c": law_text([law for law in laws if law not in integrated], ["conductance"])
        + law_text([law for law in laws if law in integrated], ["conductance", "charge_rate"]),
        **{name: runtime_file(name) for name in ("hardware.c", "events.c", "lines.c", "pulses.c", "random.c")},
    }


def _tables(die: Die) -> str:
    """The die as C constants: ``die.c``."""
    from ohmloom.mapping._cell_kernels import INTEGRATED
    from ohmloom.mapping._fabric import CHARGE_METERED, EXACT_WIDTH, MAY_FIRE, VOLTAGE, DrivenLines
    from ohmloom.mapping.fabric import build_fabric

    fabric, _, _ = build_fabric(die)
    cells, tiles, neurons, c = fabric.cells, fabric.tiles, fabric.neurons, fabric.constants[0]
    reads, drive = fabric.reads, {VOLTAGE: "VOLTAGE", EXACT_WIDTH: "EXACT_WIDTH"}.get(c["mode"], "CHARGE")
    cards = [die.plan.hardware.devices[tile.kind] for tile in die.plan.tiles]
    is_integrated = tiles["family"] == INTEGRATED
    integrates = bool(is_integrated.any())
    meters_late = c["mode"] == CHARGE_METERED and c["metering_delay"] > 0.0
    ages, disturbs = c["decay"] != 1.0, c["read_disturb"] > 0.0
    has_cycle_noise, bits = c["cycle_to_cycle"] > 0.0, int(c["bits"])
    # What the drives need to know besides.
    q_d, event_charge = ("charge", "charge_scale", "C"), ("event_charge", "event_charge", "C")
    moving = {"CHARGE": (q_d, event_charge) if meters_late else (q_d,) if integrates else (), "EXACT_WIDTH": (q_d,),
              "VOLTAGE": (q_d, ("event_flux", "event_flux", "Wb of a pulse"), ("bottom", "bottom", "Wb at s = 0"),
                          ("top", "top", "Wb at s = 1"))}  # fmt: skip
    live = cells["is_live"] & (tiles["family"][cells["tile"]] >= 0) if len(cells) else cells["is_live"]
    size = fabric.table.shape[0]
    dispatch = [
        "/* S, of a tile's devices. */",
        "static double conductance(int tile, double s)",
        "{",
        "    switch (tile) {",
    ]
    for t, card in enumerate(cards):
        case = "default:" if t == len(cards) - 1 else f"case {t}:"
        dispatch += [f"    {case}", f"        return {card.law}_conductance(s, 0.0, tile_p_{t});"]
    if not cards:
        dispatch += ["    default:", "        return s;"]
    dispatch += ["    }", "}"]
    if integrates:
        dispatch += _integrated([f"{cards[t].law}_{{}}" if is_integrated[t] else "" for t in range(len(cards))])
    is_plastic, drives_lines = (tiles["family"] >= 0).tolist(), isinstance(fabric.lines, DrivenLines)
    is_closed = [moves and not other for moves, other in zip(is_plastic, is_integrated, strict=True)]
    laws = {card.law for card, follows in zip(cards, is_closed, strict=True) if follows}
    needs_newton = drive == "VOLTAGE" and not laws <= set(INVERSES)
    alone = () if drives_lines else ("series",)  # of cells that are driven one by one
    if drive != "CHARGE" or meters_late:
        dispatch += ["", *flux_code(cards, is_closed, has_inverse=drive == "VOLTAGE",
                                    has_flux=needs_newton or not drives_lines or ages)]  # fmt: skip

    def square(name: str, kind: str, values: Any) -> str:
        rows = ", ".join(
            "{" + ", ".join(number(x) if kind == "double" else str(int(x)) for x in row) + "}" for row in values
        )
        return f"static const {kind} {name}[][{size}] = {{{rows}}};"

    parts = [
        f"/* {identifier(die.plan.network.name)} on {identifier(die.plan.hardware.name)}. */",
        '#include "law.c"',
        f"enum {{ NEURONS = {len(neurons)}, CELLS = {max(len(cells), 1)}, READS = {max(len(reads), 1)}, "
        f"SLOTS = {1 + max(int(read['tap'].max(initial=1)) for read in (reads, cells))}, PHASES = {len(fabric.phase)}, "
        f"COUNTS_HALF_SELECTS = {int(c['counts_half_selects'])} }};",
        "#define CHARGE 1",
        "#define VOLTAGE 2",
        "#define EXACT_WIDTH 3",
        f"#define DRIVE {drive}",
        f"#define DRIVES_LINES {int(drives_lines)}",
        f"#define NEEDS_NEWTON {int(needs_newton)}",
        *(f"#define {name} {int(value)}" for name, value in (
            ("HAS_READ_NOISE", c["read_noise"] > 0.0), ("HAS_CYCLE_NOISE", has_cycle_noise),
            ("READ_DISTURBS", disturbs), ("AGES", ages), ("INTEGRATES", integrates),
            ("IS_METERED", c["mode"] == CHARGE_METERED), ("METERS_LATE", meters_late), ("BITS", bits))),
        *(f"#define {name}_{part} 0x{word:08x}u" for name, key in (("READ_KEY", "read_key"), ("CYCLE_KEY", "cycle_key"))
          for part, word in (("LOW", int(c[key]) & 0xFFFFFFFF), ("HIGH", int(c[key]) >> 32))),
        f"enum {{ LAST_SPIKE = {c['last_spike']}, CLAMP = {int(c['clamp'])}, CARRY_STATE = {int(c['carry'])} }};",
        *(f"#define {name} {number(c[field])}" for name, field in (
            ("EVENT_LEVEL", "event_level"), ("PULSE_VOLTAGE", "pulse_voltage"), ("ASYMMETRY", "asymmetry"),
            ("HALF_SELECT", "half_select"), ("READ_NOISE", "read_noise"), ("CYCLE_TO_CYCLE", "cycle_to_cycle"),
            ("READ_DISTURB", "read_disturb"), ("DECAY", "decay"), ("SETTLED", "settled"),
            ("METERING_DELAY", "metering_delay"))),
        array("int", "first_cell", fabric.starts.tolist(), "by receiver; the next one's is the end"),
        *(array("int", f"cell_{name}", cells[name].tolist()) for name, is_needed in (
            ("tile", True), ("sender", not drives_lines or disturbs), ("tap", disturbs), ("number", has_cycle_noise))
          if is_needed),
        array("int", "first_read", fabric.read_starts.tolist(), "what columns read, likewise"),
        *(array("int", f"read_{name}", reads[name].tolist()) for name in ("sender", "tap")),
        array("double", "read_polarity", reads["polarity"].tolist()),
        *_wire_tables(fabric),
        array("int", "cell_is_live", live.astype(int).tolist(), "whether events move it"),
        *(array("double", f"cell_{name}", cells[field].tolist(), doc) for name, field, doc in (
            ("start", "first_s", "state"),
            ("origin", "first_origin", "where its events are counted from: a state, or a flux in Wb"),
            *((("belief", "first_belief", "what the driver takes for the state"),) if drive == "EXACT_WIDTH" else ()),
            ("fixed", "fixed_g", "S, where no event moves it"),
            ("factor", "factor", "charge of an event, 1 nominally"), ("threshold", "threshold", "V"),
            *((name, name, "Ohm of the wires to it") for name in alone),
            *((("polarity", "polarity", "of a read's voltage"),) if disturbs else ()))),
        *(array("double", f"tile_{name}", tiles[field].tolist(), doc) for name, field, doc in (
            ("gain", "gain", ""), ("reference", "reference", "S that is subtracted"), ("on", "g_on", "S"),
            *(moving[drive] if needs_newton or not drives_lines or integrates else moving[drive][1:]),
            *((("duration", "duration", "s of a pulse"),) if integrates and c["mode"] != CHARGE_METERED else ()))),
        array("int", "tile_is_plastic", [int(x) for x in is_plastic]),
        *(array("double", f"tile_p_{t}", [float(x) for x in die.plan.hardware.devices[tile.kind].parameters.values()])
          for t, tile in enumerate(die.plan.tiles)),
        *(array("double", f"neuron_{name}", neurons[field].tolist()) for name, field in (
            ("a", "a"), ("b", "b"), ("threshold", "y_thresh"), ("offset", "offset"),
            *((("full_scale", "full_scale"),) if bits else ()))),
        array("double", "phase_width", fabric.phase.tolist(), "of the waveform's phases, in pulses"),
        square("row_level", "double", fabric.levels[:, 0, :size]),
        square("column_level", "double", fabric.levels[:, 1, :size]),
        *([square("may_fire", "int", (np.asarray(fabric.table) & MAY_FIRE) != 0)] if alone else []),
        *dispatch,
        "",
    ]  # fmt: skip
    return "\n".join(parts)


def _integrated(functions: list[str]) -> list[str]:
    """Laws of the tiles whose devices are integrated: names of their functions, empty for other tiles."""
    lines = ["/* Whether a tile's devices are integrated, and the laws of those that are. */",
             "static int tile_is_integrated(int tile)", "{",
             f"    static const int is_integrated[] = {{{', '.join(str(int(bool(f))) for f in functions)}}};",
             "    return is_integrated[tile];", "}"]  # fmt: skip
    for name, head, call in (("conductance", "double s, double v", "s, v"),
                             ("charge_rate", "double s, double v, double i", "s, v, i")):  # fmt: skip
        lines += [f"static double {name}_at(int tile, {head})", "{", "    switch (tile) {"]
        for t, function in enumerate(functions):
            if function:
                lines += [f"    case {t}:", f"        return {function.format(name)}({call}, tile_p_{t});"]
        lines += ["    default:", f"        return NAN * ({call.replace(', ', ' + ')});", "    }", "}"]
    return lines


def _wire_tables(fabric: Any) -> list[str]:
    """Lines of all tiles, padded to the largest, where there are wires."""
    from ohmloom.mapping._fabric import DrivenLines, Wires

    w = fabric.wires
    if not isinstance(w, Wires):
        return ["#define HAS_WIRES 0"]
    tiles, rows, columns = w.still.shape
    still = ", ".join(
        "{" + ", ".join("{" + ", ".join(map(number, line)) + "}" for line in tile) + "}" for tile in w.still
    )

    def lines(name: str, values: Any) -> str:
        rows = ", ".join("{" + ", ".join(str(int(x)) for x in line) + "}" for line in values)
        return f"static const int {name}[][{values.shape[1]}] = {{{rows}}}; /* -1 where a line has none */"

    return [
        "#define HAS_WIRES 1",
        f"enum {{ TILES = {tiles}, ROWS = {rows}, COLUMNS = {columns} }};",
        "/* Ohm of a segment of a row and of a column; S of a driver and of a sense with theirs. */",
        *(f"#define {name} {number(x)}" for name, x in (("ROW_SEGMENT", w.r_row), ("COLUMN_SEGMENT", w.r_column),
                                                       ("ROW_NEAR", w.near[0]), ("COLUMN_FAR", w.far[0]))),
        f"static const double still[][{rows}][{columns}] = {{{still}}};",
        lines("column_neuron", w.column_neuron),
        *([lines("row_neuron", w.row_neuron)] if isinstance(fabric.lines, DrivenLines) else []),
        array("int", "reference_column", w.reference_column.tolist(), "-1 where a tile has none"),
        *(array("int", f"cell_{name}", fabric.cells[name].tolist()) for name in ("row", "column")),
        *(array("int", f"read_{name}", fabric.reads[name].tolist()) for name in ("row", "column")),
        array("int", "read_tile_of", fabric.reads["tile"].tolist()),
    ]  # fmt: skip
