"""Placement: every synapse on one device of its kind, and what does not fit is named."""

import json
import re

import numpy as np
import pytest

from ohmloom.errors import FileFormatError, MappingError, ParameterError
from ohmloom.mapping import Hardware, Plan, place
from ohmloom.neurocontroller import Network, Readings, Synapse

HET = Network.random(system="HET", rng=np.random.default_rng(3))


def tiny(**changes):
    network = Network(
        system="GA", hidden=("excitatory", "inhibitory"),
        synapses=(Synapse(0, 6, "constant", 0.25), Synapse(7, 6, "constant", 1.0), Synapse(7, 8, "constant", 0.0)),
    )  # fmt: skip
    return network.replace(**changes)


def test_every_synapse_has_one_crosspoint_of_its_own():
    plan = place(HET, Hardware.load("het_mixed"))
    assert [point.synapse for point in plan.crosspoints] == list(range(len(HET.synapses)))
    cells = {(point.tile, point.row, point.column) for point in plan.crosspoints}
    assert len(cells) == len(HET.synapses)
    for point in plan.crosspoints:
        synapse, tile = HET.synapses[point.synapse], plan.tiles[point.tile]
        assert (tile.kind, tile.rows[point.row], tile.columns[point.column]) == (
            synapse.kind,
            synapse.pre,
            synapse.post,
        )


def test_sign_delay_and_conductance_of_a_hand_made_network():
    plan = place(tiny(), Hardware.load("het_mixed"))
    first, lateral, last = plan.crosspoints
    assert (first.polarity, first.tap) == (1, 1)
    assert (lateral.polarity, lateral.tap) == (-1, 1)
    # The linear card runs from 1 uS to 100 uS, and constant weights are read against a reference at G_off.
    assert first.conductance == pytest.approx(1e-6 + 0.25 * 99e-6, rel=1e-12)
    assert lateral.conductance == pytest.approx(100e-6, rel=1e-12)
    assert last.conductance == pytest.approx(1e-6, rel=1e-12)
    assert plan.tiles[0].has_reference


def test_lateral_delay_becomes_the_tap():
    network = Network(
        system="HP", hidden=("excitatory",) * 4, synapses=(Synapse(9, 6, "hp", 0.5), Synapse(9, 8, "hp", 0.5))
    )
    assert [point.tap for point in place(network, Hardware.load("hp_1t1r")).crosspoints] == [3, 1]


def test_memristive_devices_start_at_half_of_g_on():
    plan = place(HET, Hardware.load("het_mixed"))
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        device = plan.hardware.devices[tile.kind]
        g_on = float(device.conductance(1.0))
        wanted = (g_on + float(device.conductance(0.0))) / 2 if tile.has_reference else g_on / 2
        assert point.conductance == pytest.approx(wanted, rel=1e-9)


def test_kind_without_a_card_names_kind_and_synapse():
    with pytest.raises(MappingError) as caught:
        place(HET, Hardware.load("hp_1t1r"))
    first = next(k for k, s in enumerate(HET.synapses) if s.kind == "peo_pani")
    assert "hp_1t1r: cards.peo_pani: expected a device card, got none" in str(caught.value)
    assert f"first synapses[{first}]" in str(caught.value)
    assert len(caught.value.problems) == 2


def test_weight_at_emission_cannot_be_built():
    with pytest.raises(MappingError, match=r"readings\.weight_at: expected 'arrival', got 'emission'"):
        place(tiny(readings=Readings(weight_at="emission")), Hardware.load("het_mixed"))


def test_network_without_synapses_has_no_tiles():
    assert place(tiny(synapses=()), Hardware.load("het_mixed")).tiles == ()


def test_save_and_load(tmp_path):
    plan = place(HET, Hardware.load("het_mixed"))
    plan.save(tmp_path / "plan.json")
    assert Plan.load(tmp_path / "plan.json").to_json() == plan.to_json()


def test_altered_plan_is_refused(tmp_path):
    plan = place(HET, Hardware.load("het_mixed"))
    path = tmp_path / "plan.json"
    path.write_text(plan.to_json().replace('"tap": 1', '"tap": 2', 1))
    with pytest.raises(FileFormatError, match=r"plan\.json: crosspoints: expected what this network and hardware give"):
        Plan.load(path)


def forget_a_row(tile):
    tile["rows"].pop()


def repeat_a_column(tile):
    tile["columns"][1] = tile["columns"][0]


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (forget_a_row, "expected one crosspoint"),
        (repeat_a_column, "tiles[0].columns"),
        (lambda tile: tile.update(card="peo_pani"), "tiles[0].card"),
        (lambda tile: tile.update(has_reference=True), "tiles[0].has_reference"),
        (lambda tile: tile.update(spare_rows=1), "tiles[0].spare"),
        (lambda tile: tile.update(rows="everywhere"), "invalid literal"),
    ],
)
def test_a_plan_whose_tiles_do_not_carry_its_network_is_refused(tmp_path, change, name):
    table = json.loads(place(HET, Hardware.load("het_mixed")).to_json())
    change(table["tiles"][0])
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(table))
    with pytest.raises(FileFormatError, match=rf"plan\.json: tiles: .*{re.escape(name)}"):
        Plan.load(path)


def test_a_plan_with_other_places_of_its_lines_is_a_plan(tmp_path):
    """Another machine may find another order of lines; what is built is what the file says."""
    table = json.loads(place(HET, Hardware.load("het_mixed")).to_json())
    tile, last = table["tiles"][0], len(table["tiles"][0]["rows"]) - 1
    tile["rows"].reverse()
    for point in table["crosspoints"]:
        point["row"] = last - point["row"] if point["tile"] == 0 else point["row"]
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(table))
    assert list(Plan.load(path).tiles[0].rows) == tile["rows"]


def test_table_names_the_units():
    row = place(tiny(), Hardware.load("het_mixed")).table()[1]
    assert (row["sender"], row["receiver"]) == ("hidden 1 (-)", "hidden 0 (+)")
    assert {"conductance_S", "tap_steps"} <= set(row)


def test_a_plan_with_another_key_is_refused(tmp_path):
    path = tmp_path / "plan.json"
    path.write_text(place(tiny(), Hardware.load("het_mixed")).to_json().replace('"tiles":', '"note": 1,\n "tiles":', 1))
    with pytest.raises(FileFormatError, match=r"plan\.json: note: expected no such key, got 1\. "):
        Plan.load(path)


@pytest.mark.parametrize("path", [None, 5, b"x"])
def test_what_is_no_path(path):
    with pytest.raises(ParameterError, match=r"^plan file: expected a path, got "):
        Plan.load(path)


@pytest.mark.parametrize("value", [-1, 1.5, "a", None, True])
@pytest.mark.parametrize("name", ["seed", "die"])
def test_seed_and_die_are_integers_from_0(name, value):
    with pytest.raises(ParameterError, match=rf"^Plan\.sample\.{name}: expected an integer >= 0, got "):
        place(tiny(), Hardware.load("het_mixed")).sample(**({"seed": 1} | {name: value}))


def test_placing_wants_a_network_and_hardware():
    with pytest.raises(ParameterError, match=r"^place\.network: expected Network, got None\."):
        place(None, Hardware.load("het_mixed"))
    with pytest.raises(ParameterError, match=r"^place\.hardware: expected Hardware, got 'het_mixed'\."):
        place(tiny(), "het_mixed")


def test_the_gain_of_a_tile_makes_a_full_synapse_count_as_one():
    plan = place(HET, Hardware.load("het_mixed"))
    for t, tile in enumerate(plan.tiles):
        device = plan.hardware.devices[tile.kind]
        full = 0.1 * (float(device.conductance(1.0)) - (float(device.conductance(0.0)) if tile.has_reference else 0.0))
        assert plan.tile_gain(t) * full == pytest.approx(1.0, rel=1e-14)
