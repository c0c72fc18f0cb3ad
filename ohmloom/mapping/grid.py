"""The physical array of a tile: every crosspoint with what stands on it, as a crossbar, a netlist and a SPICE deck."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray, frozen_array
from ohmloom.circuits import Crossbar, Netlist, crossbar_netlist
from ohmloom.circuits.spice import deck
from ohmloom.errors import expect_integer, expect_type
from ohmloom.mapping.plan import Plan

# What stands on a crosspoint.
SYNAPSE, PARTNER, REFERENCE, DISABLED, FORBIDDEN, SPARE = range(6)
CELLS: Final = {
    SYNAPSE: "a synapse", PARTNER: "second device of a differential pair, at G_off",
    REFERENCE: "reference, at G_off", DISABLED: "no synapse here, though one could be",
    FORBIDDEN: "no synapse may be here", SPARE: "spare line",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """One tile as it is built.

    Lines are those of the tile, then its spare rows; its columns, then spare columns, then the reference.

    Attributes
    ----------
    conductance
        S, axes (word_line, bit_line); 0 where nothing conducts.
    cell
        What stands there, a key of `CELLS`, the same axes.
    synapse
        Index of the synapse, or -1, the same axes.
    row_polarity
        Sign of each row's read voltage, axes (word_line,); 0 for a spare row.
    """

    conductance: FloatArray
    cell: IntArray
    synapse: IntArray
    row_polarity: IntArray

    def __post_init__(self) -> None:
        axes = ("word_line", "bit_line")
        object.__setattr__(self, "conductance", frozen_array("Grid.conductance", self.conductance, axes))
        for name in ("cell", "synapse"):
            object.__setattr__(self, name, frozen_array(f"Grid.{name}", getattr(self, name), axes, dtype=np.int64))
        polarity = frozen_array("Grid.row_polarity", self.row_polarity, ("word_line",), dtype=np.int64)
        object.__setattr__(self, "row_polarity", polarity)


def tile_grid(plan: Plan, tile: int, *, conductances: npt.ArrayLike | None = None) -> Grid:
    """The array of a tile, at the plan's initial conductances or at others.

    A crosspoint without a synapse conducts as `array.disabled` says: nothing behind a closed transistor, what an
    unformed cell conducts, or G_off where a device is present.

    Parameters
    ----------
    plan, tile
        What is placed where, and the index of the tile.
    conductances
        Axes (synapse,), in the network's order [S].

    Raises
    ------
    ParameterError
        If `plan` is no Plan, there is no such tile, or the conductances are not one per synapse.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import champion
    >>> tile_grid(place(champion("GA"), Hardware.load("hp_1t1r")), 0).conductance.shape
    (18, 16)
    """
    expect_type("tile_grid.plan", plan, Plan)
    tile = expect_integer("tile_grid.tile", tile, 0, len(plan.tiles) - 1)
    made, network, array = plan.tiles[tile], plan.network, plan.hardware.array
    given = [p.conductance for p in plan.crosspoints] if conductances is None else conductances
    values = frozen_array("tile_grid.conductances", given, (f"synapse={len(plan.crosspoints)}",))
    g_off = float(plan.hardware.devices[made.kind].conductance(0.0))
    m, n = len(made.rows), len(made.columns)
    shape = (m + made.spare_rows, n + made.spare_columns + made.has_reference)
    cell, synapse = np.full(shape, SPARE), np.full(shape, -1)
    legal = set(network.legal)
    for i, pre in enumerate(made.rows):
        for j, (post, sign) in enumerate(zip(made.columns, made.column_signs, strict=True)):
            is_here = array.signs == "row_polarity" or sign == network.sign(pre)
            cell[i, j] = DISABLED if (pre, post) in legal and is_here else FORBIDDEN
    if made.has_reference:
        cell[:m, -1] = REFERENCE
    empty = {
        "masked": 0.0,
        "unformed": 0.0 if array.unformed_conductance is None else array.unformed_conductance.value,
        "present": g_off,
    }
    g = np.full(shape, empty[array.disabled])
    g[cell == REFERENCE] = g_off
    for point in plan.crosspoints:
        pre, post = network.synapses[point.synapse].pre, network.synapses[point.synapse].post
        if point.tile == tile:
            cell[point.row, point.column] = SYNAPSE
            synapse[point.row, point.column] = point.synapse
            g[point.row, point.column] = values[point.synapse]
        elif not (made.is_differential and plan.tiles[point.tile].kind == made.kind):
            continue
        if made.is_differential:
            partner = (post, -plan.tiles[point.tile].column_signs[point.column])
            lines = list(zip(made.columns, made.column_signs, strict=True))
            if pre in made.rows and partner in lines:
                place = made.rows.index(pre), lines.index(partner)
                cell[place], synapse[place], g[place] = PARTNER, point.synapse, g_off
    signs = [int(network.sign(pre)) if array.signs == "row_polarity" else 1 for pre in made.rows]
    return Grid(conductance=g, cell=cell, synapse=synapse, row_polarity=np.array([*signs, *[0] * made.spare_rows]))


def tile_crossbar(plan: Plan, tile: int, *, conductances: npt.ArrayLike | None = None) -> Crossbar:
    """The same as a `Crossbar` with the spec's wires, drivers and senses.

    Raises
    ------
    ParameterError
        As `tile_grid`.
    """
    grid = tile_grid(plan, tile, conductances=conductances)
    wires = plan.hardware.wires.resistances
    return Crossbar(
        conductance=grid.conductance, r_row=wires["r_row"], r_column=wires["r_column"],
        r_driver=wires["r_driver"], r_sense=wires["r_sense"],
    )  # fmt: skip


def read_voltages(plan: Plan, tile: int) -> FloatArray:
    """Voltage of every row while all senders spike, axes (word_line,) [V]: the read voltage with the sender's sign."""
    polarity = tile_grid(plan, tile).row_polarity.astype(np.float64)
    return polarity * plan.hardware.read.voltage.value


def tile_netlist(plan: Plan, tile: int) -> Netlist:
    """A read of a tile with all senders spiking, as a netlist of resistors; names are those of `crossbar_netlist`.

    Raises
    ------
    ParameterError
        As `tile_grid`.
    """
    netlist = crossbar_netlist(tile_crossbar(plan, tile), read_voltages(plan, tile))
    return replace(netlist, name=f"tile_{tile}_read")


def tile_deck(plan: Plan, tile: int) -> str:
    """The same for ngspice, an operating point, with comments that say which neuron stands on which line.

    Raises
    ------
    ParameterError
        As `tile_grid`.
    """
    first, rest = deck(tile_netlist(plan, tile)).split("\n", 1)
    made, labels = plan.tiles[tile], plan.network.labels()
    notes = [
        f"* {plan.network.name} on {plan.hardware.name}, tile {tile}",
        f"* {made.kind} devices of the card {made.card}, at the start of a trial; every sender spikes",
        "* row i is driven by V_i through P_i; the current of column j is that into its sense S_j",
        *(f"* row {i}: {labels[pre]}" for i, pre in enumerate(made.rows)),
        *(
            f"* column {j}: {labels[post]}, counted {'+' if sign > 0 else '-'}"
            for j, (post, sign) in enumerate(zip(made.columns, made.column_signs, strict=True))
        ),
    ]
    notes += [f"* column {len(made.columns) + made.spare_columns}: reference"] if made.has_reference else []
    return "\n".join([first, *notes, rest])
