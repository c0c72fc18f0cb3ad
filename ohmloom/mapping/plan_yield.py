"""Yield of a plan: of every tile by formula and from samples, from the fault probabilities of the spec."""

from __future__ import annotations

import numpy as np

from ohmloom.errors import expect_type
from ohmloom.mapping.grid import PARTNER, REFERENCE, SYNAPSE, tile_grid
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.plan import Plan
from ohmloom.mapping.repair import BoolArray
from ohmloom.mapping.yield_ import Yield, sample_yield

FAULTS = ("stuck_on", "stuck_off", "forming")


def fault_probabilities(hardware: Hardware) -> tuple[float, float] | None:
    """Probability of a cell stuck on, and of one stuck off or never formed; None where the spec names none.

    A cell that is stuck on is that and nothing else.
    """
    found = [getattr(hardware.nonidealities, name) for name in FAULTS]
    on, off, forming = (0.0 if q is None else q.value for q in found)
    return (on, (1.0 - on) * (1.0 - (1.0 - off) * (1.0 - forming))) if on + off + forming > 0.0 else None


def needed_devices(plan: Plan, t: int) -> BoolArray:
    """Where a device of tile `t` must work, axes (row, column): its lines without the spare ones, references last."""
    tile = plan.tiles[t]
    cell = tile_grid(plan, t).cell[: len(tile.rows)]
    built = np.delete(cell, np.arange(len(tile.columns), len(tile.columns) + tile.spare_columns), axis=1)
    return np.isin(built, (SYNAPSE, PARTNER, REFERENCE))


def plan_yield(plan: Plan, *, dies: int = 400, rng: np.random.Generator) -> tuple[Yield, ...]:
    """Share of good dies of each tile, without and with repair on the tile's spare lines; empty without faults.

    Devices that must work are those of synapses, their partners in differential pairs, and references. Tiles are
    independent: a plan's yield is the product.

    Parameters
    ----------
    plan
        What is placed where.
    dies, rng
        Samples of each tile, and where they come from.

    Raises
    ------
    ParameterError
        If one of these is of another type.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import champion
    >>> plan_yield(place(champion("HP"), Hardware.load("hp_1t1r")), rng=np.random.default_rng(1))
    ()
    """
    expect_type("plan_yield.plan", plan, Plan)
    expect_type("plan_yield.rng", rng, np.random.Generator)
    faults = fault_probabilities(plan.hardware)
    if faults is None:
        return ()
    found = []
    for t, tile in enumerate(plan.tiles):
        found.append(sample_yield(
            needed_devices(plan, t), stuck_on=faults[0], stuck_off=faults[1],
            spare_rows=tile.spare_rows, spare_columns=tile.spare_columns, dies=dies, rng=rng,
        ))  # fmt: skip
    return tuple(found)
