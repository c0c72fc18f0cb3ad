"""Yield of a plan: which devices must work, and the formula against the samples."""

import numpy as np
import pytest

from ohmloom.mapping import Hardware, Quantity, place, plan_yield
from ohmloom.mapping.plan_yield import fault_probabilities
from ohmloom.neurocontroller import champion

GA = champion("GA")


def plan(faults, **array):
    hardware = Hardware.load("hp_1t1r")
    quantities = {name: Quantity(value=value, source="definition") for name, value in faults.items()}
    return place(GA, hardware.model_copy(update={
        "nonidealities": hardware.nonidealities.model_copy(update=quantities),
        "array": hardware.array.model_copy(update=array),
    }))  # fmt: skip


def test_synapses_and_references_must_work_and_no_other_cell_may_be_stuck_on():
    placed = plan({"stuck_on": 0.001, "stuck_off": 0.002})
    (found,) = plan_yield(placed, dies=1, rng=np.random.default_rng(1))
    tile = placed.tiles[0]
    enabled = len(GA.synapses) + len(tile.rows)
    cells = len(tile.rows) * (len(tile.columns) + 1)
    off = 0.999 * 0.002
    assert found.formula == pytest.approx((1 - 0.001 - off) ** enabled * 0.999 ** (cells - enabled), rel=1e-12)


def test_the_formula_lies_in_the_interval_of_the_samples_and_spare_lines_help():
    (plain,) = plan_yield(plan({"stuck_off": 0.005}), dies=300, rng=np.random.default_rng(2))
    (spared,) = plan_yield(
        plan({"stuck_off": 0.005}, spare_rows=1, spare_columns=1), dies=100, rng=np.random.default_rng(2)
    )
    low, high = plain.plain_interval
    assert low < plain.formula < high
    assert spared.repaired > plain.plain


def test_an_unformed_cell_is_one_that_is_stuck_off():
    hardware = plan({"stuck_on": 0.1, "stuck_off": 0.2, "forming": 0.5}).hardware
    assert fault_probabilities(hardware) == pytest.approx((0.1, 0.9 * (1 - 0.8 * 0.5)))
    assert fault_probabilities(Hardware.load("hp_1t1r")) is None
