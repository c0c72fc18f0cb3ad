"""Crossbar maps of the report: conductance, IR drop and pulses of every device, the values under the pointer, and the
worst devices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from markupsafe import Markup

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.mapping import Plan, tile_grid
from ohmloom.mapping.grid import CELLS, PARTNER, SYNAPSE
from ohmloom.mapping.placement import Wires, read_errors
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.report._page_run import DieRun
from ohmloom.report._page_svg import figure_of, page_svg
from ohmloom.report._page_words import percent
from ohmloom.report._replay_data import KINDS
from ohmloom.report.crossbar_plot import REFERENCE_GAP, plot_tile, plot_tile_values
from ohmloom.sim import Agreement, Feasibility
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = tuple[str, Markup]  # caption, SVG
WORST: Final = 10
MARKED: Final = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class DeviceValues:
    """What is known of every device, axes (synapse,); None where nothing was sampled.

    Attributes
    ----------
    error
        Share of the read voltage that the device does not see: all rows read, plastic devices at G_on.
    weight, conductance
        As programmed, [1] and [S].
    ideal
        Weight of the ideal network after its trial.
    end_weight, end_conductance, pulses
        Of the sampled die after its trial; without one, of hardware without spread.
    end_name
        Which of the two.
    """

    error: FloatArray
    weight: FloatArray
    conductance: FloatArray
    ideal: FloatArray | None
    end_weight: FloatArray | None
    end_conductance: FloatArray | None
    pulses: IntArray | None
    end_name: str


def device_values(study: Feasibility, run: DieRun | None) -> DeviceValues | None:
    """Gather them; None in a study that was loaded."""
    plan, agreement = study.plan, study.agreement
    if plan is None:
        return None
    n = len(plan.crosspoints)
    conductance = np.zeros(n)
    for point in plan.crosspoints:
        conductance[point.synapse] = point.conductance
    end_weight = end_conductance = None
    if run is not None:
        end_weight, end_conductance = run.weights, run.conductances
    elif agreement is not None:
        end_weight, end_conductance = agreement.emulated_weights[-1], end_conductances(plan, agreement)
    return DeviceValues(
        error=device_errors(plan), weight=np.array([s.weight for s in plan.network.synapses]), conductance=conductance,
        ideal=None if agreement is None else agreement.weights[-1], end_weight=end_weight,
        end_conductance=end_conductance, pulses=None if run is None else run.pulses,
        end_name="without spread" if run is None else f"die {run.die}",
    )  # fmt: skip


def device_errors(plan: Plan) -> FloatArray:
    """Read error of every device, axes (synapse,); the largest is the figure `read_error`, to six digits."""
    errors = np.zeros(len(plan.crosspoints))
    highest = np.zeros(len(plan.crosspoints))
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        is_plastic = tile.kind in PLASTIC_KINDS
        device = plan.hardware.devices[tile.kind]
        highest[point.synapse] = float(device.conductance(1.0)) if is_plastic else point.conductance
    for k in range(len(plan.tiles)):
        grid = tile_grid(plan, k, conductances=highest)
        of_tile = read_errors(grid.conductance, Wires(**plan.hardware.wires.resistances))
        here = grid.cell == SYNAPSE
        errors[grid.synapse[here]] = of_tile[here]
    return errors


def end_conductances(plan: Plan, agreement: Agreement) -> FloatArray:
    """Conductances at the end of the emulated trial, (synapse,) [S]: G = W (G_on - reference) + reference."""
    last = agreement.emulated_weights[-1]
    values = np.empty(len(last))
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        device = plan.hardware.devices[tile.kind]
        reference = float(device.conductance(0.0)) if tile.subtracts_off else 0.0
        values[point.synapse] = last[point.synapse] * (float(device.conductance(1.0)) - reference) + reference
    return values


def tiles(study: Feasibility, known: DeviceValues | None) -> list[tuple[str, str, list[Picture]]]:
    """For each tile its name, the colour of its kind, and its maps."""
    plan = study.plan
    if plan is None or known is None:
        return []
    found = []
    for k, tile in enumerate(plan.tiles):
        name = f"{tile.kind} tile" + (f" {k}" if sum(t.kind == tile.kind for t in plan.tiles) > 1 else "")
        pictures = [
            (caption, page_svg(draw, f"tile{k}-{key}", f"{name}: {caption}", map_index=k))
            for key, caption, draw in tile_views(plan, k, known)
        ]
        found.append((name, KINDS[tile.kind], pictures))
    return found


def tile_views(plan: Plan, index: int, known: DeviceValues) -> list[tuple[str, str, Callable[[], Figure]]]:
    """Key, caption and drawing of each map of a tile."""
    here = [point.synapse for point in plan.crosspoints if point.tile == index]
    views: list[tuple[str, str, Callable[[], Figure]]] = [
        ("programmed", "Conductance as programmed", partial(_conductance, plan, index, None))
    ]
    if known.end_conductance is not None:
        views.append(("after", f"Conductance after one trial, {known.end_name}",
                      partial(_conductance, plan, index, known.end_conductance)))  # fmt: skip
    for key, values, caption, label, unit in (
        ("drop", known.error, "Read error by IR drop, all rows read at once, plastic devices at G_on; the worst framed",
         "share of the read voltage lost", "%"),
        ("pulses", known.pulses, f"Write pulses in one trial, {known.end_name}; the busiest framed", "pulses",
         "pulses"),
    ):  # fmt: skip
        if values is not None and values[here].any():
            draw = partial(_values, plan, index, np.asarray(values, dtype=float), label, unit)
            views.append((key, caption, draw))
    return views


def hover(study: Feasibility, known: DeviceValues | None) -> list[dict[str, Any]]:
    """For each tile: where its columns stand, names of the values, and (row, column, title, values) of each cell."""
    plan = study.plan
    if plan is None or known is None:
        return []
    rows = device_rows(plan, known)
    found = []
    for k, tile in enumerate(plan.tiles):
        grid = tile_grid(plan, k)
        columns = [float(j) for j in range(grid.cell.shape[1])]
        if tile.has_reference:
            columns[-1] += REFERENCE_GAP
        cells: list[list[Any]] = []
        for i, j in np.ndindex(grid.cell.shape):
            what = int(grid.cell[i, j])
            if what == SYNAPSE:
                row = rows[int(grid.synapse[i, j])]
                cells.append([i, j, row["synapse"], list(row.values())[1:]])
            else:
                words = CELLS[what]
                if what == PARTNER:
                    words += f" ({rows[int(grid.synapse[i, j])]['synapse']})"
                cells.append([i, j, words, []])
        found.append({"x": columns, "keys": list(rows[0])[1:] if rows else [], "cells": cells})
    return found


def device_rows(plan: Plan, known: DeviceValues) -> list[dict[str, str]]:
    """What is known of each device, in words, in the network's order; the first entry names the synapse."""
    labels = plan.network.labels()
    rows = []
    for point in sorted(plan.crosspoints, key=lambda p: p.synapse):
        k, tile, synapse = point.synapse, plan.tiles[point.tile], plan.network.synapses[point.synapse]
        row = {
            "synapse": f"{labels[synapse.pre]} → {labels[synapse.post]}",
            "kind, card": f"{tile.kind}, {tile.card}",
            "place": f"tile {point.tile}, row {point.row}, column {point.column}",
            "sign, delay": f"{'−' if point.polarity < 0 else '+'}, {max(point.tap, 1)} "
                           f"step{'s' if point.tap > 1 else ''}",
            "weight W, programmed": f"{known.weight[k]:.3f}",
            "conductance, programmed": format_quantity(known.conductance[k], "S"),
        }  # fmt: skip
        if known.ideal is not None:
            row["W after a trial, ideal"] = f"{known.ideal[k]:.3f}"
        if known.end_weight is not None and known.end_conductance is not None:
            row[f"W after a trial, {known.end_name}"] = f"{known.end_weight[k]:.3f}"
            row[f"conductance after it, {known.end_name}"] = format_quantity(known.end_conductance[k], "S")
        row["read error"] = percent(known.error[k])
        if known.pulses is not None:
            row["write pulses in a trial"] = f"{known.pulses[k]:,}"
        rows.append(row)
    return rows


def worst_rows(study: Feasibility, known: DeviceValues | None) -> list[dict[str, Any]]:
    """The devices that lose most of the read voltage and those that are pulsed most; text and number of each column."""
    plan = study.plan
    if plan is None or known is None or not plan.crosspoints:
        return []
    pulses = np.zeros(len(known.error), dtype=np.int64) if known.pulses is None else known.pulses
    chosen = sorted({*_largest(known.error, WORST // 2), *_largest(pulses, WORST // 2)})
    names = device_rows(plan, known)
    return [
        {
            "synapse": names[k]["synapse"], "kind": plan.network.synapses[k].kind, "place": names[k]["place"],
            "error": (percent(known.error[k]), float(known.error[k])),
            "pulses": None if known.pulses is None else (f"{pulses[k]:,}", int(pulses[k])),
            "weight": None if known.end_weight is None else (f"{known.end_weight[k]:.3f}", float(known.end_weight[k])),
        }
        for k in sorted(chosen, key=lambda k: (-known.error[k], -pulses[k], k))
    ]  # fmt: skip


def _largest(values: Any, count: int) -> tuple[int, ...]:
    """Indices of the largest values above 0; of equal ones the first."""
    order = sorted(range(len(values)), key=lambda k: (-values[k], k))
    return tuple(k for k in order[:count] if values[k] > 0)


def _conductance(plan: Plan, index: int, conductances: FloatArray | None) -> Figure:
    return figure_of(plot_tile(plan, index, conductances=conductances))


def _values(plan: Plan, index: int, values: FloatArray, label: str, unit: str) -> Figure:
    here = np.zeros(len(values))
    for point in plan.crosspoints:
        if point.tile == index:
            here[point.synapse] = values[point.synapse]
    marked = _largest(here, MARKED)
    return figure_of(plot_tile_values(plan, index, values, label=label, unit=unit, marked=marked))
