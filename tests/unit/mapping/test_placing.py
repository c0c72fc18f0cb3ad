"""Tiles, order of lines, signs and delays: what `place` makes of a spec's array."""

import numpy as np
import pytest

from ohmloom.errors import MappingError
from ohmloom.mapping import Hardware, Quantity, place
from ohmloom.mapping.placement import Wires, worst_read_error
from ohmloom.neurocontroller import Network, Readings, Synapse, champion

HP, GA = champion("HP"), champion("GA")


def spec(name="hp_1t1r", *, wires=None, limit=None, drive=None, **array):
    """A shipped spec with another array; `wires` in ohm per segment."""
    hardware = Hardware.load(name)
    changes = {"array": hardware.array.model_copy(update=array)}
    if wires is not None:
        q = Quantity(value=wires, source="definition")
        changes["wires"] = hardware.wires.model_copy(update={"r_row": q, "r_column": q})
    if limit is not None:
        changes["limits"] = hardware.limits.model_copy(
            update={"read_error": Quantity(value=limit, source="definition")}
        )
    if drive is not None:
        changes["drive"] = hardware.drive.model_copy(update=drive)
    return hardware.model_copy(update=changes)


def carried(plan):
    """Which synapse each crosspoint stands for: kind, sender, receiver."""
    found = []
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        found.append((tile.kind, tile.rows[point.row], tile.columns[point.column]))
    return found


def wanted(network):
    return [(s.kind, s.pre, s.post) for s in network.synapses]


def test_without_wires_lines_are_in_ascending_order():
    (tile,) = place(HP, spec(wires=0.0)).tiles
    assert tile.rows == tuple(sorted({s.pre for s in HP.synapses}))
    assert tile.columns == tuple(sorted({s.post for s in HP.synapses}))
    assert tile.read_error.given == tile.read_error.refined == 0.0


def test_wires_put_lines_in_the_order_of_the_least_error_and_the_plan_says_what_it_gains():
    plan = place(HP, spec(wires=1.06))
    (tile,) = plan.tiles
    errors = tile.read_error
    assert errors.refined < errors.sorted < errors.given
    assert tile.rows != tuple(sorted(tile.rows))
    # The error that the plan states, by the exact solution of the array it describes, to its six digits.
    g = np.zeros((len(tile.rows), len(tile.columns)))
    for point in plan.crosspoints:
        g[point.row, point.column] = float(plan.hardware.devices["hp"].conductance(1.0))
    assert worst_read_error(g, Wires(r_row=1.06, r_column=1.06)) == pytest.approx(errors.refined, rel=1e-5)
    assert errors.gain == pytest.approx(1.0 - errors.refined / errors.given)


def test_a_tile_stays_under_the_limit_of_the_read_error():
    plan = place(HP, spec(wires=1.06, limit=0.003))
    assert len(plan.tiles) > 1
    assert all(tile.read_error.built <= 0.003 for tile in plan.tiles)
    assert carried(plan) == wanted(HP)


def test_devices_that_no_size_of_tile_helps_stay_on_one():
    (tile,) = place(HP, Hardware.load("hp_strukov")).tiles
    assert tile.read_error.built > tile.read_error.limit


@pytest.mark.parametrize("signs", ["row_polarity", "column_pair", "differential_pair"])
@pytest.mark.parametrize(("rows", "columns"), [(4, 5), (64, 3), (1, 2)])
def test_arrays_too_small_for_a_network_become_several_and_no_synapse_is_dropped(signs, rows, columns):
    plan = place(GA, spec(wires=0.0, max_rows=rows, max_columns=columns, signs=signs))
    assert carried(plan) == wanted(GA)
    assert len({(p.tile, p.row, p.column) for p in plan.crosspoints}) == len(GA.synapses)
    for tile in plan.tiles:
        assert len(tile.rows) <= rows
        assert len(tile.columns) + tile.has_reference <= columns


def test_spare_lines_take_room_in_the_array():
    plan = place(HP, spec(wires=0.0, max_rows=9, max_columns=7, spare_rows=2, spare_columns=3))
    assert max(len(tile.rows) for tile in plan.tiles) <= 7
    assert max(len(tile.columns) for tile in plan.tiles) <= 4
    assert all((tile.spare_rows, tile.spare_columns) == (2, 3) for tile in plan.tiles)
    assert carried(plan) == wanted(HP)


def test_spare_lines_lengthen_the_wires():
    plain = place(HP, spec(wires=1.06)).tiles[0].read_error
    (spared,) = place(HP, spec(wires=1.06, limit=0.1, spare_rows=4)).tiles
    assert spared.read_error.built > spared.read_error.refined == plain.built == plain.refined
    # At the limit that one tile without spare lines keeps, there are more, so that each keeps it with them.
    assert all(tile.read_error.built <= plain.built for tile in place(HP, spec(
        wires=1.06, limit=plain.built, spare_rows=4)).tiles)  # fmt: skip


@pytest.mark.parametrize(
    ("array", "text"),
    [
        ({"max_rows": 2, "spare_rows": 2}, r"array\.max_rows: expected at least 3 for the constant tile"),
        ({"max_columns": 1}, r"array\.max_columns: expected at least 2 for the constant tile"),
    ],
)
def test_an_array_without_room_for_a_line_names_the_synapse(array, text):
    first = GA.synapses[0]
    with pytest.raises(MappingError, match=text + rf".*synapses\[0\] \({first.pre} -> {first.post}\) is the first"):
        place(GA, spec(**array))


def test_a_column_pair_takes_the_sign_from_the_line():
    plan = place(HP, spec(signs="column_pair"))
    for point, synapse in zip(plan.crosspoints, HP.synapses, strict=True):
        assert plan.tiles[point.tile].column_signs[point.column] == point.polarity == HP.sign(synapse.pre)
    assert not any(tile.is_differential for tile in plan.tiles)


def test_a_differential_pair_has_a_second_line_for_every_synapse():
    plan = place(GA, spec(signs="differential_pair", wires=0.0))
    (tile,) = plan.tiles
    assert tile.is_differential
    assert not tile.has_reference
    lines = set(zip(tile.columns, tile.column_signs, strict=True))
    for point, synapse in zip(plan.crosspoints, GA.synapses, strict=True):
        assert tile.column_signs[point.column] == GA.sign(synapse.pre)
        assert (synapse.post, -tile.column_signs[point.column]) in lines


def test_memristive_differential_pairs_start_at_the_weight_that_is_left_after_subtraction():
    plan = place(HP, spec(signs="differential_pair"))
    device = plan.hardware.devices["hp"]
    g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
    for point, synapse in zip(plan.crosspoints, HP.synapses, strict=True):
        # Rounding of the state, which the law's slope of 49 amplifies.
        assert (point.conductance - g_off) / (g_on - g_off) == pytest.approx(synapse.weight, rel=1e-12)


def test_skewed_clocks_need_no_taps():
    assert {point.tap for point in place(HP, spec(delays="retimed")).crosspoints} == {0}


@pytest.mark.parametrize("readings", [Readings(lateral="both"), Readings(hidden_delay="one")])
def test_skewed_clocks_give_only_delays_by_index(readings):
    network = Network(system="HP", hidden=("excitatory",) * 2, synapses=(Synapse(7, 6, "hp", 0.5),), readings=readings)
    with pytest.raises(
        MappingError, match=r"readings\.(lateral|hidden_delay): expected .* with array\.delays = 'retimed'"
    ):
        place(network, spec(delays="retimed"))


def test_a_driver_that_cannot_carry_a_pulse_is_named():
    weak = {"compliance_current": Quantity(value=5e-5, source="definition")}
    text = r"drive\.compliance_current: expected at least 0\.0001 A, which a pulse puts on hp_tio2_10k .*, got 5e-05 A"
    with pytest.raises(MappingError, match=text):
        place(HP, spec(drive=weak))
    place(GA, spec(drive=weak))  # programmed devices get no pulse
