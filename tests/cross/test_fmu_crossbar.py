"""Crossbars and netlists as flattened FMUs: what `circuits` computes, what device FMUs compute, what SciPy computes."""

import subprocess
import sys

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from ohmloom.circuits import (
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    MemristorCrossbar,
    Netlist,
    PulseTrain,
    Resistor,
    VoltageSource,
    memristor_netlist,
)
from ohmloom.devices import Device
from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.fmu import check, export_crossbar, export_device
from ohmloom.fmu.crossbar import choose_tile, tile_circuit
from ohmloom.mapping import Hardware, place
from ohmloom.mapping.grid import tile_crossbar
from ohmloom.neurocontroller import champion

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy")
HP = Device.load("hp_tio2_10k")
H, STEPS = 1e-3, 5
# Of q against circuits: both integrate with 1e-12 of the range or better.
SAME = 1e-9


def states(shape, seed=1):
    return np.random.default_rng(seed).uniform(0.2, 0.8, shape)


ARRAYS = {
    "wires": MemristorCrossbar(devices=HP, s=states((4, 4)), r_row=1.0, r_column=2.0),
    "ends": MemristorCrossbar(devices=HP, s=states((3, 4)), r_row=1.0, r_column=1.0, r_driver=50.0, r_sense=20.0,
                              drive="both", sense="both"),
    "ideal": MemristorCrossbar(devices=HP, s=states((4, 4))),
    # Two kinds, of which one is not ohmic, and an open crosspoint.
    "mixed": MemristorCrossbar(devices=(Device.load("vteam_memtorch"), Device.load("yakopcic_miao")), r_row=5.0,
                               r_column=5.0, s=states((3, 3)), kind=[[0, 1, 0], [1, -1, 1], [0, 0, 1]]),
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """(name, fmi) -> file, each compiled once."""
    folder = tmp_path_factory.mktemp("crossbar")
    made = {}

    def file(name, fmi=2):
        if (name, fmi) not in made:
            made[name, fmi] = export_crossbar(ARRAYS[name], folder / f"{name}{fmi}.fmu", fmi=fmi).path
        return made[name, fmi]

    return file


def lines(shape, amplitude):
    rng = np.random.default_rng(2)
    return rng.uniform(-amplitude, amplitude, shape[0]), rng.uniform(-0.1, 0.1, shape[1]) * amplitude


def inputs(v_row, v_column):
    return {f"v_row_{i}": v for i, v in enumerate(v_row)} | {f"v_column_{j}": v for j, v in enumerate(v_column)}


@pytest.mark.parametrize(("name", "fmi", "amplitude", "h"), [
    ("wires", 2, 1.0, H), ("ends", 3, 1.0, H), ("mixed", 3, 0.5, 1e-4),
])  # fmt: skip
def test_a_crossbar_is_that_of_circuits(files, name, fmi, amplitude, h):
    array = ARRAYS[name]
    v_row, v_column = lines(array.s.shape, amplitude)
    t = h * np.arange(STEPS + 1)
    wanted = array.simulate(t, np.tile(v_row, (t.size, 1)), np.tile(v_column, (t.size, 1)), tolerance=1e-12)
    file = str(files(name, fmi))
    assert validate_fmu(file) == []
    found = fmpy.simulate_fmu(file, fmi_type="CoSimulation", stop_time=float(t[-1]), step_size=h, output_interval=h,
                              relative_tolerance=1e-12, start_values=inputs(v_row, v_column))  # fmt: skip
    for (i, j), k in np.ndenumerate(array.kind):
        if k >= 0:
            s = found[f"q_{i}_{j}"] / array.devices[k].charge_scale
            np.testing.assert_allclose(s, wanted.s[:, i, j], rtol=0, atol=SAME)
    current = np.column_stack([found[f"i_column_{j}"] for j in range(array.s.shape[1])])
    np.testing.assert_allclose(current, wanted.current, rtol=0, atol=SAME * np.abs(wanted.current).max())
    assert np.abs(wanted.s[-1] - wanted.s[0]).max() > 0.01


def test_devices_that_saturate_are_those_of_circuits(files):
    array = ARRAYS["wires"]
    v_row, v_column = lines((4, 4), 1.0)
    t = 0.05 * np.arange(21)
    wanted = array.simulate(t, np.tile(v_row, (t.size, 1)), np.tile(v_column, (t.size, 1)), tolerance=1e-12)
    found = fmpy.simulate_fmu(str(files("wires")), fmi_type="CoSimulation", stop_time=1.0, step_size=0.05,
                              relative_tolerance=1e-12, output_interval=0.05,
                              start_values=inputs(v_row, v_column))  # fmt: skip
    s = np.array([[found[f"q_{i}_{j}"] for j in range(4)] for i in range(4)]).transpose(2, 0, 1) / HP.charge_scale
    np.testing.assert_allclose(s, wanted.s, rtol=0, atol=SAME)
    assert np.isin(wanted.s[-1], (0.0, 1.0)).sum() > 8


def test_without_wires_it_is_as_many_device_fmus(files, tmp_path, master):
    array = ARRAYS["ideal"]
    v_row, v_column = lines((4, 4), 1.0)
    one = master(files("ideal", 3), **inputs(v_row, v_column))
    card = export_device(HP, tmp_path / "hp.fmu").path
    devices = {(i, j): master(card, q0=array.s[i, j] * HP.charge_scale, v=v_row[i] - v_column[j])
               for i, j in np.ndindex(4, 4)}  # fmt: skip
    for k in range(20):
        for fmu in (one, *devices.values()):
            fmu.step(k, H)
    for (i, j), fmu in devices.items():
        # Each chooses steps of its own: their errors at the tolerance 1e-8 are 1e-13 of the range here.
        assert one.get(f"q_{i}_{j}")[0] / HP.charge_scale == pytest.approx(fmu.get("q")[0] / HP.charge_scale, abs=1e-12)
    total = sum(fmu.get("i")[0] for (_, j), fmu in devices.items() if j == 1)
    assert one.get("i_column_1")[0] == pytest.approx(total, rel=1e-12)


def test_dependencies_are_exact(files, master):
    def needs(name):
        d = master(files(name, 3 if name == "ideal" else 2)).d
        return {u.variable.name: None if u.dependencies is None else {v.name for v in u.dependencies}
                for u in [*d.outputs, *d.derivatives]}  # fmt: skip

    ideal = needs("ideal")
    assert ideal["der(q_1_2)"] == {"v_row_1", "v_column_2", "q_1_2"}
    assert ideal["i_column_2"] == {"v_column_2", *(f"v_row_{i}" for i in range(4)), *(f"q_{i}_2" for i in range(4))}
    assert ideal["q_1_2"] == {"q_1_2"}
    assert needs("wires")["der(q_1_2)"] is None  # everything


@pytest.mark.parametrize(("name", "amplitude"), [("ends", 1.0), ("mixed", 0.5), ("ideal", 1.0)])
def test_derivatives_are_those_of_differences(files, master, name, amplitude):
    array, file = ARRAYS[name], files(name, 3)
    volts = inputs(*lines(array.s.shape, amplitude))
    q_d = {f"q_{i}_{j}": array.devices[k].charge_scale for (i, j), k in np.ndenumerate(array.kind) if k >= 0}
    one = master(file, **volts)
    unknowns = [*(f"der({q})" for q in q_d), *(f"i_column_{j}" for j in range(array.s.shape[1]))]
    knowns = [*volts, *q_d]

    def refs(names):
        return [one.variables[n].valueReference for n in names]

    jacobian = np.array([one.fmu.getDirectionalDerivative(refs(unknowns), refs([known]), [1.0]) for known in knowns]).T
    columns = refs(knowns)
    adjoint = np.array([one.fmu.getAdjointDerivative(refs([u]), columns, [1.0], len(columns)) for u in unknowns])
    # The same sums in another order; rates and currents are both in A.
    assert (np.abs(adjoint - jacobian) <= 1e-12 * np.abs(jacobian).max(axis=0) + 1e-9 * np.abs(jacobian)).all()
    for known in ("v_row_1", "v_column_0", "q_0_0", "q_2_2"):
        size = 1e-4 if known in volts else 1e-5 * q_d[known]
        ends = []
        for sign in (1.0, -1.0):
            value = {known: volts[known] + sign * size} if known in volts else {
                "q0" + known[1:]: one.get(known)[0] + sign * size}  # fmt: skip
            ends.append(np.array(master(file, **{**volts, **value}).get(*unknowns)))
        difference = (ends[0] - ends[1]) / (2.0 * size)
        # Of the curvature, which the difference takes in, and of rounding.
        np.testing.assert_allclose(jacobian[:, knowns.index(known)], difference, rtol=1e-5,
                                   atol=1e-6 * np.abs(difference).max())  # fmt: skip


def test_a_resting_device_has_no_rate(files, master):
    one = master(files("ideal", 3), q0_0_0=HP.charge_scale, **inputs(np.ones(4), np.zeros(4)))
    refs = [one.variables[n].valueReference for n in ("der(q_0_0)", "der(q_0_1)")]
    slopes = one.fmu.getDirectionalDerivative(refs, [one.variables["v_row_0"].valueReference], [1.0])
    assert slopes[0] == 0.0
    assert slopes[1] > 0.0


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    """Two of the paper's devices in series on a voltage source, with a current source between them."""
    hp = Device.load("hp_tio2_paper")
    netlist = Netlist(name="pair", elements=(
        VoltageSource(name="V1", p="0", n="top", voltage=-0.7),
        Memristor(name="M1", p="top", n="2", device=hp, s0=0.3),
        Resistor(name="R0", p="2", n="mid", resistance=0.0),
        Memristor(name="X1.M2", p="mid", n="0", device=hp, s0=0.1),
        CurrentSource(name="I1", p="0", n="mid", current=0.1),
    ))  # fmt: skip
    return netlist, export_crossbar(netlist, tmp_path_factory.mktemp("series") / "pair.fmu").path


def test_two_devices_in_series_are_those_of_an_ode(series):
    netlist, file = series

    def rates(t, q):
        m1, m2 = 1.0 - q
        i1 = (0.7 - 0.1 * m2) / (m1 + m2)
        return [i1, i1 + 0.1]

    wanted = solve_ivp(rates, (0.0, 0.5), [0.99 * 0.3, 0.99 * 0.1], rtol=1e-11, atol=1e-12).y[:, -1]
    options = {"stop_time": 0.5, "step_size": 0.01, "output_interval": 0.01, "relative_tolerance": 1e-10}
    found = fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", **options)
    assert validate_fmu(str(file)) == []
    # SciPy's own error.
    np.testing.assert_allclose([found["q.M1"][-1], found["q.X1.M2"][-1]], wanted, rtol=1e-9)
    point = netlist.dc()
    for name, value in {"v.'2'": point.v["2"], "v.mid": point.v["mid"], "v.top": 0.7, "i.V1": point.i["V1"],
                        "i.M1": point.i["M1"]}.items():  # fmt: skip
        assert found[name][0] == pytest.approx(value, rel=1e-12)


def test_every_client_runs_it(series, files):
    for file in (series[1], files("ends", 3)):
        found = check(file)
        assert found.passed, found.rows
        assert "pathsim" in {row.client for row in found.rows if row.status == "passed"}


def test_fmutool_finds_no_error(files):
    for fmi, name in ((2, "wires"), (3, "ends")):
        words = [
            sys.executable,
            "-m",
            "fmu_manipulation_toolbox.cli.fmutool",
            "-input",
            str(files(name, fmi)),
            "-check",
        ]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert f"No semantic error against the FMI-{fmi} standard." in done.stdout + done.stderr


def test_a_netlist_that_is_a_crossbar_is_named_like_one(tmp_path):
    array = ARRAYS["wires"]
    train = PulseTrain.rectangular(np.ones((1, 4)), columns=4, width=1e-5, edge=1e-6, period=2e-5)
    memristor_netlist(array, train).save(tmp_path / "x.netlist.json")
    file = export_crossbar(Netlist.load(tmp_path / "x.netlist.json"), tmp_path / "x.fmu").path
    names = {v.name for v in fmpy.read_model_description(str(file)).modelVariables}
    assert {"v_row_0", "v_row_3", "v_column_3", "i_column_3", "q_3_3", "q0_3_3"} <= names


@pytest.mark.parametrize(("system", "spec"), [("HP", "hp_passive"), ("HET", "het_mixed")])
def test_a_tile_of_a_plan_reads_as_its_crossbar(tmp_path, master, system, spec):
    plan = place(champion(system), Hardware.load(spec))
    tile = len(plan.tiles) - 1
    one = master(export_crossbar(tile_circuit(plan, tile), tmp_path / "tile.fmu").path)
    array = tile_crossbar(plan, tile)
    volts = 1e-3 * np.arange(1.0, array.shape[0] + 1.0)
    one.set(**{f"v_row_{i}": v for i, v in enumerate(volts)})
    found = one.get(*(f"i_column_{j}" for j in range(array.shape[1])))
    np.testing.assert_allclose(found, array.read(volts).current, rtol=1e-9)
    assert choose_tile(plan, plan.tiles[tile].kind) == choose_tile(plan, str(tile)) == tile
    with pytest.raises(UnknownNameError, match=r"^tile: "):
        choose_tile(plan, "none")
    if len(plan.tiles) > 1:
        with pytest.raises(ParameterError, match=rf"^tile: expected one of 0 \(.*, {tile} \(.*, got none"):
            choose_tile(plan, None)


def test_large_arrays_are_loops(files, tmp_path, monkeypatch):
    """The code of 20 x 20 devices is that of 4 x 4: what grows are its tables."""
    monkeypatch.setattr("ohmloom.fmu._compile.find_compiler", lambda: None)
    sizes = []
    for n in (4, 20):
        array = MemristorCrossbar(devices=HP, s=states((n, n)), r_row=1.0, r_column=1.0)
        file = export_crossbar(array, tmp_path / f"{n}.fmu").path
        fmpy.extract(str(file), str(tmp_path / str(n)))
        text = (tmp_path / str(n) / "sources" / "fmu.c").read_text()
        sizes.append(sum(line.rstrip().endswith((";", "{")) for line in text.splitlines()))
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize(("card", "fmi"), [("hp_tio2_10k", 2), ("yakopcic_miao", 3)])
def test_controlled_and_floating_sources_are_those_of_circuits(tmp_path, master, card, fmi):
    """A follower behind a device drives another one, whose current is fed back; the second card is not ohmic."""
    device = Device.load(card)
    netlist = Netlist(name="amplifier", elements=(
        VoltageSource(name="V1", p="in", n="0", voltage=0.6),
        Memristor(name="M1", p="in", n="a", device=device, s0=0.4),
        Resistor(name="R1", p="a", n="0", resistance=20.0),
        VCVS(name="E1", p="b", n="c", control_p="a", control_n="0", gain=2.5),
        Resistor(name="R2", p="c", n="0", resistance=500.0),
        VoltageSource(name="V2", p="b", n="d", voltage=0.1),
        Memristor(name="M2", p="d", n="e", device=device, s0=0.6),
        Resistor(name="R3", p="e", n="0", resistance=2e3),
        VCCS(name="G1", p="e", n="a", control_p="d", control_n="0", transconductance=1e-4),
    ))  # fmt: skip
    file = export_crossbar(netlist, tmp_path / "x.fmu", fmi=fmi).path
    assert validate_fmu(str(file)) == []
    t = np.linspace(0.0, 0.1, 6)
    wanted, point = netlist.simulate(t=t), netlist.dc()
    found = fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", stop_time=0.1, step_size=0.02, output_interval=0.02,
                              relative_tolerance=1e-11)  # fmt: skip
    s = np.array([found[f"q.{name}"] / device.charge_scale for name in ("M1", "M2")])
    # What circuits integrates to.
    np.testing.assert_allclose(s, [wanted.s[name] for name in ("M1", "M2")], rtol=0, atol=3e-9)
    assert np.ptp(s, axis=1).max() > 1e-3
    for node in "abcde":
        assert found[f"v.{node}"][0] == pytest.approx(point.v[node], rel=1e-10)
    for name in ("V1", "V2", "E1", "M1", "M2"):
        assert found[f"i.{name}"][0] == pytest.approx(point.i[name], rel=1e-10)
    if fmi == 2:
        return
    unknowns, knowns = ("der(q.M1)", "der(q.M2)", "i.V1", "i.V2", "i.E1", "v.e"), ("voltage.V1", "voltage.V2")
    one = master(file)
    rows, columns = ([one.variables[n].valueReference for n in names] for names in (unknowns, (*knowns, "q.M1")))
    jacobian = np.array([one.fmu.getDirectionalDerivative(rows, [column], [1.0]) for column in columns]).T
    adjoint = [one.fmu.getAdjointDerivative([row], columns, [1.0], len(columns)) for row in rows]
    np.testing.assert_allclose(adjoint, jacobian, rtol=1e-9, atol=1e-12 * np.abs(jacobian).max())
    for column, (name, v) in enumerate(zip(knowns, (0.6, 0.1), strict=True)):
        ends = [np.array(master(file, **{name: v + sign * 1e-5}).get(*unknowns)) for sign in (1.0, -1.0)]
        # Of rounding, in volts as in amperes.
        np.testing.assert_allclose(jacobian[:, column], (ends[0] - ends[1]) / 2e-5, rtol=1e-5, atol=1e-9)


CHARGED = ("q.M1", "q.M2", "voltage.C1", "voltage.C2", "voltage.C3")


@pytest.fixture(scope="module", params=[("hp_tio2_10k", 2), ("yakopcic_miao", 3)])
def charged(request, tmp_path_factory):
    """Capacitors to ground, either way round, and between two nodes; the second card is not ohmic."""
    device = Device.load(request.param[0])
    netlist = Netlist(name="filter", elements=(
        VoltageSource(name="V1", p="in", n="0", voltage=0.6),
        Memristor(name="M1", p="in", n="a", device=device, s0=0.4),
        Capacitor(name="C1", p="0", n="a", capacitance=2e-5, initial=-0.05),
        Resistor(name="R1", p="a", n="b", resistance=300.0),
        Capacitor(name="C2", p="b", n="c", capacitance=1e-5, initial=0.02),
        Memristor(name="M2", p="c", n="0", device=device, s0=0.6),
        Capacitor(name="C3", p="c", n="d", capacitance=4e-6),
        Resistor(name="R2", p="d", n="0", resistance=1e3),
        VCCS(name="G1", p="d", n="0", control_p="a", control_n="c", transconductance=1e-5),
    ))  # fmt: skip
    file = tmp_path_factory.mktemp("charged") / "x.fmu"
    return netlist, export_crossbar(netlist, file, fmi=request.param[1]).path, device


def test_capacitors_are_those_of_circuits(charged):
    netlist, file, device = charged
    assert validate_fmu(str(file)) == []
    t = np.linspace(0.0, 0.1, 11)
    wanted = netlist.simulate(t=t)
    found = fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", stop_time=0.1, step_size=0.01, output_interval=0.01,
                              relative_tolerance=1e-11)  # fmt: skip
    for name in ("C1", "C2", "C3"):
        ends = [next(getattr(e, end) for e in netlist.elements if e.name == name) for end in "pn"]
        v_p, v_n = (np.zeros(len(t)) if end == "0" else wanted.v[end] for end in ends)
        # What circuits integrates to.
        np.testing.assert_allclose(found[f"voltage.{name}"], v_p - v_n, rtol=0, atol=1e-7)
        assert np.ptp(v_p - v_n) > 1e-3
    for node in "abcd":
        np.testing.assert_allclose(found[f"v.{node}"], wanted.v[node], rtol=0, atol=1e-7)
    for name in ("M1", "M2"):
        np.testing.assert_allclose(found[f"q.{name}"] / device.charge_scale, wanted.s[name], rtol=0, atol=1e-7)
    # From one end of a capacitor into it, and out of the other.
    into_c3 = found["v.d"] / 1e3 + 1e-5 * (found["v.a"] - found["v.c"])
    np.testing.assert_allclose(found["i.C3"], into_c3, rtol=1e-9, atol=1e-15)


def test_every_client_runs_capacitors(charged):
    found = check(charged[1])
    assert found.passed, found.rows


def test_derivatives_of_capacitors_are_those_of_differences(charged, master):
    file = charged[1]
    one = master(file)
    unknowns = (*(f"der({x})" for x in CHARGED), "i.V1", "i.C1", "i.C2", "v.d")
    knowns = ("voltage.V1", *CHARGED)
    rows, columns = ([one.variables[n].valueReference for n in names] for names in (unknowns, knowns))
    jacobian = np.array([one.fmu.getDirectionalDerivative(rows, [column], [1.0]) for column in columns]).T
    if one.d.fmiVersion == "3.0":
        adjoint = [one.fmu.getAdjointDerivative([row], columns, [1.0], len(columns)) for row in rows]
        scale = np.fmax(np.abs(jacobian).max(axis=1, keepdims=True), 1e-300)  # a rate may be 0, below a threshold
        np.testing.assert_allclose(adjoint / scale, jacobian / scale, rtol=1e-9, atol=1e-12)
    for column, name in enumerate(knowns):
        size = 1e-5 if "voltage" in name else 1e-5 * charged[2].charge_scale
        at_start = name if name == "voltage.V1" else name.replace(".", "0.", 1)
        ends = [np.array(master(file, **{at_start: one.get(name)[0] + sign * size}).get(*unknowns))
                for sign in (1.0, -1.0)]  # fmt: skip
        difference = (ends[0] - ends[1]) / (2.0 * size)
        # Of the curvature, which the difference takes in, and of rounding.
        np.testing.assert_allclose(jacobian[:, column], difference, rtol=1e-5, atol=1e-7 * np.abs(difference).max())


def test_a_capacitor_in_series_charges_as_its_closed_form_says(tmp_path):
    """A device that rests at its upper limit is a resistor; nothing but it and the capacitor sets the rate."""
    r_on = 1.0 / HP.conductance(1.0)
    netlist = Netlist(elements=(
        VoltageSource(name="V1", p="in", n="0", voltage=0.6),
        Memristor(name="M1", p="in", n="a", device=HP, s0=1.0),
        Capacitor(name="C1", p="a", n="0", capacitance=0.05 / r_on),
    ))  # fmt: skip
    file = export_crossbar(netlist, tmp_path / "rc.fmu").path
    for interface in ("CoSimulation", "ModelExchange"):
        found = fmpy.simulate_fmu(str(file), fmi_type=interface, stop_time=0.1, step_size=0.01, output_interval=0.01,
                                  relative_tolerance=1e-10)  # fmt: skip
        v = 0.6 * (1.0 - np.exp(-found["time"] / 0.05))
        np.testing.assert_allclose(found["v.a"], v, rtol=0, atol=1e-10 if interface == "CoSimulation" else 1e-6)


@pytest.mark.parametrize("more", [
    (VoltageSource(name="H_0", p="h", n="g", voltage=0.0), Resistor(name="R2", p="g", n="0", resistance=0.5)),
    (VoltageSource(name="H_0", p="h", n="0", voltage=0.0), CurrentSource(name="I1", p="0", n="b", current=0.1)),
    (VoltageSource(name="H_0", p="h", n="0", voltage=0.0), Memristor(name="M1", p="b", n="0", device=HP, s0=0.5)),
], ids=["floating", "current", "name"])  # fmt: skip
def test_what_is_only_named_a_crossbar_is_a_netlist(tmp_path, master, more):
    netlist = Netlist(name="crossbar", elements=(
        VoltageSource(name="V_0", p="a", n="0", voltage=1.0), Resistor(name="R1", p="a", n="b", resistance=1.0),
        Memristor(name="D_0_0", p="b", n="h", device=HP, s0=0.5), *more,
    ))  # fmt: skip
    one = master(export_crossbar(netlist, tmp_path / "x.fmu").path)
    assert one.get("i.H_0")[0] == pytest.approx(netlist.dc().i["H_0"], rel=1e-12)


def test_a_start_value_is_within_its_range(tmp_path):
    netlist = Netlist(elements=(VoltageSource(name="V1", p="a", n="0", voltage=1e9),
                                Memristor(name="M1", p="a", n="0", device=HP, s0=0.5)))  # fmt: skip
    with pytest.raises(ParameterError, match=r"voltage\.V1: expected at most 1e\+06 V at the start, got 1e\+09 V"):
        export_crossbar(netlist, tmp_path / "x.fmu")


@pytest.mark.parametrize(("elements", "text"), [
    ([Capacitor(name="C1", p="a", n="0", capacitance=1.0), Capacitor(name="C2", p="0", n="a", capacitance=1.0)],
     "C2: expected no loop of capacitors and voltage sources, got C1, C2. Put a resistance into it"),
    ([Capacitor(name="C1", p="a", n="0", capacitance=1.0), VoltageSource(name="V1", p="a", n="0", voltage=1.0)],
     "C1: expected no loop of capacitors and voltage sources, got V1, C1"),
    ([Resistor(name="R1", p="b", n="c", resistance=1.0)], "b"),
    ([VCVS(name="E1", p="a", n="0", control_p="a", control_n="0", gain=1.0)], "E1"),
    ([Resistor(name="R1", p="a", n="0", resistance=1.0)], "expected at least one memristor, got none"),
])  # fmt: skip
def test_other_netlists_are_refused(tmp_path, elements, text):
    memristor = [Memristor(name="M1", p="a", n="0", device=HP, s0=0.5)] if "memristor, got" not in text else []
    with pytest.raises(ParameterError, match=f"^export_crossbar: .*{text}|{text}"):
        export_crossbar(Netlist(elements=(*memristor, *elements)), tmp_path / "x.fmu")
    with pytest.raises(ParameterError, match=r"^export_crossbar: circuit: expected"):
        export_crossbar("x.netlist.json", tmp_path / "x.fmu")


def test_values_that_cannot_be_are_refused(files, master):
    with pytest.raises(Exception, match="ExitInitializationMode"):
        master(files("ideal", 3), q0_0_0=2.0 * HP.charge_scale)
