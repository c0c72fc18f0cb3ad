"""Studies to report on, made once: short trials, since what is drawn does not depend on their length."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import Network
from ohmloom.sim import Arena, Feasibility, feasibility


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
