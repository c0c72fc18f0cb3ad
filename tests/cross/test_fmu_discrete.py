"""Controller, arena and closed loop as FMUs: spike for spike and step for step what `run_trial` does."""

import subprocess
import sys
from importlib.resources import files as files_of

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from ohmloom.devices._kernels import LAW_INDEX, flux, state_at_flux
from ohmloom.errors import OperationError, ParameterError, UnknownNameError
from ohmloom.fmu import Host, check, export_arena, export_controller, export_hardware_controller, export_system
from ohmloom.fmu._discrete_code import key_parts
from ohmloom.fmu._flux_code import FLUXES, INVERSES
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, Readings, SpikingController, champion
from ohmloom.sim import Arena, run_trial

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy")
KEY = 12345678901234567890  # both halves of it have their highest bit set or not: 0xAB54A98C_EB1F0AD2
STEP = 0.032
SENSORS = ("ir_0", "ir_2", "ir_5", "light_0", "light_2", "light_5")
ACTIONS = ("forward", "left", "right")
ACTION = ("action", "spikes_left", "spikes_right")
POSE = ("x", "y", "heading", "st")
# Every reading that has a branch of its own in controller.c, away from its default.
OTHER = Readings(lateral="both", weight_at="emission", last_spike=5, stdp_threshold=6, input_bias=False, clamp=False)
FORGETFUL = Readings(lateral="ascending", carry_state=False, high_count=3, synapse_gain=0.5)
HARD = Arena.paper(task="dynamic").replace(slip_mode="uniform", slip=0.4, shadow=True, second_part_start="start",
                                           goal=0.2, max_timesteps=1500)  # fmt: skip


def network(case):
    if case == "champion":
        return champion("HET")
    readings = {"emission": OTHER, "forgetful": FORGETFUL}[case]
    return Network.random(system="HET", rng=np.random.default_rng(3), hidden=7, readings=readings)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Name -> file, each compiled once."""
    folder = tmp_path_factory.mktemp("discrete")
    made = {}

    def file(name, export):
        if name not in made:
            made[name] = export(folder / f"{name}.fmu").path
        return made[name]

    return file


def controller_file(files, case, fmi):
    return files(f"{case}{fmi}", lambda out: export_controller(network(case), out, fmi=fmi))


def arena_file(files):
    return files("arena", lambda out: export_arena("dynamic", out))


@pytest.mark.parametrize(("case", "fmi"), [("champion", 2), ("emission", 3), ("forgetful", 2)])
def test_a_controller_is_the_compiled_one_spike_for_spike(files, master, case, fmi):
    trial = run_trial(SpikingController(network(case)), Arena.paper(task="dynamic"), trial_key=KEY)
    one = master(controller_file(files, case, fmi))
    assert one.get(*ACTION) == [0, 0, 0]
    got = []
    for k, sensors in enumerate(trial.sensors):
        one.set(**dict(zip(SENSORS, sensors, strict=True)))
        one.step(k)
        got.append(one.get(*ACTION))
    np.testing.assert_array_equal(got, np.column_stack([trial.actions, trial.output_spikes]))
    # A trial in which nothing happens would show nothing.
    assert len(got) > 1000
    assert np.unique(trial.output_spikes).size > 5


@pytest.mark.parametrize(("name", "arena", "fmi"), [
    ("static", Arena.paper(), 3), ("hard", HARD, 2), ("arena", Arena.paper(task="dynamic"), 2),
])  # fmt: skip
def test_an_arena_is_that_of_a_trial_step_for_step(files, master, name, arena, fmi):
    trial = run_trial(SpikingController(champion("HET")), arena, trial_key=KEY)
    one = master(files(name, lambda out: export_arena(arena, out, fmi=fmi)), **key_parts(KEY))
    seen, path = [], [one.get(*POSE)]
    for k, action in enumerate(trial.actions):
        seen.append(one.get(*SENSORS))
        assert not one.get("done")[0]
        one.set(action=int(action))
        one.step(k)
        path.append(one.get(*POSE))
    # Bit for bit: the same operations in the same order, and the same C library.
    np.testing.assert_array_equal(seen, trial.sensors)
    np.testing.assert_array_equal(path, np.column_stack([trial.path, trial.st]))
    assert one.get("solved", "done", "fitness", "bumps") == [trial.solved, True, trial.fitness, trial.bumps]
    one.step(len(path))
    assert one.get(*POSE) == path[-1]
    # The hard one begins its second part anew, and solves it; in the others the robot bumps.
    assert (trial.fitness == 2.0) == (name == "hard")
    assert (trial.bumps > 0) == (name != "hard")


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_loop_in_one_fmu_is_a_trial(files, master, fmi):
    arena = Arena.paper(task="dynamic")
    trial = run_trial(SpikingController(champion("HET")), arena, trial_key=KEY)
    file = files(f"loop{fmi}", lambda out: export_system(champion("HET"), out, task=arena, trial_key=1, fmi=fmi))
    one = master(file, **key_parts(KEY))
    path, acted = [one.get(*POSE)], []
    # Two timesteps in one communication step are two timesteps.
    for k in range(0, len(trial.actions) - 1, 2):
        one.step(k // 2, 2 * STEP)
        path.append(one.get(*POSE))
        acted.append(one.get(*ACTION))
    np.testing.assert_array_equal(path, np.column_stack([trial.path, trial.st])[::2][: len(path)])
    np.testing.assert_array_equal(acted, np.column_stack([trial.actions, trial.output_spikes])[1::2][: len(acted)])


@pytest.mark.parametrize("fmi", [2, 3])
def test_every_client_runs_a_controller(files, fmi):
    file = controller_file(files, "champion", fmi)
    found = check(file, start_values={"light_2": 0.9, "ir_0": 0.3})
    assert found.passed
    assert {row.client for row in found.rows if row.status == "passed"} >= {"FMPy", "fmuloader", "loader"} | (
        {"libcosimpy"} if fmi == 2 else set()
    )


def test_descriptions_have_no_problem(files):
    for file in (controller_file(files, "champion", 2), controller_file(files, "champion", 3), arena_file(files)):
        assert validate_fmu(str(file)) == []


SPREAD = """
[nonidealities]
write_verify = { value = 0.02, source = "test" }
event_charge = { value = 0.05, source = "test" }
threshold = { value = 0.01, source = "test" }
asymmetry = { value = 0.1, source = "test" }
neuron_threshold = { value = 0.02, source = "test" }
neuron_leak = { value = 0.02, source = "test" }
neuron_bias = { value = 0.02, source = "test" }
sense_offset = { value = 0.01, source = "test" }
tile_gain = { value = 0.02, source = "test" }
"""


@pytest.fixture(scope="module")
def spread_die(tmp_path_factory):
    """A die of the ideal spec with everything spread that an FMU of it has."""
    text = (files_of("ohmloom.mapping") / "specs" / "ideal.toml").read_text()
    begin = text.index("[nonidealities]")
    path = tmp_path_factory.mktemp("spec") / "spread.toml"
    path.write_text(text[:begin] + SPREAD.lstrip() + text[text.index("[endurance]") - 1 :])
    return place(champion("HET"), Hardware.load(path)).sample(seed=5)


def test_a_die_is_the_emulated_one_spike_for_spike(files, master, spread_die):
    nominal = place(champion("HET"), Hardware.load("ideal")).nominal()
    ends = []
    wired = place(champion("HET"), Hardware.load("het_mixed")).sample(seed=3)
    for name, die in (("nominal", nominal), ("spread", spread_die), ("wired", wired)):
        arena = Arena.paper(task="dynamic").replace(max_timesteps=1200)
        trial = run_trial(EmulatedController(die), arena, trial_key=KEY)
        one = master(files(name, lambda out, d=die: export_hardware_controller(d, out)))
        got = []
        for k, sensors in enumerate(trial.sensors):
            one.set(**dict(zip(SENSORS, sensors, strict=True)))
            one.step(k)
            got.append(one.get(*ACTION))
        np.testing.assert_array_equal(got, np.column_stack([trial.actions, trial.output_spikes]))
        ends.append(trial.path[-1])
    assert (ends[0] != ends[1]).any()
    assert (ends[0] != ends[2]).any()


def spec(folder, name, drive, effects=""):
    """A shipped spec with another drive."""
    text = (files_of("ohmloom.mapping") / "specs" / f"{name}.toml").read_text()
    at = [text.index(section) for section in ("[drive]", "[read]", "[nonidealities]", "[endurance]")]
    drive = f"[drive]\n{drive}\n" if drive else text[at[0] : at[1]]
    path = folder / f"{name}.toml"
    path.write_text(f"{text[: at[0]]}{drive}{text[at[1] : at[2]]}[nonidealities]\n{effects}\n{text[at[3] :]}")
    return Hardware.load(path)


def driven(mode, parallelism, waveform="half"):
    value = '{ value = %s, source = "test" }'
    duration = f"pulse_duration = {value % 2e-5}\n" if mode in ("voltage", "current") else ""
    return (f'source = "test"\nmode = "{mode}"\nwaveform = "{waveform}"\nparallelism = "{parallelism}"\n{duration}'
            f"pulse_voltage = {value % 1.0}\nthreshold = {value % 0.75}\n")  # fmt: skip


SELECTED = 'asymmetry = { value = 0.1, source = "test" }\nevent_charge = { value = 0.05, source = "test" }\n'
TROUBLED = "".join(f'{name} = {{ value = {value}, source = "test" }}\n' for name, value in {
    "event_charge": 0.05, "cycle_to_cycle": 0.2, "asymmetry": 0.1, "read_noise": 0.1, "quantisation": 6,
    "settling": 3e-10, "retention": 2.0, "read_disturb": 0.05, "sense_offset": 0.01,
}.items())  # fmt: skip
METER = 'metering_delay = { value = 0.3, source = "test" }\n'
HALF = 'half_select = { value = 0.01, source = "test" }\n'


@pytest.mark.parametrize(("system", "name", "drive", "effects"), [
    ("HP", "hp_1t1r", driven("voltage", "cell"), SELECTED),  # behind the wires' resistance
    ("HET", "ideal", driven("voltage", "cell"), SELECTED),
    ("PEO", "ideal", driven("voltage", "array"), HALF),
    ("HP", "ideal", driven("exact_width", "cell"), ""),
    ("HP", "hp_1t1r", driven("exact_width", "column"), SELECTED),
    ("HP", "hp_passive", "", ""),  # all lines at once, through their wires
    ("HP", "hp_strukov", "", ""),
    # Noise, ageing, disturb, converters.
    ("HET", "ideal", driven("charge_metered", "cell"), TROUBLED + METER),
    ("HP", "hp_1t1r", driven("charge_metered", "cell"), TROUBLED + METER),
    ("HET", "ideal", driven("voltage", "cell"), TROUBLED),
    ("PEO", "ideal", driven("exact_width", "cell"), TROUBLED),
    ("HP", "hp_passive", "", TROUBLED),
    ("forgetful", "ideal", driven("current", "array"), TROUBLED),
    # A law without closed forms, which is integrated.
    ("PEO", "peo_pani_redox", "", TROUBLED),
    ("PEO", "peo_pani_redox", driven("charge_metered", "cell"), TROUBLED + METER),
    ("PEO", "peo_pani_redox", driven("current", "cell"), TROUBLED),
    ("PEO", "peo_pani_redox", driven("voltage", "array"), TROUBLED + HALF),
], ids=["wires", "cells", "half", "exact", "exact_wires", "lines", "two_part", "metered", "metered_wires",
        "troubled_cells", "troubled_exact", "troubled_lines", "forgetful",
        "redox", "redox_metered", "redox_current", "redox_lines"])  # fmt: skip
def test_a_die_that_is_driven_otherwise_is_the_emulated_one(tmp_path, master, system, name, drive, effects):
    hardware = spec(tmp_path, name, drive, effects) if drive or effects else Hardware.load(name)
    # What is counted since the start goes on where nothing else is carried over.
    net = champion("HET").replace(readings=Readings(carry_state=False, high_count=6)) if system == "forgetful" else (
        champion(system))  # fmt: skip
    die = place(net, hardware).sample(seed=3)
    emulated = EmulatedController(die)
    one = master(export_hardware_controller(die, tmp_path / "die.fmu").path)
    before, rng = emulated.weights.copy(), np.random.default_rng(1)
    wanted, got = [], []
    for k in range(100 if name == "peo_pani_redox" else 400):  # an integrated pulse takes long
        # Sensors that rise and fall, so that inputs spike at many rates.
        sensors = np.clip(rng.uniform(-0.3, 0.8, 6) + 0.3 * np.sin(k / 20.0), 0.0, 1.0)
        action = emulated.step(sensors)
        wanted.append([ACTIONS.index(action), *map(int, emulated.output_spikes)])
        one.set(**dict(zip(SENSORS, sensors.tolist(), strict=True)))
        one.step(k)
        got.append(one.get(*ACTION))
    np.testing.assert_array_equal(got, wanted)
    # Devices have moved, and outputs did many things.
    assert np.abs(emulated.weights - before).max() > 0.01
    assert len(np.unique(wanted, axis=0)) > 2


@pytest.mark.parametrize(("system", "name", "drive", "limit", "text"), [
    ("HP", "hp_strukov", "", "MOST_ITERATIONS", "the potentials of the wires to converge"),
    ("PEO", "ideal", driven("voltage", "array"), "MOST_FLUX_ROUNDS", "the state that belongs to a pulse's flux"),
    ("HP", "hp_1t1r", driven("voltage", "cell"), "MOST_FLUX_ROUNDS", "the state that belongs to a pulse's flux"),
], ids=["wires", "flux", "flux_behind_wires"])  # fmt: skip
def test_what_does_not_converge_fails_the_step(tmp_path, monkeypatch, need_tool, system, name, drive, limit, text):
    compiler = need_tool("a solver that fails is not run here", "gcc", "clang")
    monkeypatch.setenv("CC", f"{compiler} -D{limit}=0")
    die = place(champion(system), spec(tmp_path, name, drive) if drive else Hardware.load(name)).sample(seed=3)
    path = export_hardware_controller(die, tmp_path / "die.fmu").path
    with Host(path) as host:
        host.set(dict.fromkeys(SENSORS, 0.7))
        # One communication step of 200 timesteps: the first pulse is not the first step's.
        with pytest.raises(OperationError, match=f"expected {text}"):
            host.step(200 * STEP)


@pytest.mark.parametrize("law", ["hp_linear", "linear", "peo_pani_mirror"])
def test_fluxes_in_c_are_those_of_the_kernels(need_tool, tmp_path, law):
    """Bit for bit: the same operations in the same order, and the same C library."""
    compiler = need_tool("fluxes in C are not compared here", "gcc", "clang")
    p = {"hp_linear": [100.0, 16000.0, 100.0], "linear": [1e4, 1e6, 1e-6], "peo_pani_mirror": [1e4, 1e6, 1e-6]}[law]
    states = np.linspace(0.0, 1.0, 101).tolist()
    fluxes = [float(flux(LAW_INDEX[law], s, np.array(p))) for s in states]
    inverse = INVERSES.get(law, "")
    lines = [f'    printf("%a\\n", {law}_flux({s!r}, p));' for s in states]
    lines += [f'    printf("%a\\n", {law}_state_at_flux({phi!r}, p));' for phi in fluxes if inverse]
    text = ["#include <math.h>", "#include <stdio.h>", FLUXES[law], inverse, "int main(void)", "{",
            f"    const double p[] = {{{', '.join(map(repr, p))}}};", *lines, "    return 0;", "}"]  # fmt: skip
    (tmp_path / "flux.c").write_text("\n".join(text))
    words = [compiler, "-std=c99", "-O2", "-ffp-contract=off", "flux.c", "-o", "flux", "-lm"]
    subprocess.run(words, cwd=tmp_path, check=True)
    printed = subprocess.run(["./flux"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout.split()
    wanted = fluxes + [float(state_at_flux(LAW_INDEX[law], phi, np.array(p))) for phi in fluxes if inverse]
    assert [float.fromhex(x) for x in printed] == wanted


def test_a_die_in_its_arena_is_a_trial(files, master, spread_die):
    trial = run_trial(EmulatedController(spread_die), Arena.paper(), trial_key=KEY)
    one = master(files("dieloop", lambda out: export_system(spread_die, out, task="static", trial_key=KEY)))
    path = []
    for k in range(400):
        one.step(k)
        path.append(one.get(*POSE))
    np.testing.assert_array_equal(path, np.column_stack([trial.path, trial.st])[1:401])


def test_fmutool_finds_no_error(files):
    for file in (controller_file(files, "champion", 2), controller_file(files, "champion", 3), arena_file(files)):
        words = [sys.executable, "-m", "fmu_manipulation_toolbox.cli.fmutool", "-input", str(file), "-check"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert (
            f"No semantic error against the FMI-{3 if '3' in file.name else 2} standard." in done.stdout + done.stderr
        )


def test_dependencies_say_what_a_step_needs(files, master):
    controller = master(controller_file(files, "champion", 2))
    for unknown in controller.d.outputs:
        assert [v.name for v in unknown.dependencies] == list(SENSORS)
    arena = master(arena_file(files))
    assert [unknown.dependencies for unknown in arena.d.outputs] == [[]] * 14


def test_reset_and_instances_beside_each_other(files, master):
    file = controller_file(files, "champion", 2)
    first, second = master(file), master(file)
    sensors = dict(zip(SENSORS, (0.0, 0.0, 0.4, 0.7, 0.9, 0.2), strict=True))

    def run(one):
        one.set(**sensors)
        rows = []
        for k in range(50):
            one.step(k)
            rows.append(one.get(*ACTION))
        return rows

    wanted = run(first)
    assert run(second) == wanted  # the first's history is not the second's
    assert run(first) != wanted  # but its own
    first.fmu.reset()
    first.start()
    assert run(first) == wanted


def test_start_values_are_parameters(files, master):
    file = controller_file(files, "champion", 2)
    quick, slow = master(file, y_thresh=0.3), master(file, y_thresh=3.0)
    for one in (quick, slow):
        one.set(light_2=0.9)
        for k in range(30):
            one.step(k)
    assert quick.get("spikes_left")[0] > slow.get("spikes_left")[0]
    with pytest.raises(Exception, match="SetInteger"):
        slow.set(high_count=3)
    # FMPy keeps one callback for all: the last instance's.
    assert "high_count: expected to be set before the end of initialization" in slow.log[-1]


@pytest.mark.parametrize(("value", "text"), [
    (1.5, "ir_0: expected a number from 0 to 1, got 1.5"),
    (float("nan"), "ir_0: expected a number from 0 to 1, got nan"),
])  # fmt: skip
def test_sensors_out_of_range_are_refused(files, master, value, text):
    one = master(controller_file(files, "champion", 2))
    with pytest.raises(Exception, match="SetReal"):
        one.set(ir_0=value)
    assert text in one.log[-1]


def test_other_steps_actions_and_types_are_refused(files, master):
    one = master(arena_file(files))
    with pytest.raises(Exception, match="DoStep"):
        one.step(0, 0.01)
    assert "expected a step of 0.032 s or a multiple of it, got 0.01" in one.log[-1]
    two = master(arena_file(files))
    with pytest.raises(Exception, match="SetInteger"):
        two.set(action=3)
    assert "action: expected a number from 0 to 2, got 3" in two.log[-1]
    with pytest.raises(Exception, match="GetReal"):
        two.fmu.getReal([two.variables["action"].valueReference])
    assert "expected a variable of the type that the function is for" in two.log[-1]


def test_a_state_of_another_model_is_refused(files, master):
    arena, controller = master(arena_file(files)), master(controller_file(files, "champion", 2))
    state = arena.fmu.getFMUstate()
    data = arena.fmu.serializeFMUstate(state)
    arena.fmu.freeFMUstate(state)
    with pytest.raises(Exception, match="DeSerialize"):
        controller.fmu.deSerializeFMUstate(data)
    assert "of a state of this very FMU" in controller.log[-1]


def test_bad_options_are_refused_before_any_work(tmp_path):
    out = tmp_path / "x.fmu"
    with pytest.raises(ParameterError, match=r"^export_controller: network: expected .*Network"):
        export_controller("net.json", out)
    with pytest.raises(ParameterError, match=r"^export_controller: timestep: expected 1e-06 to 1e\+06 s, got 0\."):
        export_controller(champion("HET"), out, timestep=0)
    with pytest.raises(UnknownNameError, match=r"^export_arena: task: .*static"):
        export_arena("statics", out)
    with pytest.raises(ParameterError, match=r"^export_arena: trial_key: "):
        export_arena("static", out, trial_key=2**64)
    assert not out.exists()
