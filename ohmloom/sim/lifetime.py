"""After many trials: what retention does to weights that nobody writes again, and what pulses do to the busiest device.

Every trial begins with every device in its programmed state (`ohmloom.mapping.plan_reset`), so that plasticity does not
add up; what adds up is wear, and the decay of states where the array is left alone between trials.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmloom.mapping import Ledger, Plan
from ohmloom.mapping.effects import retention_time
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP
from ohmloom.sim.figures_cost import TIMESTEP

TRIALS = (1, 10, 100, 1000, 10_000, 100_000)


def lifetime(plan: Plan, ledger: Ledger) -> tuple[dict[str, Any], ...]:
    """Wear and decay after so many trials, one after the other, each as long as the nominal die's.

    Returns
    -------
    tuple of dict
        ``trial``; ``hours`` of 32 ms timesteps; ``pulses`` of the busiest device; ``wear``, those over
        ``endurance.pulses``, 1 at its end; ``mean_weight_error`` and ``worst_weight_error`` of initial weights that
        decay with ``nonidealities.retention`` and are not written again, None where the spec declares none.
    """
    hardware = plan.hardware
    seconds = ledger.steps / STEPS_PER_TIMESTEP * TIMESTEP
    retention = retention_time(hardware)
    rows: list[dict[str, Any]] = []
    for trial in TRIALS:
        error = None if retention is None else weight_errors(plan, trial * seconds / retention)
        pulses = trial * ledger.most_pulses
        rows.append({
            "trial": trial, "hours": trial * seconds / 3600.0, "pulses": pulses,
            "wear": pulses / hardware.endurance.pulses.value,
            "mean_weight_error": None if error is None or not error.size else float(error.mean()),
            "worst_weight_error": None if error is None or not error.size else float(error.max()),
        })  # fmt: skip
    return tuple(rows)


def weight_errors(plan: Plan, decays: float) -> Any:
    """Change of every plastic synapse's initial weight after so many time constants, axes (plastic synapse,)."""
    devices, errors = plan.hardware.devices, []
    for point in plan.crosspoints:
        tile = plan.tiles[point.tile]
        if tile.kind in PLASTIC_KINDS:
            device = devices[tile.kind]
            reference = float(device.weight(0.0)) if tile.subtracts_off else 0.0
            now, then = (float(device.weight(s)) for s in (point.state, point.state * math.exp(-decays)))
            errors.append(abs(then - now) / (1.0 - reference))
    return np.array(errors)
