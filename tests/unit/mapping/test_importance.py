"""What a repair gives up last: synapses through which much of the outputs' input runs."""

import numpy as np
import pytest

from ohmloom.mapping import Hardware, Quantity, place
from ohmloom.mapping.importance import LEAST, column_importance, neuron_influence
from ohmloom.neurocontroller import Network, Readings, Synapse

TOO_MANY = 0.35  # share of faulty devices that no order of the lines avoids


def network(*pairs):
    synapses = tuple(Synapse(pre, post, "hp", 0.5) for pre, post in pairs)
    return Network(
        system="HP",
        hidden=("excitatory",) * 3,
        synapses=synapses,
        readings=Readings.model_validate({"lateral": "both"}),
    )


def test_a_chain_passes_its_share_on():
    # 6 and 7 feed output 9; 7 is fed by 0 and 1.
    found = neuron_influence(network((0, 7), (1, 7), (6, 9), (7, 9)))
    assert found[[9, 10, 6, 7, 8, 0, 1]].tolist() == [1.0, 1.0, 0.5, 0.5, 0.0, 0.25, 0.25]


def test_signals_that_go_round_stay_finite():
    found = neuron_influence(network((0, 6), (6, 7), (7, 6), (7, 9)))
    # Half of what 6 receives comes round again: 7 counts 1 + 1/2 of itself, and so on.
    assert found[7] == pytest.approx(2.0, rel=0.05)  # followed eleven times, so not to the end


def test_what_leads_nowhere_counts_least():
    found = column_importance(network((0, 8), (0, 6), (6, 9)))
    assert found[8] == LEAST
    assert found[9] == 1.0


def test_dies_are_repaired_by_importance(monkeypatch):
    hardware = Hardware.load("hp_1t1r")
    faults = Quantity(value=TOO_MANY, source="a test")
    spread = hardware.nonidealities.model_copy(update={"stuck_off": faults})
    net = Network.random(system="HP", rng=np.random.default_rng(5))
    plan = place(net, hardware.model_copy(update={"nonidealities": spread}))
    importance = column_importance(net)

    def lost():
        dies = [plan.sample(seed=1, die=k) for k in range(30)]
        return sum(importance[net.synapses[k].post] for die in dies for k in die.residual)

    weighted = lost()
    monkeypatch.setattr("ohmloom.mapping.die._importance", lambda *_: None)
    assert 0.0 < weighted < 0.9 * lost()
