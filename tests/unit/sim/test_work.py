"""The work engine: the same bytes whoever works and whatever dies, and nothing left over."""

import errno
import hashlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ohmloom import _files
from ohmloom.errors import Interrupted, OperationError, ParameterError, UnknownNameError
from ohmloom.sim import work as engine
from ohmloom.sim.work import Shard, open_work

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def units():
    # By a name that the processes of an engine can import too.
    sys.path.insert(0, str(HERE))
    try:
        yield importlib.import_module("work_units")
    finally:
        sys.path.remove(str(HERE))


@pytest.fixture
def marks(tmp_path):
    folder = tmp_path / "marks"
    folder.mkdir()
    return folder


def digest(out):
    """Of the names and bytes of all files; no name begins with a dot, as those of half-written ones do."""
    files = sorted(path for path in out.rglob("*") if path.is_file())
    assert [path.name for path in files if path.name.startswith(".")] == []
    return hashlib.sha256(b"".join(str(p.relative_to(out)).encode() + p.read_bytes() for p in files)).hexdigest()


@pytest.fixture(scope="module")
def alone(units, tmp_path_factory):
    """What one process makes: rows, and the digest of its folder."""
    folder = tmp_path_factory.mktemp("alone")
    (folder / "marks").mkdir()
    rows = units.drive(folder / "out", folder / "marks")
    return rows, digest(folder / "out")


def unit_files(out):
    return sorted(path.name for path in out.glob("units/*/[0-9]*"))


def tried(marks):
    return [int(line.split()[1]) for line in (marks / "pids").read_text().splitlines()]


def test_rows_come_back_as_they_were_and_a_second_run_works_on_nothing(units, marks, tmp_path, alone):
    rows = units.drive(tmp_path / "out", marks)
    assert rows == alone[0]
    assert list(rows) == list(range(units.ITEMS))
    assert rows[3][0][0] == 3
    assert (rows[3][0][1]["count"], rows[3][0][1]["even"]) == (3, False)
    (marks / "pids").unlink()
    assert units.drive(tmp_path / "out", marks) == rows
    assert not (marks / "pids").exists()
    # A leftover of a process that was killed while it wrote goes away.
    leftover = next((tmp_path / "out").glob("units/*")) / ".000002.json.a1b2c3d4"
    leftover.write_text("half")
    units.drive(tmp_path / "out", marks)
    assert digest(tmp_path / "out") == alone[1]


def test_a_killed_worker_and_a_killed_driver_lose_nothing_and_leave_nothing(marks, tmp_path, alone):
    """Three processes: one is killed, then the driver; two go on from there."""
    out = tmp_path / "out"
    (marks / "kill_worker_1").touch()
    (marks / "kill_driver_4").touch()
    command = [sys.executable, str(HERE / "work_units.py"), str(out), str(marks)]
    done = subprocess.run([*command, "3"], check=False, capture_output=True)
    assert done.returncode == -signal.SIGKILL
    assert not (marks / "kill_worker_1").exists()
    assert len(unit_files(out)) < 6
    for pid in {int(line.split()[0]) for line in (marks / "pids").read_text().splitlines()}:
        assert ends(pid), f"worker {pid} outlived its driver"
    before = {path: path.stat().st_mtime_ns for path in out.glob("units/*/[0-9]*.json")}
    again = subprocess.run([*command, "2"], check=True, capture_output=True, text=True)
    assert {int(k): [(i, row) for i, row in v] for k, v in json.loads(again.stdout).items()} == alone[0]
    assert digest(out) == alone[1]
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())


def ends(pid):
    """Whether a process is gone, or only waits to be counted, within a minute."""
    for _ in range(600):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.1)
    return False


@pytest.mark.filterwarnings("ignore")  # dask's own
def test_dask_gives_the_same_bytes_though_a_worker_is_killed(units, marks, tmp_path, alone):
    if importlib.util.find_spec("distributed") is None:
        assert "OHMLOOM_REQUIRE_TOOLS" not in os.environ, "distributed is not installed"
        pytest.skip("distributed is not installed: pip install 'ohmloom[cluster]'")
    (marks / "kill_worker_2").touch()
    assert units.drive(tmp_path / "out", marks, engine="dask", workers=2) == alone[0]
    assert not (marks / "kill_worker_2").exists()
    assert digest(tmp_path / "out") == alone[1]


def test_a_bad_unit_is_reported_after_five_tries_with_its_input(units, marks, tmp_path, alone):
    out = tmp_path / "out"
    (marks / "bad_2").touch()
    with pytest.raises(
        OperationError, match=r"draws 2: expected a unit .*, got 5 failures, the last: ValueError: bad 2"
    ):
        units.drive(out, marks)
    assert tried(marks).count(2) == 5
    assert unit_files(out) == [f"00000{k}.{'failed' if k == 2 else 'json'}" for k in range(units.ITEMS)]
    kept = json.loads(next(out.glob("units/*/*.failed")).read_text())
    assert (kept["item"], kept["inputs"], kept["error"]) == (2, {"seed": 5}, "ValueError: bad 2")
    (marks / "bad_2").unlink()
    units.drive(out, marks)
    assert digest(out) == alone[1]


def test_a_full_disk_is_said_and_the_run_resumes(units, marks, tmp_path, alone, monkeypatch):
    out, real = tmp_path / "out", os.fsync

    def full(descriptor):
        if len(unit_files(out)) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(_files.os, "fsync", full)
        with pytest.raises(OperationError, match=r"00000\d.json: expected a file .*, got No space left on device"):
            units.drive(out, marks)
    assert len(unit_files(out)) == 3
    units.drive(out, marks)
    assert digest(out) == alone[1]


def test_shards_do_their_own_first_and_then_what_others_left(units, marks, tmp_path, alone):
    assert Shard.parse("2/3").order(range(6)) == [1, 4, 5, 3, 2, 0]
    assert sorted(Shard(index=3, count=3).order(range(7))) == list(range(7))
    (marks / "bad_1").touch()
    with pytest.raises(OperationError):
        units.drive(tmp_path / "out", marks, shard=Shard.parse("1/2"))
    (marks / "bad_1").unlink()
    (marks / "pids").unlink()
    units.drive(tmp_path / "out", marks, shard=Shard.parse("2/2"))
    assert tried(marks) == [1]
    assert digest(tmp_path / "out") == alone[1]


def test_ctrl_c_keeps_what_is_done(units, marks, tmp_path, alone):
    with open_work(folder=tmp_path / "out") as work, pytest.raises(Interrupted, match="all finished work is kept"):
        work.run(units.batch(marks), lambda done, _: os.kill(os.getpid(), signal.SIGINT) if done == 2 else None)
    assert len(unit_files(tmp_path / "out")) == 2
    units.drive(tmp_path / "out", marks)
    assert digest(tmp_path / "out") == alone[1]


def test_other_inputs_or_other_code_are_other_units(units, marks, monkeypatch):
    key = units.batch(marks).key
    assert engine.Batch(name="draws", unit=None, items=(), inputs={"seed": 6}).key != key
    monkeypatch.setattr(engine, "code_version", lambda: "0.0 other")
    assert units.batch(marks).key != key


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        (
            {"engine": "dsk"},
            UnknownNameError,
            "--engine: expected one of dask, processes, got 'dsk'. Did you mean 'dask'",
        ),
        ({"address": "host:1"}, ParameterError, "--address: expected --engine dask with it"),
        ({"workers": 0}, ParameterError, "--workers: expected an integer >= 1, got 0"),
    ],
)
def test_bad_engines(options, error, text):
    with pytest.raises(error, match=text), open_work(**options):
        pass


@pytest.mark.parametrize("text", ["1", "0/3", "4/3", "a/b", "1/0"])
def test_bad_shards(text):
    with pytest.raises(ParameterError, match="--shard: expected"):
        Shard.parse(text)
