"""Files that are no FMU, or a hostile one: a clear error, a caller that survives, nothing left on disk."""

import stat
import subprocess
import tempfile
import zipfile
from importlib.resources import files

import pytest

from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, MissingFileError, OperationError, ParameterError, UnknownNameError
from ohmloom.fmu import Host, check, export_device, run
from ohmloom.fmu._archive import open_archive
from ohmloom.fmu._compile import compile_library, host
from ohmloom.fmu.build import HEADERS, archive

DESCRIPTION = (b'<?xml version="1.0"?>'
               b'<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g">'
               b'<CoSimulation modelIdentifier="m"/>'
               b'<ModelVariables/><ModelStructure/></fmiModelDescription>')  # fmt: skip


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """A folder of its own for temporary files; it must be empty in the end."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    yield folder
    assert list(folder.iterdir()) == []


@pytest.fixture
def pack(tmp_path):
    def write(**entries):
        path = tmp_path / "bad.fmu"
        path.write_bytes(archive({name.replace("__", "/"): data for name, data in entries.items()}))
        return path

    return write


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return export_device(Device.load("hp_tio2_paper"), tmp_path_factory.mktemp("good") / "hp.fmu", q0=0.0).path


def with_library(good, path, text):
    """`good` with the library that this C text becomes in place of its own."""
    with zipfile.ZipFile(good) as file:
        content = {name: file.read(name) for name in file.namelist()}
    (name,) = [name for name in content if name.startswith("binaries/")]
    library = compile_library({"fmu.c": text.encode()})
    path.write_bytes(archive({**content, name: library}))
    return path


def changed(good, path, old, new):
    """`good` whose sources have `new` in place of `old`, built again."""
    with zipfile.ZipFile(good) as file:
        content = {name: file.read(name) for name in file.namelist()}
    sources = {n.removeprefix("sources/"): content[n] for n in content if n.startswith("sources/")}
    for name, data in sources.items():
        sources[name] = data.replace(old.encode(), new.encode())
    assert any(old.encode() in content[f"sources/{name}"] for name in sources)
    (name,) = [name for name in content if name.startswith("binaries/")]
    headers = {name: (files("fmpy") / "c-code" / name).read_bytes() for name in HEADERS[2]}
    path.write_bytes(archive({**content, name: compile_library({**sources, **headers})}))
    return path


def test_no_file_and_no_zip(tmp_path):
    with pytest.raises(MissingFileError, match=r"none.fmu: expected an FMU file, got none. Check the path."):
        open_archive(tmp_path / "none.fmu")
    (tmp_path / "text.fmu").write_text("not a zip")
    with pytest.raises(FileFormatError, match=r"text.fmu: expected a zip file, got File is not a zip file. Check"):
        open_archive(tmp_path / "text.fmu")


@pytest.mark.parametrize("name", ["../evil", "/etc/evil", "a/../../evil", "a\\evil", "C:evil"])
def test_a_path_that_escapes(tmp_path, name):
    path = tmp_path / "bad.fmu"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", DESCRIPTION)
        file.writestr(name, b"")
    with pytest.raises(FileFormatError, match=r"bad.fmu: expected entries inside the archive's own folder, got '"):
        open_archive(path)


def test_a_link(tmp_path):
    path = tmp_path / "bad.fmu"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", DESCRIPTION)
        entry = zipfile.ZipInfo("resources/link")
        entry.create_system, entry.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
        file.writestr(entry, "/etc/passwd")
    with pytest.raises(FileFormatError, match=r"expected files and folders, got a link or device, 'resources/link'"):
        open_archive(path)


def test_a_bomb(tmp_path, monkeypatch):
    path = tmp_path / "bad.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("modelDescription.xml", DESCRIPTION)
        file.writestr("resources/zeros", bytes(20_000_000))
    with pytest.raises(
        FileFormatError, match=r"expected entries that unpack to at most 500 times their size, got 'res"
    ):
        open_archive(path)
    monkeypatch.setattr("ohmloom.fmu._archive.LARGEST_CONTENT", 10_000_000)
    with pytest.raises(FileFormatError, match=r"expected at most 10 MB when unpacked, got more"):
        open_archive(path)
    monkeypatch.setattr("ohmloom.fmu._archive.MOST_ENTRIES", 1)
    with pytest.raises(FileFormatError, match=r"expected at most 1 entries, got 2"):
        open_archive(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_entry_that_stands_there_twice(tmp_path):
    path = tmp_path / "bad.fmu"
    with zipfile.ZipFile(path, "w") as file:
        for _ in range(2):
            file.writestr("modelDescription.xml", DESCRIPTION)
    with pytest.raises(FileFormatError, match=r"expected each entry once, got 'modelDescription.xml' twice"):
        open_archive(path)


@pytest.mark.parametrize(
    ("description", "text"),
    [
        (b"<fmi", "modelDescription.xml: expected XML, got unclosed token"),
        (
            DESCRIPTION.replace(b'"2.0"', b'"1.0"'),
            "expected fmiVersion 2.0 or 3.0, got '1.0'. Export it in one of these.",
        ),
        (DESCRIPTION.replace(b'"m"/>', b'"../m"/>'), "expected a modelIdentifier that is a name in C, got '../m'"),
        (DESCRIPTION.replace(b"CoSimulation", b"Other"), "expected ModelExchange or CoSimulation, got neither"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]>' + DESCRIPTION, "expected no document type, got one"),
    ],
)
def test_a_description_that_is_none(pack, description, text):
    with pytest.raises(FileFormatError) as caught:
        open_archive(pack(**{"modelDescription.xml": description}))
    assert text in str(caught.value)


def test_no_description(pack):
    with pytest.raises(FileFormatError, match=r"expected modelDescription.xml inside, got no such entry"):
        open_archive(pack(readme=b""))
    with pytest.raises(FileFormatError, match=r"expected an FMU, got a system of FMUs \(SSP\)\. Run it by run_ssp"):
        open_archive(pack(**{"SystemStructure.ssd": b""}))


def test_no_library_for_this_machine(pack, temporary):
    path = pack(**{"modelDescription.xml": DESCRIPTION, "binaries__win32__m.dll": b""})
    with pytest.raises(
        FileFormatError, match=rf"expected a library for {host()}, binaries/.*, got win32. Export it for"
    ):
        run(path)
    found = check(path)
    assert not found.passed
    assert "expected a library for" in found.rows[-1].detail


def test_a_damaged_entry(good, tmp_path, temporary):
    data = bytearray(good.read_bytes())
    start = data.index(b"sources/fmu.c") + len(b"sources/fmu.c")
    data[start + 200] ^= 0xFF
    path = tmp_path / "bad.fmu"
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=r"bad.fmu: expected a whole zip file, got"):
        run(path)


def test_missing_functions_fail_the_check(good, tmp_path, temporary):
    path = with_library(good, tmp_path / "bad.fmu", "int nothing_of_fmi(void) { return 0; }")
    found = check(path)
    assert not found.passed
    (row,) = [row for row in found.rows if row.what == "functions of CoSimulation"]
    assert row.status == "failed"
    assert "got none named fmi2GetTypesPlatform, fmi2GetVersion, " in row.detail


def test_a_crash_inside_is_named(good, tmp_path, temporary):
    path = changed(good, tmp_path / "bad.fmu", "status = advance(m, duration);",
                   "status = *(volatile int *)(duration > 0.0 ? 8 : 16);")  # fmt: skip
    with pytest.raises(OperationError) as caught:
        run(path)
    assert str(caught.value) == (f"{path}: expected simulation to end, got a crash (SIGSEGV) inside the FMU. "
                                 "Ask its maker.")  # fmt: skip


def test_an_endless_loop_inside_is_ended(good, tmp_path, temporary):
    path = changed(good, tmp_path / "bad.fmu", "status = advance(m, duration);",
                   "for (status = 0; status == 0;) m->s.step += duration;")  # fmt: skip
    with pytest.raises(OperationError, match=r"expected simulation within 3 s, got no end. The FMU may loop for ever"):
        run(path, timeout=3.0)
    # Nothing of it lives on.
    assert str(path) not in subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout


def test_a_greedy_fmu_is_refused_memory(good, tmp_path, temporary):
    path = changed(good, tmp_path / "bad.fmu", "Instance *m = calloc(1, sizeof *m);",
                   "Instance *m = calloc(1, 8000000000u + sizeof *m);")  # fmt: skip
    with pytest.raises(OperationError, match=r"expected simulation to succeed, got Failed to instantiate"):
        run(path)


def test_values_that_are_not_finite_are_refused(good, tmp_path, temporary):
    path = changed(good, tmp_path / "bad.fmu", "s->outputs_known = 1;",
                   "s->outputs_known = 1; s->value[FIRST_Y + 2] = NAN;")  # fmt: skip
    with pytest.raises(OperationError, match=r"bad.fmu: weight: expected finite values, got nan at t = 0 s. Check the"):
        run(path)


def test_a_host_survives_what_it_hosts(good, tmp_path, temporary):
    """A crash, an endless loop and a value that is no number, each in the middle of a run."""
    crash = changed(
        good, tmp_path / "crash.fmu", "y[1] = 1.0 / g;", "y[1] = u[0] > 0.5 ? *(volatile double *)8 : 1.0 / g;"
    )
    with Host(crash) as host:
        host.step(0.01, {"v": 0.1})
        with pytest.raises(
            OperationError, match=r"crash.fmu: expected an answer, got a crash \(SIGSEGV\) inside the FMU"
        ):
            host.step(0.01, {"v": 0.6}, ["memristance"])
        with pytest.raises(OperationError, match=r"expected a host that is open, got a closed one"):
            host.get(["i"])
    loop = changed(good, tmp_path / "loop.fmu", "y[1] = 1.0 / g;", "while (u[0] > 0.5) y[1] = 1.0 / g;")
    with Host(loop, timeout=20.0) as host:
        host.timeout = 0.3
        with pytest.raises(OperationError, match=r"loop.fmu: expected an answer within 0.3 s, got none"):
            host.step(0.01, {"v": 0.6}, ["memristance"])
    empty = changed(good, tmp_path / "nan.fmu", "s->outputs_known = 1;",
                    "s->outputs_known = 1; s->value[FIRST_Y + 2] = NAN;")  # fmt: skip
    with (
        Host(empty) as host,
        pytest.raises(OperationError, match=r"weight: expected a finite value, got nan at t = 0 s"),
    ):
        host.step(0.01, {"v": 0.6}, ["weight"])


def test_a_greedy_host_is_refused_memory(good, tmp_path, temporary):
    greedy = with_library(
        good, tmp_path / "greedy.fmu", "char room[8000000000]; double fmi2DoStep(void) { return room[1]; }"
    )
    with pytest.raises(OperationError, match=r"greedy.fmu: expected it to go on at t = 0 s, got .*greedy|.*memory"):
        Host(greedy)


def test_a_host_refuses_what_the_fmu_has_not(good, temporary):
    with Host(good, start_values={"q0": 0.3}) as host:
        assert host.get(["q"]) == {"q": 0.3}
        host.step(0.1, {"v": 0.8})
        assert host.get(["q"])["q"] > 0.3
        host.reset()
        assert host.get(["q"]) == {"q": 0.3}
        host.reset({"q0": 0.1})
        assert (host.get(["q"]), host.time) == ({"q": 0.1}, 0.0)
        with pytest.raises(ParameterError, match=r"hp.fmu: v: expected a value from -1e\+06 to 1e\+06, got 10000000"):
            host.set({"v": 1e7})
        with pytest.raises(UnknownNameError, match=r"Did you mean 'weight'"):
            host.get(["wieght"])
        with pytest.raises(OperationError, match=r"hp.fmu: expected it to go on at t = 0 s, got .*positive step"):
            host.step(-0.1)


def test_an_error_of_the_fmu_is_passed_on(good, temporary):
    with pytest.raises(OperationError, match=r"got .*: r_on: expected r_on < r_off. Check the FMU"):
        run(good, start_values={"r_on": 2.0})


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        (
            {"start_values": {"v": 1e9}},
            ParameterError,
            "hp.fmu: v: expected a value from -1e+06 to 1e+06, got 1000000000.",
        ),
        ({"start_values": {"w": 1.0}}, UnknownNameError, "hp.fmu: start values: expected one of"),
        ({"start_values": {"q": 1.0}}, ParameterError, "q: expected a parameter or an input, got one that is output"),
        ({"start_values": {"v": "x"}}, ParameterError, "hp.fmu: v: expected a finite number, got 'x'"),
        ({"stop_time": 0.0}, ParameterError, "run: stop_time: expected a number above 0, got 0"),
        (
            {"interface": "cs"},
            UnknownNameError,
            "run: interface: expected one of CoSimulation, ModelExchange, got 'cs'",
        ),
        ({"outputs": ["w"]}, UnknownNameError, "hp.fmu: outputs: expected one of"),
        ({"inputs": {"v": [0.0, 1.0]}}, ParameterError, "inputs: expected times under 'time', got none"),
        ({"inputs": {"time": [1.0, 0.0], "v": [0.0, 1.0]}}, ParameterError, "with rising times"),
        (
            {"inputs": {"time": [0.0, 1.0], "u": [0.0, 1.0]}},
            UnknownNameError,
            "hp.fmu: inputs: expected one of time, v",
        ),
    ],
)
def test_bad_options(good, temporary, options, kind, text):
    with pytest.raises(kind) as caught:
        run(good, **options)
    assert text in str(caught.value)
