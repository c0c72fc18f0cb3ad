"""Traces: frozen, drawn with units, saved to the same bytes, refused when broken."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest

from ohmloom.devices import Device, Trace
from ohmloom.errors import FileFormatError, MissingFileError, ParameterError


@pytest.fixture
def trace():
    return Device.load("hp_tio2").simulate([0.0, 1.0, 0.0, -1.0], [0.0, 0.1, 0.2, 0.3], s0=0.2)


def arrays_of(path):
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files}


def test_arrays_are_copies_that_cannot_be_written(trace):
    with pytest.raises(ValueError, match="read-only"):
        trace.s[0] = 1.0
    t = np.array([0.0, 1.0])
    made = Trace(t=t, v=t, i=t, q=t, s=t)
    t[0] = 5.0
    assert made.t[0] == 0.0


def test_a_trace_comes_back_whole(trace, tmp_path):
    trace.save(tmp_path / "a.npz")
    back = Trace.load(tmp_path / "a.npz")
    for name in ("t", "v", "i", "q", "s"):
        np.testing.assert_array_equal(getattr(back, name), getattr(trace, name))
    assert json.loads(back.provenance) == json.loads(trace.provenance)
    back.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_provenance_names_version_card_parameters_and_start(trace):
    from importlib.metadata import version

    device = Device.load("hp_tio2")
    assert json.loads(trace.provenance) == {
        "ohmloom": version("ohmloom"),
        "device": "hp_tio2",
        "law": "hp_linear",
        "parameters": {"r_on": 100.0, "r_off": 16e3, "beta": 100.0},
        "device_sha256": device.sha256,
        "s0": 0.2,
        "walls": "clip",
        "method": "integrate",
    }


def test_the_plot_is_the_loop_with_its_units(trace):
    ax = trace.plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("voltage [V]", "current [A]")
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), trace.v)
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), trace.i)
    assert trace.plot(ax) is ax
    assert len(ax.lines) == 2


def test_the_plot_does_not_touch_pyplot(trace):
    import subprocess
    import sys

    code = (
        "import sys; from ohmloom.devices import Device;"
        "Device.load('hp_tio2').simulate([0.0, 1.0], [0.0, 1.0], s0=0.2).plot();"
        "print('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_a_trace_in_a_notebook_is_escaped():
    t = np.array([0.0, 0.5])
    page = Trace(t=t, v=t, i=t, q=t, s=t, provenance='{"device": "<script>"}')._repr_html_()
    assert "&lt;script&gt;" in page
    assert "<script>" not in page
    assert "<td>500 mV</td>" in page


def test_arrays_of_different_length_are_refused():
    t = np.array([0.0, 1.0])
    with pytest.raises(ParameterError) as caught:
        Trace(t=t, v=t, i=np.zeros(3), q=t, s=t)
    assert str(caught.value) == ("Trace.i: expected axes (time,) as long as t, 2, got 3. Give one value per time.")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no\.npz: expected a trace file, got No such file or directory"):
        Trace.load(tmp_path / "no.npz")


@pytest.mark.parametrize("cut", [0, 10, 300, -30])
def test_a_truncated_file_is_refused(trace, tmp_path, cut):
    path = tmp_path / "a.npz"
    trace.save(path)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(FileFormatError, match=r"a\.npz: expected an npz file of a trace, got .* It may be truncated\."):
        Trace.load(path)


def test_a_damaged_file_is_refused_or_unharmed(trace, tmp_path):
    """One byte of the zip's own bookkeeping may not matter; no byte may change a number unnoticed."""
    path = tmp_path / "a.npz"
    trace.save(path)
    whole = path.read_bytes()
    refused = 0
    for place in range(0, len(whole), 7):
        data = bytearray(whole)
        data[place] ^= 0xFF
        path.write_bytes(bytes(data))
        try:
            back = Trace.load(path)
        except FileFormatError:
            refused += 1
        else:
            for name in ("t", "v", "i", "q", "s"):
                np.testing.assert_array_equal(getattr(back, name), getattr(trace, name))
    assert refused > 20


def test_a_single_array_is_not_a_trace(tmp_path):
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    (tmp_path / "a.npz").write_bytes(buffer.getvalue())
    with pytest.raises(FileFormatError, match=r"a\.npz: expected an npz file of a trace"):
        Trace.load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"header": None}, "header: expected text, got nothing. Check that this is a trace file."),
        ({"q": None}, "q: expected an array, got nothing. Make the trace again."),
        (
            {"header": np.array('{"format": "ohmloom.run", "version": 1}')},
            "format: expected 'ohmloom.trace', got 'ohmloom.run'. Check that this is the right file.",
        ),
        (
            {"v": np.zeros((2, 2))},
            "Trace.v: expected axes (time), got shape (2, 2). Give one axis per name.",
        ),
        ({"v": np.array(["a"])}, "v: expected numbers, got <U1. Make the trace again."),
    ],
)
def test_a_file_with_other_contents_is_told_what_was_expected(trace, tmp_path, change, message):
    path = tmp_path / "a.npz"
    trace.save(path)
    arrays = {name: array for name, array in {**arrays_of(path), **change}.items() if array is not None}
    np.savez(path, **arrays)
    with pytest.raises(FileFormatError) as caught:
        Trace.load(path)
    assert str(caught.value) == f"{path}: {message}"
