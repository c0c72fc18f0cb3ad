"""Readings of what the paper leaves open, one at a time and in random combinations, and how well they fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ohmloom.sim.paper.published import published

if TYPE_CHECKING:
    from ohmloom.sim.paper.experiment import Count

# Each is an `OpenSettings` as plain values; what is left out has the default.
ALTERNATIVES: Final[dict[str, dict[str, Any]]] = {
    "default": {},
    "gain_1": {"readings": {"synapse_gain": 1.0}},
    "gain_0.5": {"readings": {"synapse_gain": 0.5}},
    "lateral_both": {"readings": {"lateral": "both"}},
    "lateral_ascending": {"readings": {"lateral": "ascending"}},
    "weight_at_emission": {"readings": {"weight_at": "emission"}},
    "hidden_delay_one": {"readings": {"hidden_delay": "one"}},
    "no_input_bias": {"readings": {"input_bias": False}},
    "no_clamp": {"readings": {"clamp": False}},
    "state_not_carried": {"readings": {"carry_state": False}},
    "all_enabled": {"enable_probability": 1.0},
    "shadow": {"shadow": True},
}

# What the search draws from. Arena constants: Webots' Khepera has other figures in other versions.
READINGS: Final[dict[str, tuple[Any, ...]]] = {
    "synapse_gain": (0.15, 0.2, 0.25, 0.3, 0.4, 0.6, 1.0),
    "lateral": ("descending", "both", "ascending"),
    "weight_at": ("arrival", "emission"),
    "hidden_delay": ("index", "one"),
    "input_bias": (True, False),
    "clamp": (True, False),
    "carry_state": (True, False),
}
WORLD: Final[dict[str, tuple[Any, ...]]] = {
    "enable_probability": (0.5, 0.75, 1.0),
    "shadow": (False, True),
    "axle": (0.052, 0.1),
    "ir_range": (0.03, 0.05, 0.1),
    "light_saturation": (0.1, 0.2, 0.5),
}


def candidates(count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Random combinations, without repetition; the default comes first."""
    found: list[dict[str, Any]] = [{}] if count else []
    while len(found) < count:
        readings = {name: values[int(rng.integers(len(values)))] for name, values in READINGS.items()}
        world = {name: values[int(rng.integers(len(values)))] for name, values in WORLD.items()}
        drawn = world | {"readings": readings}
        if drawn not in found:
            found.append(drawn)
    return found


def deviance(counts: Mapping[str, Count]) -> float:
    """Binomial deviance of these systems' counts from what the paper's numbers imply; 0 is a perfect fit."""
    total = 0.0
    for system, count in counts.items():
        expected = published().implied_success[system]
        for k, p in ((count.solved, expected), (count.tried - count.solved, 1.0 - expected)):
            total += 2.0 * k * math.log(k / (count.tried * p)) if k else 0.0
    return total
