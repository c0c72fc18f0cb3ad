"""Measured sweeps: read from the files that people have, checked as a physicist would check them."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmloom.devices.measurement import Measurement
from ohmloom.errors import FileFormatError, MissingFileError, OhmloomError, ParameterError, UnknownNameError

DATA = Path(__file__).parents[3].parent / "shared" / "data"
TABLE = "t,v,i\n0,0,0\n1,1,0.001\n2,0.5,0.0005\n3,-1,-0.002\n"


def sweep(**changes):
    values = {"name": "a", "t": [0.0, 1.0, 2.0], "v": [0.0, 1.0, -1.0], "i": [0.0, 1e-3, -2e-3]}
    return Measurement(**{**values, **changes})


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "a.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refusal(path, error=FileFormatError, **options):
    """What reading `path` is refused with, without the folder."""
    with pytest.raises(OhmloomError) as caught:
        Measurement.read_csv(path, **options)
    assert type(caught.value) is error
    return str(caught.value).replace(f"{path}", "a.csv")


@pytest.mark.parametrize("text", [
    TABLE, TABLE.replace(",", ";"), TABLE.replace(",", "\t"), TABLE.replace(",", " \t"), TABLE.replace(",", "   "),
    TABLE.replace(",", " , "), TABLE.replace("\n", "\r\n"), TABLE.replace("\n", "\r"), "\ufeff" + TABLE,
    "# made on Monday\n\n" + TABLE + "\n  # end\n", TABLE.replace("t,v,i", '"t","v","i"'),
    TABLE.replace("t,v,i", '"t" "v" "i"').replace(",", " "), TABLE.replace("1,1,", '"1","1",'),
], ids=["comma", "semicolon", "tab", "blank tab", "blanks", "comma blanks", "crlf", "cr", "bom", "comments", "quotes",
        "quotes blanks", "quoted numbers"])  # fmt: skip
def test_every_common_kind_of_table_gives_the_same_numbers(written, text):
    read = Measurement.read_csv(written(text))
    assert read.t.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert read.v.tolist() == [0.0, 1.0, 0.5, -1.0]
    assert read.i.tolist() == [0.0, 1e-3, 5e-4, -2e-3]


def test_a_measurement_knows_where_it_comes_from(written):
    path = written(TABLE)
    read = Measurement.read_csv(path, series_resistance=10.0)
    assert (read.name, read.file, read.rows, read.every) == ("a", "a.csv", (0, 4), 1)
    assert read.sha256 == hashlib.sha256(TABLE.encode()).hexdigest()
    assert read.series_resistance == 10.0
    assert Measurement.read_csv(path, name="loop 7").name == "loop 7"


def test_columns_are_named_and_in_any_order(written):
    path = written("note,I,V,s\nup,1,10,0\ndown,2,20,5\n")
    read = Measurement.read_csv(path, time="s", voltage="V", current="I")
    assert (read.t.tolist(), read.v.tolist(), read.i.tolist()) == ([0.0, 5.0], [10.0, 20.0], [1.0, 2.0])


def test_a_file_without_names_counts_its_columns(written):
    path = written("0 0 0\n1 1 0.001\n")
    assert Measurement.read_csv(path, "1", "2", "3").i.tolist() == [0.0, 0.001]


def test_a_column_without_a_name_is_counted(written):
    assert Measurement.read_csv(written(",v,i\n0,0,0\n1,1,1\n"), time="1").t.tolist() == [0.0, 1.0]


def test_units_scale_to_si(written):
    path = written("t(ms),V [mV],i_\u00b5A\n0,0,0\n10,100,5\n")
    units = {"t(ms)": "ms", "V [mV]": "mV", "i_\u00b5A": "\u00b5A"}
    read = Measurement.read_csv(path, "t(ms)", "V [mV]", "i_\u00b5A", units=units)
    np.testing.assert_allclose([read.t[1], read.v[1], read.i[1]], [0.01, 0.1, 5e-6], rtol=1e-15)  # one product


def test_the_micro_sign_of_old_instruments_is_read(written):
    path = written("t,v,i_\u00b5A\n0,0,0\n1,1,5\n".encode("latin-1"))
    read = Measurement.read_csv(path, current="i_\u00b5A", units={"i_\u00b5A": "uA"})
    np.testing.assert_allclose(read.i[1], 5e-6, rtol=1e-15)  # one product


def test_a_period_without_times_gets_them_from_its_frequency(written):
    read = Measurement.read_csv(written("v,i\n0,0\n1,1\n0,0\n-1,-1\n"), frequency=50.0)
    assert read.t.tolist() == [0.0, 0.005, 0.01, 0.015]
    assert read.frequency == 50.0


def test_rows_of_a_period_keep_its_times(written):
    read = Measurement.read_csv(written("v,i\n0,0\n1,1\n0,0\n-1,-1\n"), frequency=50.0, rows=(1, 4))
    assert read.t.tolist() == [0.005, 0.01, 0.015]
    assert read.rows == (1, 4)


def test_equal_steps_make_the_times(written):
    read = Measurement.read_csv(written("v,i\n0,0\n1,1\n"), sample_interval=0.25)
    assert (read.t.tolist(), read.frequency) == ([0.0, 0.25], None)


def test_a_time_column_can_be_ignored(written):
    assert Measurement.read_csv(written(TABLE), time=None, frequency=1.0).t.tolist() == [0.0, 0.25, 0.5, 0.75]


def test_lines_outside_of_the_rows_are_not_read(written):
    path = written("t,v,i\noff,off,off\n0,0,0\n1,1,1\nend\n")
    read = Measurement.read_csv(path, rows=(1, 3))
    assert (read.t.tolist(), read.rows) == ([0.0, 1.0], (1, 3))


def test_the_line_of_a_bad_time_counts_from_the_top_of_the_file(written):
    path = written("t,v,i\n9,0,0\n0,0,0\n1,1,1\n1,2,2\n")
    assert refusal(path, rows=(1, 4)).startswith("a.csv, line 5, column 't': expected a time above 1, ")


def test_blocks_become_their_means_and_a_rest_is_left_out(written):
    path = written("t,v,i\n0,0,0\n1,1,2\n2,4,3\n3,6,5\n4,9,9\n")
    read = Measurement.read_csv(path, every=2)
    assert (read.t.tolist(), read.v.tolist(), read.i.tolist()) == ([0.5, 2.5], [0.5, 5.0], [1.0, 4.0])
    assert (read.rows, read.every) == ((0, 4), 2)


def test_a_current_counted_outward_is_inverted(written):
    path = written("t,v,i\n0,0,0\n1,1,-1\n")
    assert Measurement.read_csv(path, invert_current=True).i.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("text", "message"), [
    ("", "a.csv: expected rows of numbers, got an empty file. Check the path."),
    ("# only this\n\n", "a.csv: expected rows of numbers, got an empty file. Check the path."),
    ("t,v,i\n", "a.csv: expected rows of numbers below the names, got none. It may be truncated."),
    (b"t,v,i\n0,\x000,0\n", "a.csv: expected UTF-8 text, got other bytes. Export the table as CSV in UTF-8."),
    ("t,v,v\n0,0,0\n", "a.csv, line 1: expected each column name once, got 'v' twice. Rename one."),
    ("t,v,i\x07\n0,0,0\n",
     "a.csv, line 1: expected names of columns, got 'i\\x07'. Check that this is the right file."),
    ("#\nt,v,i\n0,0,0\n1,1\n",
     "a.csv, line 4: expected 3 fields (t, v, i), got 2: '1,1'. "
     "Correct the line, or put '#' before it if it is no data."),
    ("Instrument 7\nt,v,i\n0,0,0\n",
     "a.csv, line 2: expected 1 field (Instrument 7), got 3: 't,v,i'. "
     "Correct the line, or put '#' before it if it is no data."),
    ("t,v,i\n0,0,0\n", "a.csv: expected at least 2 rows of numbers, got 1. Give a whole sweep."),
    ("t,v,i\n0,0,0,0,0,0\n",
     "a.csv, line 2: expected 3 fields (t, v, i), got 6: '0,0,0,0,0,0'. Write decimal points, not decimal commas."),
    ("t,v,i\n0,0,0\n1,x,1\n",
     "a.csv, line 3, column 'v': expected a finite number, got 'x'. "
     "Correct it, or read rows=(start, stop) without this line."),
    ("t,v,i\n0,0,0\n1,,1\n",
     "a.csv, line 3, column 'v': expected a finite number, got ''. "
     "Correct it, or read rows=(start, stop) without this line."),
    ("t,v,i\n0,0,0\n1,1,NaN\n",
     "a.csv, line 3, column 'i': expected a finite number, got 'NaN'. "
     "Correct it, or read rows=(start, stop) without this line."),
    ("t,v,i\n0,0,0\n1,-inf,1\n",
     "a.csv, line 3, column 'v': expected a finite number, got '-inf'. "
     "Correct it, or read rows=(start, stop) without this line."),
    ("t,v,i\n0,0,0\n1,1_0,1\n",
     "a.csv, line 3, column 'v': expected a finite number, got '1_0'. "
     "Correct it, or read rows=(start, stop) without this line."),
    ("t;v;i\n0;0;0\n1;1,5;1\n",
     "a.csv, line 3, column 'v': expected a number with a decimal point, got '1,5'. "
     "Write 1.5, here and in all lines."),
    ("t v i\n0 0 0\n1 1.5 1,5e-3\n",
     "a.csv, line 3, column 'i': expected a number with a decimal point, got '1,5e-3'. "
     "Write 1.5e-3, here and in all lines."),
    ("t,v,i\n0,0,0\n2,1,1\n\n1.5,1,1\n",
     "a.csv, line 5, column 't': expected a time above 2, that of the row before, got 1.5. "
     "Remove repeats, or read one sweep with rows=(start, stop)."),
    ("t,v,i\n0,0,0\n0,1,1\n",
     "a.csv, line 3, column 't': expected a time above 0, that of the row before, got 0. "
     "Remove repeats, or read one sweep with rows=(start, stop)."),
    ("t,v,i\n0,1,0\n1,1,1\n",
     "a.csv: Measurement.v: expected a voltage that changes, got 1 V throughout. Check the column."),
    ("t,v,i\n0,0,0\n1,1,0\n", "a.csv: Measurement.i: expected a current, got 0 A throughout. Check the column."),
    ("t,v,i\n0,0,0\n1,1e9,1\n",
     "a.csv: Measurement.v: expected at most 1e+06 V in size, got 1e+09 V. Check the unit."),
    ("t,v,i\n0,0,0\n1,1,-1\n",
     "a.csv: Measurement.i: expected a current that takes energy into the device (integral of v i dt above 0), got one "
     "of the wrong sign. Pass invert_current=True to read_csv, or swap the terminals."),
])  # fmt: skip
def test_a_bad_file_is_refused_with_line_column_and_value(written, text, message):
    assert refusal(written(text)) == message


def test_a_decimal_comma_without_names_is_told(written):
    assert refusal(written("0,5;0,1;1\n1;1;1\n"), time="1", voltage="2", current="3") == (
        "a.csv, line 1, column '1': expected a number with a decimal point, got '0,5'. "
        "Write 0.5, here and in all lines."
    )
    assert "got '0,5'. Write 0.5" in refusal(written("t;v;i\n0,5;0,1;1,0\n1,0;1,5;1,0\n"))
    assert "got '0,5'. Write 0.5" in refusal(written("0,5 0,1 1,0\n1,0 1,5 1,0\n"), time="1", voltage="2", current="3")


@pytest.mark.parametrize(("options", "error", "message"), [
    ({"voltage": "u"}, UnknownNameError, "a.csv: voltage column: expected one of i, t, v, got 'u'. Use one of these."),
    ({"voltage": "V"}, UnknownNameError,
     "a.csv: voltage column: expected one of t, v, i, got 'V'. Did you mean voltage='v'?"),
    ({"time": "time"}, UnknownNameError,
     "a.csv: time column: expected one of i, t, v, got 'time'. Did you mean 't'?"),
    ({"current": "v"}, ParameterError,
     "a.csv: expected a column of its own for each quantity, got time='t', voltage='v', current='v'. Correct one."),
    ({"frequency": 1.0}, ParameterError,
     "a.csv: expected the times from one source, got a column 't' and frequency. "
     "Leave frequency out, or pass time=None to ignore the column."),
    ({"sample_interval": 1.0}, ParameterError,
     "a.csv: expected the times from one source, got a column 't' and sample_interval. "
     "Leave sample_interval out, or pass time=None to ignore the column."),
    ({"time": None, "sample_interval": 1.0, "frequency": 1.0}, ParameterError,
     "Measurement.read_csv: expected one of frequency and sample_interval, got both. Leave one out."),
    ({"time": None, "frequency": 0.0}, ParameterError,
     "Measurement.read_csv: frequency: expected a number above 0 Hz, got 0 Hz. Correct it."),
    ({"time": None, "sample_interval": "1"}, ParameterError,
     "Measurement.read_csv: sample_interval: expected a number above 0 s, got '1'. Correct it."),
    ({"series_resistance": -1.0}, ParameterError,
     "Measurement.read_csv: series_resistance: expected a resistance of 0 Ohm or more, got -1 Ohm. Correct it."),
    ({"units": {"q": "V"}}, UnknownNameError, "a.csv: units: expected one of i, t, v, got 'q'. Use one of these."),
    ({"units": {"i": "uX"}}, UnknownNameError,
     "a.csv: unit of column 'i': expected one of A, GA, MA, fA, kA, mA, nA, pA, uA, got 'uX'. Did you mean 'uA'?"),
    ({"units": {"i": "mV"}}, UnknownNameError,
     "a.csv: unit of column 'i': expected a unit of A, such as mA, got 'mV', a unit of V. "
     "Check that this is the right quantity."),
    ({"units": "uA"}, ParameterError,
     "Measurement.read_csv: units: expected a table from column name to unit, got 'uA'. Pass a value of this type."),
    ({"rows": (2, 9)}, ParameterError,
     "Measurement.read_csv: rows: expected 0 <= start < stop <= 4, the rows of a.csv, got (2, 9). "
     "The first row has number 0."),
    ({"rows": (2, 2)}, ParameterError,
     "Measurement.read_csv: rows: expected 0 <= start < stop <= 4, the rows of a.csv, got (2, 2). "
     "The first row has number 0."),
    ({"rows": 3}, ParameterError,
     "Measurement.read_csv: rows: expected (start, stop), got 3. Give two integers."),
    ({"rows": (-1, 2)}, ParameterError,
     "Measurement.read_csv: rows: expected an integer >= 0, got -1. Correct it."),
    ({"every": 0}, ParameterError, "Measurement.read_csv: every: expected an integer >= 1, got 0. Correct it."),
    ({"every": 3}, ParameterError,
     "Measurement.read_csv: every: expected at least 2 blocks in 4 rows, got 3 rows per block. Lower it."),
    ({"voltage": 2}, ParameterError,
     "Measurement.read_csv: voltage: expected a column name, got 2. Pass a value of this type."),
    ({"name": 2}, FileFormatError, "a.csv: Measurement.name: expected str, got 2. Pass a value of this type."),
])  # fmt: skip
def test_a_wrong_argument_is_refused(written, options, error, message):
    assert refusal(written(TABLE), error, **options) == message


@pytest.mark.parametrize(("column", "quantity", "unit"), [
    ("i_uA", "current", "uA"), ("I [mA]", "current", "mA"), ("I / nA", "current", "nA"), ("i_ua", "current", "uA"),
    ("u(mV)", "voltage", "mV"), ("clock ms", "time", "ms"), ("clock (min)", "time", "min"),
    ("i_\u00b5A", "current", "uA"),
])  # fmt: skip
def test_a_unit_in_a_name_must_be_said(written, column, quantity, unit):
    names = {"time": "t", "voltage": "v", "current": "i"} | {quantity: column}
    path = written(f"{';'.join(names.values())}\n0;0;0\n1;1;1\n")
    text = refusal(path, ParameterError, **names)
    assert text.startswith(f"a.csv: unit of column {column!r}: expected it in units, got nothing, though the name ends")
    assert text.endswith(f"Pass units={{{column!r}: {unit!r}}} (--unit {column}={unit}).")
    Measurement.read_csv(path, **names, units={column: unit})


@pytest.mark.parametrize("column", ["v_V", "V [V]", "v_source_V", "V_GS", "v_A", "voltage", "v_min", "v 1", "E (rel)"])
def test_a_name_without_another_unit_is_accepted(written, column):
    path = written(f"t;{column};i\n0;0;0\n1;1;1\n")
    assert Measurement.read_csv(path, voltage=column).v.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("column", "got"), [("i_uA", "'uA', a unit of A"), ("x [ms]", "'ms', a unit of s")])
def test_a_column_of_another_quantity_is_refused(written, column, got):
    path = written(f"t;{column};i\n0;0;0\n1;1;1\n")
    assert refusal(path, UnknownNameError, voltage=column) == (
        f"a.csv: unit of column {column!r}: expected a unit of V, got a name that ends in {got}. Choose another column."
    )


def test_a_file_without_times_asks_for_them(written):
    assert refusal(written("v,i\n0,0\n1,1\n"), ParameterError) == (
        "a.csv: expected a time for each row, got no column 't' among v, i. Name the column (time=...), or give "
        "frequency= in Hz if the file is one period, or sample_interval= in s."
    )
    assert refusal(written("T,v,i\n0,0,0\n1,1,1\n"), UnknownNameError) == (
        "a.csv: time column: expected one of T, v, i, got 't'. Did you mean time='T'?"
    )


def test_a_misspelt_time_column_is_not_passed_over_for_a_frequency(written):
    text = refusal(written("v,i\n0,0\n1,1\n"), UnknownNameError, time="zeit", frequency=1.0)
    assert text.startswith("a.csv: time column: expected one of i, v, got 'zeit'.")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no\.csv: expected a measurement file, got No such file"):
        Measurement.read_csv(tmp_path / "no.csv")


@pytest.mark.parametrize(("changes", "message"), [
    ({"v": [0.0, 1.0]}, "Measurement.v: expected axes (time,) as long as t, 3, got 2. Give one value per time."),
    ({"t": [0.0], "v": [0.0], "i": [0.0]}, "Measurement.t: expected at least 2 points, got 1. Give a whole sweep."),
    ({"t": [0.0, 2.0, 1.0]},
     "Measurement.t: expected strictly increasing times in s, got 1 s after 2 s. Sort them and drop repeats."),
    ({"i": [0.0, np.nan, 1.0]}, "Measurement.i: expected finite numbers, got NaN or infinity. Check the input."),
    ({"series_resistance": np.inf},
     "Measurement.series_resistance: expected a resistance of 0 Ohm or more, got inf. Correct it."),
    ({"frequency": -1.0}, "Measurement.frequency: expected a number above 0 Hz, got -1 Hz. Correct it."),
    # In steps of 1 s the source gives 0.5 + 1.5 mJ, and the resistor takes 0.5 + 2.5 mJ for each 1000 Ohm.
    ({"series_resistance": 1000.0, "v": [0.0, 1.0, 1.0], "i": [0.0, 1e-3, 2e-3]},
     "Measurement.series_resistance: expected less than 666.7 Ohm, beyond which the resistor alone would take up more "
     "energy than the source gives, got 1000 Ohm. Check the resistor, and that v is the source's voltage."),
])  # fmt: skip
def test_arrays_that_are_no_measurement_are_refused(changes, message):
    with pytest.raises(ParameterError) as caught:
        sweep(**changes)
    assert str(caught.value) == message


def test_a_noisy_sweep_of_a_passive_device_has_the_right_sign():
    """Single points may give energy out; the sweep does not."""
    assert sweep(i=[-1e-5, 1e-3, -2e-3]).i[0] == -1e-5


def test_tiny_currents_have_a_sign_too():
    tiny = sweep(i=[0.0, 1e-300, -2e-300], v=[0.0, 1e-200, -1e-200])
    assert tiny.zero_offset() == pytest.approx(-0.125)  # as at any scale: the mean of 0 and -1/4
    with pytest.raises(ParameterError, match="wrong sign"):
        sweep(i=[0.0, -1e-300, 2e-300], v=[0.0, 1e-200, -1e-200])


def test_arrays_are_copies_that_cannot_be_written():
    v = np.array([0.0, 1.0, -1.0])
    made = sweep(v=v)
    v[0] = 5.0
    assert made.v[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        made.v[0] = 1.0


def test_charge_flux_and_duration():
    made = sweep(t=[1.0, 2.0, 4.0], v=[0.0, 2.0, 3.0], i=[0.0, 1e-3, 1e-3], series_resistance=1000.0)
    assert made.duration == 3.0
    np.testing.assert_allclose(made.device_voltage, [0.0, 1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(made.charge, [0.0, 5e-4, 2.5e-3], rtol=1e-15)
    np.testing.assert_allclose(made.flux, [0.0, 0.5, 3.5], rtol=1e-15)


@pytest.mark.parametrize(("v", "i", "offset"), [
    ([-1.0, 1.0, 2.0], [-1.0, 3.0, 4.0], 0.25),  # interpolated: 1 at v = 0, over 4
    ([-1.0, 3.0, 2.0], [-1.0, 3.0, 4.0], 0.0),
    ([0.0, 1.0, 2.0], [0.4, 1.0, 4.0], 0.1),  # a sample at zero
    ([0.0, 2.0, -2.0], [0.4, 2.0, -4.0], (0.1 - 0.25) / 2),  # the mean of two crossings
    ([1.0, 2.0, 3.0], [1.0, 2.0, 4.0], None),
])  # fmt: skip
def test_the_offset_at_zero_voltage(v, i, offset):
    found = sweep(v=v, i=i).zero_offset()
    assert found == offset if offset is None else found == pytest.approx(offset, rel=1e-12, abs=1e-15)  # rounding


def test_the_offset_is_that_of_the_device_behind_its_resistor():
    assert sweep(v=[1.0, 3.0, 4.0], i=[1.0, 2.0, 3.0], series_resistance=1.0).zero_offset() == pytest.approx(1 / 3)


def test_the_plot_is_the_loop_of_the_device_with_its_units():
    made = sweep(series_resistance=100.0)
    ax = made.plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("device voltage [V]", "current [A]")
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), made.device_voltage)
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), made.i)
    assert made.plot(ax) is ax
    assert len(ax.lines) == 2


def test_a_measurement_in_a_notebook_is_escaped():
    page = sweep(name="<script>", series_resistance=5000.0 / 1e3)._repr_html_()
    assert "&lt;script&gt;" in page
    assert "<script>" not in page
    assert "<td>2 mA</td>" in page
    assert "<td>5 Ohm</td>" in page


def test_a_saved_file_says_what_it_holds(tmp_path):
    sweep(name="a\nb", series_resistance=10.0, frequency=2.0, file="x.csv", sha256=16 * "12ab").save(tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == (
        "# a\\nb: t in s, v in V, i in A\n# from x.csv, sha256 " + 16 * "12ab" + "\n# frequency 2.0 Hz\n"
        "# v is a source's, across the device and 10.0 Ohm in series\n"
        "t,v,i\n0.0,0.0,0.0\n1.0,1.0,0.001\n2.0,-1.0,-0.002\n"
    )


@given(points=st.lists(st.tuples(st.floats(1e-12, 1e3), st.floats(-1e6, 1e6), st.floats(1e-15, 1.0)),
                       min_size=2, max_size=20))  # fmt: skip
def test_a_saved_measurement_comes_back_to_the_last_bit(tmp_path_factory, points):
    steps, v, g = np.array(points).T
    try:
        made = sweep(t=np.cumsum(steps), v=v, i=g * v)
    except ParameterError:  # a constant voltage, or steps lost to rounding
        return
    path = tmp_path_factory.getbasetemp() / "bits.csv"
    made.save(path)
    back = Measurement.read_csv(path)
    for name in ("t", "v", "i"):
        assert getattr(back, name).tobytes() == getattr(made, name).tobytes()


def test_a_large_file_is_read_in_well_under_a_second(written):
    t = np.linspace(0.0, 1.0, 15_000)
    lines = [f"{k!r},{v!r},{v / 1e3!r}" for k, v in zip(t.tolist(), np.sin(9 * t).tolist(), strict=True)]
    path = written("t,v,i\n" + "\n".join(lines))
    start = time.perf_counter()
    assert Measurement.read_csv(path).t.size == 15_000
    assert time.perf_counter() - start < 1.0  # 0.05 s alone; a busy machine is given time


def measured(name):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{name} is not here: the data may not be copied into the project")
    return path


@pytest.mark.parametrize(("name", "resistance", "frequency"), [
    ("47k_0p8V_100Hz_M2", 47e3, 100.0), ("5k_0p8V_100Hz_M1", 5e3, 100.0), ("5k_0p8V_10Hz_M1", 5e3, 10.0),
    ("5k_0p8V_1Hz_M1", 5e3, 1.0),
])  # fmt: skip
def test_knowm_loops_are_read_and_the_resistor_gives_the_device_voltage(name, resistance, frequency):
    path = measured(f"knowm_w_sdc/knowm_wsdc_{name}.csv")
    options = {"current": "i_uA", "units": {"i_uA": "uA"}, "frequency": frequency}
    device = Measurement.read_csv(path, voltage="v_memristor_V", **options)
    source = Measurement.read_csv(path, voltage="v_source_V", series_resistance=resistance, **options)
    assert device.t.size == 200
    assert device.duration == pytest.approx(199 / 200 / frequency, rel=1e-12)  # rounding
    # The three columns of the file obey Ohm's law to rounding.
    np.testing.assert_allclose(source.device_voltage, device.v, atol=1e-12 * 0.8)
    assert 0.002 < source.zero_offset() < 0.004  # 0.3 % at 100 Hz and below, research note on the data


def test_polyaniline_loops_without_names_and_times_are_read():
    path = measured("pani/IV_MLit10_1.txt")
    cycle = Measurement.read_csv(path, voltage="1", current="2", sample_interval=1.0, rows=(182, 364))
    assert cycle.t.size == 182
    assert (cycle.v.min(), cycle.v.max()) == (-0.1, 0.8)
    assert abs(cycle.zero_offset()) < 0.005


def test_a_polyaniline_staircase_is_averaged():
    path = measured("pani/small_mem4.csv")
    whole = Measurement.read_csv(path, voltage="s", current="m")
    assert (whole.t.size, round(whole.v.max(), 2)) == (15_635, 1.0)
    assert whole.duration == pytest.approx(750.6, abs=0.1)
    averaged = Measurement.read_csv(path, voltage="s", current="m", every=30)
    assert averaged.t.size == 521
    np.testing.assert_allclose(averaged.i[0], whole.i[:30].mean(), rtol=1e-12)  # rounding


@pytest.mark.parametrize(("t", "message"), [
    (np.array([0, 1, 2], dtype="timedelta64[ms]"), "expected numbers, got timedelta64[ms], whose unit would be lost"),
    (list(np.array([0, 1, 2], dtype="timedelta64[ms]")), "expected numbers, got timedelta64[ms], whose unit would be"),
    (np.array([0, 1, 2], dtype="datetime64[s]"), "expected numbers, got datetime64[s], whose unit would be lost."),
    (np.ma.array([0.0, 1.0, 2.0], mask=[0, 1, 0]), "expected a value everywhere, got a masked array with 1 masked."),
])  # fmt: skip
def test_numbers_that_would_lose_their_meaning_are_refused(t, message):
    with pytest.raises(ParameterError) as caught:
        sweep(t=t)
    assert str(caught.value).startswith(f"Measurement.t: {message}")
