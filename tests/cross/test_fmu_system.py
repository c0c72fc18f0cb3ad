"""The closed loop as a system of two FMUs: in our runner, in FMPy and fmucontainer; rings; hosted parts of a trial."""

import io
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd

from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, MissingFileError, ParameterError, UnknownNameError
from ohmloom.fmu import Host, HostedArena, HostedController, check, export_device, export_system, run_ssp
from ohmloom.fmu.build import archive
from ohmloom.neurocontroller import SpikingController, champion
from ohmloom.sim import Arena, run_trial

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy")
KEY = 12345678901234567890
STEP, COUNT = 0.032, 400
DYNAMIC = Arena.paper(task="dynamic")
POSE = ("x", "y", "heading")


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return export_system(
        champion("HET"), tmp_path_factory.mktemp("loop") / "loop.ssp", task="dynamic", trial_key=KEY
    ).path


@pytest.fixture(scope="module")
def parts(loop, tmp_path_factory):
    """The FMUs inside: name -> file."""
    folder = tmp_path_factory.mktemp("parts")
    with zipfile.ZipFile(loop) as file:
        file.extractall(folder)
    return {name: folder / "resources" / f"{name}.fmu" for name in ("controller", "arena")}


@pytest.fixture(scope="module")
def hp(tmp_path_factory):
    return export_device(Device.load("hp_tio2_paper"), tmp_path_factory.mktemp("hp") / "hp.fmu").path


def trial(**options):
    return run_trial(SpikingController(champion("HET")), DYNAMIC, trial_key=KEY, **options)


def pose_of(values, prefix=""):
    return np.column_stack([values[prefix + name] for name in POSE])


def test_our_runner_follows_the_path_of_a_trial(loop):
    wanted = trial()
    found = run_ssp(loop, stop_time=COUNT * STEP)
    np.testing.assert_array_equal(pose_of(found.values, "arena."), wanted.path[: COUNT + 1])
    np.testing.assert_array_equal(found.values["controller.action"][1:], wanted.actions[:COUNT])
    # Another key is another trial, whatever the file says.
    other = run_ssp(loop, stop_time=STEP, start_values={"arena.trial_key_low": 5})
    assert other.values["arena.x"][0] != found.values["arena.x"][0]


def test_fmucontainer_follows_that_of_a_trial_with_a_delay(loop, tmp_path):
    (tmp_path / "loop.ssp").write_bytes(loop.read_bytes())
    words = [sys.executable, "-m", "fmu_manipulation_toolbox.cli.fmucontainer", "-container", f"loop.ssp:{STEP}",
             "-fmu-directory", str(tmp_path)]  # fmt: skip
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (tmp_path / "loop.fmu").exists(), done.stdout + done.stderr
    # In a process of its own: the container's code is not ours, and does not bear what other tests have loaded before.
    code = (
        "import sys, fmpy, numpy as np; step, count = 0.032, 400; "
        "found = fmpy.simulate_fmu('loop.fmu', stop_time=count * step, step_size=step, output_interval=step); "
        "np.save('found.npy', np.column_stack([found[name] for name in ('x', 'y', 'heading')]))"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    np.testing.assert_array_equal(np.load(tmp_path / "found.npy"), trial(action_delay=1).path[: COUNT + 1])


class LateController:
    """Sees nothing in its first timestep, as FMPy hands on no value before it."""

    def __init__(self):
        self.controller = SpikingController(champion("HET"))

    def reset(self):
        self.controller.reset()
        self.is_first = True

    def step(self, sensors):
        seen = np.zeros(6) if self.is_first else sensors
        self.is_first = False
        return self.controller.step(seen)


def test_fmpy_follows_it_but_for_the_first_sensors(loop):
    read_ssd(str(loop))  # validates
    found = simulate_ssp(str(loop), stop_time=COUNT * STEP - STEP / 2, step_size=STEP)
    wanted = run_trial(LateController(), DYNAMIC, trial_key=KEY, action_delay=1)
    np.testing.assert_array_equal(pose_of(found), wanted.path[1 : len(found) + 1])
    assert len(found) >= COUNT


def test_a_system_is_checked_whole_and_in_its_parts(loop):
    found = check(loop, start_values={"arena.max_timesteps": 50})
    assert found.passed, found.rows
    assert found.fmi is None
    passed = {(row.what, row.client) for row in found.rows if row.status == "passed"}
    assert {("system", "ohmloom"), ("system", "FMPy"), ("arena: CoSimulation", "libcosimpy"),
            ("controller: state round trip", "FMPy")} <= passed  # fmt: skip
    with pytest.raises(ParameterError, match=r"loop\.ssp:resources/arena\.fmu: max_timesteps: expected a value from 1"):
        check(loop, start_values={"arena.max_timesteps": 0})
    with pytest.raises(UnknownNameError, match=r"component: expected one of arena, controller, got 'lamp'"):
        check(loop, start_values={"lamp.power": 1.0})


def test_a_system_with_a_part_that_fails_is_named(loop, tmp_path):
    with zipfile.ZipFile(loop) as file:
        inside = {name: file.read(name) for name in file.namelist()}
    bad = tmp_path / "bad.ssp"
    bad.write_bytes(archive(inside | {"resources/arena.fmu": inside["resources/arena.fmu"][:2000]}))
    with pytest.raises(FileFormatError, match=r"bad\.ssp:resources/arena\.fmu: expected a zip file"):
        check(bad)
    with zipfile.ZipFile(io.BytesIO(inside["resources/arena.fmu"])) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    library = next(name for name in parts if name.startswith("binaries/"))
    bad.write_bytes(archive(inside | {"resources/arena.fmu": archive(parts | {library: b"none"})}))
    found = check(bad)
    assert not found.passed
    failed = [row for row in found.rows if row.status == "failed"]
    assert all("bad.ssp:resources/arena.fmu" in row.detail for row in failed)
    assert "system" not in {row.what for row in found.rows}


def test_hosted_parts_run_a_trial(parts):
    wanted = trial()
    arena = Arena.paper(task="dynamic")
    with Host(parts["controller"]) as controller, Host(parts["arena"], start_values={"max_timesteps": 300}) as hosted:
        for _ in range(2):  # reset between
            found = run_trial(HostedController(controller), HostedArena(hosted), trial_key=KEY)
            n = len(found.actions)
            assert 100 < n <= 300
            np.testing.assert_array_equal(found.path, wanted.path[: n + 1])
            np.testing.assert_array_equal(found.sensors, wanted.sensors[:n])
            np.testing.assert_array_equal(found.output_spikes, wanted.output_spikes[:n])
            assert (found.task, found.timesteps) == ("dynamic", wanted.st[n])
        mixed = run_trial(HostedController(controller), arena.replace(max_timesteps=100), trial_key=KEY)
        np.testing.assert_array_equal(mixed.path, wanted.path[: len(mixed.path)])


def test_a_host_of_another_kind_is_refused(parts):
    with Host(parts["arena"]) as host, pytest.raises(ParameterError, match=r"arena.fmu: expected the inputs ir_0, .*"):
        HostedController(host)
    with (
        Host(parts["controller"]) as host,
        pytest.raises(ParameterError, match=r"expected the inputs action, got none"),
    ):
        HostedArena(host)


def system(path, wires, sources, extra=""):
    """An SSP file of components (name -> file) and wires ("a.i", "b.v")."""
    parts = "".join(
        f'<c:Component name="{name}" source="resources/{name}.fmu">{extra}</c:Component>' for name in sources
    )
    lines = "".join('<c:Connection startElement="{}" startConnector="{}" endElement="{}" endConnector="{}"/>'.format(
        *a.split("."), *b.split(".")) for a, b in wires)  # fmt: skip
    text = ('<c:SystemStructureDescription xmlns:c="http://ssp-standard.org/SSP1/SystemStructureDescription" '
            f'version="1.0" name="s"><c:System name="s"><c:Elements>{parts}</c:Elements><c:Connections>{lines}'
            "</c:Connections></c:System></c:SystemStructureDescription>")  # fmt: skip
    content = {f"resources/{name}.fmu": file.read_bytes() for name, file in sources.items()}
    path.write_bytes(archive({**content, "SystemStructure.ssd": text.encode()}))
    return path


def test_a_ring_of_direct_feedthrough_is_named(hp, tmp_path):
    ring = system(tmp_path / "ring.ssp", [("a.i", "b.v"), ("b.i", "a.v")], {"a": hp, "b": hp})
    with pytest.raises(
        FileFormatError, match=r"ring of direct feedthrough, got .*a\.i -> b\.v -> b\.i -> a\.v"
    ) as caught:
        run_ssp(ring, step_size=0.01)
    assert "Export its models as one flattened FMU." in str(caught.value)
    # The charge is a state: the same ring through it is none.
    cut = system(tmp_path / "cut.ssp", [("a.q", "b.v"), ("b.i", "a.v")], {"a": hp, "b": hp})
    found = run_ssp(cut, step_size=0.01, stop_time=0.1, start_values={"a.q0": 0.2})
    assert found.values["a.q"][-1] > 0.2
    # And what follows from inputs at once does so at each point, not a step later.
    gain = found.values["b.i"][0] * found.values["b.memristance"][0]
    assert gain == pytest.approx(0.2, rel=1e-12)


def test_parameters_of_the_file_are_honoured(hp, tmp_path):
    value = ('<c:ParameterBindings><c:ParameterBinding><c:ParameterValues>'
             '<v:ParameterSet xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0">'
             '<v:Parameters><v:Parameter name="q0"><v:Real value="0.25"/></v:Parameter></v:Parameters></v:ParameterSet>'
             "</c:ParameterValues></c:ParameterBinding></c:ParameterBindings>")  # fmt: skip
    file = system(tmp_path / "one.ssp", [], {"a": hp}, extra=value)
    assert run_ssp(file, step_size=0.01, stop_time=0.01).values["a.q"][0] == 0.25
    assert run_ssp(file, step_size=0.01, stop_time=0.01, start_values={"a.q0": 0.5}).values["a.q"][0] == 0.5


def test_bad_systems_are_refused(hp, tmp_path):
    with pytest.raises(MissingFileError, match=r"none.ssp: expected an SSP file, got none"):
        run_ssp(tmp_path / "none.ssp")
    (tmp_path / "no.ssp").write_bytes(b"no zip")
    with pytest.raises(FileFormatError, match=r"no.ssp: expected a zip file, got File is not a zip file"):
        run_ssp(tmp_path / "no.ssp")
    with pytest.raises(FileFormatError, match=r"hp.fmu: expected SystemStructure.ssd inside"):
        run_ssp(hp)
    unknown = system(tmp_path / "unknown.ssp", [("a.i", "z.v")], {"a": hp})
    with pytest.raises(FileFormatError, match=r"Connection: expected a component, got 'z'"):
        run_ssp(unknown)
    misspelt = system(tmp_path / "misspelt.ssp", [("a.j", "b.v")], {"a": hp, "b": hp})
    with pytest.raises(UnknownNameError, match=r"misspelt.ssp: a: output: .*got 'j'"):
        run_ssp(misspelt, step_size=0.01)
    twice = system(tmp_path / "twice.ssp", [("a.i", "b.v"), ("a.q", "b.v")], {"a": hp, "b": hp})
    with pytest.raises(FileFormatError, match=r"b\.v: expected one connection, got two"):
        run_ssp(twice)
    one = system(tmp_path / "one.ssp", [], {"a": hp})
    for name, value in (("stop_time", 0.0), ("step_size", 0.0)):
        with pytest.raises(ParameterError, match=rf"run_ssp: {name}: expected a time above 0 s, got"):
            run_ssp(one, **{name: value})
    with pytest.raises(ParameterError, match=r"expected at most 10000000 steps, got 1e\+308"):
        run_ssp(one, stop_time=1e306, step_size=0.01)
    with zipfile.ZipFile(one) as file:
        inside = {name: file.read(name) for name in file.namelist()}
    for text in ("abc", "", "-1", "nan"):
        timed = inside["SystemStructure.ssd"].replace(b"</c:System>", (
            f'</c:System><c:DefaultExperiment stopTime="{text}"/>').encode())  # fmt: skip
        assert timed != inside["SystemStructure.ssd"]
        (tmp_path / "timed.ssp").write_bytes(archive(inside | {"SystemStructure.ssd": timed}))
        with pytest.raises(FileFormatError, match=r"SystemStructure.ssd: stopTime: expected a time above 0 s, got"):
            run_ssp(tmp_path / "timed.ssp")
    # By its place in the system's file, not by where that was unpacked.
    with pytest.raises(ParameterError, match=r"one\.ssp:resources/.*: q0: expected"):
        run_ssp(one, start_values={"a.q0": -1.0})
    with pytest.raises(UnknownNameError, match=r"start values: component"):
        run_ssp(system(tmp_path / "one.ssp", [], {"a": hp}), start_values={"z.v": 1.0})
    with pytest.raises(ParameterError, match=r"export_system: out: expected a file that ends in .fmu or .ssp"):
        export_system(champion("HET"), tmp_path / "x.zip")
