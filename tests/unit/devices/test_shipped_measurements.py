"""The synthetic sweeps that come with ohmloom: there by name, and exactly what the committed script makes."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from ohmloom.devices import Measurement
from ohmloom.errors import MissingFileError

ROOT = Path(__file__).parents[3]
SHIPPED = ROOT / "ohmloom" / "devices" / "measurements"
EXAMPLES = ROOT / "examples" / "measurements"


def test_examples_hold_the_same_files_as_the_package():
    names = [f"{name}.csv" for name in Measurement.shipped_names()]
    assert names == sorted(path.name for path in SHIPPED.iterdir()) == sorted(p.name for p in EXAMPLES.glob("*.csv"))
    for name in names:
        assert (SHIPPED / name).read_bytes() == (EXAMPLES / name).read_bytes()


def test_the_script_makes_these_files(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("make_measurements", EXAMPLES / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    monkeypatch.setattr(make, "FOLDERS", (tmp_path,))
    make.main()
    for name in Measurement.shipped_names():
        made, shipped = Measurement.read_csv(tmp_path / f"{name}.csv"), Measurement.read_csv(name)
        # Six digits are written; another processor's last bit may turn over the last of them.
        assert made.t == pytest.approx(shipped.t, rel=1e-5)
        assert made.v == pytest.approx(shipped.v, rel=1e-5, abs=1e-9)
        assert made.i == pytest.approx(shipped.i, rel=1e-5)


def test_a_name_that_is_neither_shipped_nor_a_file_is_refused():
    with pytest.raises(MissingFileError) as caught:
        Measurement.read_csv("picket")
    assert str(caught.value) == (
        "Measurement.read_csv: path: expected one of pickett, pickett_fast, redox, redox_staircase, got 'picket'. "
        "Did you mean 'pickett'? A file is given by its path, with its ending."
    )


def test_a_file_beats_a_shipped_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pickett").write_text("t,v,i\n0,0,0\n1,1,1e-3\n2,0,0\n")
    assert len(Measurement.read_csv("pickett").t) == 3
