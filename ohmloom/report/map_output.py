"""What `ohmloom map` works out and writes: plan, tables, netlists, decks and pictures."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.circuits.tables import write_rows
from ohmloom.mapping import (
    Cost,
    Plan,
    ResetPlan,
    Schedule,
    plan_cost,
    plan_reset,
    plan_yield,
    pulse_schedule,
    tile_deck,
    tile_grid,
    tile_netlist,
)
from ohmloom.mapping.cost import AREA, ENERGY, TIME
from ohmloom.mapping.yield_ import Yield

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIES = 200  # sampled for the yield of a plan, where the spec has faults


@dataclass(frozen=True, kw_only=True)
class MapStudy:
    """A plan with all that follows from it.

    Attributes
    ----------
    plan, reset, cost
        What is placed where, how it gets back to its start, what it takes.
    schedule
        Of the ideal network's first timestep with all sensors at 0.5; None with skewed clocks.
    yields
        Of each tile; empty where the spec has no faults.
    """

    plan: Plan
    reset: ResetPlan
    cost: Cost
    schedule: Schedule | None
    yields: tuple[Yield, ...]

    @property
    def utilisation(self) -> float:
        """Synapses per built crosspoint."""
        cells = sum(tile_grid(self.plan, t).cell.size for t in range(len(self.plan.tiles)))
        return len(self.plan.crosspoints) / cells if cells else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Numbers for machines, in SI."""
        tiles = []
        for t, tile in enumerate(self.plan.tiles):
            cells = tile_grid(self.plan, t).cell
            used = sum(point.tile == t for point in self.plan.crosspoints)
            tiles.append({
                "kind": tile.kind, "card": tile.card, "rows": len(tile.rows), "columns": len(tile.columns),
                "spare_rows": tile.spare_rows, "spare_columns": tile.spare_columns, "synapses": used,
                "utilisation": used / cells.size, "has_reference": tile.has_reference, "gain": self.plan.tile_gain(t),
                "read_error": None if tile.read_error is None else asdict(tile.read_error),
                "yield": asdict(self.yields[t]) if self.yields else None,
            })  # fmt: skip
        cost, reset = self.cost, self.reset
        return {
            "tiles": tiles, "synapses": len(self.plan.crosspoints), "utilisation": self.utilisation,
            "reset": {"duration": _finite(reset.duration), "energy": _finite(reset.energy),
                      "first_duration": _finite(reset.first_duration),
                      "pulses": sum(d.pulses for d in reset.devices if d.every_trial)},
            "cost": {"area": cost.total(AREA), "energy_per_timestep": cost.total(ENERGY),
                     "time_per_step": cost.total(TIME), "not_counted": list(cost.not_counted),
                     "signs": [asdict(way) for way in cost.signs]},
            "late_steps": None if self.schedule is None else self.schedule.late_steps,
        }  # fmt: skip


def study_map(plan: Plan, *, seed: int = 0) -> MapStudy:
    """Work out reset, schedule, cost and yield of a plan; `seed` is that of the yield's samples."""
    schedule = None if plan.hardware.array.delays == "retimed" else pulse_schedule(plan)
    return MapStudy(
        plan=plan, reset=plan_reset(plan), cost=plan_cost(plan, schedule), schedule=schedule,
        yields=plan_yield(plan, dies=DIES, rng=np.random.default_rng(seed)),
    )  # fmt: skip


def map_files(plan: Plan) -> list[str]:
    """Names of the files that `save_map` writes."""
    names = ["plan.json", "placement.csv", "reset.csv", "cost.csv", "crossbars.png"]
    names += ["example.png"] if plan.crosspoints else []
    if plan.hardware.array.delays != "retimed":
        names += ["pulses.csv", *(["pulses.png"] if plan.crosspoints else [])]
    for t in range(len(plan.tiles)):
        names += [f"tile_{t}.netlist.json", f"tile_{t}.cir"]
        names += [f"tile_{t}_pulses.csv"] if _has_train(plan) else []
    return names


def save_map(study: MapStudy, out: Path) -> list[Path]:
    """Write everything to a folder, each file whole or not at all; their paths."""
    from ohmloom.report.crossbar_plot import plot_plan
    from ohmloom.report.mapping_plot import plot_example

    plan, schedule = study.plan, study.schedule
    plan.save(out / "plan.json")
    rows = plan.table()
    write_rows(out / "placement.csv", list(rows[0]) if rows else [], [list(row.values()) for row in rows])
    study.reset.write_csv(out / "reset.csv")
    study.cost.write_csv(out / "cost.csv")
    _save_figure(plot_plan(plan), out / "crossbars.png")
    if plan.crosspoints:
        _save_figure(plot_example(plan), out / "example.png")
    if schedule is not None:
        schedule.write_csv(out / "pulses.csv")
        if plan.crosspoints:
            _save_figure(_schedule_figure(schedule), out / "pulses.png")
    for t in range(len(plan.tiles)):
        tile_netlist(plan, t).save(out / f"tile_{t}.netlist.json")
        write_atomic(out / f"tile_{t}.cir", tile_deck(plan, t))
        if schedule is not None and _has_train(plan):
            schedule.train(t).write_csv(out / f"tile_{t}_pulses.csv")
    return [out / name for name in map_files(plan)]


def map_words(study: MapStudy) -> Iterator[str]:
    """What was found, in sentences."""
    from ohmloom.units import format_quantity

    plan, reset, cost = study.plan, study.reset, study.cost
    for t, tile in enumerate(plan.tiles):
        used = sum(point.tile == t for point in plan.crosspoints)
        size = tile_grid(plan, t).cell.size
        extra = ", plus a reference column" if tile.has_reference else ""
        extra += f", plus {tile.spare_rows} spare rows and {tile.spare_columns} spare columns" \
            if tile.spare_rows or tile.spare_columns else ""  # fmt: skip
        yield (f"tile {t}, {tile.kind}: {len(tile.rows)} rows x {len(tile.columns)} columns of {tile.card}{extra}; "
               f"{used} of {size} crosspoints used ({used / size:.0%})")  # fmt: skip
        yield f"  a synapse of W = 1 reads {format_quantity(1.0 / plan.tile_gain(t), 'A')}, its senses' unit"
        errors = tile.read_error
        if errors is not None and errors.given > 0.0:
            yield (f"  worst read error {errors.given:.2%} with lines in ascending order, {errors.sorted:.2%} sorted, "
                   f"{errors.refined:.2%} after {errors.swaps} swaps: {errors.gain:.0%} less")  # fmt: skip
            if errors.built > errors.limit:
                yield f"  above the limit of {errors.limit:.2%}, which no size of tile would keep: wires against R_on"
        if study.yields:
            found = study.yields[t]
            low, high = found.plain_interval
            yield (f"  yield {found.formula:.1%} by formula, {found.plain:.1%} [{low:.1%}, {high:.1%}] of {found.dies} "
                   f"sampled tiles; {found.repaired:.1%} with repair")  # fmt: skip
    tiles = "1 tile" if len(plan.tiles) == 1 else f"{len(plan.tiles)} tiles"
    yield f"all {len(plan.crosspoints)} synapses placed on {tiles}, {study.utilisation:.0%} of the crosspoints used"
    lost = sum(not math.isfinite(device.duration) for device in reset.devices)
    if lost:
        yield f"reset: the drive cannot bring {lost} devices back from one end of their range"
    elif any(device.every_trial for device in reset.devices):
        pulses = sum(d.pulses for d in reset.devices if d.every_trial)
        yield (f"reset takes {format_quantity(reset.duration, 's')} per trial at worst: {pulses:,} pulses, each with a "
               f"read, {format_quantity(reset.energy, 'J')}")  # fmt: skip
    if 0.0 < reset.first_duration < math.inf:
        yield f"programming the constant synapses takes {format_quantity(reset.first_duration, 's')}, once"
    yield (f"counted: {cost.total(AREA) * 1e6:.3g} mm2, {format_quantity(cost.total(ENERGY), 'J')} per timestep, "
           f"{format_quantity(cost.total(TIME), 's')} per step of 1.52 ms (first timestep, all sensors at "
           "0.5)")  # fmt: skip
    if study.schedule is not None and study.schedule.late_steps:
        yield f"  {study.schedule.late_steps} of {len(study.schedule.busy)} steps take longer than they have"
    for way in cost.signs:
        words = f"{way.devices} devices, {way.lines} lines, {way.cells} crosspoints, {way.area * 1e6:.5g} mm2"
        mark = " (this plan)" if way.signs == plan.hardware.array.signs else ""
        yield f"signs by {way.signs}{mark}: {way.problem or words}"
    yield from (f"not counted: {text}" for text in cost.not_counted)


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if math.isfinite(value) else None


def _has_train(plan: Plan) -> bool:
    """Whether pulses on the lines say all: nothing selects a cell, and something is driven."""
    return plan.hardware.array.access == "passive" and plan.hardware.array.delays != "retimed"


def _schedule_figure(schedule: Schedule) -> Figure:
    """Of the first tile on which a pair is written, else of the first that is read."""
    from ohmloom.report.mapping_plot import plot_schedule

    driven = [s for s in schedule.slots if s.rows or s.columns]
    first = next((s.tile for s in driven if s.action == "write"), driven[0].tile if driven else 0)
    figure = plot_schedule(schedule, first).get_figure(root=True)
    assert figure is not None
    return figure


def _save_figure(figure: Figure, path: Path) -> None:
    picture = io.BytesIO()
    # Tight: bars beside axes of equal aspect may reach over the figure's edge.
    figure.savefig(picture, format="png", dpi=130, bbox_inches="tight", metadata={"Software": None})
    write_atomic(path, picture.getvalue())
