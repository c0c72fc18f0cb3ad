"""Pictures that explain a mapping: their numbers are those of the plan."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import Hardware, place, pulse_schedule
from ohmloom.neurocontroller import Network, champion
from ohmloom.report import plot_example, plot_schedule

HP = place(champion("HP"), Hardware.load("hp_1t1r"))


def words(ax):
    return " ".join(text.get_text() for text in ax.texts)


def test_example_reads_and_writes_one_device_in_numbers():
    read, write, pairs = plot_example(HP).axes
    for text in ("G = 50 uS", "I = V G = 5 uA", "W = G / G_on", "= 0.5", "0.25 × 0.5 = + 0.125", "100 ns"):
        assert text in words(read)
    # An event up of 0.99 nC takes 20 kohm to 19.01 kohm: W = 0.526, as the plan's card has it.
    for text in ("0.5 to 0.526", "19.3 us", "above 750 mV: up"):
        assert text in words(write)
    assert words(pairs).count("up") == words(pairs).count("down") == 1


def test_pairs_are_those_of_the_spec_own_waveform():
    pairs = plot_example(place(champion("HP"), Hardware.load("hp_strukov"))).axes[2]
    cells = {text.get_position(): text.get_text() for text in pairs.texts}
    assert cells[(3, 2)] == "+1 V\nup"
    assert cells[(2, 3)] == "-1 V\ndown"
    assert cells[(3, 1)] == "+0.8 V"
    assert cells[(3, 3)] == "0 V"


def test_programmed_devices_are_not_written():
    (read,) = plot_example(place(champion("GA"), Hardware.load("hp_1t1r"))).axes
    assert "(G − G_off) / (G_on − G_off)" in " ".join(words(read).split())


def test_schedule_picture_has_a_column_a_slot():
    schedule = pulse_schedule(HP)
    ax = plot_schedule(schedule, 0, steps=1)
    (image,) = ax.images
    step = next(s.step for s in schedule.slots if s.action == "write")
    slots = [s for s in schedule.slots if s.step == step]
    values = np.asarray(image.get_array())
    assert values.shape == (len(HP.tiles[0].rows) + len(HP.tiles[0].columns) + 1, len(slots))
    for k, slot in enumerate(slots):
        assert {(i, v) for i, v in enumerate(values[: len(HP.tiles[0].rows), k]) if v} == set(slot.rows)
    labels = [text.get_text() for text in ax.get_xticklabels()]
    assert labels[0].startswith("read ")
    assert any(label.startswith("write one up, 19.3 us") for label in labels)


def test_what_cannot_be_drawn():
    none = place(
        Network.random(system="HP", rng=np.random.default_rng(0)).replace(synapses=()), Hardware.load("hp_1t1r")
    )
    with pytest.raises(ParameterError, match=r"plot_example\.plan: expected a plan with synapses"):
        plot_example(none)
    with pytest.raises(ParameterError, match=r"plot_schedule\.tile: expected an index from 0 to 0, got 1"):
        plot_schedule(pulse_schedule(HP), 1)
