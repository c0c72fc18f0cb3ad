"""Pulse trains, and the tables of devices and pulses."""

import csv

import numpy as np
import pytest

from ohmloom.circuits import Crossbar, MemristorCrossbar, PulseTrain
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, MissingFileError, ParameterError

TIMES = {"width": 1e-6, "edge": 1e-8, "period": 2e-6}


def test_every_line_has_its_levels_its_edges_and_its_delay():
    train = PulseTrain.rectangular([[1.0, -0.5], [0.25, 0.0]], columns=1, delays=[0.0, 3e-7], **TIMES)
    for line, delay in ((0, 0.0), (1, 3e-7)):
        for pulse, level in enumerate([[1.0, -0.5], [0.25, 0.0]]):
            begin = pulse * 2e-6 + delay

            def at(t, begin=begin, line=line):
                return np.interp(begin + t, train.t, train.v_row[:, line])

            assert at(0.0) == pytest.approx(0.0, abs=1e-9)
            assert at(0.5e-8) == pytest.approx(level[line] / 2, abs=1e-9)
            assert at(0.5e-6) == pytest.approx(level[line], abs=1e-9)
            assert at(1.02e-6) == pytest.approx(0.0, abs=1e-9)
    # The area of a pulse with edges is level (width + edge).
    assert np.trapezoid(train.v_row[:, 0], train.t) == pytest.approx(1.25 * 1.01e-6, rel=1e-12)
    assert not train.v_column.any()


def test_pulses_that_touch_are_no_error_and_the_train_drives_an_array():
    train = PulseTrain.rectangular([[1.0], [1.0]], columns=2, width=1e-4, edge=1e-5, period=1.2e-4,
                                   column_levels=[[0.0, 0.5], [0.0, 0.5]])  # fmt: skip
    device = Device.load("hp_tio2_10k")
    trace = MemristorCrossbar(devices=device, s=[[0.5, 0.5]]).simulate(train.t, train.v_row, train.v_column)
    moved = device.flux(trace.s[-1, 0]) - device.flux(0.5)
    assert moved == pytest.approx([2.2e-4, 1.1e-4], rel=1e-9)


def test_pulses_come_back_from_csv_as_they_went(tmp_path):
    train = PulseTrain.rectangular([[1.0, 1 / 3]], columns=2, **TIMES)
    train.write_csv(tmp_path / "pulses.csv")
    again = PulseTrain.read_csv(tmp_path / "pulses.csv")
    for name in ("t", "v_row", "v_column"):
        assert getattr(again, name).tolist() == getattr(train, name).tolist()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 0.0}, "width: expected a time above 0 s, got 0 s"),
        ({"edge": -1e-9}, "edge: expected a time above 0 s"),
        ({"period": 1e-6}, "period: expected at least width"),
        ({"delays": [-1e-9, 0.0]}, "delays: expected times of 0 s or more"),
        ({"column_levels": [[0.0, 1.0]]}, "column_levels: expected axes"),
    ],
)
def test_trains_that_cannot_be_are_refused(changes, words):
    with pytest.raises(ParameterError, match=words):
        PulseTrain.rectangular([[1.0, 0.5]], columns=1, **(TIMES | changes))


def test_a_train_whose_times_do_not_rise_is_refused():
    with pytest.raises(ParameterError, match=r"PulseTrain\.t: expected at least two times"):
        PulseTrain(t=[0.0, 1.0, 1.0], v_row=np.zeros((3, 1)), v_column=np.zeros((3, 1)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1: expected the columns"),
        ("t,row_0_V,column_0_V\n0,0,0\n1,0,0\n", "line 1: expected the columns"),
        ("t_s,row_0_V,column_0_V\n0,0,0\n1,x,0\n", "line 3: expected 3 numbers"),
        ("t_s,row_0_V,column_0_V\n0,0,0\n1,0\n", "line 3: expected 3 numbers, got 2"),
        ("t_s,row_0_V,column_0_V\n0,0,0\n0,0,0\n", "each above the last"),
    ],
)
def test_damaged_pulse_tables_are_refused_by_line(tmp_path, text, words):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(FileFormatError, match=words):
        PulseTrain.read_csv(tmp_path / "p.csv")


def test_a_missing_pulse_table_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"none\.csv"):
        PulseTrain.read_csv(tmp_path / "none.csv")


def test_the_placement_table_has_a_line_per_device(tmp_path):
    Crossbar(conductance=[[1e-3, 0.0], [2e-3, 1 / 3]]).write_csv(tmp_path / "g.csv")
    rows = list(csv.DictReader((tmp_path / "g.csv").read_text().splitlines()))
    assert [(int(r["word_line"]), int(r["bit_line"]), float(r["conductance_S"])) for r in rows] == [
        (0, 0, 1e-3), (0, 1, 0.0), (1, 0, 2e-3), (1, 1, 1 / 3)]  # fmt: skip
    with pytest.raises(ParameterError, match="expected one crossbar"):
        Crossbar(conductance=np.ones((2, 2, 2))).write_csv(tmp_path / "no.csv")
    device = Device.load("hp_tio2_10k")
    MemristorCrossbar(devices=device, s=[[0.25, 0.5]], kind=[[0, -1]]).write_csv(tmp_path / "d.csv")
    first, second = csv.DictReader((tmp_path / "d.csv").read_text().splitlines())
    assert (first["card"], float(first["s"]), float(first["conductance_S"])) == (
        "hp_tio2_10k", 0.25, float(device.conductance(0.25)))  # fmt: skip
    assert (second["card"], second["s"], float(second["conductance_S"])) == ("", "", 0.0)
