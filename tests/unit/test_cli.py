"""The command line as a stranger meets it: answers, files, exit codes, and one line when something is wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ohmloom.cli import main
from ohmloom.neurocontroller import Network


@pytest.fixture
def net(tmp_path):
    path = tmp_path / "small.net.json"
    Network.random(system="HP", rng=np.random.default_rng(1), hidden=3).save(path)
    return path


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
    assert "Traceback" not in err
    return lines[0]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["evalute"], "No such command 'evalute'. Did you mean"),
        (["evaluate"], "Missing argument 'NET...'."),
        (["evolve", "--system", "XX", "--out", "x"], "Invalid value for '--system': 'XX' is not one of"),
        (["evolve", "--system", "HP"], "Missing option '--out'."),
        (["evolve", "--system", "HP", "--out", "x", "--repeats", "0"], "Invalid value for '--repeats'"),
        (["evaluate", "none.net.json", "--hardware", "ideal"], "none.net.json: expected a network file, got No such"),
        (["device", "show", "hp_tio3"], "Did you mean 'hp_tio2'?"),
        (["replay", "none.net.json", "--out", "film.mp4"], "--out: expected a file that ends in .gif, .html, .png"),
        (["evaluate", "x.net.json", "--hardware", "ideal", "--dies", "-1"], "Invalid value for '--dies'"),
    ],
)  # fmt: skip
def test_bad_usage_is_one_line_and_exit_2(run, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*words)
    assert code == 2
    assert out == ""
    assert text in one_line(err)
    assert list(tmp_path.iterdir()) == []


def test_unknown_hardware_offers_the_nearest(run, net, tmp_path):
    code, _, err = run("evaluate", net, "--hardware", "het_mixd", "--out", tmp_path / "study")
    assert code == 2
    assert "got 'het_mixd'. Did you mean 'het_mixed'?" in one_line(err)
    assert not (tmp_path / "study").exists()


def test_several_problems_are_counted_and_shown_on_request(run, net, tmp_path):
    text = net.read_text().replace('"weight": 0.5', '"weight": -1', 2)
    bad = tmp_path / "bad.net.json"
    bad.write_text(text)
    code, _, err = run("map", bad, "--hardware", "hp_1t1r", "--out", tmp_path / "map")
    assert code == 2
    assert one_line(err).endswith("(and 1 more; see --verbose)")
    assert "synapses[0].weight: expected greater than or equal to 0" in err
    code, _, err = run("map", bad, "--hardware", "hp_1t1r", "--out", tmp_path / "map", "--verbose")
    assert code == 2
    assert len(err.strip().splitlines()) == 2
    assert not (tmp_path / "map").exists()


def test_out_that_is_a_file_is_refused_before_any_work(run, net):
    before = net.read_bytes()
    code, _, err = run("evaluate", net, "--hardware", "hp_1t1r", "--out", net)
    assert code == 2
    assert "--out: expected a folder, got the file" in one_line(err)
    assert net.read_bytes() == before


@pytest.mark.parametrize("verb", ["map", "evaluate", "replay"])
def test_output_never_replaces_an_input(run, net, verb):
    """A network file under the name of an output, in the folder that the outputs go to."""
    name = {"map": "plan.json", "evaluate": "report.json", "replay": "trial.html"}[verb]
    source = net.with_name(name)
    source.write_bytes(net.read_bytes())
    out = source if verb == "replay" else source.parent
    code, _, err = run(verb, source, "--hardware", "hp_1t1r", "--out", out)
    assert code == 2
    assert "expected to leave the input" in one_line(err)
    assert source.read_bytes() == net.read_bytes()


def test_pairs_are_told_apart_by_their_files(run, net, tmp_path):
    other = tmp_path / "other.net.json"
    other.write_bytes(net.read_bytes().replace(b'"network"', b'"../../escape"'))
    run("evaluate", net, other, "--hardware", "hp_1t1r", "--dies", 0, "--out", tmp_path / "studies")
    assert {p.name for p in (tmp_path / "studies").iterdir()} == {"small_hp_1t1r", "other_hp_1t1r", "comparison.json"}
    code, _, err = run("evaluate", net, net, "--hardware", "hp_1t1r", "--dies", 0, "--out", tmp_path / "twice")
    assert code == 2
    assert "got small_hp_1t1r twice" in one_line(err)
    assert not (tmp_path / "twice").exists()


def test_replay_of_a_die_is_the_trial_of_evaluate(run, net, tmp_path):
    _, out, _ = run("evaluate", net, "--hardware", "hp_1t1r", "--dies", 2, "--seed", 3, "--json")
    die = json.loads(out)["dies"][1]
    page = tmp_path / "die.html"
    _, out, _ = run("replay", net, "--hardware", "hp_1t1r", "--die", 1, "--seed", 3, "--out", page)
    assert ("goal reached" in out) == die["hardware"]
    code, _, err = run("replay", net, "--die", 1, "--out", page)
    assert code == 2
    assert "expected --hardware with it" in one_line(err)


def test_kernels_without_a_cache_folder_leave_nothing_in_the_package(tmp_path):
    """A cache that cannot be written must not end beside the sources, where nothing tells old kernels from new."""
    (tmp_path / "file").write_text("")
    code = "import os, ohmloom._jit; print(os.environ['NUMBA_CACHE_DIR'])"
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment["OHMLOOM_CACHE"] = str(tmp_path / "file")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert "ohmloom-kernels-" in done.stdout


def test_kind_that_cannot_be_built_is_named(run, tmp_path):
    path = tmp_path / "het.net.json"
    Network.random(system="HET", rng=np.random.default_rng(1)).save(path)
    code, _, err = run("evaluate", path, "--hardware", "hp_1t1r")
    assert code == 2
    assert "cards.peo_pani: expected a device card, got none" in one_line(err)


def test_map_writes_what_is_needed_to_build_and_drive_it(run, net, tmp_path):
    code, out, _ = run("map", net, "--hardware", "hp_1t1r", "--out", tmp_path / "map")
    assert code == 0
    synapses = len(Network.load(net).synapses)
    for text in (
        f"all {synapses} synapses placed on 1 tile", "assumed: drive.pulse_voltage = 1 V", "reset takes ",
        " in ascending order, ", "counted: ", "signs by row_polarity (this plan)", "not counted: ",
    ):  # fmt: skip
        assert text in out
    names = {"plan.json", "placement.csv", "reset.csv", "cost.csv", "pulses.csv", "crossbars.png", "example.png",
             "pulses.png", "tile_0.cir", "tile_0.netlist.json"}  # fmt: skip
    assert {p.name for p in (tmp_path / "map").iterdir()} == names
    assert {Path(line).name for line in out.splitlines()[-len(names) :]} == names
    assert len((tmp_path / "map" / "placement.csv").read_text().splitlines()) == synapses + 1


def test_map_json_has_the_same_numbers(run, net, tmp_path):
    code, out, _ = run("map", net, "--hardware", "hp_passive", "--out", tmp_path / "map", "--json")
    table = json.loads(out)
    assert code == 0
    assert {Path(name).name for name in table["files"]} == {p.name for p in (tmp_path / "map").iterdir()}
    assert "tile_0_pulses.csv" in {Path(name).name for name in table["files"]}
    (tile,) = table["tiles"]
    assert 0.0 < tile["read_error"]["refined"] <= tile["read_error"]["given"]
    assert table["synapses"] == tile["synapses"] == len(Network.load(net).synapses)
    assert table["reset"]["duration"] > 0.0
    assert [way["signs"] for way in table["cost"]["signs"]] == ["row_polarity", "column_pair", "differential_pair"]
    assert any("drive.pulse_voltage" in line for line in table["assumed"])


def test_evaluate_json_can_be_retraced(run, net, tmp_path):
    code, out, err = run("evaluate", net, "--hardware", "hp_1t1r", "--dies", 2, "--json", "--out", tmp_path / "study")
    table = json.loads(out)
    assert code == (0 if table["verdict"] == "PASS" else 1)
    assert {"verdict", "reasons", "figures", "success", "exactness"} <= set(table)
    for figure in table["figures"]:
        assert {"name", "value", "unit", "limit", "margin", "source", "status"} <= set(figure)
    assert table["success"]["n"] == 2
    assert json.loads((tmp_path / "study" / "report.json").read_text()) == table
    assert "seed 0" in err
    page = (tmp_path / "study" / "report.html").read_text()
    assert table["verdict"] in page
    assert "ohmloom evaluate" in page
    folder = tmp_path / "study"
    code, out, _ = run("status", folder, "--json")
    assert (code, json.loads(out)["finished"]) == (0, True)
    assert {tuple(part["name"].split("_")[:1]): part["done"] - part["units"] for part in json.loads(out)["parts"]} == {
        ("dies",): 0, ("yield",): 0,
    }  # fmt: skip
    code, _, err = run("evaluate", net, "--hardware", "hp_1t1r", "--dies", 3, "--out", folder)
    assert (code, "settings.dies: expected 3, got 2. Use another --out" in err.splitlines()[-1]) == (2, True)
    # Another driver finds all done, of the same network and hardware as they stand in the folder.
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    next(folder.glob("units/dies_*/000001.json")).unlink()
    net.unlink()
    code, _, err = run("work", folder, "--shard", "2/2", "--workers", 1)
    assert (code, "all units are done" in err) == (0, True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_evaluate_of_several_pairs(run, net):
    _, out, _ = run("evaluate", net, "--hardware", "hp_1t1r", "--hardware", "ideal", "--dies", 0, "--json")
    pairs = json.loads(out)["pairs"]
    assert [pair["provenance"]["hardware"] for pair in pairs] == ["hp_1t1r", "ideal"]
    assert all(pair["success"] is None for pair in pairs)


def test_pairs_that_cannot_be_built_are_listed_last(run, net, tmp_path):
    code, out, _ = run("evaluate", net, "--hardware", "peo_pani", "--hardware", "ideal", "--dies", 0, "--out", tmp_path)
    assert code == 1
    last = out.splitlines()[-1].split(maxsplit=2)
    assert last[0] == "-"
    assert last[2].endswith("cannot be built: no card for hp")
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {"small_ideal"}
    rows = json.loads((tmp_path / "comparison.json").read_text())
    assert [(row["rank"], row["hardware"]) for row in rows] == [(1, "ideal"), (None, "peo_pani")]


def test_one_pair_that_cannot_be_built_is_an_error(run, net):
    code, out, err = run("evaluate", net, "--hardware", "peo_pani", "--dies", 0)
    assert (code, out) == (2, "")
    assert "peo_pani: cards.hp: expected a device card, got none" in one_line(err)


@pytest.mark.parametrize("suffix", ["png", "gif", "html"])
def test_replay_writes_its_file(run, net, tmp_path, suffix):
    path = tmp_path / f"trial.{suffix}"
    code, out, _ = run("replay", net, "--out", path)
    assert code == 0
    assert "timesteps" in out
    assert path.stat().st_size > 1000


def test_evolve_prints_results_and_resumes(run, tmp_path):
    words = ("evolve", "--system", "GA", "--generations", 2, "--population", 4, "--out", tmp_path / "run", "--json")
    code, out, err = run(*words)
    assert code == 0
    assert json.loads(out)["repeats"][0]["network"].endswith("GA_0.net.json")
    assert "GA 0: 2 of 2" in err
    assert run(*words)[1] == out


def test_evolve_with_other_settings_names_the_first_that_differs(run, tmp_path):
    words = ["evolve", "--system", "GA", "--generations", 1, "--population", 4, "--out", tmp_path / "run"]
    assert run(*words)[0] == 0
    before = {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    code, _, err = run(*words, "--seed", 5)
    assert code == 2
    assert "settings.seed: expected 5, got 0" in err.strip().splitlines()[-1]
    assert {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()} == before


def test_settings_file_reaches_networks_and_arena(run, tmp_path):
    path = tmp_path / "open.toml"
    path.write_text('format = "ohmloom.settings"\nversion = 1\nshadow = true\n[readings]\nlateral = "both"\n')
    words = ["evolve", "--system", "GA", "--generations", 0, "--population", 3, "--out", tmp_path / "run"]
    assert run(*words, "--settings", path)[0] == 0
    assert Network.load(tmp_path / "run" / "networks" / "GA_0.net.json").readings.lateral == "both"
    assert json.loads((tmp_path / "run" / "run.json").read_text())["arena"]["shadow"] is True


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shadow = 1\n", "open.toml: shadow: expected a valid boolean, got 1"),
        ("shadoww = true\n", "open.toml: shadoww: expected no such key, got True. Did you mean 'shadow'?"),
        ('[readings]\nlateral = "up"\n', "open.toml: readings.lateral: expected 'descending', 'both' or 'ascending'"),
        ("seed = 4\n", "open.toml: seed: expected no such key, got 4"),
        ("[readings", "open.toml: expected TOML, got"),
    ],
)
def test_bad_settings_file_is_refused(run, tmp_path, text, message):
    path = tmp_path / "open.toml"
    path.write_text('format = "ohmloom.settings"\nversion = 1\n' + text)
    code, _, err = run("evolve", "--system", "GA", "--out", tmp_path / "run", "--settings", path)
    assert code == 2
    assert message in one_line(err)
    assert not (tmp_path / "run").exists()


def test_interrupted_evolution_says_how_to_resume_and_loses_nothing(tmp_path):
    def words(out):
        return [sys.executable, "-m", "ohmloom", "evolve", "--system", "GA", "--generations", "60", "--population", "6",
                "--out", str(out)]  # fmt: skip

    process = subprocess.Popen(words(tmp_path / "run"), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    checkpoint = tmp_path / "run" / "populations" / "GA_0.json"
    while not checkpoint.exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert "Resume with: ohmloom evolve --system GA --generations 60 --population 6 --out" in err.splitlines()[-1]
    assert subprocess.run(words(tmp_path / "run"), capture_output=True, check=False).returncode == 0
    assert subprocess.run(words(tmp_path / "whole"), capture_output=True, check=False).returncode == 0
    whole = {p.relative_to(tmp_path / "whole"): p.read_bytes() for p in (tmp_path / "whole").rglob("*") if p.is_file()}
    resumed = {p.relative_to(tmp_path / "run"): p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    assert resumed == whole


def test_folder_that_cannot_be_written_is_refused(run, net, tmp_path, monkeypatch):
    # Permissions do not bind root, so the answer of the system is replaced, not the folder's mode.
    real = os.access
    monkeypatch.setattr("os.access", lambda path, mode: mode != os.W_OK and real(path, mode))
    code, _, err = run("map", net, "--hardware", "hp_1t1r", "--out", tmp_path / "map")
    assert code == 2
    assert "expected a folder that can be written" in one_line(err)


def test_disk_that_is_full_is_operational(run, net, monkeypatch, tmp_path):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    code, _, err = run("map", net, "--hardware", "hp_1t1r", "--out", tmp_path / "map")
    assert code == 3
    assert "No space left on device" in one_line(err)
    assert list((tmp_path / "map").iterdir()) == []


def test_doctor_and_device_list(run):
    code, out, _ = run("doctor", "--json")
    assert code == 0
    assert json.loads(out)["works"]
    code, out, _ = run("device", "list", "--json")
    assert {"hp_tio2", "peo_pani", "linear", "constant"} <= {card["name"] for card in json.loads(out)}
    code, out, _ = run("device", "show", "hp_tio2")
    assert "r_on = 100 Ohm" in out


def test_version_and_help_answer(run):
    assert run("--version")[0] == 0
    code, out, _ = run("--help")
    assert code == 0
    assert "evaluate" in out


def test_help_imports_nothing_heavy():
    code = "import sys; from ohmloom.cli import main\ntry:\n main(['--help'])\nexcept SystemExit: pass\n"
    code += "print([m for m in ('numba', 'scipy', 'matplotlib', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
