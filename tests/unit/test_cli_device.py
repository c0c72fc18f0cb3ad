"""`ohmloom device` as a stranger meets it: fits of small files, files, and one line when something is wrong."""

from __future__ import annotations

import json
import sys
import tomllib

import numpy as np
import pytest

from ohmloom.cli import main
from ohmloom.devices import Comparison, Device, Fit, Measurement, Trace

QUICK = ("--screen", 10, "--starts", 1)


def loop(frequency=1.0, points=50):
    t = np.arange(float(points)) / (points * frequency)
    return Device.load("hp_tio2_10k").simulate(np.sin(2 * np.pi * frequency * t), t, s0=0.3)


def write(path, trace, columns="t,v,i", scale=1.0):
    """A table of the trace's time, voltage and current, or of the last two."""
    path.parent.mkdir(exist_ok=True)
    arrays = [trace.t, trace.v, scale * trace.i][-len(columns.split(",")) :]
    rows = "\n".join(",".join(map(repr, row)) for row in np.transpose(arrays).tolist())
    path.write_text(f"{columns}\n{rows}\n")
    return path


@pytest.fixture
def csv(tmp_path):
    return write(tmp_path / "loop.csv", loop())


@pytest.fixture
def bare(tmp_path):
    """A period without times, the current in uA."""
    return write(tmp_path / "bare.csv", loop(), columns="v,i_uA", scale=1e6)


@pytest.fixture
def run(capsys):
    def call(*words):
        with pytest.raises(SystemExit) as caught:
            main([str(word) for word in words])
        captured = capsys.readouterr()
        return caught.value.code, captured.out, captured.err

    return call


def one_line(err):
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    return lines[0]


def test_fit_prints_what_the_data_say_then_the_parameters(run, csv):
    code, out, err = run("device", "fit", csv, "--law", "hp_linear", *QUICK, "--seed", 4)
    assert code == 0
    lines = out.splitlines()
    assert lines[0].startswith("loop: 50 points in 980 ms, at v = 0 the current is ")
    assert lines[1].startswith("  This sweep cannot tell whether the conductance follows the charge: too few points")
    assert lines[2].startswith("hp_linear: relative RMS 0.0")
    assert any(text.startswith("warning: Fitted to one sweep, and nothing held out") for text in lines)
    assert err.splitlines()[0] == "fitting hp_linear to 1 sweep, 50 points, 10 random starts, seed 4"
    assert list(csv.parent.iterdir()) == [csv]


def test_verdict_is_told_before_the_fit_starts(run, csv, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    # By its module's name: the attribute `fit` of the package is the function.
    monkeypatch.setattr(sys.modules["ohmloom.devices.fitting.fit"], "search", stop)
    code, out, err = run("device", "fit", csv, "--law", "hp_linear", *QUICK)
    assert code == 130
    assert "This sweep cannot tell whether the conductance follows the charge" in out
    assert err.splitlines()[-1] == "ohmloom: interrupted."


def test_fit_writes_a_card_that_other_verbs_accept(run, csv, tmp_path):
    out = tmp_path / "fit"
    code, text, _ = run("device", "fit", csv, "--law", "hp_linear", *QUICK, "--name", "mine", "--out", out)
    assert code == 0
    written = [path for path in text.splitlines() if path.startswith(str(out))]
    assert {path.name for path in out.iterdir()} == {path.rpartition("/")[2] for path in written}
    assert {"device.toml", "fit.json", "fit.png", "fit.pdf"} <= {path.name for path in out.iterdir()}
    assert Fit.load(out / "fit.json").device == Device.load(out / "device.toml")
    assert tomllib.loads((out / "device.toml").read_text())["name"] == "mine"
    code, text, _ = run("device", "show", out / "device.toml")
    assert code == 0
    assert "95 % [" in text
    assert "  data: loop.csv, sha256 " in text
    code, text, _ = run("device", "emit", out / "device.toml", "--to", "spice")
    assert ".subckt mine p n" in text
    code, text, _ = run("device", "simulate", out / "device.toml")
    assert text.startswith("mine: ")


def test_same_seed_gives_the_same_bytes(run, csv, tmp_path):
    for name in ("a", "b"):
        run("device", "fit", csv, "--law", "hp_linear", *QUICK, "--profile", "--out", tmp_path / name)
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == ["device.toml", "fit.json", "fit.pdf", "fit.png", "profiles.png"]
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_json_is_one_object_with_units_and_verdicts(run, csv):
    code, out, _ = run("device", "fit", csv, "--law", "hp_linear", *QUICK, "--seed", 2, "--fix", "r_on=10k", "--json")
    assert code == 0
    table = json.loads(out)
    assert table["seed"] == 2
    assert table["files"] == []
    assert set(table["parameters"]) == {"r_off", "beta"}
    assert set(table["parameters"]["r_off"]) == {"value", "unit", "interval", "is_at_bound"}
    assert table["held"] == {"r_on": {"value": 1e4, "unit": "Ohm"}}
    assert table["sweeps"][0]["points"] == 50
    assert "conductance" in table["sweeps"][0]["revisit"]
    assert table["holdout_rms"] is None


def test_options_reach_the_reader_and_the_fit(run, bare, tmp_path):
    """Against `Measurement.read_csv` and `fit` with the same settings in Python."""
    from ohmloom.devices import fit

    out = tmp_path / "fit"
    code, _, _ = run(
        "device", "fit", bare, "--law", "peo_pani_redox", "--unit", "i_uA=uA", "--current", "i_uA",
        "--frequency", "1000mHz", "--series-resistance", "0.1k", "--rows", "0:48", "--every", 2, "--free", "asymmetry",
        "--fix", "k0=1", "--fix", "slope=100mV", "--fix", "e0=0.1", "--fix", "r_off=1MOhm",
        "--weights", "1nA,0.02", "--screen", 5, "--starts", 1, "--out", out,
    )  # fmt: skip
    assert code == 0
    sweep = Measurement.read_csv(bare, current="i_uA", units={"i_uA": "uA"}, frequency=1.0, series_resistance=100.0,
                                 rows=(0, 48), every=2)  # fmt: skip
    found = fit(sweep, "peo_pani_redox", free=["asymmetry"],
                fixed={"k0": 1.0, "slope": 0.1, "e0": 0.1, "r_off": 1e6}, weights=(1e-9, 0.02), screen=5, starts=1,
                rng=np.random.default_rng(0))  # fmt: skip
    assert Fit.load(out / "fit.json") == found


def test_frequency_and_resistor_are_one_for_all_or_one_for_each(run, tmp_path):
    slow = write(tmp_path / "slow.csv", loop(1.0), columns="v,i")
    fast = write(tmp_path / "fast.csv", loop(10.0), columns="v,i")
    words = ["device", "fit", slow, "--holdout", fast, "--law", "hp_linear", *QUICK, "--json"]
    table = json.loads(run(*words, "--frequency", 1, "--frequency", 10)[1])
    assert [table["sweeps"][0]["frequency"], table["holdout"][0]["frequency"]] == [1.0, 10.0]
    table = json.loads(run(*words, "--frequency", 1, "--series-resistance", 3)[1])
    both = [*table["sweeps"], *table["holdout"]]
    assert [(one["frequency"], one["series_resistance"]) for one in both] == [(1.0, 3.0), (1.0, 3.0)]
    code, out, err = run(*words, "--frequency", 1, "--frequency", 10, "--frequency", 1)
    assert (code, out) == (2, "")
    text = "expected 1 value for all files, or 2 (sweeps first, then hold-outs), got 3. Repeat the option once for each"
    assert one_line(err) == f"ohmloom: --frequency: {text} file."


def test_files_of_one_name_are_told_apart_and_a_file_twice_is_refused(run, csv, tmp_path):
    other = write(tmp_path / "b" / "loop.csv", loop(points=40))
    table = json.loads(run("device", "fit", csv, other, "--law", "hp_linear", *QUICK, "--json")[1])
    assert [sweep["name"] for sweep in table["sweeps"]] == [f"{tmp_path.name}/loop.csv", "b/loop.csv"]
    code, _, err = run("device", "fit", csv, "--holdout", csv, "--law", "hp_linear")
    assert code == 2
    assert "expected each file once, among sweeps and hold-outs, got" in one_line(err)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["csv", "--law", "hp_lineer"], "--law: expected one of hp_biolek, "),
        (["csv", "--law", "hp_linear", "--fix", "r_on"], "--fix: expected NAME=VALUE, got 'r_on'."),
        (["csv", "--law", "hp_linear", "--fix", "ron=5"], "--fix: expected one of beta, r_off, r_on, got 'ron'."),
        (["csv", "--law", "hp_linear", "--fix", "r_on=5V"], "--fix r_on: expected a unit of Ohm"),
        (["csv", "--law", "hp_linear", "--fix", "r_on=1e20"], "--fix: r_on: expected 0.001 to 1e+12 Ohm, got 1e+20"),
        (["csv", "--law", "hp_linear", "--free", "x"], "--free: expected one of beta, r_off, r_on, got 'x'."),
        (["csv", "--law", "hp_linear", "--weights", "rel"], "--weights: expected one of absolute, relative, got"),
        (["csv", "--law", "hp_linear", "--weights", "1,2,3"], "--weights: expected relative, absolute or A,B, got"),
        (["csv", "--law", "hp_linear", "--weights", "0,1"], "--weights: expected a > 0 A and b >= 0 in a + b |i|"),
        (["csv", "--law", "hp_linear", "--rows", "0:4"], "CSV: expected more points than the 4 unknowns of hp_linear"),
        (["csv", "--law", "hp_linear", "--rows", "4"], "--rows: expected START:STOP, two row numbers from 0, got '4'."),
        (["csv", "--law", "hp_linear", "--rows", "0:99"], "--rows: expected 0 <= start < stop <= 50, the rows of "),
        (["csv", "--law", "hp_linear", "--every", "0"], "--every: expected an integer >= 1, got 0."),
        (["csv", "--law", "hp_linear", "--invert-current"], "got one of the wrong sign. Pass --invert-current, or"),
        (["csv", "--law", "hp_linear", "--series-resistance", "5V"], "--series-resistance: expected a unit of Ohm"),
        (["csv", "--law", "hp_linear", "--series-resistance", "1G"], "--series-resistance: expected less than "),
        (["csv", "--law", "hp_linear", "--frequency", "1"], "Leave --frequency out, or pass --no-time to ignore the"),
        (["csv", "--law", "hp_linear", "--sample-interval", "1"], "Leave --sample-interval out, or pass --no-time to"),
        (["csv", "--law", "hp_linear", "--no-time", "--frequency", "1", "--sample-interval", "1s"],
         "--frequency, --sample-interval: expected one of them, got both."),
        (["csv", "--law", "hp_linear", "--sample-interval", "0"], "--sample-interval: expected a number above 0 s"),
        (["csv", "--law", "hp_linear", "--current", "v"], "got --time 't', --voltage 'v', --current 'v'. Correct one."),
        (["bare", "--law", "hp_linear"], "Name the column (--time NAME), or give --frequency HZ if the file is one "),
        (["bare", "--law", "hp_linear", "--frequency", "1"], "Did you mean --current 'i_uA'?"),
        (["bare", "--law", "hp_linear", "--frequency", "1", "--current", "i_uA"], "Pass --unit i_uA=uA."),
        (["bare", "--law", "hp_linear", "--frequency", "1", "--current", "i_uA", "--unit", "i=uA"],
         "--unit: expected one of i_uA, v, got 'i'. Did you mean 'i_uA'?"),
        (["bare", "--law", "hp_linear", "--unit", "i_uA"], "--unit: expected COLUMN=UNIT, got 'i_uA'."),
        (["none.csv", "--law", "hp_linear"], "none.csv: expected a measurement file, got No such file"),
    ],
)  # fmt: skip
def test_bad_input_names_the_option_and_nothing_is_printed_or_written(run, csv, bare, tmp_path, words, text):
    paths = {"csv": csv, "bare": bare}
    code, out, err = run("device", "fit", *[paths.get(word, word) for word in words], "--out", tmp_path / "fit")
    assert (code, out) == (2, "")
    assert text in one_line(err)
    assert "Measurement." not in err.replace("Measurement.i: expected a current", "")
    assert not (tmp_path / "fit").exists()


@pytest.mark.parametrize(("verb", "name", "words"), [
    ("fit", "fit.json", ("--law", "hp_linear")), ("compare", "linear.toml", ("--laws", "linear,hp_linear")),
])  # fmt: skip
def test_an_input_is_never_replaced(run, csv, tmp_path, verb, name, words):
    source = csv.rename(tmp_path / name)
    before = source.read_bytes()
    code, out, err = run("device", verb, source, *words, "--out", tmp_path)
    assert (code, out) == (2, "")
    assert f"--out: expected to leave the input {source} alone" in one_line(err)
    assert source.read_bytes() == before
    assert list(tmp_path.iterdir()) == [source]


def test_folder_in_the_place_of_a_file_is_refused_before_the_fit(run, csv, tmp_path):
    (tmp_path / "out" / "fit.png").mkdir(parents=True)
    code, out, err = run("device", "fit", csv, "--law", "hp_linear", "--out", tmp_path / "out")
    assert (code, out) == (2, "")
    assert "--out: expected a place for the file fit.png, got a folder" in one_line(err)


def test_compare_ranks_and_writes_a_card_for_each_law(run, csv, tmp_path):
    held_out = write(tmp_path / "fast.csv", loop(2.0))
    words = ("device", "compare", csv, "--holdout", held_out, "--laws", "linear, hp_linear", *QUICK)
    code, out, err = run(*words, "--out", tmp_path / "out")
    assert code == 0
    assert "fitting 2 laws to 1 sweep, 50 points, 10 random starts each, seed 0" in err
    ranking = out[out.index("delta BIC") :].splitlines()[1:3]
    ranked = [line.split()[0] for line in ranking]
    assert sorted(ranked) == ["hp_linear", "linear"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "linear.toml", "hp_linear.toml", "comparison.json", "comparison.png", "comparison.pdf"}  # fmt: skip
    saved = Comparison.load(tmp_path / "out" / "comparison.json")
    assert Device.load(tmp_path / "out" / "linear.toml") == saved.fits["linear"].device
    table = json.loads(run(*words, "--json")[1])
    assert [row["law"] for row in table["ranking"]] == ranked
    assert table["by_holdout"] == list(saved.by_holdout)
    assert table["fits"]["linear"]["relative_rms"] == saved.fits["linear"].relative_rms


def test_compare_refuses_an_unknown_law_and_one_twice(run, csv):
    for laws, text in (("hp_linear,lineer", "--laws: expected one of "), ("linear,linear", "--laws: expected each law"),
                       (",", "--laws: expected the names of at least one law")):  # fmt: skip
        code, out, err = run("device", "compare", csv, "--laws", laws)
        assert (code, out) == (2, "")
        assert text in one_line(err)


def test_simulated_csv_is_read_as_a_measurement_to_the_last_bit(run, tmp_path):
    path = tmp_path / "loop.csv"
    words = ("device", "simulate", "hp_tio2", "--amplitude", "500mV", "--frequency", "2Hz", "--periods", 2)
    words = (*words, "--points", 50)
    code, out, _ = run(*words, "--s0", 0.2, "--out", path)
    assert code == 0
    assert out.splitlines()[-1] == str(path)
    read = Measurement.read_csv(path)
    t = np.arange(101) / 50 / 2.0
    np.testing.assert_array_equal(read.t, t)
    made = Device.load("hp_tio2").simulate(0.5 * np.sin(2 * np.pi * (np.arange(101) / 50)), t, s0=0.2)
    np.testing.assert_array_equal(read.v, made.v)
    np.testing.assert_array_equal(read.i, made.i)
    assert path.read_text().splitlines()[1] == "t,v,i,q,s"
    assert run(*words, "--s0", 0.2, "--out", tmp_path / "loop.npz")[0] == 0
    np.testing.assert_array_equal(Trace.load(tmp_path / "loop.npz").s, made.s)
    assert run(*words, "--out", tmp_path / "loop.png")[0] == 0
    assert (tmp_path / "loop.png").read_bytes()[1:4] == b"PNG"


def test_lobe_area_is_that_of_a_fine_polygon(run):
    """One lobe of HP's loop against the shoelace formula on ten times the points; the trapezium errs by 1/points^2."""
    table = json.loads(run("device", "simulate", "hp_tio2", "--amplitude", "0.5", "--points", 400, "--json")[1])
    t = np.linspace(0.0, 0.5, 2001)
    lobe = Device.load("hp_tio2").simulate(0.5 * np.sin(2 * np.pi * t), t, s0=0.5)
    shoelace = 0.5 * abs(np.sum(lobe.v * np.roll(lobe.i, -1) - lobe.i * np.roll(lobe.v, -1)))
    assert table["lobe_area"][0] == pytest.approx(shoelace, rel=1e-3)
    assert table["lobe_area"][1] == pytest.approx(table["lobe_area"][0], rel=1e-6)
    assert table["s_range"][0] == 0.5


def test_triangle_peaks_at_a_quarter_and_a_drive_is_read_from_a_file(run, tmp_path):
    path = tmp_path / "t.csv"
    run("device", "simulate", "linear", "--waveform", "triangle", "--points", 8, "--out", path)
    trace = Measurement.read_csv(path)
    np.testing.assert_allclose(trace.v, [0, 0.5, 1, 0.5, 0, -0.5, -1, -0.5, 0], atol=1e-15)
    again = tmp_path / "again.csv"
    code, out, _ = run("device", "simulate", "linear", "--drive", path, "--out", again)
    assert code == 0
    assert "lobe areas of the drive" in out
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(("words", "text"), [
    (["simulate", "hp_tio2", "--out", "x.txt"], "--out: expected a file that ends in .csv, .npz, .png, got x.txt."),
    (["simulate", "hp_tio2", "--amplitude", "3A"], "--amplitude: expected a unit of V"),
    (["simulate", "hp_tio2", "--frequency", "0"], "--frequency: expected a number above 0 Hz, got 0 Hz."),
    (["simulate", "hp_tio2", "--s0", "3"], "hp_tio2: s0: expected 0 <= s0 <= 1, got 3."),
    (["simulate", "hp_tio2", "--drive", "drive.csv"], "drive.csv: column: expected one of time, v, got 't'."),
    (["simulate", "hp_tio2", "--drive", "d.csv", "--out", "d.csv"], "--out: expected to leave the input d.csv alone"),
    (["emit", "hp_tio2", "--to", "c", "--out", "."], "--out: expected a file, got the folder ."),
    (["emit", "hp_tio2", "--to", "ada"], "'ada' is not one of 'c', 'spice', 'verilog-a'"),
])  # fmt: skip
def test_bad_simulation_is_one_line(run, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.csv").write_text("time,v\n0,0\n1,1\n")
    (tmp_path / "d.csv").write_text("t,v\n0,0\n1,1\n")
    code, out, err = run("device", *words)
    assert (code, out) == (2, "")
    assert text in one_line(err)
    assert {path.name for path in tmp_path.iterdir()} == {"drive.csv", "d.csv"}


@pytest.mark.parametrize(("language", "mark"), [("c", "double"), ("spice", ".subckt"), ("verilog-a", "module hp_tio2")])
def test_emit_writes_what_it_prints(run, tmp_path, language, mark):
    code, out, _ = run("device", "emit", "hp_tio2", "--to", language)
    assert code == 0
    assert mark in out
    assert run("device", "emit", "hp_tio2", "--to", language, "--out", tmp_path / "file")[0] == 0
    assert (tmp_path / "file").read_text() == out


def test_laws_are_listed_with_units_and_bounds(run):
    out = run("device", "list", "--laws")[1]
    assert "hp_linear: HP TiO2, linear drift" in out
    assert any(line.split()[:5] == ["r_on", "Ohm", "0.001", "to", "1e+12"] for line in out.splitlines())
    laws = {law["name"]: law for law in json.loads(run("device", "list", "--laws", "--json")[1])}
    redox = {parameter["name"]: parameter for parameter in laws["peo_pani_redox"]["parameters"]}
    assert redox["mirror"]["is_fitted"] is False
    assert redox["k0"]["unit"] == "1/s"


def test_progress_is_shown_once_a_fit_takes_long(run, csv, monkeypatch):
    quick = run("device", "fit", csv, "--law", "linear", *QUICK, "--json")[2]
    monkeypatch.setattr("ohmloom._cli_fit.PATIENCE", 0.0)
    slow = run("device", "fit", csv, "--law", "linear", *QUICK, "--json")[2]
    assert slow.startswith(quick)
    assert "best relative RMS 0." in slow.splitlines()[-1]


def test_a_long_default_is_apart_from_what_it_means(run):
    assert "default 3.33333e+09 " in run("device", "list", "--laws")[1]


def test_an_out_that_is_a_broken_link_is_refused_before_the_fit(tmp_path, capsys):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(SystemExit) as stopped:
        main(["device", "fit", "redox", "--law", "peo_pani_redox", "--out", str(tmp_path / "link")])
    assert stopped.value.code == 2
    message = f"ohmloom: --out: expected a folder, got the broken link {tmp_path / 'link'}. Use another path.\n"
    assert capsys.readouterr().err == message
