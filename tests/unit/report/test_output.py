"""Files that the command line writes: complete, the same each time, and refused where they cannot be."""

import json

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import Network
from ohmloom.report import doctor
from ohmloom.report.demo import run_demo
from ohmloom.report.output import check_suffix, replay_network, save_study
from ohmloom.sim import Arena, feasibility

NETWORK = Network.random(system="HET", rng=np.random.default_rng(3))
HARDWARE = Hardware.load("het_mixed")


def test_study_files_agree(tmp_path):
    study = feasibility(NETWORK, HARDWARE, dies=1, seed=2, arena=Arena(max_timesteps=40))
    page, report, plan = save_study(study, tmp_path, command="ohmloom evaluate x", has_figures=False)
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", "report.json", "plan.json"}
    assert json.loads(report.read_text())["verdict"] == study.verdict
    assert study.verdict in page.read_text()
    assert json.loads(plan.read_text())["network"]["system"] == "HET"


def test_unknown_ending_is_refused_before_a_trial(tmp_path):
    with pytest.raises(ParameterError, match=r"expected a file that ends in \.gif, \.html, \.png, got film\.mp4"):
        check_suffix(type(tmp_path)("film.mp4"))


def test_replay_of_hardware_says_so_and_follows_the_seed(tmp_path):
    a = replay_network(NETWORK, tmp_path / "a.html", hardware=HARDWARE, seed=4)
    b = replay_network(NETWORK, tmp_path / "b.html", hardware=HARDWARE, seed=4)
    c = replay_network(NETWORK, tmp_path / "c.html", seed=5)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert (a.path == b.path).all()
    assert a.trial_key != c.trial_key
    assert "on het_mixed" in (tmp_path / "a.html").read_text()


def test_dynamic_task_can_be_asked_for(tmp_path):
    assert replay_network(NETWORK, tmp_path / "a.png", task="dynamic").task == "dynamic"


def test_demo_makes_everything_in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = []
    run_demo(tmp_path / "demo", say=lines.append)
    made = {str(path.relative_to(tmp_path / "demo")) for path in (tmp_path / "demo").rglob("*") if path.is_file()}
    assert made == {
        "loops.png", "fit/device.toml", "fit/fit.json", "fit/fit.pdf", "fit/fit.png", "fit/profiles.png",
        "evolved.net.json", "map/plan.json", "map/placement.csv", "map/reset.csv", "map/cost.csv", "map/pulses.csv",
        "map/crossbars.png", "map/example.png", "map/pulses.png", "map/tile_0.cir", "map/tile_0.netlist.json",
        "map/tile_1.cir", "map/tile_1.netlist.json", "report.html",
        "report.json", "plan.json", "HET.net.json", "replay.html", "replay.png", "replay.gif",
    }  # fmt: skip
    assert any("every spike is equal" in line for line in lines)
    assert any("compiles" in line for line in lines)
    # Everything is inside the folder that was named.
    assert [path.name for path in tmp_path.iterdir()] == ["demo"]


def test_doctor_names_what_is_broken(monkeypatch):
    def broken():
        raise RuntimeError("no such card")

    monkeypatch.setattr(doctor, "_shipped", broken)
    finding = next(finding for finding in doctor.examine() if finding.name == "shipped files")
    assert not finding.works
    assert finding.is_core
    assert finding.detail == "RuntimeError: no such card"


def test_missing_tool_does_not_break_the_core(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    findings = {finding.name: finding for finding in doctor.examine()}
    assert not findings["C compiler"].works
    assert not findings["C compiler"].is_core
