"""Dies: keyed streams, spreads of the right size, nothing else."""

import numpy as np
import pytest

from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network

NETWORK = Network.random(system="HET", rng=np.random.default_rng(3))


def with_spread(**changes):
    hardware = Hardware.load("het_mixed")
    spread = hardware.nonidealities
    update = {k: getattr(spread, k).model_copy(update={"value": v}) for k, v in changes.items()}
    return place(NETWORK, hardware.model_copy(update={"nonidealities": spread.model_copy(update=update)}))


def test_same_seed_and_number_give_the_same_die():
    plan = place(NETWORK, Hardware.load("het_mixed"))
    a, b, c = plan.sample(seed=7, die=2), plan.sample(seed=7, die=2), plan.sample(seed=7, die=3)
    assert (a.state == b.state).all()
    assert (a.state != c.state).any()


def test_effects_have_streams_of_their_own():
    a = with_spread(write_verify=0.0).sample(seed=7)
    b = with_spread(write_verify=0.05).sample(seed=7)
    assert (a.event_charge == b.event_charge).all()
    assert (a.threshold == b.threshold).all()
    assert (a.state != b.state).any()


def test_no_spread_is_the_nominal_die():
    plan = with_spread(write_verify=0.0, event_charge=0.0, threshold=0.0)
    a, b = plan.sample(seed=1), plan.nominal()
    for name in ("state", "event_charge", "threshold"):
        assert (getattr(a, name) == getattr(b, name)).all()


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_spread_of_programmed_conductance(sigma):
    plan = with_spread(write_verify=sigma)
    errors = []
    for die in range(40):
        states = plan.sample(seed=5, die=die).state
        for point, state in zip(plan.crosspoints, states, strict=True):
            device = plan.hardware.devices[plan.tiles[point.tile].kind]
            errors.append((float(device.conductance(state)) - point.conductance) / float(device.conductance(1.0)))
    n = len(errors)
    # Four standard errors of a standard deviation.
    assert np.std(errors) == pytest.approx(sigma, rel=4 / np.sqrt(2 * n))
    assert abs(np.mean(errors)) < 4 * sigma / np.sqrt(n)


def test_wide_spread_never_leaves_the_device():
    plan = with_spread(write_verify=3.0, event_charge=3.0, threshold=3.0)
    die = plan.sample(seed=5)
    assert ((die.state >= 0) & (die.state <= 1)).all()
    assert (die.event_charge >= 0).all()
    assert (die.threshold >= 0).all()
