"""Studies to report on, made once: short trials, since what is drawn does not depend on their length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import Network
from ohmloom.sim import Arena, Feasibility, feasibility

HOSTILE_NAME = "<b>x</b> $\\frac$"


def run_study(system: str, hardware: str, dies: int, timesteps: int = 250) -> Feasibility:
    network = Network.random(system=system, rng=np.random.default_rng(1))
    arena = Arena.paper().replace(max_timesteps=timesteps)
    return feasibility(network, Hardware.load(hardware), dies=dies, seed=1, arena=arena)


@pytest.fixture(scope="package")
def make_study() -> Callable[..., Feasibility]:
    """Run a study: system, hardware, dies, timesteps=250."""
    return run_study


@pytest.fixture(scope="package")
def het_study() -> Feasibility:
    """All plastic kinds, three dies."""
    return run_study("HET", "het_mixed", 3)


@pytest.fixture(scope="package")
def ga_study() -> Feasibility:
    """No plastic synapse, no die."""
    return run_study("GA", "hp_1t1r", 0)


@pytest.fixture(scope="package")
def full_study(het_study: Feasibility) -> Feasibility:
    """The same with made-up results of a full study: what is shown does not depend on how they came about."""
    rates = (0.0, 0.01, 0.05, 0.1)
    yields = [
        {"fault_rate": rate, "repair": repair, "spare_rows": spare, "spare_columns": spare,
         "value": value, "interval": [max(value - 0.06, 0.0), min(value + 0.05, 1.0)], "n": 120}
        for repair, spare, slope in (("none", 0, 9.0), ("permuted", 0, 4.0), ("permuted", 2, 1.5))
        for rate in rates
        for value in [max(1.0 - slope * rate, 0.0)]
    ]  # fmt: skip
    figures = [asdict(figure) for figure in het_study.figures]
    assert het_study.success is not None
    corners = [
        {"name": "typical", "description": "every value as the spec has it", "success": asdict(het_study.success),
         "figures": figures, "verdict": "MARGINAL"},
        {"name": HOSTILE_NAME, "description": "cannot be built: no card", "success": None, "figures": [],
         "verdict": "FAIL"},
    ]  # fmt: skip
    factors: list[dict[str, Any]] = [
        {"name": name, "unit": unit, "low": 0.0, "high": high, "source": "assumed: a guess", "mu_star": mu,
         "interval": [0.7 * mu, 1.4 * mu], "sigma": 0.5 * mu}
        for name, unit, high, mu in (
            ("nonidealities.event_charge", "1", 0.1, 0.031), ("wires.r_row", "Ohm", 5.0, 0.012),
            (HOSTILE_NAME, "1", 0.02, 0.0004),
        )
    ]  # fmt: skip
    sensitivity = {
        "output": "action_agreement", "trajectories": 40, "factors": factors, "n_sobol": 256,
        "sobol": [{"name": one["name"], "first": 0.5, "first_interval": [0.4, 0.6], "total": 0.62,
                   "total_interval": [0.5, 0.75]} for one in factors[:2]],
        "convergence": [{"trajectories": n, "mu_star": {one["name"]: one["mu_star"] * (1 + 2 / n) for one in factors}}
                        for n in (10, 20, 40)],
    }  # fmt: skip
    requirements = [
        {"figure": "time_per_step", "parameter": "drive.pulse_voltage", "unit": "V", "now": 1.0, "needed": 3.21,
         "sentence": "time_per_step passes with drive.pulse_voltage >= 3.21 V"},
        {"figure": "time_per_step", "parameter": HOSTILE_NAME, "unit": "V", "now": 1.0, "needed": None,
         "sentence": "no value helps"},
    ]  # fmt: skip
    lifetime = [
        {"trial": trial, "hours": 0.02 * trial, "pulses": 24118 * trial, "wear": 2.4118e-5 * trial,
         "mean_weight_error": None if trial == 1 else 0.001 * trial}
        for trial in (1, 10, 100)
    ]  # fmt: skip
    return replace(
        het_study, yield_=tuple(yields), corners=tuple(corners), sensitivity=sensitivity,
        requirements=tuple(requirements), lifetime=tuple(lifetime),
    )  # fmt: skip
