"""Pulse schedules: slot by slot what the waveform, the taps and the parallelism ask for."""

import csv

import numpy as np
import pytest

from ohmloom.errors import MappingError, ParameterError
from ohmloom.mapping import EmulatedController, Hardware, place, pulse_schedule
from ohmloom.mapping.schedule import STEP, first_spikes
from ohmloom.neurocontroller import Network, Synapse, champion

# Hidden 9 is inhibitory and reaches hidden 6 after three steps.
SMALL = Network(
    system="HP", hidden=("excitatory", "excitatory", "excitatory", "inhibitory"),
    synapses=(Synapse(0, 6, "hp", 0.5), Synapse(9, 6, "hp", 0.5), Synapse(6, 10, "hp", 0.5)),
)  # fmt: skip


def plan(name="hp_1t1r", network=SMALL, drive=None, **array):
    hardware = Hardware.load(name)
    changes = {"array": hardware.array.model_copy(update=array), "drive": hardware.drive.model_copy(update=drive or {})}
    return place(network, hardware.model_copy(update=changes))


def spikes(*pairs, steps=8, network=SMALL):
    found = np.zeros((steps, network.neurons), dtype=bool)
    for step, neuron in pairs:
        found[step, neuron] = True
    return found


def lines(schedule, step, action):
    """Driven lines by neuron: (neuron, voltage), of each slot that drives any."""
    found = []
    for slot in schedule.slots:
        tile = schedule.plan.tiles[slot.tile]
        if (slot.step, slot.action) == (step, action) and (slot.rows or slot.columns):
            rows = [(tile.rows[i], round(v, 12)) for i, v in slot.rows]
            found.append((sorted(rows), sorted((tile.columns[j], round(v, 12)) for j, v in slot.columns)))
    return found


def test_a_row_is_read_after_its_delay_with_the_sign_of_its_sender():
    schedule = pulse_schedule(plan(), spikes((1, 9), (1, 0)))
    assert lines(schedule, 2, "read") == [([(0, 0.1)], [])]
    assert lines(schedule, 3, "read") == []
    assert lines(schedule, 4, "read") == [([(9, -0.1)], [])]
    pair = pulse_schedule(plan(signs="column_pair"), spikes((1, 9)))
    assert lines(pair, 4, "read") == [([(9, 0.1)], [])]


def test_columns_are_read_one_after_the_other():
    schedule = pulse_schedule(plan(), spikes((1, 9), (1, 0)))
    begins = [slot.begin for slot in schedule.slots if (slot.step, slot.action) == (2, "read")]
    assert begins == pytest.approx([2 * STEP, 2 * STEP + 100e-9])


@pytest.mark.parametrize(("first", "second", "sign"), [(0, 6, 1), (6, 0, -1)])
def test_a_pair_one_step_apart_is_written_with_the_half_waveform(first, second, sign):
    schedule = pulse_schedule(plan(), spikes((2, first), (3, second)))
    (slot,) = [s for s in schedule.slots if s.action == "write"]
    tile = schedule.plan.tiles[0]
    assert slot.step == 3
    ((i, row),), ((j, column),) = slot.rows, slot.columns
    assert (tile.rows[i], tile.columns[j]) == (0, 6)
    assert (row, column) == (-0.5 * sign, 0.5 * sign)
    assert slot.selected == ((i, j),)
    # 0.99 nC at 1 V through the mean of 20 kohm, at W = 0.5, and 990 ohm less or more.
    assert slot.duration == pytest.approx(0.99e-9 * (20e3 - sign * 990.0 / 2))


def test_ties_and_late_pairs_are_not_written():
    assert not [s for s in pulse_schedule(plan(), spikes((2, 0), (2, 6))).slots if s.action == "write"]
    assert not [s for s in pulse_schedule(plan(), spikes((2, 0), (4, 6))).slots if s.action == "write"]


def test_a_passive_array_drives_all_lines_at_once_and_half_selects():
    schedule = pulse_schedule(plan("hp_passive"), spikes((2, 0), (3, 6)))
    writes = [s for s in schedule.slots if s.action == "write"]
    assert [(s.step, len(s.selected)) for s in writes] == [(2, 0), (3, 1), (4, 0)]
    assert lines(schedule, 3, "write") == [([(0, -0.5), (6, 0.5)], [(6, 0.5)])]
    assert len({s.duration for s in writes}) == 1


def test_two_slots_write_each_sign_in_its_own():
    like = Hardware.load("hp_strukov").drive
    drive = {"waveform": "two_slot", "pulse_voltage": like.pulse_voltage, "threshold": like.threshold}
    two = plan("hp_passive", drive=drive)
    schedule = pulse_schedule(two, spikes((2, 0), (3, 6), (4, 10)))
    selected = {s.step: s.selected for s in schedule.slots if s.action == "write" and s.selected}
    tile = two.tiles[0]
    assert {(step, tile.rows[i], tile.columns[j]) for step, cells in selected.items() for i, j in cells} == {
        (3, 0, 6), (4, 6, 10)
    }  # fmt: skip
    first = [s for s in schedule.slots if (s.step, s.action) == (3, "write")]
    assert len(first) == 2
    assert first[1].begin == pytest.approx(first[0].end)


@pytest.mark.parametrize("parallelism", ["cell", "column"])
@pytest.mark.parametrize("kind", ["HP", "PEO"])
def test_the_schedule_takes_the_time_of_the_emulated_hardware(kind, parallelism):
    """Same spikes, same devices: the times are those that the emulation finds by its own kernels."""
    network = champion(kind)
    placed = plan("het_mixed", network, drive={"parallelism": parallelism})
    none = Hardware.load("ideal").wires
    free = placed.hardware.wires.model_copy(update={"r_row": none.r_row, "r_column": none.r_column})
    placed = place(network, placed.hardware.model_copy(update={"wires": free}))
    emulated = EmulatedController(placed.nominal())
    emulated.step((0.5,) * 6)
    schedule = pulse_schedule(placed)
    assert np.array_equal(schedule.spikes.sum(axis=0), emulated.spike_counts)
    written = [s for s in schedule.slots if s.action == "write"]
    assert len(written) == emulated.ledger.events
    reads = len(placed.tiles[0].columns) * 100e-9
    # Closed forms against the kernels' own integration.
    assert max(schedule.busy) - reads == pytest.approx(emulated.ledger.worst_programming_time, rel=1e-6)
    assert sum(schedule.busy) / 21 - reads == pytest.approx(emulated.ledger.mean_programming_time, rel=1e-6)


def test_currents_are_written_sign_by_sign():
    ideal = plan("ideal", champion("LIN"))
    writes = [s for s in pulse_schedule(ideal).slots if s.action == "write"]
    assert {np.sign(s.current) for s in writes} == {1, -1}
    assert {s.duration for s in writes} == {0.0005}


def test_table_has_a_row_a_driven_line(tmp_path):
    schedule = pulse_schedule(plan(), spikes((2, 0), (3, 6)))
    schedule.write_csv(tmp_path / "pulses.csv")
    with (tmp_path / "pulses.csv").open() as file:
        rows = list(csv.DictReader(file))
    written = [row for row in rows if row["action"] == "write"]
    assert [(row["line"].split()[0], row["neuron"], float(row["voltage_V"])) for row in written] == [
        ("row", "IR 0", -0.5), ("column", "hidden 0 (+)", 0.5)
    ]  # fmt: skip
    assert {"begin_s", "end_s", "voltage_V", "current_A"} <= set(rows[0])
    assert len({row["slot"] for row in rows}) == len(schedule.slots)


def test_a_passive_tile_is_a_pulse_train():
    schedule = pulse_schedule(plan("hp_passive"), spikes((2, 0), (3, 6)))
    train, tile = schedule.train(0), schedule.plan.tiles[0]
    (write,) = [s for s in schedule.slots if s.action == "write" and s.selected]
    middle = write.begin + write.duration / 2
    v = {pre: np.interp(middle, train.t, train.v_row[:, i]) for i, pre in enumerate(tile.rows)}
    assert v == pytest.approx({0: -0.5, 6: 0.5, 9: 0.0})
    assert np.interp(middle, train.t, train.v_column[:, tile.columns.index(6)]) == 0.5
    with pytest.raises(MappingError, match=r"Schedule\.train: expected array\.access = 'passive', got '1T1R'"):
        pulse_schedule(plan(), spikes((2, 0), (3, 6))).train(0)


def test_slow_devices_make_late_steps():
    slow = pulse_schedule(plan("peo_pani", champion("PEO")))
    assert slow.late_steps > 0
    begins = list({s.step: s.begin for s in slow.slots if s.action == "read" and s.rows}.values())
    assert (np.diff(begins) > 0.9 * STEP).all()
    assert (np.diff(begins) > 1.1 * STEP).any()


def test_what_is_no_history():
    with pytest.raises(ParameterError, match=r"pulse_schedule\.spikes: expected booleans, axes \(step, neuron=12\)"):
        pulse_schedule(plan(), np.zeros((3, 12)))
    with pytest.raises(MappingError, match=r"expected array\.delays = 'column_serial', got 'retimed'"):
        pulse_schedule(plan(delays="retimed"), spikes())
    assert first_spikes(SMALL, 5).shape == (5, 12)
