"""Cost of a plan from the component numbers of its spec: area, energy of a timestep, time of a step."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ohmloom.circuits.tables import write_rows
from ohmloom.errors import MappingError, expect_type
from ohmloom.mapping.grid import tile_grid
from ohmloom.mapping.placing import placed
from ohmloom.mapping.plan import Plan
from ohmloom.mapping.quantity import Quantity
from ohmloom.mapping.schedule import STEP, Schedule, pulse_schedule

AREA, ENERGY, TIME = "area", "energy of a timestep", "time of a step"
UNITS: Final = {AREA: "m2", ENERGY: "J", TIME: "s"}
SIGNS: Final = ("row_polarity", "column_pair", "differential_pair")
NEVER: Final = ("control logic, clocks and wiring between tiles", "power supply and what leaks while nothing happens")
STEPS: Final = 21


@dataclass(frozen=True, kw_only=True)
class CostLine:
    """One item: how many of it, what each costs, and where that number comes from.

    Attributes
    ----------
    group
        ``area``, ``energy of a timestep`` or ``time of a step``.
    item
        What it is.
    count, each, total
        ``total = count * each``, in m2, J or s.
    source
        Of the number.
    """

    group: str
    item: str
    count: float
    each: float
    source: str

    @property
    def total(self) -> float:
        """``count * each``."""
        return self.count * self.each

    @property
    def unit(self) -> str:
        """Of `each` and `total`."""
        return UNITS[self.group]


@dataclass(frozen=True, kw_only=True)
class SignCost:
    """What one way to carry signs costs: `array.signs`, with everything else as in the spec.

    Attributes
    ----------
    signs
        ``row_polarity``, ``column_pair`` or ``differential_pair``.
    tiles, devices, lines, cells
        Tiles; devices that are built, references included; rows and columns; crosspoints.
    area
        Sum of what the spec gives an area for [m2].
    read_error
        Worst of all tiles, with lines sorted but not yet swapped.
    problem
        Why it cannot be built, else an empty text.
    """

    signs: str
    tiles: int = 0
    devices: int = 0
    lines: int = 0
    cells: int = 0
    area: float = 0.0
    read_error: float = 0.0
    problem: str = ""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """All items of a plan.

    Attributes
    ----------
    lines
        What is counted.
    not_counted
        What is not, because the spec has no number for it, or no spec has.
    signs
        The alternatives of `array.signs` side by side.
    """

    lines: tuple[CostLine, ...]
    not_counted: tuple[str, ...]
    signs: tuple[SignCost, ...]

    def total(self, group: str) -> float:
        """Sum of a group."""
        return sum(line.total for line in self.lines if line.group == group)

    def write_csv(self, path: Path | str) -> None:
        """Items, then what is not counted, then the alternatives of `signs`; whole or not at all."""
        rows: list[list[Any]] = [[x.group, x.item, x.count, x.each, x.total, x.unit, x.source] for x in self.lines]
        rows += [["not counted", text, "", "", "", "", ""] for text in self.not_counted]
        for s in self.signs:
            words = f"{s.tiles} tiles, {s.devices} devices, {s.lines} lines, {s.cells} crosspoints"
            words = s.problem or f"{words}, worst read error {s.read_error:.3g}"
            rows.append(["alternatives of array.signs", f"{s.signs}: {words}", "", "", s.area, "m2", "as above"])
        write_rows(path, ["group", "item", "count", "each", "total", "unit", "source"], rows)


def plan_cost(plan: Plan, schedule: Schedule | None = None) -> Cost:
    """Count what a plan takes.

    Area is that of the built arrays, with spare lines and references. Energy and time are those of the schedule, scaled
    to a timestep of 21 steps; a step's time is its columns read one after the other, and the longest programming.

    Parameters
    ----------
    plan
        What is placed where.
    schedule
        Of `pulse_schedule`; by default that of the ideal network's first timestep. Without one (skewed clocks) only
        area is counted.

    Raises
    ------
    ParameterError
        If `plan` is no Plan.
    """
    expect_type("plan_cost.plan", plan, Plan)
    is_scheduled = plan.hardware.array.delays != "retimed"
    if schedule is None and is_scheduled:
        schedule = pulse_schedule(plan)
    found = _Found()
    _area(plan, found)
    if schedule is None:
        found.missing.append("energy and time: array.delays = 'retimed' has no schedule")
    else:
        _energy(plan, schedule, found)
        _time(plan, schedule, found)
    return Cost(
        lines=tuple(found.lines), not_counted=(*found.missing, *NEVER),
        signs=tuple(_sign_cost(plan, signs) for signs in SIGNS),
    )  # fmt: skip


class _Found:
    """Items so far, and what had no number."""

    def __init__(self) -> None:
        self.lines: list[CostLine] = []
        self.missing: list[str] = []

    def add(
        self, group: str, item: str, count: float, key: str, quantity: Quantity | None, factor: float = 1.0
    ) -> None:
        """Count an item, or note that `key` of the spec is missing."""
        if count == 0:
            return
        if quantity is None:
            self.missing.append(f"{group} of {item}: the spec has no {key}")
        else:
            each = quantity.value * factor
            self.lines.append(CostLine(group=group, item=item, count=count, each=each, source=quantity.source))

    def add_known(self, group: str, item: str, count: float, total: float, source: str) -> None:
        """Count an item whose total follows from devices and drive."""
        if count:
            self.lines.append(CostLine(group=group, item=item, count=count, each=total / count, source=source))


def _area(plan: Plan, found: _Found) -> None:
    hardware, periphery, converter = plan.hardware, plan.hardware.periphery, plan.hardware.converter
    grids = [tile_grid(plan, t) for t in range(len(plan.tiles))]
    rows, columns = (sum(grid.cell.shape[axis] for grid in grids) for axis in (0, 1))
    cells = sum(grid.cell.size for grid in grids)

    def part(name: str) -> Quantity | None:
        return None if periphery is None else getattr(periphery, name)

    feature, cell = part("feature"), part("cell_area")
    if feature is None or cell is None:
        found.add(AREA, "crosspoints", cells, "periphery.feature and cell_area", None)
    else:
        source = f"{cell.source}; feature size: {feature.source}"
        found.add_known(AREA, "crosspoints", cells, cells * cell.value * feature.value**2, source)
    found.add(AREA, "drivers of rows and columns", rows + columns, "periphery.driver_area", part("driver_area"))
    found.add(AREA, "senses of columns", columns, "periphery.sense_area", part("sense_area"))
    if hardware.drive.mode == "charge_metered":
        meters = columns if hardware.drive.parallelism == "column" else len(grids)
        found.add(AREA, "charge meters", meters, "periphery.meter_area", part("meter_area"))
    found.add(AREA, "bits of shift registers", register_bits(plan), "periphery.register_area", part("register_area"))
    if converter is not None:
        found.add(AREA, "converters of columns", columns, "converter.area", converter.area)
    found.add(AREA, "neurons", plan.network.neurons, "neuron.area", hardware.neuron.area)


def register_bits(plan: Plan) -> int:
    """Bits of all rows' shift registers: each as long as the row's longest tap; a spare row as the tile's longest."""
    bits = 0
    for t, tile in enumerate(plan.tiles):
        taps = [(p.row, p.tap) for p in plan.crosspoints if p.tile == t]
        depth = [max((tap for row, tap in taps if row == i), default=0) for i in range(len(tile.rows))]
        bits += sum(depth) + tile.spare_rows * max(depth, default=0)
    return bits


def _energy(plan: Plan, schedule: Schedule, found: _Found) -> None:
    hardware, periphery, converter = plan.hardware, plan.hardware.periphery, plan.hardware.converter
    scale = STEPS / max(len(schedule.busy), 1)
    reads = [slot for slot in schedule.slots if slot.action == "read"]
    writes = [slot for slot in schedule.slots if slot.action == "write"]
    grids = [tile_grid(plan, t) for t in range(len(plan.tiles))]
    is_selected = hardware.array.access == "1T1R"
    read_energy = 0.0
    for slot in reads:
        g = grids[slot.tile].conductance
        columns = {j for _, j in slot.selected} | ({g.shape[1] - 1} if plan.tiles[slot.tile].has_reference else set())
        lines = sorted(columns) if is_selected else list(range(g.shape[1]))
        read_energy += sum(v**2 * float(g[i, lines].sum()) for i, v in slot.rows) * hardware.read.duration.value
    pulses = sum(len(slot.selected) for slot in writes)
    by_law = "device cards, drive and schedule"
    found.add_known(ENERGY, "reads, in the devices", scale * len(reads), scale * read_energy, by_law)
    written, idle = sum(slot.energy for slot in writes), sum(slot.idle_energy for slot in writes)
    found.add_known(ENERGY, "programming pulses, in the devices", scale * pulses, scale * written, by_law)
    if idle:
        found.add_known(ENERGY, "half-selected devices", scale * len(writes), scale * idle, by_law)

    def part(name: str) -> Quantity | None:
        return None if periphery is None else getattr(periphery, name)

    driven = scale * sum(len(slot.rows) + len(slot.columns) for slot in schedule.slots)
    found.add(ENERGY, "driven lines", driven, "periphery.driver_energy", part("driver_energy"))
    found.add(ENERGY, "reads, in the senses", scale * len(reads), "periphery.sense_energy", part("sense_energy"))
    if hardware.drive.mode == "charge_metered":
        found.add(ENERGY, "metered pulses", scale * pulses, "periphery.meter_energy", part("meter_energy"))
    shifted = register_bits(plan) * STEPS
    found.add(ENERGY, "shifted bits", shifted, "periphery.register_energy", part("register_energy"))
    if converter is not None:
        found.add(ENERGY, "conversions", scale * len(reads), "converter.energy", converter.energy)
    spikes = scale * float(schedule.spikes.sum())
    found.add(ENERGY, "spikes of neurons", spikes, "neuron.energy_per_spike", hardware.neuron.energy_per_spike)


def _time(plan: Plan, schedule: Schedule, found: _Found) -> None:
    columns = max((len(tile.columns) for tile in plan.tiles), default=0)
    found.add(TIME, "reads of columns, one after the other", columns, "read.duration", plan.hardware.read.duration)
    if plan.hardware.converter is not None:
        found.add(TIME, "conversions", columns, "converter.duration", plan.hardware.converter.duration)
    reading = found.lines and sum(line.total for line in found.lines if line.group == TIME)
    longest = max(schedule.busy, default=0.0) - float(reading or 0.0)
    source = (
        f"device cards, drive and schedule: the longest of {len(schedule.busy)} steps; a step has {STEP * 1e3:.4g} ms"
    )
    found.add_known(TIME, "programming", 1, max(longest, 0.0), source)


def _sign_cost(plan: Plan, signs: str) -> SignCost:
    hardware = plan.hardware
    array = hardware.array.model_copy(update={"signs": signs})
    try:
        # Swaps change no count, and take most of the time.
        made = placed(plan.network, hardware.model_copy(update={"array": array}), sweeps=0)
    except MappingError as error:
        return SignCost(signs=signs, problem=error.problems[0])
    found = _Found()
    _area(made, found)
    shapes = [tile_grid(made, t).cell.shape for t in range(len(made.tiles))]
    devices = len(made.crosspoints) * (2 if signs == "differential_pair" else 1)
    return SignCost(
        signs=signs, tiles=len(made.tiles), lines=sum(m + n for m, n in shapes), cells=sum(m * n for m, n in shapes),
        devices=devices + sum(len(tile.rows) for tile in made.tiles if tile.has_reference),
        area=sum(line.total for line in found.lines),
        read_error=max((t.read_error.built for t in made.tiles if t.read_error is not None), default=0.0),
    )  # fmt: skip
