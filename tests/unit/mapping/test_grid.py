"""The array of a tile: every crosspoint once, with what the plan and the spec say stands there."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import Hardware, Quantity, place, tile_crossbar, tile_deck, tile_grid, tile_netlist
from ohmloom.mapping.grid import DISABLED, FORBIDDEN, PARTNER, REFERENCE, SPARE, SYNAPSE, read_voltages
from ohmloom.neurocontroller import champion

HP, GA = champion("HP"), champion("GA")


def plan(network=HP, name="hp_1t1r", **array):
    hardware = Hardware.load(name)
    return place(network, hardware.model_copy(update={"array": hardware.array.model_copy(update=array)}))


def test_every_crosspoint_is_counted_once():
    placed = plan()
    grid, tile = tile_grid(placed, 0), placed.tiles[0]
    legal = sum((i, j) in set(HP.legal) for i in tile.rows for j in tile.columns)
    count = {what: int((grid.cell == what).sum()) for what in (SYNAPSE, DISABLED, FORBIDDEN)}
    assert count == {
        SYNAPSE: len(HP.synapses), DISABLED: legal - len(HP.synapses),
        FORBIDDEN: len(tile.rows) * len(tile.columns) - legal,
    }  # fmt: skip
    for point in placed.crosspoints:
        assert grid.synapse[point.row, point.column] == point.synapse
        assert grid.conductance[point.row, point.column] == point.conductance


def test_reference_and_spare_lines_stand_where_the_plan_says():
    placed = plan(GA, spare_rows=2, spare_columns=1)
    grid, tile = tile_grid(placed, 0), placed.tiles[0]
    m, n = len(tile.rows), len(tile.columns)
    assert grid.cell.shape == (m + 2, n + 2)
    assert (grid.cell[m:] == SPARE).all()
    assert (grid.cell[:, n] == SPARE).all()
    assert (grid.cell[:m, n + 1] == REFERENCE).all()
    assert (grid.row_polarity[m:] == 0).all()
    g_off = float(placed.hardware.devices["constant"].conductance(0.0))
    assert (grid.conductance[:m, n + 1] == g_off).all()


@pytest.mark.parametrize(
    ("array", "wanted"),
    [
        ({"disabled": "masked"}, 0.0),
        ({"disabled": "unformed"}, 0.0),
        ({"disabled": "unformed", "unformed_conductance": Quantity(value=1e-9, source="definition")}, 1e-9),
        ({"disabled": "present"}, 1e-6),  # G_off of hp_tio2_10k
    ],
)
def test_a_crosspoint_without_a_synapse_conducts_as_the_spec_says(array, wanted):
    grid = tile_grid(plan(**array), 0)
    assert np.unique(grid.conductance[grid.cell != SYNAPSE]) == pytest.approx([wanted])


def test_differential_pairs_have_a_partner_at_the_lowest_conductance_for_every_synapse():
    placed = plan(GA, signs="differential_pair", max_columns=7)
    assert len(placed.tiles) > 1
    partners = []
    for t, tile in enumerate(placed.tiles):
        grid = tile_grid(placed, t)
        for i, j in np.argwhere(grid.cell == PARTNER):
            synapse = GA.synapses[grid.synapse[i, j]]
            assert (tile.rows[i], tile.columns[j]) == (synapse.pre, synapse.post)
            assert tile.column_signs[j] == -GA.sign(synapse.pre)
            assert grid.conductance[i, j] == float(placed.hardware.devices["constant"].conductance(0.0))
            partners.append(int(grid.synapse[i, j]))
    assert sorted(partners) == list(range(len(GA.synapses)))


def test_read_polarity_is_the_senders_sign_only_where_the_row_carries_it():
    placed = plan()
    assert read_voltages(placed, 0) == pytest.approx([0.1 * HP.sign(pre) for pre in placed.tiles[0].rows])
    assert set(read_voltages(plan(signs="column_pair"), 0)) == {0.1}


@pytest.mark.parametrize("name", ["hp_1t1r", "hp_strukov"])
def test_the_netlist_reads_what_the_crossbar_reads(name):
    placed = plan(name=name)
    current = tile_crossbar(placed, 0).read(read_voltages(placed, 0)).current
    point = tile_netlist(placed, 0).dc()
    # Two solvers, both to about 1e-12 of the largest current.
    assert [point.i[f"S_{j}"] for j in range(len(current))] == pytest.approx(
        list(current), rel=1e-9, abs=1e-9 * abs(current).max()
    )


def test_the_deck_says_who_stands_on_which_line():
    text = tile_deck(plan(GA), 0)
    tile = plan(GA).tiles[0]
    assert f"* row 0: {GA.labels()[tile.rows[0]]}\n" in text
    assert f"* column {len(tile.columns)}: reference\n" in text
    assert text.endswith(".end\n")


def test_other_conductances_and_bad_tiles():
    g = np.linspace(1e-6, 1e-4, len(HP.synapses))
    placed = plan()
    grid = tile_grid(placed, 0, conductances=g)
    assert grid.conductance[placed.crosspoints[5].row, placed.crosspoints[5].column] == g[5]
    with pytest.raises(ParameterError, match=r"tile_grid\.tile: expected an integer from 0 to 0, got 1"):
        tile_grid(placed, 1)
    with pytest.raises(ParameterError, match=r"tile_grid\.conductances: expected axes \(synapse="):
        tile_grid(placed, 0, conductances=[1e-6])
