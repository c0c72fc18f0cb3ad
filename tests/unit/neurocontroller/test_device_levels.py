"""The discrete controller on device cards: charge as the paper's, flux as the device's own equation has it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ohmloom.devices import Device
from ohmloom.devices._event_kernels import MEM_LIFETIME as EVENTS_OF_KERNELS
from ohmloom.devices._event_kernels import event_state
from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network, Readings, SpikingController
from ohmloom.neurocontroller.device_levels import PAPER_CARDS, events_of, state_of_weight
from ohmloom.neurocontroller.kinds import MEM_LIFETIME
from ohmloom.sim import Arena, run_trial

SYSTEMS = ["HP", "PEO", "LIN", "GA", "HET"]
CARDS = {kind: Device.load(name) for kind, name in
         {"hp": "hp_tio2_10k", "peo_pani": "peo_pani", "linear": "linear"}.items()}  # fmt: skip
MODELS = {
    "charge": {"cards": CARDS},
    "flux": {"plasticity": "flux"},
    "flux on cards": {"plasticity": "flux", "cards": CARDS},
}
# A spike drives each input in turn, so that synapses move far both ways.
PHASES = [(0.9, 0.1, 0.0, 0.2, 0.8, 1.0), (0.0, 0.7, 0.3, 1.0, 0.1, 0.0), (1.0, 1.0, 0.0, 0.0, 0.0, 0.4)]


def random_network(system, seed, **readings):
    return Network.random(system=system, rng=np.random.default_rng(seed), readings=Readings(**readings))


def events(kind, plasticity, cards=None, event_flux=None):
    system = {"hp": "HP", "peo_pani": "PEO", "linear": "LIN"}[kind]
    return events_of(random_network(system, 1), plasticity, cards, event_flux)[kind]


def state(model, now):
    law, family, event_flux, p, bottom, top = model._device
    return event_state(law, family, *now, event_flux, p, bottom, top)[0]


def run_together(first, second, timesteps, atol):
    """Step both; every neuron's spikes and the weights, which differ by `atol` at most, are compared."""
    total = 0
    for t in range(timesteps):
        sensors = PHASES[t // 7 % len(PHASES)]
        assert first.step(sensors) == second.step(sensors)
        assert first.spike_counts.tolist() == second.spike_counts.tolist(), t
        np.testing.assert_allclose(first.weights, second.weights, rtol=0, atol=atol)
        total += int(first.spike_counts[6:].sum())
    assert total > timesteps  # a silent network would compare nothing
    assert first.events == second.events


@pytest.mark.parametrize("system", ["HP", "PEO", "LIN", "HET"])
def test_cards_of_the_papers_ratio_are_the_papers_model(system):
    """Ratio 100 in any ohms: the same weights but for rounding, so the same spikes where no sum is a tie."""
    for seed in (3, 4):
        network = random_network(system, seed)
        run_together(SpikingController(network), SpikingController(network, cards=CARDS), 100, 1e-12)


def test_a_card_of_another_ratio_moves_otherwise():
    network = random_network("HP", 3)
    paper, other = SpikingController(network), SpikingController(network, cards={"hp": Device.load("hp_tio2")})
    for _ in range(20):
        paper.step(PHASES[0])
        other.step(PHASES[0])
    assert np.abs(paper.weights - other.weights).max() > 0.05


def test_flux_differs_from_charge_away_from_the_start():
    network = random_network("HET", 3)
    charge, flux = SpikingController(network), SpikingController(network, plasticity="flux")
    np.testing.assert_allclose(flux.weights, charge.weights, rtol=0, atol=1e-12)
    for _ in range(20):
        charge.step(PHASES[0])
        flux.step(PHASES[0])
    assert np.abs(charge.weights - flux.weights).max() > 0.05


@pytest.mark.parametrize("name", ["hp_tio2_paper", "peo_pani_paper", "linear_paper", "hp_tio2", "peo_pani", "linear"])
def test_a_flux_event_is_a_pulse_of_fixed_voltage(name):
    """dq/dt = V G(s) over each of many pulses, up and down, by SciPy; 1e-9 of an event is its tolerance here."""
    device = Device.load(name)
    kind = {"hp_linear": "hp", "peo_pani_mirror": "peo_pani", "linear": "linear"}[device.law]
    model = events(kind, "flux", {kind: device})
    volts = 0.7
    width = model.event_flux / volts
    now, rng = model.start, np.random.default_rng(2)
    for k in range(200):
        sign = 1 if rng.random() < (0.2 if k < 150 else 0.9) else -1
        for _ in range(int(rng.integers(1, 40))):
            now, before = model.moved(now, sign), now
        start = state(model, before)

        def rate(t, s, sign=sign):
            return sign * volts * device.conductance(np.clip(s, 0.0, 1.0)) / device.charge_scale

        path = solve_ivp(rate, (0.0, width), [start], method="DOP853", rtol=1e-13, atol=1e-16)
        assert abs(state(model, now) - min(max(path.y[0, -1], 0.0), 1.0)) <= 1e-9 / MEM_LIFETIME


@pytest.mark.parametrize("kind", ["hp", "peo_pani", "linear"])
def test_the_default_event_of_flux_is_right_at_the_start(kind):
    model = events(kind, "flux")
    device = Device.load(PAPER_CARDS[kind])
    assert device.weight(model.first_state) == pytest.approx(0.505 if kind == "linear" else 0.5, rel=1e-12)
    up, down = (state(model, model.moved(model.start, sign)) - model.first_state for sign in (1, -1))
    # Both directions together: the change of G over a pulse is of second order.
    assert (up - down) / 2 == pytest.approx(1 / MEM_LIFETIME, rel=5e-3)


@pytest.mark.parametrize("kind", ["hp", "peo_pani", "linear"])
@pytest.mark.parametrize("plasticity", ["charge", "flux"])
def test_levels_are_all_that_events_reach(kind, plasticity):
    """Each level's neighbours are where one event takes its state: from the start, from both walls, back from both."""
    device = CARDS[kind]
    coarse = {kind: float(device.flux(1.0)) / 57.3} if plasticity == "flux" else None
    model = events(kind, plasticity, CARDS, coarse)
    levels = model.levels
    states = {levels.start: model.start}
    waiting = [levels.start]
    while waiting:
        level = waiting.pop()
        assert model.weight(states[level]) == levels.weights[level]
        for sign, following in ((1, levels.up), (-1, levels.down)):
            after = int(following[level])
            moved = model.moved(states[level], sign)
            if after not in states:
                states[after] = moved
                waiting.append(after)
            assert states[after] == moved
    assert sorted(states) == list(range(len(levels.weights)))
    # Three families, each from wall to wall, but for the walls themselves.
    assert len(states) == pytest.approx(3 * (1000 if plasticity == "charge" else 58), abs=3)
    assert levels.weights.max() == 1.0
    assert levels.weights.min() == (0.0 if kind == "linear" else pytest.approx(0.01, rel=1e-12))


def test_an_event_of_more_than_the_whole_range_goes_from_wall_to_wall():
    model = events("hp", "flux", CARDS, {"hp": 3.0 * float(CARDS["hp"].flux(1.0))})
    levels = model.levels
    assert len(levels.weights) == 3
    up, down = int(levels.up[levels.start]), int(levels.down[levels.start])
    assert (levels.weights[up], levels.weights[down]) == (1.0, pytest.approx(0.01, rel=1e-12))
    assert (levels.up[up], levels.down[up], levels.up[down], levels.down[down]) == (up, down, up, down)


def test_a_start_at_a_wall_counts_from_the_wall():
    """Ratio 2: W = 0.5 is the lowest weight."""
    device = Device.load("hp_tio2_10k").replace(r_on=1e4, r_off=2e4)
    for plasticity in ("charge", "flux"):
        network = random_network("HP", 3)
        plain, compiled = (
            SpikingController(network, plasticity=plasticity, cards={"hp": device}, implementation=i)
            for i in ("plain", "compiled")
        )
        assert set(compiled.weights.tolist()) == {0.5}
        run_together(plain, compiled, 15, 0.0)
        assert compiled.weights.min() == 0.5
        assert compiled.weights.max() > 0.5


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("system", SYSTEMS)
def test_compiled_equals_plain(system, model):
    network = random_network(system, 11)
    options = (
        MODELS[model] if system != "GA" else {"plasticity": MODELS[model].get("plasticity", "charge"), "cards": {}}
    )
    run_together(*(SpikingController(network, implementation=i, **options) for i in ("plain", "compiled")), 40, 0.0)


@pytest.mark.parametrize("readings", [{"weight_at": "emission"}, {"lateral": "both", "last_spike": 4}], ids=str)
def test_other_readings_are_followed(readings):
    network = random_network("HET", 12, **readings)
    run_together(
        *(SpikingController(network, plasticity="flux", implementation=i) for i in ("plain", "compiled")), 20, 0.0
    )


def test_constant_weights_are_the_networks():
    network = random_network("GA", 5)
    cards = {"constant": Device.load("constant")}
    controller = SpikingController(network, cards=cards)
    assert controller.weights.tolist() == [s.weight for s in network.synapses]


def test_a_whole_trial_in_one_call_is_the_plain_one():
    network, arena = random_network("HET", 7), Arena.paper().replace(max_timesteps=60)
    one, loop = (
        run_trial(SpikingController(network, plasticity="flux", implementation=i), arena, trial_key=6)
        for i in ("compiled", "plain")
    )
    assert one.actions.tolist() == loop.actions.tolist()
    assert one.output_spikes.tolist() == loop.output_spikes.tolist()
    assert one.path.tolist() == loop.path.tolist()


def test_a_plan_starts_its_devices_where_the_discrete_model_does():
    network, hardware = random_network("HET", 3), Hardware.load("het_mixed")
    found = events_of(network, "charge", hardware.devices, None)
    for point in place(network, hardware).crosspoints:
        assert point.state == found[network.synapses[point.synapse].kind].first_state
    hp, linear = hardware.devices["hp"], hardware.devices["linear"]
    assert hp.weight(state_of_weight(hp, 0.25, has_reference=False)) == pytest.approx(0.25, rel=1e-12)
    assert state_of_weight(linear, 0.25, has_reference=True) == pytest.approx(0.25, rel=1e-12)
    assert state_of_weight(hp, 0.001, has_reference=False) == 0.0


def test_events_per_lifetime_are_those_of_the_device_kernels():
    assert MEM_LIFETIME == EVENTS_OF_KERNELS  # two names, as the kernels come with the compiler


REFUSALS = [
    ({"cards": {"hq": CARDS["hp"]}}, r"^SpikingController\.cards: .*'hq'.* Did you mean 'hp'\?$", UnknownNameError),
    ({"cards": [CARDS["hp"]]}, r"^SpikingController\.cards: expected a table of kinds and devices, ", ParameterError),
    ({"cards": {"hp": "hp_tio2"}}, r"^SpikingController\.cards\['hp'\]: expected .*Device, got ", ParameterError),
    ({"cards": {}}, r"^SpikingController\.cards: expected a card for every plastic kind of the network, got none for "
                    r"'hp'\. Add it\.$", ParameterError),
    ({"cards": {"hp": Device.load("hp_tio2_10k").replace(r_off=1.5e4)}},
     r"^SpikingController\.cards\['hp'\]: expected G_off/G_on <= 0\.5, the weight at the start, got 0\.666667 of the "
     r"card 'hp_tio2_10k'\. Use a card with a larger ratio\.$", ParameterError),
    ({"plasticity": "flux", "cards": {"hp": Device.load("peo_pani_redox")}},
     r"^SpikingController\.cards\['hp'\]: expected a law that has a flux \(hp_linear, .*\), got 'peo_pani_redox' of "
     r"the card 'peo_pani_redox'\. Use another card, or plasticity='charge'\.$", ParameterError),
    ({"event_flux": {"hp": 1e-6}},
     r"^SpikingController\.event_flux: expected None with plasticity = 'charge', got \{'hp'", ParameterError),
    ({"plasticity": "flux", "event_flux": 1e-6},
     r"^SpikingController\.event_flux: expected a table of kinds and fluxes in Wb, got 1e-06", ParameterError),
    ({"plasticity": "flux", "event_flux": {"constant": 1.0}}, r"^SpikingController\.event_flux: .*'constant'",
     UnknownNameError),
    ({"plasticity": "flux", "event_flux": {"hp": 0.0}},
     r"^SpikingController\.event_flux\['hp'\]: expected a flux > 0 Wb, got 0\.0\. ", ParameterError),
    ({"plasticity": "flux", "event_flux": {"hp": float("nan")}},
     r"^SpikingController\.event_flux\['hp'\]: expected a flux > 0 Wb, got nan\. ", ParameterError),
    ({"plasticity": "flux", "event_flux": {"hp": 1e-9}},
     r"^SpikingController\.event_flux\['hp'\]: expected a flux that crosses the range of the card 'hp_tio2_paper' in "
     r"at most 200000 events, got 1e-09 Wb \(given flux\), which takes 5e\+08\. Give a larger flux\.$", ParameterError),
]  # fmt: skip


@pytest.mark.parametrize(("options", "words", "error"), REFUSALS, ids=[str(k) for k in range(len(REFUSALS))])
def test_bad_input_is_refused_before_any_work(options, words, error):
    with pytest.raises(error, match=words):
        SpikingController(random_network("HP", 1), **options)
