"""A die: one sampled piece of hardware that carries a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.errors import expect_integer, expect_type
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.mapping.plan import Plan


@dataclass(frozen=True, kw_only=True, eq=False)
class Die:
    """Devices of one piece of hardware, each array with axes (synapse,) in the network's order.

    Attributes
    ----------
    plan
        What is placed where.
    seed, index
        Seed and number of the die; None for the nominal one.
    state
        Initial state s after programming, in [0, 1].
    event_charge
        Charge of one STDP event as a fraction of the nominal q_d / 1000.
    threshold
        Threshold voltage [V].
    """

    plan: Plan
    seed: int | None
    index: int | None
    state: FloatArray
    event_charge: FloatArray
    threshold: FloatArray

    def __post_init__(self) -> None:
        expect_type("Die.plan", self.plan, Plan)
        for name in ("state", "event_charge", "threshold"):
            object.__setattr__(self, name, frozen_array(f"Die.{name}", getattr(self, name), ("synapse",)))


def nominal(plan: Plan) -> Die:
    """Every device as its card says."""
    n = len(plan.crosspoints)
    return Die(
        plan=plan, seed=None, index=None, state=np.array([c.state for c in plan.crosspoints]),
        event_charge=np.ones(n), threshold=np.full(n, plan.hardware.drive.threshold.value),
    )  # fmt: skip


def sample(plan: Plan, *, seed: int, die: int = 0) -> Die:
    """Draw the build-time and program-time spreads of one die; streams are keyed by (effect, die).

    Parameters
    ----------
    plan
        What is placed where.
    seed, die
        Integers >= 0. Any worker that knows both draws the same die.

    Raises
    ------
    ParameterError
        If `seed` or `die` is no such integer.
    """
    seed, die = expect_integer("Plan.sample.seed", seed), expect_integer("Plan.sample.die", die)
    n = len(plan.crosspoints)
    spread = {name: 0.0 if (q := getattr(plan.hardware.nonidealities, name)) is None else q.value for name in EFFECTS}

    def normal(effect: str) -> FloatArray:
        stream = np.random.SeedSequence(seed, spawn_key=(EFFECTS[effect].stream, die))
        return np.random.default_rng(stream).standard_normal(n)

    states, devices = np.empty(n), plan.hardware.devices
    errors = spread["write_verify"] * normal("write_verify")
    for k, (point, error) in enumerate(zip(plan.crosspoints, errors, strict=True)):
        device = devices[plan.tiles[point.tile].kind]
        g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
        if error == 0.0:
            states[k] = point.state
        else:
            g = min(max(point.conductance + error * g_on, g_off), g_on)
            states[k] = device.state_at_weight(min(max(g / g_on, g_off / g_on), 1.0))
    return Die(
        plan=plan, seed=seed, index=die, state=states,
        # A meter cannot count backwards, nor a threshold be negative.
        event_charge=np.maximum(1.0 + spread["event_charge"] * normal("event_charge"), 0.0),
        threshold=plan.hardware.drive.threshold.value
        * np.maximum(1.0 + spread["threshold"] * normal("threshold"), 0.0),
    )  # fmt: skip
