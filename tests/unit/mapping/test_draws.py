"""What is drawn for a die: each effect from a stream of its own; repair brings back the nominal one."""

import numpy as np
import pytest

from ohmloom.mapping import EmulatedController, place
from ohmloom.mapping.die import sample
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.neurocontroller import Network

RANDOM = Network.random(system="HET", rng=np.random.default_rng(3))


@pytest.fixture(name="die")
def _die(changed):
    def build(effects, *, die=0, **sections):
        return place(RANDOM, changed("ideal", nonidealities=effects, **sections)).sample(seed=7, die=die)

    return build


# What each effect that is drawn at build or program time may change of a die.
DRAWN = {
    "write_verify": "state", "event_charge": "event_charge", "threshold": "threshold", "stuck_on": "faults",
    "stuck_off": "faults", "forming": "faults", "neuron_threshold": "neuron_threshold", "neuron_leak": "neuron_leak",
    "neuron_bias": "neuron_bias", "sense_offset": "sense_offset", "tile_gain": "tile_gain",
    "wire_resistance": "wire_resistance",
}  # fmt: skip
FAULTS = {"stuck_on": 1, "stuck_off": 2, "forming": 3}


def all_effects(without=None):
    """Every effect that a meter and wires can show, but one."""
    values = {name: 1.0 if name == "quantisation" else 0.1 for name in EFFECTS if name != "half_select"}
    return values | ({} if without is None else {without: None})


METERED = {
    "drive": {"mode": "charge_metered", "parallelism": "column", "pulse_duration": None},
    "wires": {"r_row": 1e-6, "r_column": 1e-6},
}


@pytest.mark.parametrize("effect", [name for name in EFFECTS if name != "half_select"])
def test_an_effect_leaves_the_draws_of_all_others(effect, die):
    base, less = (die(all_effects(name), **METERED) for name in (None, effect))
    for name in {*DRAWN.values()} - {"faults", DRAWN.get(effect)}:
        assert np.array_equal(getattr(base, name), getattr(less, name)), name
    assert base.keys == less.keys
    for a, b in zip(base.faults, less.faults, strict=True):
        # Of two faults in one cell the last one wins, so a fault that is taken away may show another.
        assert (a == b)[a != FAULTS.get(effect)].all()
    changed = DRAWN.get(effect)
    if changed == "faults":
        assert any((a != b).any() for a, b in zip(base.faults, less.faults, strict=True))
    elif changed is not None:
        assert not np.array_equal(getattr(base, changed), getattr(less, changed))


def test_noise_of_events_and_reads_is_drawn_from_the_die_and_from_different_streams(die):
    a, b = (die({"cycle_to_cycle": 0.1, "read_noise": 0.1}, die=k) for k in range(2))
    assert len({*a.keys.values(), *b.keys.values()}) == 4


def test_a_repaired_die_of_equal_devices_spikes_like_the_nominal_one(changed):
    spec = changed(
        "ideal", array={"spare_rows": 3, "spare_columns": 3, "disabled": "masked"},
        nonidealities={"stuck_off": 0.02, "stuck_on": 0.02, "forming": 0.02},
    )  # fmt: skip
    plan = place(RANDOM, spec)
    dies = [plan.sample(seed=5, die=k) for k in range(12)]
    repaired = [d for d in dies if not d.residual and any(grid.any() for grid in d.faults)]
    moved = [d for d in repaired if any((r.rows != np.arange(len(r.rows))).any() for r in d.repairs)]
    broken = [sample(plan, seed=5, die=d.index, is_repaired=False) for d in moved]
    assert moved
    assert any(d.residual for d in broken)
    nominal = EmulatedController(plan.nominal())
    rng = np.random.default_rng(1)
    sensors = rng.random((40, 6))
    wanted = [nominal.spikes(values).tolist() for values in sensors.repeat(5, axis=0)]
    for d in moved[:3]:
        emulated = EmulatedController(d)
        assert [emulated.spikes(values).tolist() for values in sensors.repeat(5, axis=0)] == wanted
        assert (emulated.weights == nominal.weights).all()
    worst = EmulatedController(next(d for d in broken if d.residual))
    for values in sensors.repeat(5, axis=0):
        worst.spikes(values)
    assert (worst.weights != nominal.weights).any()
