"""Run folders: the same bytes for any number of workers and after any interruption; conflicts are named."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest

from ohmloom.errors import (
    FileFormatError,
    Interrupted,
    MissingFileError,
    OhmloomError,
    ParameterError,
    SettingsConflictError,
)  # fmt: skip
from ohmloom.neurocontroller import Network, Readings, SpikingController
from ohmloom.sim import evolution, run_trial
from ohmloom.sim.evolution import EvolutionSettings, evolve

SMALL = EvolutionSettings(system="HET", repeats=2, generations=21, population=4, seed=3)
LONGER = SMALL.model_copy(update={"generations": 60})


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference") / "run"
    outcome = evolve(SMALL, out=folder)
    return folder, outcome


def test_what_a_run_folder_holds(reference):
    folder, outcome = reference
    assert list(contents(folder)) == [
        "networks/HET_0.net.json", "networks/HET_1.net.json", "populations/HET_0.json", "populations/HET_1.json",
        "run.json", "tables/HET_0.csv", "tables/HET_1.csv", "tables/summary.csv",
    ]  # fmt: skip
    run = json.loads((folder / "run.json").read_text())
    assert (run["format"], run["version"]) == ("ohmloom.run", 2)
    assert EvolutionSettings(**run["settings"] | {"readings": Readings(**run["settings"]["readings"])}) == SMALL
    with (folder / "tables" / "HET_0.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["generation"] for row in rows] == ["0", "20", "21"]
    assert float(rows[-1]["best_fitness"]) == outcome.repeats[0].best_fitness
    assert float(rows[-1]["mean_fitness"]) == outcome.repeats[0].mean_fitness
    assert outcome.repeats[0].network == folder / "networks" / "HET_0.net.json"


def test_the_stored_fitness_can_be_reproduced(reference):
    for repeat in reference[1].repeats:
        network = Network.load(repeat.network)
        trial = run_trial(SpikingController(network), SMALL.arena(), trial_key=network.provenance["trial_key"])
        assert trial.fitness == network.provenance["fitness"] == repeat.best_fitness
        assert trial.task == network.provenance["task"]


def test_repeats_differ(reference):
    first, second = (Network.load(repeat.network) for repeat in reference[1].repeats)
    assert first.synapses != second.synapses


def test_two_workers_give_the_same_bytes(reference, tmp_path):
    rows = []
    evolve(SMALL, out=tmp_path / "run", workers=2, report=lambda repeat, row: rows.append((repeat, row)))
    assert contents(tmp_path / "run") == contents(reference[0])
    assert {(repeat, row["generation"]) for repeat, row in rows} == {(0, 20), (0, 21), (1, 20), (1, 21)}


def test_a_finished_run_is_not_run_again(reference, monkeypatch):
    before = contents(reference[0])

    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(evolution, "run_repeat", refuse)
    outcome = evolve(SMALL, out=reference[0])
    assert outcome == reference[1]
    assert contents(reference[0]) == before


@pytest.mark.parametrize("after", [0, 1, 7, 20, 21, 22, 30])
def test_a_stop_between_generations_loses_nothing(reference, tmp_path, monkeypatch, after):
    """`after` counts the moments at which the run asks whether it should stop."""
    asked = 0

    def stopped():
        nonlocal asked
        asked += 1
        return asked > after

    with monkeypatch.context() as patch:
        patch.setattr(evolution, "stop_on_interrupt", lambda: contextlib.nullcontext(stopped))
        with pytest.raises(Interrupted):
            evolve(SMALL, out=tmp_path / "run")
    assert contents(tmp_path / "run") != contents(reference[0])
    evolve(SMALL, out=tmp_path / "run")
    assert contents(tmp_path / "run") == contents(reference[0])


@pytest.mark.parametrize("writes", [1, 2, 3, 4, 5, 6])
def test_a_crash_at_any_write_loses_nothing(reference, tmp_path, monkeypatch, writes):
    done = 0
    real = evolution.write_atomic

    def write(path, data):
        nonlocal done
        done += 1
        if done > writes:
            raise MemoryError
        real(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(evolution, "write_atomic", write)
        with pytest.raises(MemoryError):
            evolve(SMALL, out=tmp_path / "run")
    evolve(SMALL, out=tmp_path / "run")
    assert contents(tmp_path / "run") == contents(reference[0])


SCRIPT = """
import sys
from ohmloom.errors import Interrupted
from ohmloom.sim.evolution import EvolutionSettings, evolve

if __name__ == "__main__":
    settings = EvolutionSettings(system="HET", repeats=2, generations=60, population=4, seed=3)
    try:
        evolve(settings, out=sys.argv[1], workers=int(sys.argv[2]), report=lambda *_: print("row", flush=True))
    except Interrupted:
        sys.exit(130)
"""


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("longer") / "run"
    evolve(LONGER, out=folder)
    return contents(folder)


def start(tmp_path, folder, workers):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    return subprocess.Popen([sys.executable, str(script), str(folder), str(workers)], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, start_new_session=True)  # fmt: skip


@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_then_the_same_command(tmp_path, workers, longer):
    folder = tmp_path / "run"
    process = start(tmp_path, folder, workers)
    assert process.stdout.readline() == b"row\n"
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes of the group
    _, errors = process.communicate(timeout=240)
    assert process.returncode == 130, errors
    assert b"Traceback" not in errors
    assert not (folder / "tables" / "summary.csv").exists()
    assert not [p for p in folder.rglob("*") if p.name.startswith(".")]
    evolve(LONGER, out=folder)
    assert contents(folder) == longer


def test_workers_do_not_outlive_a_killed_driver(tmp_path):
    process = start(tmp_path, tmp_path / "run", 2)
    process.stdout.readline()
    process.kill()
    # The workers hold the other ends of these pipes, which close when the last of them has ended.
    try:
        process.communicate(timeout=240)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        pytest.fail("worker processes lived on")


@pytest.mark.parametrize(("changes", "field"), [
    ({"seed": 4}, "settings.seed: expected 4, got 3"),
    ({"repeats": 3, "seed": 9}, "settings.repeats: expected 3, got 2"),
    ({"readings": Readings(synapse_gain=1.0)}, "settings.readings.synapse_gain: expected 1.0, got 0.25"),
    ({"task": "dynamic"}, "settings.task: expected 'dynamic', got 'static'"),
])  # fmt: skip
def test_other_settings_are_refused_and_nothing_is_written(reference, changes, field):
    folder = reference[0]
    before = contents(folder)
    with pytest.raises(SettingsConflictError) as caught:
        evolve(SMALL.model_copy(update=changes), out=folder)
    expected = f"{folder}/run.json: {field}. Use another --out, or the settings of that run."
    assert str(caught.value) == expected
    assert contents(folder) == before


def test_a_folder_of_somebody_else_is_refused(tmp_path):
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(SettingsConflictError) as caught:
        evolve(SMALL, out=tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: expected a new folder or a run folder, got one with other files. Use another --out."
    )
    assert list(contents(tmp_path)) == ["thesis.txt"]
    with pytest.raises(SettingsConflictError, match=r"thesis\.txt: expected .*, got a file\. Use another --out\."):
        evolve(SMALL, out=tmp_path / "thesis.txt")


def test_an_empty_folder_is_used(tmp_path):
    settings = SMALL.model_copy(update={"repeats": 1, "generations": 0})
    assert len(evolve(settings, out=tmp_path).repeats) == 1


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": [], "population": {"generation": 1}}',
                                  '{"rows": [], "population": []}'])  # fmt: skip
def test_a_damaged_checkpoint_is_named(tmp_path, text):
    folder = tmp_path / "run"
    evolve(SMALL.model_copy(update={"repeats": 1, "generations": 0}), out=folder)
    (folder / "networks" / "HET_0.net.json").unlink()
    (folder / "populations" / "HET_0.json").write_text(text)
    with pytest.raises(FileFormatError, match=r"HET_0\.json: .*expected .*Delete it to redo this repeat\.") as caught:
        evolve(SMALL.model_copy(update={"repeats": 1, "generations": 0}), out=folder)
    assert isinstance(caught.value, OhmloomError)


def altered(change):
    def write(folder):
        path = folder / "populations" / "HET_0.json"
        table = json.loads(path.read_text())
        change(table)
        path.write_text(json.dumps(table))

    return write


def first(table):
    return table["population"]["individuals"][0]


@pytest.mark.parametrize(("change", "field"), [
    (lambda t: first(t)["synapses"].append([99, 6, "hp", 0.5]), "population: individuals[0].synapses["),
    (lambda t: first(t)["synapses"].append([0.5, 6, "hp", 0.5]), "population: individuals[0].synapses["),
    (lambda t: first(t)["synapses"].append([6, "hp", 0.5]), "population: individuals[0].synapses["),
    (lambda t: t["population"]["individuals"].clear(), "population.individuals: expected 4 individuals, got 0"),
    (lambda t: first(t).update(trials=0), "population.individuals[0].trials: expected greater"),
    (lambda t: first(t).update(trials=2), "population.individuals[0].trials: expected 1 for each"),
    (lambda t: first(t).update(solved=2), "population.individuals[0]: expected "),
    (lambda t: first(t).update(hidden="+?"), "population.individuals[0].hidden: expected "),
    (lambda t: first(t)["adaptation"].update(mu=None), "population.individuals[0].adaptation.mu: expected "),
    (lambda t: t["population"]["generator"].update(bit_generator="MT19937"), "population.generator.bit_generator: "),
    (lambda t: t["population"].update(generation=99), "population.generation: expected 0 to 0, got 99"),
    (lambda t: t["population"].update(births=1), "population: expected "),
    (lambda t: t["rows"][0].pop("mu"), "rows[0].mu: expected a value, got nothing"),
    (lambda t: t["rows"].append(3), "rows[1]: expected "),
    (lambda t: t.update(rows={}), "rows: expected "),
])  # fmt: skip
def test_an_altered_checkpoint_names_the_field(tmp_path, change, field):
    folder, settings = tmp_path / "run", SMALL.model_copy(update={"repeats": 1, "generations": 0})
    evolve(settings, out=folder)
    (folder / "networks" / "HET_0.net.json").unlink()
    altered(change)(folder)
    with pytest.raises(FileFormatError) as caught:
        evolve(settings, out=folder)
    for problem in caught.value.problems:
        assert problem.startswith(f"{folder}/populations/HET_0.json: {field}")
        assert problem.endswith(". Delete it to redo this repeat.")


def remove(path):
    path.unlink()


def shorten(path):
    path.write_bytes(path.read_bytes()[:-30])


def empty(path):
    path.write_bytes(b"")


def without_outcome(path):
    path.write_text(path.read_text().replace('"solved":', '"sloved":'))


@pytest.mark.parametrize(("part", "damage", "message"), [
    ("tables/HET_0.csv", remove, "expected a table file, got No such file or directory. Delete {net} to redo this"),
    ("tables/HET_0.csv", shorten, "Delete {net} to redo this repeat."),
    ("tables/HET_0.csv", empty, "got []. Delete {net} to redo this repeat."),
    ("networks/HET_0.net.json", shorten, "expected JSON, got "),
    ("networks/HET_0.net.json", without_outcome, "provenance: solved: expected a value, got nothing. Delete it"),
])  # fmt: skip
def test_a_damaged_outcome_says_what_to_delete(tmp_path, part, damage, message):
    folder, settings = tmp_path / "run", SMALL.model_copy(update={"repeats": 1, "generations": 0})
    evolve(settings, out=folder)
    damage(folder / part)
    with pytest.raises((FileFormatError, MissingFileError)) as caught:
        evolve(settings, out=folder)
    text = str(caught.value)
    assert text.startswith(f"{folder}/{part}: ")
    assert message.format(net=f"{folder}/networks/HET_0.net.json") in text
    (folder / "networks" / "HET_0.net.json").unlink()
    evolve(settings, out=folder)  # the advice works


def test_what_a_killed_write_left_is_removed(tmp_path):
    folder, settings = tmp_path / "run", SMALL.model_copy(update={"repeats": 1, "generations": 0})
    evolve(settings, out=folder)
    before = contents(folder)
    for name in ("tables/.HET_0.csv.ab_12cd9", "populations/.HET_0.json.abcdefgh", "networks/.HET_0.net.json.12345678",
                 ".run.json.zzzzzzzz"):  # fmt: skip
        (folder / name).write_text("half")
    (folder / "tables" / ".notes.txt.abcdefgh").write_text("not ours")
    evolve(settings, out=folder)
    assert contents(folder) == before | {"tables/.notes.txt.abcdefgh": b"not ours"}


@pytest.mark.parametrize(("field", "arguments"), [
    ("settings", {"settings": None}), ("settings", {"settings": "HET"}), ("workers", {"workers": "a"}),
    ("workers", {"workers": True}), ("workers", {"workers": 1.5}), ("out", {"out": None}), ("report", {"report": 1}),
])  # fmt: skip
def test_arguments_of_a_wrong_type(tmp_path, field, arguments):
    with pytest.raises(ParameterError, match=rf"^evolve\.{field}: expected .*, got "):
        evolve(**({"settings": SMALL, "out": tmp_path / "run"} | arguments))
    assert not (tmp_path / "run").exists()


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="sees starting workers in /proc")
def test_ctrl_c_while_workers_start(tmp_path):
    process = start(tmp_path, tmp_path / "run", 2)
    children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None and len(children.read_text().split()) < 3:  # a resource tracker and two workers
        time.sleep(0.002)
    time.sleep(0.1)  # they import now
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=240)
    assert process.returncode == 130, errors
    assert errors == b""


def test_workers_are_at_least_one(tmp_path):
    with pytest.raises(ParameterError, match=r"^evolve\.workers: expected an integer >= 1, got 0\. Correct it\.$"):
        evolve(SMALL, out=tmp_path / "run", workers=0)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("changes", [{"system": "XX"}, {"repeats": 0}, {"population": 2}, {"seed": -1},
                                     {"enable_probability": 1.5}, {"unknown": 1}, {"generations": "9"}])  # fmt: skip
def test_settings_are_checked(changes):
    with pytest.raises(ParameterError, match=r"^EvolutionSettings\.") as caught:
        EvolutionSettings(**({"system": "HP"} | changes))
    assert "\n" not in str(caught.value)


def test_settings_reach_the_arena():
    settings = EvolutionSettings(system="HP", task="dynamic", shadow=True, slip_mode="uniform",
                                 second_part_start="start")  # fmt: skip
    arena = settings.arena()
    assert (arena.task, arena.shadow, arena.slip_mode, arena.second_part_start) == (
        "dynamic", True, "uniform", "start",
    )  # fmt: skip


def test_enable_probability_and_readings_reach_the_networks(tmp_path):
    settings = EvolutionSettings(system="HP", generations=0, population=3, enable_probability=1.0,
                                 readings=Readings(lateral="both"))  # fmt: skip
    network = Network.load(evolve(settings, out=tmp_path / "run").repeats[0].network)
    assert network.readings.lateral == "both"
    assert network.connectivity == 1.0
