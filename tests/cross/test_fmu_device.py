"""Device FMUs in FMPy: the closed form, events, derivatives, state, and what they refuse."""

import ctypes
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu

from ohmloom.devices import LAWS, Device
from ohmloom.fmu import export_device
from ohmloom.fmu.check import function_names

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:fmpy")
VERSIONS = (2, 3)
INTERFACES = ("CoSimulation", "ModelExchange")
V = 0.8
# In bytes, of archives that are larger than 25 kB: reference generators of long formulas.
LARGEST = {("yakopcic_miao", 3): 26_500, ("pickett", 2): 30_000, ("pickett", 3): 32_000}
ARRIVAL = (1.0 - 0.01**2) / (2.0 * V)  # of q at q_max = 0.99 from q = 0: phi = (1 - (1 - q)^2)/2 = v t


def closed_form(t, v=V):
    """The paper's HP device, normalised: (1 - q)^2 = 1 - 2 phi, q <= 0.99."""
    return np.minimum(1.0 - np.sqrt(np.maximum(1.0 - 2.0 * v * t, 0.0)), 0.99)


@pytest.fixture(scope="module")
def hp(tmp_path_factory):
    """Version -> file."""
    folder = tmp_path_factory.mktemp("hp")
    device = Device.load("hp_tio2_paper")
    return {fmi: str(export_device(device, folder / f"hp{fmi}.fmu", fmi=fmi, q0=0.0).path) for fmi in VERSIONS}


class Instance:
    """An instance in FMPy, both versions alike; keeps what it logged."""

    def __init__(self, file, folder, interface="CoSimulation", is_talkative=False):
        self.log = []
        fmpy.extract(file, str(folder))
        self.d = fmpy.read_model_description(str(folder))
        self.is_two = self.d.fmiVersion == "2.0"
        self.refs = {v.name: v.valueReference for v in self.d.modelVariables}
        self.fmu = instantiate_fmu(str(folder), self.d, interface, False, is_talkative, self._keep)

    def _keep(self, *arguments):
        self.log.append(arguments[-1].decode())

    def set(self, name, value):
        (self.fmu.setReal if self.is_two else self.fmu.setFloat64)([self.refs[name]], [value])

    def get(self, *names):
        return list((self.fmu.getReal if self.is_two else self.fmu.getFloat64)([self.refs[n] for n in names]))

    def start(self):
        if self.is_two:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()

    def step(self, begin, count, h=0.01):
        for k in range(begin, begin + count):
            self.fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)

    def save(self):
        fmu = self.fmu
        state = fmu.getFMUstate() if self.is_two else fmu.getFMUState()
        data = fmu.serializeFMUstate(state) if self.is_two else fmu.serializeFMUState(state)
        fmu.freeFMUstate(state) if self.is_two else fmu.freeFMUState(state)
        return bytes(data)

    def restore(self, data):
        fmu = self.fmu
        state = fmu.deSerializeFMUstate(data) if self.is_two else fmu.deserializeFMUState(data)
        fmu.setFMUstate(state) if self.is_two else fmu.setFMUState(state)
        fmu.freeFMUstate(state) if self.is_two else fmu.freeFMUState(state)

    def jacobian(self, unknowns, knowns):
        directional = self.fmu.getDirectionalDerivative
        references = [self.refs[n] for n in unknowns]
        return np.array([directional(references, [self.refs[known]], [1.0]) for known in knowns]).T


@pytest.fixture
def instance(hp, tmp_path):
    made = []

    def make(fmi, interface="CoSimulation", is_talkative=False):
        made.append(Instance(hp[fmi], tmp_path / str(len(made)), interface, is_talkative))
        return made[-1]

    yield make
    for one in made:
        one.fmu.freeInstance()


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("name", Device.names())
def test_every_card_validates(name, fmi, tmp_path):
    written = export_device(Device.load(name), tmp_path / "device.fmu", fmi=fmi)
    assert written.size == written.path.stat().st_size < LARGEST.get((name, fmi), 25_000)
    file = written.path
    assert validate_fmu(str(file)) == []
    result = fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", start_values={"v": 0.1}, stop_time=0.1)
    assert result["q"][0] == pytest.approx(fmpy_start(file), rel=1e-12)


def fmpy_start(file):
    return float(next(v.start for v in fmpy.read_model_description(str(file)).modelVariables if v.name == "q0"))


@pytest.mark.parametrize("name", ["hp_tio2", "peo_pani", "peo_pani_redox", "linear", "vteam_memtorch"])
def test_a_driven_device_is_the_one_that_is_simulated_here(name, tmp_path):
    device = Device.load(name)
    s0 = 0.4
    file = export_device(device, tmp_path / "device.fmu", q0=s0 * device.charge_scale).path
    # Held over each step, as a master holds it: two samples a step for the reference, which draws straight lines.
    h, count = 0.01, 50
    levels = 0.6 * np.sin(2.0 * np.pi * (np.arange(count) + 0.5) / count)
    s, wanted = s0, [s0]
    for v in levels:
        s = float(device.simulate(np.full(2, v), [0.0, h], s0=s).s[-1])
        wanted.append(s)
    signals = np.zeros(count + 1, dtype=[("time", float), ("v", float)])
    signals["time"], signals["v"] = h * np.arange(count + 1), [*levels, levels[-1]]
    held = np.repeat(signals, 2)[:-1]
    held["v"][1::2] = held["v"][:-1:2]
    result = fmpy.simulate_fmu(str(file), fmi_type="CoSimulation", input=held, stop_time=count * h, step_size=h,
                               output_interval=h, relative_tolerance=1e-10)  # fmt: skip
    # Both are integrated, to 1e-9 or better of the range, 1e-7 where the law is stiff.
    np.testing.assert_allclose(result["q"] / device.charge_scale, wanted, rtol=0, atol=2e-7)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_library_has_every_function(hp, fmi, tmp_path):
    with zipfile.ZipFile(hp[fmi]) as file:
        (name,) = [n for n in file.namelist() if n.startswith("binaries/")]
        file.extract(name, tmp_path)
    library = ctypes.CDLL(str(tmp_path / name))
    for interface in INTERFACES:
        names = function_names(fmi, interface)
        assert len(names) > 25
        assert [n for n in names if not hasattr(library, n)] == []


@pytest.mark.parametrize("fmi", VERSIONS)
def test_co_simulation_equals_the_closed_form(hp, fmi):
    run = fmpy.simulate_fmu(hp[fmi], fmi_type="CoSimulation", start_values={"v": V}, stop_time=1.0,
                            output_interval=0.01, relative_tolerance=1e-8)  # fmt: skip
    error = np.abs(run["q"] - closed_form(run["time"]))
    assert error[run["time"] <= 0.5].max() < 1e-10
    # Near the wall the charge is 50 times as sensitive as at the start.
    assert error.max() < 1e-6
    assert run["q"][-1] == 0.99
    assert run["memristance"][-1] == pytest.approx(0.01, rel=1e-12)
    assert run["weight"][-1] == 1.0


@pytest.mark.parametrize("fmi", VERSIONS)
def test_one_long_step_is_as_good(hp, fmi):
    run = fmpy.simulate_fmu(hp[fmi], fmi_type="CoSimulation", start_values={"v": V}, stop_time=0.5, output_interval=0.5,
                            relative_tolerance=1e-8)  # fmt: skip
    assert run["q"][-1] == pytest.approx(
        closed_form(0.5), abs=1e-7
    )  # 1e-8 for each inner step, of which there are a few


@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_arrival_is_located_within_one_long_step(instance, fmi):
    one = instance(fmi, is_talkative=True)
    one.set("v", V)
    one.start()
    one.step(0, 1, h=1.0)
    (message,) = [text for text in one.log if "rests" in text]
    assert message.endswith(" s: q rests at its upper limit")
    # 1e-8 of the charge for each of some ten steps, at a rate of 80 per second near the wall.
    assert float(message.split()[2]) == pytest.approx(ARRIVAL, abs=1e-6)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_model_exchange_stops_at_the_wall_at_the_right_time(hp, fmi):
    run = fmpy.simulate_fmu(hp[fmi], fmi_type="ModelExchange", start_values={"v": V}, stop_time=1.0,
                            output_interval=0.05, relative_tolerance=1e-8, output=["q", "der(q)"])  # fmt: skip
    resting = run["time"][run["der(q)"] == 0.0]
    assert resting[0] == pytest.approx(ARRIVAL, abs=1e-5)
    assert run["q"][-1] == 0.99
    np.testing.assert_allclose(run["q"], closed_form(run["time"]), atol=1e-4)  # CVode's tolerance, magnified 50 times


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_resting_charge_leaves_when_the_voltage_turns(instance, fmi):
    one = instance(fmi)
    one.set("v", V)
    one.start()
    one.step(0, 100)
    assert one.get("q", "der(q)") == [0.99, 0.0]
    one.set("v", -V)
    assert one.get("der(q)")[0] == pytest.approx(-V / 0.01, rel=1e-12)
    one.step(100, 10)
    # From M = 0.01 at the wall: M^2 = 0.01^2 + 2 v t.
    assert one.get("q")[0] == pytest.approx(1.0 - np.sqrt(0.01**2 + 2.0 * V * 0.1), abs=1e-7)
    one.step(110, 100)
    assert one.get("q") == [0.0]


@pytest.mark.parametrize("fmi", VERSIONS)
def test_state_round_trip_is_equal_to_the_bit(instance, fmi):
    first, second = instance(fmi), instance(fmi)
    for one in (first, second):
        one.set("v", V)
        one.start()
    first.step(0, 37)
    data = first.save()
    first.step(37, 40)
    assert second.get("q") != first.get("q")
    second.restore(data)
    second.step(37, 40)
    assert second.get("q", "i", "memristance", "weight") == first.get("q", "i", "memristance", "weight")
    assert second.save() == first.save()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_state_of_another_model_is_refused(instance, hp, fmi, tmp_path):
    one = instance(fmi)
    one.start()
    data = one.save()
    other = Instance(str(export_device(Device.load("hp_tio2"), tmp_path / "o.fmu", fmi=fmi).path), tmp_path / "other")
    other.start()
    for bad in (other.save(), data[:-1], data[:8] + b"\7" + data[9:], b""):
        with pytest.raises(Exception, match="failed with status 3"):
            one.restore(bad)
        # FMPy's helper for FMI 2.0 gives every message to the instance that came last.
        assert "of this very FMU" in (other if fmi == 2 else one).log[-1]
    other.fmu.freeInstance()
    assert one.save() == data


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize(("t", "is_free"), [(0.3, True), (0.9, False)])
def test_directional_derivatives_equal_differences(instance, fmi, t, is_free):
    unknowns, knowns = ("der(q)", "i", "memristance", "weight"), ("v", "q")
    one = instance(fmi, "ModelExchange")
    one.start()
    q = closed_form(t)
    values = {}
    pairs = {"v": 1e-6, "q": 1e-7}
    for name, h in pairs.items():
        for sign in (-1.0, 0.0, 1.0):
            enter(one, q + (sign * h if name == "q" and is_free else 0.0), V + (sign * h if name == "v" else 0.0))
            values[name, sign] = np.array(one.get(*unknowns))
    enter(one, q, V)
    jacobian = one.jacobian(unknowns, knowns)
    for column, (name, h) in enumerate(pairs.items()):
        if name == "q" and not is_free:
            continue
        differences = (values[name, 1.0] - values[name, -1.0]) / (2.0 * h)
        np.testing.assert_allclose(jacobian[:, column], differences, rtol=1e-6, atol=1e-6)
    if not is_free:
        assert jacobian[0].tolist() == [0.0, 0.0]
        assert jacobian[1, 0] == pytest.approx(100.0)


def enter(one, q, v):
    """Put a model-exchange instance at a point, through an event, so that modes are chosen anew."""
    one.fmu.enterEventMode()
    one.set("v", v)
    one.fmu.setContinuousStates((ctypes.c_double * 1)(q), 1)
    one.fmu.newDiscreteStates() if one.is_two else one.fmu.updateDiscreteStates()
    one.fmu.enterContinuousTimeMode()


def test_derivatives_of_a_law_in_rounds_equal_differences(tmp_path, master):
    """Pickett's, whose slopes follow from what its rounds solve; in the gap's own range, and beyond it."""
    file = export_device(Device.load("pickett"), tmp_path / "pickett.fmu", fmi=3).path
    unknowns, sizes = ("der(q)", "i", "memristance"), {"v": 1e-6, "q0": 1e-6}
    for v, q in ((-0.4, 0.3), (0.55, 0.62), (1.3, 0.9)):
        at = {"v": v, "q0": q}
        one = master(file, **at)
        refs = [one.variables[name].valueReference for name in (*unknowns, "v", "q")]
        for name, known in (("v", refs[-2]), ("q0", refs[-1])):
            ends = [np.array(master(file, **{**at, name: at[name] + sign * sizes[name]}).get(*unknowns))
                    for sign in (1.0, -1.0)]  # fmt: skip
            wanted = (ends[0] - ends[1]) / (2.0 * sizes[name])
            found = one.fmu.getDirectionalDerivative(refs[:3], [known], [1.0])
            # The rounds' own error of 1e-12 or so, over steps of 1e-6.
            np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-9 * abs(ends[0]).max())


def test_adjoint_is_the_transpose(instance):
    one = instance(3)
    one.set("v", V)
    one.start()
    one.step(0, 30)
    unknowns, knowns = ("der(q)", "q", "i", "memristance", "weight"), ("v", "q")
    jacobian = one.jacobian(unknowns, knowns)
    assert jacobian[1].tolist() == [0.0, 1.0]
    rows, columns = ([one.refs[n] for n in names] for names in (unknowns, knowns))
    for row, unknown in zip(jacobian, rows, strict=True):
        # A fresh forward derivative in between must not disturb it.
        one.fmu.getDirectionalDerivative(rows, [columns[0]], [1.0])
        assert one.fmu.getAdjointDerivative([unknown], columns, [1.0], len(columns)) == row.tolist()


@pytest.mark.parametrize("law", LAWS)
def test_dependencies_are_exact(law):
    from ohmloom.devices import CardValue
    from ohmloom.fmu._device_code import device_description

    values = tuple(CardValue(value=p.default, source="test") for p in LAWS[law].parameters)
    device = Device(name="d", law=law, source="test", values=values)
    variables = {v.name: v for v in device_description(device, 0.0).variables}
    needs_rate = set(variables["der(q)"].dependencies)
    s, v, p, h = 0.37, 0.63, [value.value for value in values], 1e-3
    q_d = device.charge_scale

    def rate(ds, dv):
        g = LAWS[law].conductance(s + ds, v + dv, p)
        return float(LAWS[law].charge_rate(s + ds, v + dv, g * (v + dv), p))

    assert q_d > 0.0
    moved = {name for name, d in (("v", (0.0, h)), ("q", (h, 0.0))) if rate(*d) != rate(0.0, 0.0)}
    assert needs_rate == moved
    assert variables["i"].dependencies == ("v", "q")
    assert variables["memristance"].dependencies == variables["weight"].dependencies == ("q",)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_reset_and_many_instances(instance, fmi):
    several = [instance(fmi) for _ in range(3)]
    for k, one in enumerate(several):
        one.set("v", 0.1 * (k + 1))
        one.start()
    for k in range(20):
        for one in several:
            one.step(k, 1)
    for k, one in enumerate(several):
        assert one.get("q")[0] == pytest.approx(closed_form(0.2, 0.1 * (k + 1)), abs=1e-10)
    first = several[0]
    first.fmu.reset()
    first.set("v", V)
    first.start()
    first.step(0, 10)
    assert first.get("q")[0] == pytest.approx(closed_form(0.1), abs=1e-10)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_parameters_are_tunable(instance, fmi):
    one = instance(fmi)
    one.set("q0", 0.25)
    one.set("v", V)
    one.start()
    assert one.get("q") == [0.25]
    one.set("r_off", 2.0)
    q_d = (2.0 - 0.01) / (2.0 * 0.01 * 100.0)
    assert one.get("memristance")[0] == pytest.approx(2.0 - (2.0 - 0.01) * 0.25 / q_d, rel=1e-12)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_limit_that_moves_takes_the_charge_along(instance, fmi):
    """The range shrinks below where the charge is, and below where it began: only the start is judged by q0."""
    one = instance(fmi)
    one.set("q0", 0.99)
    one.set("v", -1.0)
    one.start()
    one.set("beta", 200.0)
    assert one.get("q", "der(q)", "i") == pytest.approx([0.495, -100.0, -100.0])
    np.testing.assert_allclose(one.jacobian(("der(q)", "i"), ("v",)), [[100.0], [100.0]], rtol=1e-12)
    one.step(0, 100)
    assert one.get("q") == [0.0]


@pytest.mark.parametrize("voltage", [1.0, -1.0])
def test_the_longest_steps_end_at_a_wall(instance, voltage):
    for time in (1e9, 1e294, 1e303, 1e308):
        one = instance(2)
        one.set("q0", 0.5)
        one.set("v", 1e6 * voltage)
        one.start()
        one.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=time)
        assert one.get("q") == pytest.approx([0.99 if voltage > 0.0 else 0.0])


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("v", 1e7, "v: expected a number from -1e+06 to 1e+06, got 10000000"),
        ("v", float("nan"), "v: expected a number from"),
        ("r_on", -1.0, "r_on: expected a number from 0.001"),
        ("q", 0.5, "q: expected an input or a parameter, got a value that the model calculates"),
    ],
)
def test_values_out_of_range_are_refused(instance, fmi, name, value, text):
    one = instance(fmi)
    with pytest.raises(Exception, match="failed with status 3"):
        one.set(name, value)
    assert one.log[-1].startswith(text)


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize(
    ("name", "value", "text"),
    [("r_on", 2.0, "r_on: expected r_on < r_off"), ("q0", 1.0, "q0: expected at most the charge q_d")],
)
def test_parameters_that_disagree_are_refused(instance, fmi, name, value, text):
    one = instance(fmi)
    one.set(name, value)
    with pytest.raises(Exception, match="failed with status 3"):
        one.start()
    assert one.log[-1].startswith(text)


def test_a_fixed_parameter_is_fixed(instance):
    one = instance(2)
    one.start()
    with pytest.raises(Exception, match="failed with status 3"):
        one.set("q0", 0.1)
    assert one.log[-1] == "q0: expected to be set before the end of initialization, got it set later"


def test_functions_are_refused_in_other_phases(instance):
    one = instance(2)
    with pytest.raises(Exception, match="failed with status 3"):
        one.step(0, 1)
    assert one.log[-1] == "DoStep: called in a phase in which FMI does not allow it"
