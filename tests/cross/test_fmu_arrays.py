"""FMUs of FMI 3.0 with arrays: bit for bit those with scalars, in FMPy, fmuloader, a host and a probe."""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from ohmloom.circuits import Memristor, MemristorCrossbar, Netlist, VoltageSource
from ohmloom.devices import Device
from ohmloom.errors import ParameterError
from ohmloom.fmu import Host, check, export_arena, export_controller, export_crossbar, export_hardware_controller, run
from ohmloom.fmu._archive import open_archive
from ohmloom.fmu._process import run_probe
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import champion

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy")
HP = Device.load("hp_tio2_10k")
V_ROW, V_COLUMN = [1.0, -0.5, 0.7], [0.0, 0.1, 0.0, -0.2]
SENSORS = ("ir_0", "ir_2", "ir_5", "light_0", "light_2", "light_5")


def crossbar(kind=0):
    s = np.random.default_rng(1).uniform(0.2, 0.9, (3, 4))
    return MemristorCrossbar(devices=HP, s=s, kind=np.zeros((3, 4), dtype=int) + kind, r_row=1.0, r_column=2.0)


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """The same crossbar by scalars and by arrays."""
    folder = tmp_path_factory.mktemp("arrays")
    return [export_crossbar(crossbar(), folder / f"{name}.fmu", fmi=3, arrays=arrays).path
            for name, arrays in (("scalars", False), ("arrays", True))]  # fmt: skip


def lines():
    return {f"v_row_{i}": v for i, v in enumerate(V_ROW)} | {f"v_column_{j}": v for j, v in enumerate(V_COLUMN)}


def stacked(result, name, shape):
    """Scalars ``name_I_J`` as an array, axes (time, I, J)."""
    return np.stack([result[name.format(*map(str, i))] for i in np.ndindex(shape)], axis=-1).reshape(-1, *shape)


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_arrays_are_the_scalars_bit_for_bit(pair, interface):
    # Long enough for devices to come to rest at their limits, which are events.
    options = {"fmi_type": interface, "stop_time": 1.0, "output_interval": 0.05}
    scalars = fmpy.simulate_fmu(str(pair[0]), start_values=lines(), **options)
    arrays = fmpy.simulate_fmu(str(pair[1]), start_values={"v_row": V_ROW, "v_column": V_COLUMN}, **options)
    assert validate_fmu(str(pair[1])) == []
    np.testing.assert_array_equal(arrays["time"], scalars["time"])
    np.testing.assert_array_equal(arrays["q"], stacked(scalars, "q_{}_{}", (3, 4)))
    np.testing.assert_array_equal(arrays["i_column"], stacked(scalars, "i_column_{}", (4,)))
    assert np.isin(arrays["q"][-1] / HP.charge_scale, (0.0, 1.0)).sum() > 5


def test_descriptions_and_dependencies_are_by_array(pair):
    d = fmpy.read_model_description(str(pair[1]))
    shapes = {v.name: v.shape for v in d.modelVariables if v.shape}
    assert shapes == {"q0": (3, 4), "v_row": (3,), "v_column": (4,), "q": (3, 4), "der(q)": (3, 4), "i_column": (4,),
                      "q_from_limits": (3, 4, 2)}  # fmt: skip
    needs = {u.variable.name: u.dependencies and {v.name for v in u.dependencies} for u in d.outputs}
    assert needs == {"q": {"q"}, "i_column": None}  # None: everything
    starts = next(v.start for v in d.modelVariables if v.name == "q0")
    np.testing.assert_array_equal([float(x) for x in str(starts).split()], crossbar().s.ravel() * HP.charge_scale)


def test_derivatives_are_those_of_the_scalars(pair, master):
    scalars, arrays = master(pair[0], **lines()), master(pair[1])
    for name, values in (("v_row", V_ROW), ("v_column", V_COLUMN)):
        arrays.fmu.setFloat64([arrays.variables[name].valueReference], values)
    rng = np.random.default_rng(4)
    seed, weights = rng.normal(size=15), rng.normal(size=16)

    def refs(one, *names):
        return [one.variables[name].valueReference for name in names]

    cells, columns = [f"{i}_{j}" for i, j in np.ndindex(3, 4)], [f"i_column_{j}" for j in range(4)]
    few = refs(scalars, *(f"q_{cell}" for cell in cells), "v_row_0", "v_row_1", "v_row_2")
    many = refs(scalars, *(f"der(q_{cell})" for cell in cells), *columns)
    forward = scalars.fmu.getDirectionalDerivative(many, few, list(seed))
    backward = scalars.fmu.getAdjointDerivative(many, few, list(weights), 15)
    into, out = refs(arrays, "q", "v_row"), refs(arrays, "der(q)", "i_column")
    assert list(arrays.fmu.getDirectionalDerivative(out, into, list(seed), 16)) == list(forward)
    assert list(arrays.fmu.getAdjointDerivative(out, into, list(weights), 15)) == list(backward)
    assert len(set(forward)) > 10


def test_every_client_that_knows_arrays_runs_it(pair):
    found = check(pair[1], start_values={"v_row": V_ROW})
    rows = {(row.what, row.client): row for row in found.rows}
    assert found.passed, found.rows
    assert rows["CoSimulation", "fmuloader"].status == "passed"
    assert rows["state round trip", "FMPy"].status == "passed"
    assert rows["ModelExchange", "pathsim"].detail == "knows no arrays"


def test_fmuloader_has_the_same_bits_too(pair):
    given = (lines(), {"v_row": V_ROW, "v_column": V_COLUMN})
    scalars, arrays = (
        run_probe(open_archive(file), "fmuloader", {"start_values": values, "step_size": 0.01})["values"]
        for file, values in zip(pair, given, strict=True)
    )
    assert list(arrays.values()) == list(scalars.values())
    assert len(set(arrays.values())) > 8  # several rest at a limit


def test_a_run_and_a_host_have_its_elements(pair):
    scalars = run(pair[0], stop_time=0.1, start_values=lines())
    arrays = run(pair[1], stop_time=0.1, start_values={"v_row": V_ROW, "v_column": V_COLUMN})
    np.testing.assert_array_equal(arrays.values["q[2,1]"], scalars.values["q_2_1"])
    with Host(pair[1]) as host:
        host.set({"v_row": V_ROW, "v_column": V_COLUMN})
        host.step(0.1)
        np.testing.assert_allclose(host.get(["q"])["q"][9], scalars.values["q_2_1"][-1], rtol=1e-6)
    with pytest.raises(ParameterError, match=r": v_row: expected 3 numbers, got 2\."):
        run(pair[1], stop_time=0.1, start_values={"v_row": [0.0, 1.0]})
    with pytest.raises(ParameterError, match=r": v_row: expected a value from "):
        run(pair[1], stop_time=0.1, start_values={"v_row": 1e300})


def test_elements_of_an_array_have_no_reference_of_their_own(pair, master):
    one = master(pair[1])
    v_row = one.variables["v_row"].valueReference
    for references, values in (([v_row + 1], [0.5]), ([v_row], [0.5]), ([v_row], [0.5] * 4), ([10**6], [0.5])):
        with pytest.raises(Exception, match="SetFloat64"):
            one.fmu.setFloat64(references, values)
    assert "expected variables of 1 values together, got others" in one.log[0]


def test_an_array_with_open_crosspoints_is_a_list_of_its_devices(tmp_path):
    kind = np.zeros((3, 4), dtype=int)
    kind[1, 2] = kind[0, 0] = -1
    files = [export_crossbar(crossbar(kind), tmp_path / f"{x}.fmu", fmi=3, arrays=x).path for x in (False, True)]
    scalars = fmpy.simulate_fmu(str(files[0]), fmi_type="CoSimulation", stop_time=0.1, start_values={"v_row_1": 1.0})
    arrays = fmpy.simulate_fmu(str(files[1]), fmi_type="CoSimulation", stop_time=0.1,
                               start_values={"v_row": [0.0, 1.0, 0.0]})  # fmt: skip
    wanted = [scalars[f"q_{i}_{j}"] for i, j in np.ndindex(3, 4) if kind[i, j] >= 0]
    np.testing.assert_array_equal(arrays["q"], np.column_stack(wanted))


@pytest.mark.parametrize("name", ["controller", "die"])
def test_a_controller_takes_its_sensors_as_one_array(tmp_path, master, name):
    def export(out, arrays):
        if name == "controller":
            return export_controller(champion("HET"), out, fmi=3, arrays=arrays).path
        die = place(champion("HET"), Hardware.load("ideal")).nominal()
        return export_hardware_controller(die, out, fmi=3, arrays=arrays).path

    scalars, arrays = (master(export(tmp_path / f"{x}.fmu", x)) for x in (False, True))
    assert validate_fmu(str(tmp_path / "True.fmu")) == []
    assert check(tmp_path / "True.fmu", start_values={"sensors": [0.1] * 6}).passed
    rng, seen = np.random.default_rng(1), []
    for k in range(200):
        values = rng.uniform(size=6).tolist()
        scalars.set(**dict(zip(SENSORS, values, strict=True)))
        arrays.fmu.setFloat64([arrays.variables["sensors"].valueReference], values)
        for one in (scalars, arrays):
            one.step(k)
        seen.append(arrays.get("action", "spikes_left", "spikes_right"))
        assert seen[-1] == scalars.get("action", "spikes_left", "spikes_right")
    assert len(np.unique(seen, axis=0)) > 5


def test_an_arena_gives_its_sensors_as_one_array(tmp_path, master):
    scalars, arrays = (
        master(export_arena("dynamic", tmp_path / f"{x}.fmu", fmi=3, arrays=x).path) for x in (False, True)
    )
    for k in range(50):
        for one in (scalars, arrays):
            one.set(action=1 if k % 5 == 0 else 0)
            one.step(k)
        got = arrays.fmu.getFloat64([arrays.variables["sensors"].valueReference], 6)
        assert list(got) == scalars.get(*SENSORS)
    assert max(got) > 0.0


def test_arrays_elsewhere_are_refused(tmp_path):
    out = tmp_path / "x.fmu"
    with pytest.raises(ParameterError, match=r"^export_crossbar: arrays: expected FMI 3\.0, since FMI 2\.0 has no"):
        export_crossbar(crossbar(), out, arrays=True)
    with pytest.raises(ParameterError, match=r"^export_controller: arrays: expected FMI 3\.0"):
        export_controller(champion("HET"), out, arrays=True)
    with pytest.raises(ParameterError, match=r"^export_crossbar: arrays: expected True or False, got 'yes'"):
        export_crossbar(crossbar(), out, fmi=3, arrays="yes")
    parts = (VoltageSource(name="V1", p="a", n="0", voltage=1.0),
             Memristor(name="M1", p="a", n="0", device=HP, s0=0.5))  # fmt: skip
    with pytest.raises(ParameterError, match=r"^export_crossbar: arrays: expected a crossbar"):
        export_crossbar(Netlist(elements=parts), out, fmi=3, arrays=True)
    assert not out.exists()
