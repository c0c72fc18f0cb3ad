"""`ohmloom circuit`: runs and decks of netlist files, and one line when something is wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ohmloom.circuits import Capacitor, Memristor, Netlist, NetlistTrace, Resistor, Sine, VoltageSource
from ohmloom.cli import main
from ohmloom.devices import Device

NETLIST = Netlist(name="low_pass", t_end=1.0, elements=(
    VoltageSource(name="V1", p="in", n="0", voltage=Sine(amplitude=1.0, frequency=2.0)),
    Memristor(name="M1", p="in", n="out", device=Device.load("hp_tio2"), s0=0.3),
    Resistor(name="R1", p="out", n="0", resistance=5e3),
    Capacitor(name="C1", p="out", n="0", capacitance=1e-6),
))  # fmt: skip


@pytest.fixture
def file(tmp_path):
    NETLIST.save(tmp_path / "low_pass.netlist.json")
    return tmp_path / "low_pass.netlist.json"


@pytest.fixture
def run(capsys):
    def call(*words):
        with pytest.raises(SystemExit) as caught:
            main(["circuit", *map(str, words)])
        captured = capsys.readouterr()
        return caught.value.code, captured.out, captured.err

    return call


def test_run_prints_voltages_and_states(run, file):
    code, out, err = run("run", file, "--points", 81)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].startswith("low_pass: 81 points to 1 s by ohmloom, Kirchhoff's residual ")
    assert lines[1].startswith("  v(in) from -1 V to 1 V, at the end ")
    assert lines[3].startswith("  s(M1) from 0.3 to ")
    assert len(lines) == 4


def test_run_writes_what_the_ending_says(run, file, tmp_path):
    for ending in (".csv", ".npz", ".png"):
        code, out, _ = run("run", file, "--points", 11, "--t-end", "500m", "--out", tmp_path / f"out{ending}")
        assert code == 0
        assert out.splitlines()[-1] == str(tmp_path / f"out{ending}")
    trace = NetlistTrace.load(tmp_path / "out.npz")
    assert trace.t.tolist() == np.linspace(0.0, 0.5, 11).tolist()
    head = (tmp_path / "out.csv").read_text().splitlines()
    assert head[1] == "t,v(in),v(out),i(V1),i(M1),i(R1),i(C1),s(M1),q(M1)"
    table = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=2)
    assert table[:, 2].tolist() == trace.v["out"].tolist()
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


def test_run_gives_one_json_object(run, file):
    code, out, _ = run("run", file, "--points", 101, "--json")
    table = json.loads(out)
    trace = NETLIST.simulate(points=101)
    assert code == 0
    assert (table["engine"], table["points"], table["t_end"], table["files"]) == ("ohmloom", 101, 1.0, [])
    assert table["v"]["out"] == {"min": trace.v["out"].min(), "max": trace.v["out"].max(), "end": trace.v["out"][-1]}


def test_export_writes_the_deck(run, file, tmp_path):
    code, out, _ = run("export", file, "--out", tmp_path / "a.cir", "--max-step", "1m")
    assert (code, out) == (0, f"{tmp_path / 'a.cir'}\n")
    assert (tmp_path / "a.cir").read_text() == NETLIST.to_spice(max_step=1e-3)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--out", "out.txt"), "--out: expected a file that ends in .csv, .npz, .png, got out.txt"),
        (("--t-end", "5 V"), "--t-end: expected a unit of s"),
        (("--max-step", "1"), "max_step: expected at most 0.125 s, the shortest edge of V1, got 1 s"),
    ],
)
def test_bad_option_is_one_line(run, file, words, text):
    code, out, err = run("run", file, *words)
    assert (code, out) == (2, "")
    assert text in err
    assert len(err.splitlines()) == 1


def test_input_is_not_overwritten(run, file):
    before = file.read_bytes()
    code, _, err = run("export", file, "--out", file)
    assert code == 2
    assert "expected to leave the input" in err
    assert file.read_bytes() == before


def test_engine_that_is_missing_exits_3(run, file, monkeypatch):
    monkeypatch.setenv("PATH", "")
    code, _, err = run("run", file, "--engine", "ngspice")
    assert code == 3
    assert err.startswith("ohmloom: run_ngspice: expected ngspice on PATH, got none.")
