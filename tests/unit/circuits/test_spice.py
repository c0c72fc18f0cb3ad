"""Decks as text, ngspice that is not there, and raw files: binary, ASCII, damaged."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ohmloom.circuits import (
    Capacitor,
    Crossbar,
    Memristor,
    Netlist,
    Pulse,
    Resistor,
    VoltageSource,
    crossbar_netlist,
    run_ngspice,
)
from ohmloom.circuits._raw_file import parse_raw
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, OperationError, ParameterError

DEVICE = Device.load("hp_tio2")
HEADER = (
    "Title: * test\nDate: today\nPlotname: Transient Analysis\nFlags: real\nNo. Variables: 2\nNo. Points: 3\n"
    "Variables:\n\t0\ttime\ttime\n\t1\tV(Out)\tvoltage\n"
)
NUMBERS = [0.0, 1.5, 1e-6, -2.25, 2e-6, 1e-300]
BINARY = (HEADER + "Binary:\n").encode() + struct.pack("<6d", *NUMBERS)
ASCII = (HEADER + "Values:\n 0\t0.0\n\t1.5\n\n 1\t1e-6\n\t-2.25\n\n 2\t2e-6\n\t1e-300\n\n").encode()


def netlist(*more, **fields):
    pulse = Pulse(high=1.0, rise=1e-3, width=1.0, fall=1e-3)
    return Netlist(elements=(
        VoltageSource(name="drive", p="in", n="0", voltage=pulse),
        Memristor(name="M1", p="in", n="0", device=DEVICE, s0=0.25), *more,
    ), **fields)  # fmt: skip


@pytest.mark.parametrize("data", [BINARY, ASCII], ids=["binary", "ascii"])
def test_raw_file_is_read(data):
    (plot,) = parse_raw(data, "out.raw")
    assert plot.plotname == "Transient Analysis"
    assert {name: values.tolist() for name, values in plot.vectors.items()} == {
        "time": NUMBERS[::2],
        "v(out)": NUMBERS[1::2],
    }


def test_several_plots_stand_one_after_the_other():
    assert [p.vectors["time"].tolist() for p in parse_raw(BINARY + ASCII, "out.raw")] == [NUMBERS[::2]] * 2


DAMAGED = {
    "empty": (b"", "out.raw: line 1: expected 'Title:', got nothing"),
    "cut binary": (BINARY[:-3], f"out.raw: byte {len(BINARY) - 48}: expected 3 points of 2 values, 48 bytes, got 45"),
    "cut header": (BINARY[:90], "out.raw: line 6: expected a header line, as 'No. Points: 10', got 'No. Po'"),
    "no count": (
        BINARY.replace(b"No. Points: 3\n", b""),
        "out.raw: line 6: expected 'No. Points:' with a whole number",
    ),
    "complex": (BINARY.replace(b"real", b"complex"), "out.raw: line 7: expected real values, got complex ones"),
    "variable": (BINARY.replace(b"\t1\tV(Out)", b"\t7\tV(Out)"), "out.raw: line 9: expected number, name and type"),
    "kind": (BINARY.replace(b"Binary:", b"Bin:"), "out.raw: line 10: expected 'Binary:' or 'Values:', got 'bin:'"),
    "word": (ASCII.replace(b"-2.25", b"two"), "out.raw: line 15: expected value 1 of point 1, got 'two'"),
    "point": (ASCII.replace(b" 1\t1e-6", b" 5\t1e-6"), "out.raw: line 14: expected the number 1 and a value"),
    "cut ascii": (ASCII[:-9], "out.raw: line 18: expected value 1 of point 2, got the end of the file"),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_raw_file_names_the_place(case):
    data, text = DAMAGED[case]
    with pytest.raises(FileFormatError) as caught:
        parse_raw(data, "out.raw")
    assert text in str(caught.value)
    assert str(caught.value).endswith("The file may be truncated.")


def test_deck_holds_cards_states_and_steps(tmp_path):
    other = DEVICE.replace(r_off=32e3)
    text = netlist(Memristor(name="2", p="in", n="0", device=other, s0=0.5), t_end=2.0).to_spice(tmp_path / "a.cir")
    assert (tmp_path / "a.cir").read_text() == text
    lines = text.splitlines()
    assert "Vdrive in 0 PWL(0.0 0.0" in lines
    assert "XM1 in 0 hp_tio2 s0=0.25" in lines
    assert "X2 in 0 hp_tio2_2 s0=0.5" in lines  # the same name, other parameters
    assert sum(line.startswith(".subckt hp_tio2") for line in lines) == 2
    (tran,) = (line.split() for line in lines if line.startswith(".tran"))
    # As long as an edge, which is half a thousandth; the times of its ends are rounded.
    assert float(tran[4]) == pytest.approx(1e-3, rel=1e-9)
    assert "numdgt=15" in text
    assert lines[-1] == ".end"


def test_deck_with_capacitors_starts_from_their_voltages():
    with_one = netlist(Capacitor(name="C1", p="a", n="0", capacitance=1e-6, initial=0.5),
                       Resistor(name="R1", p="in", n="a", resistance=1e3))  # fmt: skip
    lines = with_one.to_spice(t_end=1.0, max_step=1e-4).splitlines()
    assert "C1 a 0 1e-06 ic=0.5" in lines
    assert ".tran 0.0001 1.0 0 0.0001 uic" in lines


def test_deck_without_a_duration_is_an_operating_point():
    assert netlist().to_spice().splitlines()[-2] == ".op"


def test_step_longer_than_an_edge_is_refused():
    with pytest.raises(
        ParameterError, match=r"max_step: expected at most 0\.001 s, the shortest edge of drive, got 0\.1"
    ):
        netlist().to_spice(t_end=1.0, max_step=0.1)


def test_missing_ngspice_is_told(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(OperationError, match=r"expected ngspice on PATH, got none\. Install it, or"):
        run_ngspice(netlist(), t_end=1.0)


def test_crossbar_netlist_reads_as_the_crossbar():
    array = Crossbar(conductance=[[1e-3, 0.0, 2e-3], [3e-4, 1e-4, 5e-4]], r_row=2.0, r_column=1.0, r_sense=10.0)
    point, read = crossbar_netlist(array, [1.0, -0.5]).dc(), array.read([1.0, -0.5])
    np.testing.assert_allclose([point.i[f"S_{j}"] for j in range(3)], read.current, rtol=1e-12)
    assert point.v["row_1_2"] == pytest.approx(read.v_row[1, 2], rel=1e-12)
    assert "D_0_1" not in point.i  # an open device


def test_batch_of_crossbars_is_refused():
    with pytest.raises(
        ParameterError, match=r"expected one crossbar, axes \(word_line, bit_line\), got shape \(2, 3, 3\)"
    ):
        crossbar_netlist(Crossbar(conductance=np.ones((2, 3, 3))), np.ones(3))
    with pytest.raises(ParameterError, match=r"expected finite voltages, axes \(word_line=3,\), got shape \(2,\)"):
        crossbar_netlist(Crossbar(conductance=np.ones((3, 3))), np.ones(2))
