"""Every non-ideality does what its meaning says, by a plain formula, and leaves the others alone."""

import math

import numpy as np
import pytest

from ohmloom.mapping import EmulatedController, place
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.neurocontroller import Network, Readings, Synapse

# No leak from step to step (b = 1), no constant input: a membrane is what was read in this step, and an input spikes
# where its sensor is 1. Two of the three synapses make the receiver spike, one does not.
READINGS = Readings(a=0.0, b=1.0, c_ini=0.0, y_thresh=0.9, synapse_gain=1.2)
THREE = Network(
    system="LIN", hidden=("excitatory",), synapses=tuple(Synapse(k, 6, "linear", 0.5) for k in range(3)),
    readings=READINGS,
)  # fmt: skip
ONE = Network(system="LIN", hidden=("excitatory",), synapses=(Synapse(0, 6, "linear", 0.5),), readings=READINGS)
RANDOM = Network.random(system="HET", rng=np.random.default_rng(3))
QUIET = (0.0,) * 6
VOLTAGE = {"mode": "voltage", "pulse_duration": None}  # each kind gets the duration that is right at W = 0.5
EVENT = 0.001  # of s
ROUNDING = 1e-15  # of a state or weight


def inputs(*spiking):
    return tuple(float(k in spiking) for k in range(6))


def up(emulated):
    """One positive event on synapse 0 (and 1); how far the state of synapse 0 moved."""
    return _moved(emulated, (inputs(0, 1), QUIET, QUIET, QUIET))


def down(emulated):
    """One negative event on synapse 0: it spikes a step after the receiver, which the others drove."""
    return _moved(emulated, (inputs(1, 2), QUIET, inputs(0), QUIET, QUIET, QUIET))


def _moved(emulated, steps):
    before = emulated.states[0]
    for sensors in steps:
        emulated.spikes(sensors)
    return emulated.states[0] - before


def read(emulated, *spiking):
    """What the receiver reads, in units of a weight, a step after these inputs spiked; it must not spike."""
    emulated.spikes(inputs(*spiking))
    emulated.spikes(QUIET)
    gain = emulated.die.plan.network.readings.synapse_gain
    return emulated.membranes[6] / gain


@pytest.fixture(name="die")
def _die(changed):
    def build(effects, *, network=THREE, seed=7, die=0, **sections):
        return place(network, changed("ideal", nonidealities=effects, **sections)).sample(seed=seed, die=die)

    return build


@pytest.fixture(name="run")
def _run(die):
    return lambda effects, **options: EmulatedController(die(effects, **options))


CASES = {}


def case(function):
    """A test of the effect that it is named after."""
    CASES[function.__name__] = function
    return function


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_does_what_its_meaning_says(effect, run, die):
    assert effect in CASES, f"no test of the effect {effect}"
    CASES[effect](run, die)


@case
def write_verify(run, die):
    for k in range(3):
        emulated = run({"write_verify": 0.02}, die=k)
        device = emulated.die.plan.hardware.devices["linear"]
        draws = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0, k))).standard_normal(3)
        g_on, g = float(device.conductance(1.0)), float(device.conductance(emulated.die.plan.crosspoints[0].state))
        np.testing.assert_allclose(emulated.conductances, g + 0.02 * g_on * draws, rtol=1e-12)


@case
def event_charge(run, die):
    emulated = run({"event_charge": 0.3})
    factor = emulated.die.event_charge[0]
    assert abs(factor - 1.0) > 0.01
    assert up(emulated) == pytest.approx(factor * EVENT, abs=ROUNDING)
    assert down(emulated) == pytest.approx(-factor * EVENT, abs=ROUNDING)


@case
def threshold(run, die):
    """An event of 1 V is lost above it; half a volt on the row writes below it, up and down again."""
    seen = set()
    for k in range(12):
        emulated = run({"threshold": 0.6}, die=k)
        limit = emulated.die.threshold[0]
        emulated.spikes(inputs(0))
        emulated.spikes(QUIET)
        assert emulated.pulses[0] == (2 if limit < 0.5 else 0)
        emulated.reset()
        assert (up(emulated) != 0.0) == (limit < 1.0)
        seen.add((bool(limit < 0.5), bool(limit < 1.0)))
    assert len(seen) == 3


@case
def stuck_on(run, die):
    emulated = run({"stuck_on": 1.0}, network=ONE)
    up_ = _moved(emulated, (inputs(0), QUIET, QUIET))
    assert (emulated.weights == 1.0).all()
    assert up_ == 0.0
    assert emulated.ledger.lost == emulated.ledger.ideal_events == 1
    _check_share(die, "stuck_on", 1)


@case
def stuck_off(run, die):
    emulated = run({"stuck_off": 1.0})
    assert (emulated.weights == 0.0).all()
    assert read(emulated, 0, 1) == 0.0
    _check_share(die, "stuck_off", 2)


@case
def forming(run, die):
    emulated = run({"forming": 1.0}, array={"unformed_conductance": 1e-3})
    assert (emulated.conductances == 1e-3).all()
    _check_share(die, "forming", 3)


def _check_share(die, effect, fault, p=0.2):
    grids = [grid for k in range(8) for grid in die({effect: p}, network=RANDOM, die=k).faults]
    cells = np.concatenate([grid.ravel() for grid in grids])
    assert set(cells) == {0, fault}
    assert np.mean(cells == fault) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / len(cells)))  # standard errors


@case
def neuron_threshold(run, die):
    emulated = run({"neuron_threshold": 0.02})
    limit = 0.9 * emulated.die.neuron_threshold[0]
    assert emulated.spikes((limit * (1.0 + 1e-9), 0, 0, 0, 0, 0))[0]
    assert not emulated.spikes((limit * (1.0 - 1e-9), 0, 0, 0, 0, 0))[0]
    assert limit != 0.9


@case
def neuron_leak(run, die):
    readings = Readings(a=0.0, b=0.05, c_ini=0.5, y_thresh=0.9)
    emulated = run({"neuron_leak": 0.2}, network=THREE.replace(readings=readings))
    emulated.spikes(QUIET)
    np.testing.assert_allclose(emulated.membranes, 0.5 * (1.0 - 0.05 * emulated.die.neuron_leak), rtol=1e-12)
    assert np.ptp(emulated.membranes) > 0.001


@case
def neuron_bias(run, die):
    emulated = run({"neuron_bias": 0.2}, network=THREE.replace(readings=READINGS.model_copy(update={"a": 0.3})))
    emulated.spikes(QUIET)
    np.testing.assert_allclose(emulated.membranes, 0.3 * emulated.die.neuron_bias, rtol=1e-12)
    assert np.ptp(emulated.membranes) > 0.01


@case
def sense_offset(run, die):
    for k in range(4):
        emulated = run({"sense_offset": 0.1}, die=k)
        offset = emulated.die.sense_offset[6]
        assert read(emulated, 0) == pytest.approx(0.5 + offset, abs=ROUNDING)
        assert offset != 0.0


@case
def tile_gain(run, die):
    emulated = run({"tile_gain": 0.1})
    assert read(emulated, 0) == pytest.approx(0.5 * emulated.die.tile_gain[0], abs=ROUNDING)
    assert emulated.die.tile_gain[0] != 1.0


@case
def wire_resistance(run, die):
    """One device behind a row and a column segment: 1/(1/G + 2 R)."""
    network = Network(system="HP", hidden=("excitatory",), synapses=(Synapse(0, 6, "hp", 0.5),))
    emulated = run(
        {"wire_resistance": 0.2}, network=network, wires={"r_row": 1e-3, "r_column": 1e-3},
        drive={"parallelism": "column"}, limits={"read_error": 0.9},
    )  # fmt: skip
    factor = emulated.die.wire_resistance
    assert abs(factor - 1.0) > 0.01
    # 0.01 ohm is G_on's resistance of the paper's device.
    assert emulated.read_weights[0] == pytest.approx(0.01 / (0.02 + 2e-3 * factor), rel=1e-9)


@case
def cycle_to_cycle(run, die):
    emulated = run({"cycle_to_cycle": 0.2})
    first = [up(emulated) for _ in range(2)]
    assert first[0] != first[1]
    emulated.reset()
    assert [up(emulated) for _ in range(2)] == first
    assert up(run({"cycle_to_cycle": 0.2}, seed=8)) != first[0]
    emulated.reset()
    factors = np.array([up(emulated) for _ in range(300)]) / EVENT
    assert np.std(factors) == pytest.approx(0.2, abs=0.2 * 4 / math.sqrt(600))  # standard errors
    assert np.mean(factors) == pytest.approx(1.0, abs=0.2 * 4 / math.sqrt(300))


@case
def asymmetry(run, die):
    emulated = run({"asymmetry": 0.25})
    assert up(emulated) == pytest.approx(1.25 * EVENT, abs=ROUNDING)
    assert down(emulated) == pytest.approx(-0.75 * EVENT, abs=ROUNDING)


@case
def metering_delay(run, die):
    """The pulse goes on for a tenth of the time that its charge took, at the conductance it has then."""
    emulated = run(
        {"metering_delay": 0.1},
        drive={"mode": "charge_metered", "parallelism": "column", "pulse_duration": None},
    )
    device, s = emulated.die.plan.hardware.devices["linear"], emulated.states[0]
    path = np.linspace(s, s + EVENT, 101)
    duration = np.trapezoid(device.charge_scale / np.asarray(device.conductance(path)), path)
    more = 0.1 * duration * float(device.conductance(s + EVENT)) / device.charge_scale
    assert up(emulated) == pytest.approx(EVENT + more, rel=1e-9)


@case
def read_noise(run, die):
    """Independent from device to device: three have sqrt(3) times the spread of one. A run repeats it."""
    emulated = run(
        {"read_noise": 0.05}, network=THREE.replace(readings=READINGS.model_copy(update={"synapse_gain": 0.4}))
    )
    one, three = ([read(emulated, *rows) for _ in range(400)] for rows in ((0,), (0, 1, 2)))
    for values, devices in ((one, 1), (three, 3)):
        sigma = 0.05 * 0.5 * math.sqrt(devices)
        assert np.std(values) == pytest.approx(sigma, rel=4 / math.sqrt(800))  # standard errors
        assert np.mean(values) == pytest.approx(0.5 * devices, abs=4 * sigma / math.sqrt(400))
    emulated.reset()
    assert [read(emulated, 0) for _ in range(3)] == one[:3]


@case
def quantisation(run, die):
    """Eight steps from -3 to 3: 0.75 each."""
    readings = READINGS.model_copy(update={"synapse_gain": 0.4})
    emulated = run({"quantisation": 3.0}, network=THREE.replace(readings=readings))
    found = [read(emulated, *range(n)) for n in range(4)]
    assert found == pytest.approx([0.0, 0.75, 0.75, 1.5], abs=ROUNDING)


@case
def settling(run, die):
    emulated = run({"settling": 2e-9})  # the read takes 1 ns
    assert read(emulated, 0) == pytest.approx(0.5 * (1.0 - math.exp(-0.5)), abs=ROUNDING)


@case
def retention(run, die):
    emulated = run({"retention": 3.2})
    for timesteps in range(3):
        emulated.step(QUIET)  # the first one begins at once, the others 32 ms later
        assert emulated.states[0] == pytest.approx(0.5 * math.exp(-0.01 * timesteps), abs=1e-14)


@case
def half_select(run, die):
    """The sender alone puts half a volt of either sign on its row, the receiver on its column."""
    emulated = run({"half_select": 0.25}, drive=VOLTAGE)
    device = emulated.die.plan.hardware.devices["linear"]
    part = 0.25 * device.charge_scale * EVENT / float(device.conductance(0.5))
    emulated.spikes(inputs(0))
    assert device.flux(emulated.states[0]) == pytest.approx(device.flux(0.5) - part, rel=1e-12)
    emulated.spikes(QUIET)
    assert emulated.states[0] == pytest.approx(0.5, abs=ROUNDING)
    assert (emulated.ledger.half_selects_row, emulated.ledger.half_selects_column) == (2, 0)
    emulated.reset()
    emulated.spikes(inputs(1, 2))
    emulated.spikes(QUIET)
    assert device.flux(emulated.states[0]) == pytest.approx(device.flux(0.5) + part, rel=1e-12)
    assert emulated.ledger.half_selects_column == 1


@case
def read_disturb(run, die):
    """A row that is read with a positive voltage depresses its device, in the step in which the spike arrives."""
    emulated = run({"read_disturb": 0.125})
    for reads in range(3):
        assert emulated.states[0] == pytest.approx(0.5 - reads * 0.125 * EVENT, abs=ROUNDING)
        read(emulated, 0)
    assert emulated.ledger.events == 0


@pytest.mark.parametrize("effect", [name for name in EFFECTS if name not in ("half_select", "metering_delay")])
def test_no_effect_acts_on_the_nominal_die(effect, changed):
    wires = {"wires": {"r_row": 1e-3, "r_column": 1e-3}, "drive": {"parallelism": "column"}}
    sections = wires if effect == "wire_resistance" else {}
    value = 1.0 if effect == "quantisation" else 0.5
    plain, with_effect = (
        EmulatedController(place(THREE, changed("ideal", nonidealities=effects, **sections)).nominal())
        for effects in ({}, {effect: value})
    )
    for emulated in (plain, with_effect):
        up(emulated)
        down(emulated)
    assert (plain.states == with_effect.states).all()
    assert (plain.membranes == with_effect.membranes).all()


def test_heat_makes_states_decay_faster(run):
    """Arrhenius: 0.5 eV from 300 K to 310 K."""
    hot = {"temperature": 310.0, "card_temperature": 300.0, "retention_activation": 0.5}
    emulated = run({"retention": 3.2}, environment=hot)
    faster = math.exp(0.5 / 8.617333262e-5 * (1.0 / 300.0 - 1.0 / 310.0))
    emulated.step(QUIET)
    emulated.step(QUIET)
    assert emulated.states[0] == pytest.approx(0.5 * math.exp(-0.01 * faster), rel=1e-12)
    assert faster > 1.8


def test_heat_makes_a_pulse_of_fixed_voltage_move_more(run):
    hot = {"temperature": 310.0, "card_temperature": 300.0, "drift_activation": 0.1}
    emulated = run({}, environment=hot, drive=VOLTAGE)
    device = emulated.die.plan.hardware.devices["linear"]
    event = device.charge_scale * EVENT / float(device.conductance(0.5))
    up(emulated)
    more = math.exp(0.1 / 8.617333262e-5 * (1.0 / 300.0 - 1.0 / 310.0))
    assert device.flux(emulated.states[0]) == pytest.approx(device.flux(0.5) + event * more, rel=1e-12)


def test_a_converter_of_the_periphery_rounds_like_the_effect(run):
    bits = {"value": 3.0, "source": "definition: a test"}
    emulated = run(
        {}, converter={"bits": bits}, network=THREE.replace(readings=READINGS.model_copy(update={"synapse_gain": 0.4}))
    )
    assert read(emulated, 0) == pytest.approx(0.75, abs=ROUNDING)
