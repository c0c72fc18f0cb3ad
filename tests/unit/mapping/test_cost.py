"""Cost: counts by hand, each with the spec's number and source, and what has none is named."""

import csv

import numpy as np
import pytest

from ohmloom.mapping import Hardware, Quantity, place, plan_cost, pulse_schedule
from ohmloom.mapping.cost import AREA, ENERGY, TIME, register_bits
from ohmloom.mapping.spec import ConverterSpec
from ohmloom.neurocontroller import Network, Synapse, champion

SMALL = Network(
    system="HP", hidden=("excitatory", "excitatory", "excitatory", "inhibitory"),
    synapses=(Synapse(0, 6, "hp", 0.5), Synapse(9, 6, "hp", 0.5), Synapse(6, 10, "hp", 0.5)),
)  # fmt: skip


def plan(name="hp_1t1r", network=SMALL, **sections):
    hardware = Hardware.load(name)
    changes = {key: getattr(hardware, key).model_copy(update=value) for key, value in sections.items()}
    return place(network, hardware.model_copy(update=changes))


def history(*pairs):
    found = np.zeros((21, SMALL.neurons), dtype=bool)
    for step, neuron in pairs:
        found[step, neuron] = True
    return found


def items(cost, group):
    return {line.item: line for line in cost.lines if line.group == group}


def test_area_of_a_small_tile_by_hand():
    found = items(plan_cost(plan(array={"spare_rows": 1, "spare_columns": 2})), AREA)
    # 3 senders and 2 receivers, with one and two spare lines: 4 rows, 4 columns.
    assert {name: line.count for name, line in found.items()} == {
        "crosspoints": 16, "drivers of rows and columns": 8, "neurons": 12,
        "bits of shift registers": 1 + 1 + 3 + 3,  # inputs and outputs one step, hidden 3 to hidden 0 three; spare: 3
    }  # fmt: skip
    assert found["crosspoints"].total == pytest.approx(16 * 16 * (40e-9) ** 2)
    assert "NeuroSim" in found["crosspoints"].source


def test_energy_of_a_timestep_by_hand():
    """Input 0 spikes in step 2, hidden 0 in step 3: two rows read once, one event up."""
    placed = plan()
    cost = plan_cost(placed, pulse_schedule(placed, history((2, 0), (3, 6))))
    found = items(cost, ENERGY)
    g = placed.crosspoints[0].conductance
    after = 1.0 / (1.0 / g - 990.0)  # of hidden 0's own device nothing changes; that of input 0 is read before
    assert after > g
    assert found["reads, in the devices"].total == pytest.approx(2 * 0.01 * g * 100e-9)
    assert found["programming pulses, in the devices"].total == pytest.approx(0.99e-9 * 1.0)
    assert (found["driven lines"].count, found["spikes of neurons"].count) == (2 + 2, 2)
    assert found["shifted bits"].count == 21 * register_bits(placed) == 21 * 5
    assert cost.total(ENERGY) == pytest.approx(sum(line.total for line in found.values()))


def test_a_short_history_counts_as_a_whole_timestep():
    placed = plan()
    whole = plan_cost(placed, pulse_schedule(placed, history((2, 0), (3, 6))))
    third = plan_cost(placed, pulse_schedule(placed, history((2, 0), (3, 6))[:7]))
    for name, line in items(whole, ENERGY).items():
        share = 1.0 if name in ("shifted bits", "reads, in the senses") else 3.0
        assert items(third, ENERGY)[name].total == pytest.approx(share * line.total)


@pytest.mark.parametrize(("spec", "columns"), [("hp_1t1r", "read"), ("hp_passive", "all")])
def test_a_selected_column_alone_takes_current_and_its_reference(spec, columns):
    """Input 0 and its two programmed devices; without transistors each read drives both, and the reference, twice."""
    network = Network(system="GA", hidden=("excitatory",) * 2,
                      synapses=(Synapse(0, 6, "constant", 0.5), Synapse(0, 7, "constant", 1.0)))  # fmt: skip
    placed = plan(spec, network)
    spikes = np.zeros((21, network.neurons), dtype=bool)
    spikes[2, 0] = True
    found = items(plan_cost(placed, pulse_schedule(placed, spikes)), ENERGY)["reads, in the devices"].total
    a, b, off = 50.5e-6, 100e-6, 1e-6
    wanted = {"read": a + off + b + off, "all": 2 * (a + b + off)}[columns]
    assert found == pytest.approx(0.01 * 100e-9 * wanted)


def test_half_selected_devices_are_counted_where_all_lines_are_driven():
    placed = plan("hp_passive")
    cost = plan_cost(placed, pulse_schedule(placed, history((2, 0), (3, 6))))
    line = items(cost, ENERGY)["half-selected devices"]
    g, pulse = placed.crosspoints[0].conductance, 0.99e-9 * 20e3
    assert line.count == 3
    # Half a volt on: 0 -> 6 in step 2; the two others in step 3, the event's; all three in step 4, the tails'.
    # A volt for that long takes q to where M^2 is smaller by 2 (R_off - R_on)/q_d times the flux.
    after = 1.0 / np.sqrt(1.0 / g**2 - 2.0 * 990e3 / 0.99e-6 * pulse)
    assert line.total == pytest.approx(pulse * 0.25 * (g + 2 * g + 2 * g + after), rel=1e-6)


def test_time_of_a_step_is_reads_one_after_the_other_and_the_longest_programming():
    placed = plan()
    found = items(plan_cost(placed, pulse_schedule(placed, history((2, 0), (3, 6)))), TIME)
    assert found["reads of columns, one after the other"].total == pytest.approx(2 * 100e-9)
    assert found["programming"].total == pytest.approx(0.99e-9 * (20e3 - 990.0 / 2), rel=1e-6)


def test_what_the_spec_does_not_give_is_named():
    cost = plan_cost(plan(periphery={"driver_area": None}))
    assert "area of drivers of rows and columns: the spec has no periphery.driver_area" in cost.not_counted
    assert "drivers of rows and columns" not in items(cost, AREA)
    assert any("control logic" in text for text in cost.not_counted)


def test_converters_are_counted_where_the_spec_has_them():
    assert "conversions" not in items(plan_cost(plan()), ENERGY)
    energy, duration = Quantity(value=2e-12, source="a data sheet"), Quantity(value=1e-9, source="a data sheet")
    hardware = Hardware.load("hp_1t1r").model_copy(
        update={"converter": ConverterSpec(energy=energy, duration=duration)}
    )
    cost = plan_cost(place(SMALL, hardware))
    assert items(cost, ENERGY)["conversions"].total == pytest.approx(21 * 2 * 2e-12)
    assert items(cost, TIME)["conversions"].total == pytest.approx(2e-9)
    assert "area of converters of columns: the spec has no converter.area" in cost.not_counted


def test_ways_to_carry_signs_stand_side_by_side():
    polarity, pair, differential = plan_cost(plan()).signs
    assert (polarity.devices, pair.devices, differential.devices) == (3, 3, 6)
    # Receiver 6 has senders of both signs, receiver 10 of one; a differential pair has two lines for each.
    assert (polarity.lines, pair.lines, differential.lines) == (3 + 2, 3 + 3, 3 + 4)
    assert polarity.area < pair.area < differential.area


def test_ways_are_compared_with_sorted_lines():
    network = champion("HP")
    placed = plan("hp_1t1r", network)
    errors = placed.tiles[0].read_error
    assert plan_cost(placed).signs[0].read_error == errors.sorted > errors.refined


def test_a_way_that_does_not_fit_says_why():
    signs = {cost.signs: cost for cost in plan_cost(plan(array={"max_columns": 1})).signs}
    assert "array.max_columns: expected at least 2" in signs["differential_pair"].problem
    assert signs["row_polarity"].problem == signs["column_pair"].problem == ""


def test_skewed_clocks_count_area_only():
    cost = plan_cost(plan(array={"delays": "retimed"}))
    assert {line.group for line in cost.lines} == {AREA}
    assert any("retimed" in text for text in cost.not_counted)


def test_table(tmp_path):
    cost = plan_cost(plan())
    cost.write_csv(tmp_path / "cost.csv")
    with (tmp_path / "cost.csv").open() as file:
        rows = list(csv.DictReader(file))
    counted = [row for row in rows if row["total"] and row["group"] in (AREA, ENERGY, TIME)]
    assert len(counted) == len(cost.lines)
    assert all(row["source"] for row in counted)
    assert sum(row["group"] == "not counted" for row in rows) == len(cost.not_counted)
    assert sum(row["group"] == "alternatives of array.signs" for row in rows) == 3
