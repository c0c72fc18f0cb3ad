"""Options of the export, the check's table, runs, and the command line."""

import csv
import json
import math

import numpy as np
import pytest

from ohmloom.circuits import (
    Memristor,
    MemristorCrossbar,
    Netlist,
    PulseTrain,
    VoltageSource,
    memristor_netlist,
)
from ohmloom.cli import main
from ohmloom.devices import Device
from ohmloom.errors import OperationError, ParameterError, UnknownNameError
from ohmloom.fmu import check, export_device, run
from ohmloom.fmu._units import base_exponents
from ohmloom.neurocontroller import champion

V, END = 0.8, 1.0 - math.sqrt(1.0 - 2.0 * 0.8 * 0.5)  # of q from 0 after 0.5 s: (1 - q)^2 = 1 - 2 v t


@pytest.fixture(scope="module")
def hp(tmp_path_factory):
    return export_device(Device.load("hp_tio2_paper"), tmp_path_factory.mktemp("hp") / "hp.fmu", q0=0.0).path


@pytest.fixture
def command(capsys):
    def call(*words):
        with pytest.raises(SystemExit) as caught:
            main(["fmu", *map(str, words)])
        captured = capsys.readouterr()
        return caught.value.code, captured.out, captured.err

    return call


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("1/s", {"s": -1}),
        ("1/V", {"kg": -1, "m": -2, "s": 3, "A": 1}),
        ("Ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("m2/(V s)", {"kg": -1, "s": 2, "A": 1}),
    ],
)
def test_units(unit, exponents):
    assert base_exponents(unit) == exponents


def test_an_unknown_unit_is_named():
    with pytest.raises(UnknownNameError, match=r"unit V/furlong: expected one of .* got 'furlong'"):
        base_exponents("V/furlong")


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        ({"out": "x.zip"}, ParameterError, "export_device: out: expected a file that ends in .fmu, got 'x.zip'"),
        ({"fmi": 1}, ParameterError, "export_device: fmi: expected 2 or 3, got 1. Choose one."),
        ({"platforms": "mac"}, UnknownNameError, "export_device: platforms: expected one of all, host, got 'mac'"),
        ({"q0": 2.0}, ParameterError, "export_device: q0: expected 0 <= q0 <= q_d = 0.99 C, got 2 C. Correct it."),
        ({"q0": math.nan}, ParameterError, "export_device: q0: expected a charge in C, got nan"),
        ({"device": "hp"}, ParameterError, "export_device: device: expected Device, got 'hp'"),
    ],
)
def test_bad_options(tmp_path, options, kind, text):
    given = {"device": Device.load("hp_tio2_paper"), "out": tmp_path / "x.fmu", **options}
    with pytest.raises(kind) as caught:
        export_device(given.pop("device"), given.pop("out"), **given)
    assert str(caught.value).startswith(text)
    assert list(tmp_path.iterdir()) == []


def test_all_platforms_need_ziglang(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(OperationError, match=r"expected ziglang, .* got none. Install ohmloom's extra 'fmu'."):
        export_device(Device.load("hp_tio2"), tmp_path / "x.fmu", platforms="all")


def test_the_charge_starts_at_half_weight(tmp_path):
    trace = run(export_device(Device.load("hp_tio2"), tmp_path / "hp.fmu").path, stop_time=0.1)
    assert trace.values["weight"][0] == pytest.approx(0.5, rel=1e-12)


def test_run_gives_arrays_and_a_table(hp, tmp_path):
    trace = run(hp, stop_time=0.5, start_values={"v": V}, step_size=0.05)
    assert trace.t.tolist() == pytest.approx([0.05 * k for k in range(11)])
    assert trace.values["q"][-1] == pytest.approx(END, abs=1e-7)  # 1e-8 for each step
    assert not trace.t.flags.writeable
    trace.write_csv(tmp_path / "x.csv")
    rows = list(csv.reader((tmp_path / "x.csv").read_text().splitlines()))
    assert rows[0] == ["time", "q", "i", "memristance", "weight"]
    assert [float(x) for x in rows[-1]] == [trace.t[-1], *(x[-1] for x in trace.values.values())]
    assert [line.get_label() for line in trace.plot(["q"]).lines] == ["q"]
    with pytest.raises(UnknownNameError, match=r"^FmuTrace\.plot: expected one of i, "):
        trace.plot(["p"])


def test_run_by_model_exchange_and_with_inputs(hp):
    trace = run(
        hp, stop_time=0.5, start_values={"v": V}, interface="ModelExchange", tolerance=1e-9, outputs=["q", "der(q)"]
    )
    assert trace.values["q"][-1] == pytest.approx(END, abs=1e-6)  # CVode's own error
    t = np.array([0.0, 0.25, 0.25, 0.5])
    held = run(hp, stop_time=0.5, step_size=0.01, inputs={"v": [V, V, -V, -V], "time": t})
    assert held.values["q"][-1] == pytest.approx(0.0, abs=1e-9)


def test_check_passes_and_says_what(hp):
    found = check(hp, start_values={"v": V})
    assert found.passed, found.rows
    table = {(row.what, row.client): row.status for row in found.rows}
    assert table["validation", "FMPy"] == table["CoSimulation", "FMPy"] == table["ModelExchange", "FMPy"] == "passed"
    assert table["state round trip", "FMPy"] == "passed"
    assert {client for _, client in table} == {"FMPy", "loader", "fmuloader", "libcosimpy", "pathsim"}
    assert found.to_dict()["passed"] is True
    assert "<td>passed</td>" in found._repr_html_()


def test_the_command_line_exports_checks_and_runs(command, tmp_path):
    file = tmp_path / "hp.fmu"
    code, out, err = command("export", "device", "hp_tio2_paper", "--q0", "0 C", "--fmi", "3", "--out", file)
    assert (code, err) == (0, "")
    assert out.startswith(f"{file} (")
    code, out, _ = command("check", file, "--start-values", "v=0.8")
    assert code == 0
    assert out.startswith(f"{file}: FMI 3.0, passed\n")
    words = ["run", file, "--stop-time", "500ms", "--start-values", "v=0.8", "--output-file", tmp_path / "x.csv"]
    code, out, err = command(*words)
    assert code == 0
    assert out.splitlines()[1].startswith("  q from 0 to ")
    assert err == f"{tmp_path / 'x.csv'}\n"
    code, out, _ = command(*words, "--json")
    assert json.loads(out)["values"]["q"]["end"] == pytest.approx(END, abs=1e-9)
    # As FMPy has it.
    code, out, _ = command("run", "--start-values", "v", "0.8", "q0", "0", file, "--stop-time", "0.5", "--json")
    assert json.loads(out)["values"]["q"]["end"] == pytest.approx(END, abs=1e-9)
    # What is written is what is read.
    (tmp_path / "in.csv").write_text("time,v\n0,0.8\n1,0.8\n")
    code, out, _ = command("run", file, "--stop-time", "0.5", "--input-file", tmp_path / "in.csv", "--json")
    assert json.loads(out)["values"]["q"]["end"] == pytest.approx(END, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["export", "device", "hp_tio3", "--out", "x.fmu"], "Did you mean 'hp_tio2'?"),
        (["export", "device", "hp_tio2", "--out", "x.zip"], "export_device: out: expected a file that ends in .fmu"),
        (["export", "device", "hp_tio2", "--out", "x.fmu", "--q0", "1 V"], "--q0: expected a unit of C"),
        (["export", "device", "--out", "x.fmu"], "fmu export device: expected a CARD, got none. Name it."),
        (["export", "controller", "none.net.json", "--out", "x.fmu"], "none.net.json: expected a network file"),
        (
            ["export", "crossbar", "none.net.json", "--out", "x.fmu"],
            "--hardware: expected one for hardware or a tile",
        ),
        (
            ["export", "device", "hp_tio2", "--hardware", "ideal", "--out", "x.fmu"],
            "--hardware: expected one for hardware",
        ),
        (["export", "crossbar", "none.netlist.json", "--out", "x.fmu"], "none.netlist.json: expected"),
        (["export", "arena", "net.json", "--out", "x.fmu"], "fmu export arena: expected no file, got 'net.json'."),
        (["export", "arena", "--out", "x.ssp"], "export_arena: out: expected a file that ends in .fmu, got 'x.ssp'."),
        (["export", "arena", "--q0", "1", "--out", "x.fmu"], "--q0: expected a device, got arena. Leave it out."),
        (["run", "none.ssp"], "none.ssp: expected an SSP file, got none. Check the path."),
        (["run", "none.ssp", "--relative-tolerance", "1"], "--relative-tolerance: expected an FMU, got the system"),
        (["run", "none.fmu"], "none.fmu: expected an FMU file, got none. Check the path."),
        (["run", "none.fmu", "--start-values", "v"], "--start-values: expected NAME=VALUE, got 'v'. Write it so."),
        (["run", "none.fmu", "--stop-time", "1 V"], "--stop-time: expected a unit of s"),
        (["check", "none.fmu"], "none.fmu: expected an FMU file, got none. Check the path."),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(command, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert text in err
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_exports_a_loop_and_runs_it(command, tmp_path):
    net, fmu, ssp = tmp_path / "het.net.json", tmp_path / "loop.fmu", tmp_path / "loop.ssp"
    champion("HET").save(net)
    ends = []
    for out in (fmu, ssp):
        options = ["--task", "dynamic", "--trial-key", "7", "--out", out]
        assert command("export", "system", net, *options)[0] == 0
        code, text, _ = command("run", out, "--stop-time", "3.2", "--json")
        assert code == 0
        values = json.loads(text)["values"]
        ends.append([values[("arena." if out == ssp else "") + name]["end"] for name in ("x", "y", "st")])
    assert ends[0] == ends[1]
    assert ends[0][2] >= 100
    deck = tmp_path / "pair.netlist.json"
    parts = [
        Memristor(name=f"M{k}", p=p, n=n, device=Device.load("hp_tio2"), s0=0.5)
        for k, (p, n) in enumerate(("ab", "b0"))
    ]
    Netlist(elements=(VoltageSource(name="V1", p="a", n="0", voltage=1.0), *parts)).save(deck)
    for kind, source in (("controller", [net]), ("arena", []), ("crossbar", [deck]),
                         ("hardware-controller", [net, "--hardware", "ideal", "--seed", "2"])):  # fmt: skip
        code, text, _ = command("export", kind, *source, "--fmi", "3", "--out", tmp_path / f"{kind}.fmu", "--json")
        assert code == 0
        assert json.loads(text)["platforms"]


def test_the_command_line_exports_arrays(command, tmp_path):
    deck, file = tmp_path / "array.netlist.json", tmp_path / "array.fmu"
    array = MemristorCrossbar(devices=Device.load("hp_tio2_10k"), s=np.full((2, 3), 0.4), r_row=1.0, r_column=1.0)
    rest = PulseTrain(t=np.array([0.0, 1.0]), v_row=np.zeros((2, 2)), v_column=np.zeros((2, 3)))
    memristor_netlist(array, rest).save(deck)
    words = ["export", "crossbar", deck, "--arrays", "--out", file]
    # FMI 2.0, the default, has none.
    code, out, err = command(*words)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "arrays: expected FMI 3.0, since FMI 2.0 has no arrays, got fmi=2. Set fmi=3." in err
    code, _, err = command("export", "device", "hp_tio2", "--fmi", "3", "--arrays", "--out", file)
    assert (code, len(err.splitlines())) == (2, 1)
    assert "--arrays: expected " in err
    assert not file.exists()
    assert command(*words, "--fmi", "3")[0] == 0
    code, out, _ = command("run", file, "--stop-time", "0.1", "--json")
    assert code == 0
    assert [name for name in json.loads(out)["values"] if name.startswith("q[")] == [
        f"q[{i},{j}]" for i in range(2) for j in range(3)
    ]


def test_a_failed_check_exits_1(command, tmp_path, monkeypatch):
    monkeypatch.setattr("ohmloom.fmu._compile.find_compiler", lambda: None)
    export_device(Device.load("hp_tio2"), tmp_path / "sources.fmu")
    code, out, _ = command("check", tmp_path / "sources.fmu")
    assert code == 1
    assert "FAILED" in out
    assert "expected a library for" in out
