"""Synthetic sweeps of known devices, and quick settings for a search that is not the point."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.devices import LAWS, CardValue, Device, Measurement

# law -> (parameters that differ from the defaults, amplitude in V, period in s, s0)
TRUTHS = {
    "hp_linear": ({"r_off": 1.6e3, "beta": 1e3}, 1.0, 1.0, 0.3),
    "hp_biolek": ({"r_off": 1.6e3, "beta": 1e3}, 0.4, 1.0, 0.3),
    "linear": ({"r_on": 1e4, "r_off": 1e5, "q_d": 4e-6}, 1.0, 1.0, 0.2),
    "peo_pani_mirror": ({"r_on": 1e4, "r_off": 1e5, "q_d": 1e-5}, 1.0, 1.0, 0.2),
    "tio2_threshold": ({"r_on": 2e3, "r_off": 4e4, "v_set": 0.4, "v_reset": 0.3, "q_set": 3e-5, "q_reset": 2e-5},
                       1.0, 1.0, 0.2),
    "mirror_threshold": ({"r_on": 2e3, "r_off": 2e4, "v_set": 0.3, "v_reset": 0.2, "q_set": 8e-5, "q_reset": 6e-5},
                         1.0, 1.0, 0.05),
    "peo_pani_redox": ({"r_on": 1.147e4, "r_off": 5e5, "e0": 0.2, "slope": 0.2, "k0": 1.0}, 0.8, 4.0, 0.2),
}  # fmt: skip
NOISE = 0.01


def make_device(law, **changed):
    values = {**TRUTHS.get(law, ({},))[0], **changed}
    return Device(name=law, law=law, source="made up", values=tuple(
        CardValue(value=values.get(p.name, p.default), source="made up") for p in LAWS[law].parameters))  # fmt: skip


def make_sweep(law, seed=1, *, noise=NOISE, points=200, s0=None, amplitude=None, period=None, name=None,
               correlation=0.0, **changed):  # fmt: skip
    _, default_amplitude, default_period, default_s0 = TRUTHS[law]
    amplitude, period = amplitude or default_amplitude, period or default_period
    t = np.linspace(0.0, period, points)
    loop = make_device(law, **changed).simulate(
        amplitude * np.sin(2 * np.pi * t / period), t, s0=default_s0 if s0 is None else s0
    )
    raw = np.random.default_rng(seed).standard_normal(points)
    e = raw.copy()
    for k in range(1, points):
        e[k] = correlation * e[k - 1] + np.sqrt(1.0 - correlation**2) * raw[k]
    return Measurement(name=name or law, t=loop.t, v=loop.v, i=loop.i + noise * np.sqrt(np.mean(loop.i**2)) * e)


@pytest.fixture(scope="session")
def truths():
    return TRUTHS


@pytest.fixture(scope="session")
def device():
    return make_device


@pytest.fixture(scope="session")
def sweep():
    return make_sweep


@pytest.fixture
def rng():
    return np.random.default_rng(0)
