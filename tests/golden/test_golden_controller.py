"""The exact cases beside this file, on the plain and on the compiled controller."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ohmloom.neurocontroller import LATTICES, Network, Readings, SpikingController, Synapse, _kernels, plain
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.plain import PlainController
from ohmloom.neurocontroller.wiring import charge_levels, level_tables, new_state, wire

HERE = Path(__file__).parent
COLUMN = {"hp": "HP", "peo_pani": "PEO", "linear": "LIN"}
TOLERANCE = 1e-12  # the cases are exact fractions, written out in double precision


def read(name):
    return json.loads((HERE / name).read_text())


# A sensor value is never negative; only the membrane functions can have that case.
SENSOR_CASES = [case for case in read("01_lif_constant_current.json")["cases"] if case["I"] >= 0]


def het_star():
    """Inputs 0, 1, 2 onto hidden neuron 6 by one synapse of each plastic kind."""
    synapses = tuple(Synapse(pre, 6, kind, 0.5) for pre, kind in enumerate(PLASTIC_KINDS))
    return Network(system="HET", hidden=("excitatory",), synapses=synapses)


def plain_membrane(y, current):
    return plain.membrane(y, current, 0.3, Readings())


def compiled_membrane(y, current):
    y = _kernels.membrane(y, current, 0.3, 0.05, True)
    return y, y > 1.0


@pytest.mark.parametrize("membrane", [plain_membrane, compiled_membrane])
@pytest.mark.parametrize("case", read("01_lif_constant_current.json")["cases"], ids=lambda c: f"I={c['I']}")
def test_case_01_membrane_under_constant_current(case, membrane):
    y, spikes, before_reset = case["y0"], [], []
    for step in range(1, case["steps"] + 1):
        y, above = membrane(y, case["I"])
        before_reset.append(y)
        if above:
            spikes.append(step)
            y = 0.0
    assert spikes == case["spike_steps"]
    assert len(spikes) == case["n"]
    np.testing.assert_allclose(before_reset[:6], case["y_before_reset_first6"], rtol=0, atol=TOLERANCE)
    if case["I"] == 0.7:
        assert before_reset[1] == 1.0


@pytest.mark.parametrize("implementation", ["plain", "compiled"])
@pytest.mark.parametrize("case", SENSOR_CASES, ids=lambda c: f"I={c['I']}")
def test_case_01_input_neurons_of_a_controller(case, implementation):
    controller = SpikingController(het_star(), implementation=implementation)
    spikes = [step for step in range(1, 22) if controller.spikes([case["I"]] * 6)[0]]
    assert spikes == case["spike_steps"]


@pytest.mark.parametrize(
    "classify",
    [lambda a, b: plain.classify((a, b), 11), lambda a, b: _kernels.classify(a, b, 11)],
    ids=["plain", "compiled"],
)
def test_case_02_classification(classify):
    golden = read("02_classification.json")
    label = {case["n_spikes"]: case["label"] for case in golden["cases"]}
    names = ("forward", "left", "right")
    expected = {tuple(case["o"]): case["action"] for case in golden["actions"]}
    assert set(label.values()) == {"low", "high"}
    for left, left_label in label.items():
        for right, right_label in label.items():
            assert names[classify(left, right)] == expected[left_label, right_label]


def stdp_of_plain(network):
    controller = PlainController(network)

    def step(spiked):
        controller._stdp(spiked)
        return tuple(np.sum(controller.events, axis=0))

    return step


def stdp_of_masks(network):
    w = wire(network)
    s = new_state(w)
    last = 0

    def step(spiked):
        nonlocal last
        spikes = sum(1 << j for j, spike in enumerate(spiked) if spike)
        _kernels.stdp_masked(w.plastic, w.sign, w.kind, w.tables, w.up, w.down, s.weight, s.level, s.events,
                             spikes, last & ~spikes)  # fmt: skip
        last = spikes
        return tuple(s.events)

    return step


def stdp_of_general_form(network):
    w = wire(network)
    s = new_state(w)

    def step(spiked):
        s.ls[np.flatnonzero(spiked)] = w.last_spike
        _kernels.stdp_general(w, s)
        return tuple(s.events)

    return step


@pytest.mark.parametrize("rule", [stdp_of_plain, stdp_of_masks, stdp_of_general_form])
@pytest.mark.parametrize("case", read("03_stdp_events.json")["cases"], ids=lambda c: f"{c['pre']}-{c['post']}")
def test_case_03_stdp_events(case, rule):
    network = Network(system="LIN", hidden=("excitatory",), synapses=(Synapse(0, 6, "linear", 0.5),))
    step_rule = rule(network)
    found, before = [], (0, 0)
    for step in range(1, case["steps"] + 1):
        after = step_rule([(j == 0 and step in case["pre"]) or (j == 6 and step in case["post"]) for j in range(9)])
        found += [[step, 1]] * int(after[0] - before[0]) + [[step, -1]] * int(after[1] - before[1])
        before = after
    assert found == case["events"]
    assert before[0] - before[1] == case["net"]


def test_case_04_weight_curves():
    golden = read("04_weight_curves.json")
    tables = level_tables()[0]
    for row in golden["rows"]:
        n = row["n_positive_events_from_q0"]
        for kind, lattice in LATTICES.items():
            q = n * lattice.event
            level = charge_levels(lattice).index(q)
            assert lattice.weight(q) == pytest.approx(row[COLUMN[kind]], rel=0, abs=TOLERANCE)
            assert tables[PLASTIC_KINDS.index(kind), level] == lattice.weight(q)
            if kind != "linear":
                assert q / lattice.unit == pytest.approx(row["q"], rel=0, abs=TOLERANCE)
    hp, peo = LATTICES["hp"], LATTICES["peo_pani"]
    for row in golden["mirror"]:
        total = hp.weight(row["n"] * hp.event) + peo.weight((1000 - row["n"]) * peo.event)
        assert total == pytest.approx(row["sum"], rel=0, abs=TOLERANCE)


class PlainWeights:
    def __init__(self):
        self.controller = PlainController(het_star())

    def event(self, sign):
        pre, post = (2, 3) if sign > 0 else (3, 2)
        self.controller.ls = [pre] * 6 + [post, 0, 0]
        self.controller._stdp([False] * 9)

    def values(self):
        charges = zip(PLASTIC_KINDS, self.controller.charges, strict=True)
        return self.controller.weights, {kind: q / LATTICES[kind].unit for kind, q in charges}


class CompiledWeights:
    def __init__(self):
        self.wiring = wire(het_star())
        self.state = new_state(self.wiring)

    def event(self, sign):
        w, s = self.wiring, self.state
        inputs, hidden = 0b111, 1 << 6
        new, old = (hidden, inputs) if sign > 0 else (inputs, hidden)
        _kernels.stdp_masked(w.plastic, w.sign, w.kind, w.tables, w.up, w.down, s.weight, s.level, s.events, new, old)

    def values(self):
        levels = zip(PLASTIC_KINDS, self.state.level[6, :3], strict=True)
        charges = {k: charge_levels(LATTICES[k])[level] / LATTICES[k].unit for k, level in levels}
        return self.state.weight[6, :3], charges


@pytest.mark.parametrize("implementation", [PlainWeights, CompiledWeights])
@pytest.mark.parametrize("row", read("05_weights_from_half.json")["rows"], ids=lambda r: f"{r['events']:+d}")
def test_case_05_weights_from_half(row, implementation):
    synapses = implementation()
    for _ in range(abs(row["events"])):
        synapses.event(row["events"])
    weights, charges = synapses.values()
    expected = [row["W_HP"], row["W_PEO"], row["W_LIN"]]
    np.testing.assert_allclose(weights, expected, rtol=0, atol=TOLERANCE)
    assert charges["hp"] == pytest.approx(row["q_HP"], rel=0, abs=TOLERANCE)
    assert charges["peo_pani"] == pytest.approx(row["q_PEO"], rel=0, abs=TOLERANCE)


@pytest.mark.parametrize("implementation", [PlainWeights, CompiledWeights])
@pytest.mark.parametrize(("name", "first", "column", "kind"),
                         [("HP_12up_12down", 1, 0, "hp"), ("PEO_12down_12up", -1, 1, "peo_pani")])  # fmt: skip
def test_case_05_clamping_is_not_reversible(name, first, column, kind, implementation):
    synapses = implementation()
    for sign in [first] * 12 + [-first] * 12:
        synapses.event(sign)
    weights, charges = synapses.values()
    golden = read("05_weights_from_half.json")["clamp_is_not_reversible"][name]
    assert weights[column] == pytest.approx(golden["W"], rel=0, abs=TOLERANCE)
    assert charges[kind] == pytest.approx(golden["q"], rel=0, abs=TOLERANCE)
    assert abs(weights[column] - 0.5) > 1e-3
