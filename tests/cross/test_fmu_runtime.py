"""The C of an FMU under the compiler's and the sanitizers' eyes, and its archive byte for byte."""

import importlib.util
import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from ohmloom.circuits import VCCS, Capacitor, CurrentSource, Memristor, MemristorCrossbar, Netlist, VoltageSource
from ohmloom.devices import Device
from ohmloom.errors import OperationError
from ohmloom.fmu import (
    export_arena,
    export_controller,
    export_crossbar,
    export_device,
    export_hardware_controller,
    export_system,
)
from ohmloom.fmu.build import HEADERS
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import KINDS, LATTICES, Readings, champion
from ohmloom.sim import Arena

CYCLES = Path(__file__).with_name("fmu_cycles.c")
DISCRETE_CYCLES = Path(__file__).with_name("fmu_discrete_cycles.c")
DIES = {"die ideal": "HET", "die het_mixed": "HET", "die hp_passive": "HP", "die hp_1t1r": "HP",
        "die peo_pani_redox": "PEO"}  # fmt: skip
TROUBLES = {"cycle_to_cycle": 0.2, "read_noise": 0.1, "quantisation": 6, "settling": 3e-10, "retention": 2.0,
            "read_disturb": 0.05}  # fmt: skip
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror"]


def export(name, out, fmi):
    """A model by name; what is discrete has no card of its name."""
    if name == "controller":
        # At emission, so that the branch that the default leaves unused is compiled too.
        readings = Readings(weight_at="emission", lateral="both")
        return export_controller(champion("HET").replace(readings=readings), out, fmi=fmi)
    if name == "arena":
        return export_arena("dynamic", out, fmi=fmi)
    if name == "loop":
        arena = Arena.paper(task="static")
        return export_system(champion("HET"), out, task=arena, trial_key=3, fmi=fmi)
    if name in DIES:
        # One of them with everything that a die may have besides.
        more = TROUBLES | {"metering_delay": 0.3} if name == "die hp_1t1r" else {}
        return export_hardware_controller(troubled(DIES[name], name.removeprefix("die "), more), out, fmi=fmi)
    if name == "dieloop":
        # All of the C of dies that drives through wires; both parts draw random numbers.
        die = troubled("HP", "hp_passive", TROUBLES)
        return export_system(die, out, task="static", trial_key=3, fmi=fmi)
    if name == "arrays":
        array = MemristorCrossbar(devices=Device.load("hp_tio2_10k"), s=np.full((2, 2), 0.4), r_row=1.0, r_column=1.0)
        return export_crossbar(array, out, fmi=fmi, arrays=True)
    if name == "crossbar":
        array = MemristorCrossbar(devices=Device.load("hp_tio2_10k"), s=np.full((2, 2), 0.4), r_row=1.0, r_column=1.0)
        return export_crossbar(array, out, fmi=fmi)
    if name == "netlist":
        # Not ohmic, with two cards, a capacitor, a current source, a controlled one and no wire.
        parts = [
            VoltageSource(name="V1", p="a", n="0", voltage=1.0),
            CurrentSource(name="I1", p="0", n="b", current=1e-9),
            VCCS(name="G1", p="0", n="b", control_p="a", control_n="b", transconductance=1e-12),
            Capacitor(name="C1", p="a", n="b", capacitance=1.0),
        ]
        parts += [Memristor(name=f"M{k}", p="ab"[k], n="b0"[k], device=Device.load(card), s0=0.5)
                  for k, card in enumerate(("peo_pani_redox", "vteam_memtorch"))]  # fmt: skip
        return export_crossbar(Netlist(elements=tuple(parts)), out, fmi=fmi)
    return export_device(Device.load(name), out, fmi=fmi)


def troubled(system, name, values):
    hardware = Hardware.load(name).with_values({f"nonidealities.{effect}": x for effect, x in values.items()})
    return place(champion(system), hardware).nominal()


@pytest.fixture
def sources(tmp_path, monkeypatch):
    def unpack(name, fmi):
        # The library inside is tried elsewhere; here its sources are compiled.
        with monkeypatch.context() as patch:
            patch.setattr("ohmloom.fmu._compile.find_compiler", lambda: None)
            file = export(name, tmp_path / "model.fmu", fmi).path
        with zipfile.ZipFile(file) as archive:
            archive.extractall(tmp_path / f"{name}{fmi}")
        for header in HEADERS[fmi]:
            shutil.copy(Path(fmpy.__file__).with_name("c-code") / header, tmp_path / f"{name}{fmi}" / "sources")
        return tmp_path / f"{name}{fmi}" / "sources"

    return unpack


MODELS = ("hp_tio2", "vteam_memtorch", "peo_pani_redox", "pickett", "controller", "arena", *DIES, "loop",
          "crossbar", "netlist")  # fmt: skip


@pytest.mark.parametrize(("name", "fmi"), [*((name, fmi) for name in MODELS for fmi in (2, 3)), ("arrays", 3)])
def test_no_warning(need_tool, sources, name, fmi):
    compiler = need_tool("the C of FMUs is not looked at here", os.environ.get("CC", ""), "gcc", "clang")
    flags = [*WARNINGS, "-O2", "-fvisibility=hidden", "-c", "-fPIC"]
    done = subprocess.run([compiler, *flags, "fmu.c", "-o", "fmu.o"], cwd=sources(name, fmi), capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr


def run_sanitized(compiler, folder, program, more=()):
    """What a program prints that includes fmu.c, under the sanitizers."""
    shutil.copy(program, folder)
    flags = [*WARNINGS, *more, "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    words = [compiler, *flags, program.name, "-o", "cycles", "-lm"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1"}
    done = subprocess.run(["./cycles"], cwd=folder, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(("name", "fmi"), [("hp_tio2_paper", 2), ("hp_tio2_paper", 3), ("crossbar", 2), ("netlist", 3),
                                         ("arrays", 3)])  # fmt: skip
def test_two_thousand_lives_leave_nothing_behind(need_tool, sources, name, fmi):
    compiler = need_tool("FMUs are not run under sanitizers here", os.environ.get("CC", ""), "gcc", "clang")
    run_sanitized(compiler, sources(name, fmi), CYCLES, ["-DHAS_ARRAYS"] if name == "arrays" else [])


@pytest.mark.parametrize("fmi", [2, 3])
def test_two_thousand_loops_leave_nothing_behind_and_weights_are_those_of_the_tables(need_tool, sources, fmi):
    compiler = need_tool("FMUs are not run under sanitizers here", os.environ.get("CC", ""), "gcc", "clang")
    lines = run_sanitized(compiler, sources("loop", fmi), DISCRETE_CYCLES).splitlines()
    assert len(lines) == sum(lattice.top // lattice.event + 1 for lattice in LATTICES.values())
    for kind, charge, weight in map(str.split, lines):
        assert float(weight) == LATTICES[KINDS[int(kind)]].weight(int(charge))


def test_a_die_that_drives_its_lines_leaves_nothing_behind(need_tool, sources):
    """Fewer lives: each solves for the potentials of the array thousands of times."""
    compiler = need_tool("FMUs are not run under sanitizers here", os.environ.get("CC", ""), "gcc", "clang")
    run_sanitized(compiler, sources("dieloop", 2), DISCRETE_CYCLES, ["-DIS_DIE", "-DLIVES=5"])


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_same_model_gives_the_same_bytes(tmp_path, fmi):
    device = Device.load("hp_tio2")
    first = export_device(device, tmp_path / "a" / "hp.fmu", fmi=fmi)
    second = export_device(device, tmp_path / "b" / "hp.fmu", fmi=fmi)
    assert first.path.read_bytes() == second.path.read_bytes()
    other = export_device(device.replace(r_on=101.0), tmp_path / "hp.fmu", fmi=fmi)
    assert other.token != first.token == second.token


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_archive_is_small_and_complete(tmp_path, fmi):
    written = export_device(Device.load("hp_tio2"), tmp_path / "hp.fmu", fmi=fmi)
    with zipfile.ZipFile(written.path) as file:
        names = set(file.namelist())
        page = file.read("documentation/index.html").decode()
        licence = file.read("documentation/licenses/license.txt").decode()
    wanted = {"modelDescription.xml", "sources/fmu.c"}
    assert wanted <= names
    assert ("sources/buildDescription.xml" in names) == (fmi == 3)
    assert "Apache-2.0" in licence
    assert "i = G(s, v) v" in page
    assert Device.load("hp_tio2").sources["r_on"].split()[0] in page


def test_ziglang_takes_over_where_there_is_no_compiler(tmp_path, monkeypatch):
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("shutil.which", lambda name: None)
    written = export_device(Device.load("hp_tio2_paper"), tmp_path / "hp.fmu", q0=0.0)
    monkeypatch.undo()
    assert written.platforms
    run = fmpy.simulate_fmu(str(written.path), fmi_type="CoSimulation", start_values={"v": 0.8}, stop_time=0.5)
    assert run["q"][-1] == pytest.approx(1.0 - (1.0 - 0.8) ** 0.5, abs=1e-9)


def test_without_a_compiler_the_sources_alone_are_written(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("ohmloom.fmu._compile.find_compiler", lambda: None)
    written = export_device(Device.load("hp_tio2"), tmp_path / "hp.fmu")
    assert written.platforms == ()
    assert "the FMU holds sources alone" in caplog.text
    with zipfile.ZipFile(written.path) as file:
        assert not [name for name in file.namelist() if name.startswith("binaries/")]


def test_a_compiler_that_fails_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(OperationError, match=r"^false: expected it to compile an FMU, got: no word. Try another"):
        export_device(Device.load("hp_tio2"), tmp_path / "hp.fmu")
    monkeypatch.setenv("CC", "no-such-compiler -O9")
    with pytest.raises(OperationError, match=r"^CC: expected a C compiler, got 'no-such-compiler -O9', which is not"):
        export_device(Device.load("hp_tio2"), tmp_path / "hp.fmu")
    assert not (tmp_path / "hp.fmu").exists()
