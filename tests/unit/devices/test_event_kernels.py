"""Counted events against the laws' own inverses, exact fractions and the plain functions."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmloom.devices import LAWS, Device
from ohmloom.devices import _event_kernels as events
from ohmloom.devices._kernels import LAW_INDEX

CARDS = ["hp_tio2", "hp_tio2_10k", "hp_tio2_paper", "linear", "linear_paper", "peo_pani", "peo_pani_paper"]
IDEAL = [name for name, law in LAWS.items() if law.is_ideal]


def setup(name):
    device = Device.load(name)
    return device, LAW_INDEX[device.law], np.array(list(device.parameters.values()))


def plain(function, *arguments):
    """The function without its compiler."""
    return getattr(function, "py_func", function)(*arguments)


# Rounding of the flux, of order 1e-16 of it, over its slope; the hp law loses R_off/R_on of it near s = 1.
@pytest.mark.parametrize("name", CARDS)
@settings(max_examples=100, deadline=None)
@given(s=st.floats(0.0, 1.0))
def test_the_state_at_a_flux_gives_the_flux_back_and_agrees_with_the_law(name, s):
    device, law, p = setup(name)
    phi = float(LAWS[device.law].flux(s, p))
    found = events.state_at_any_flux(law, phi, p)
    assert abs(found - s) <= (1e-11 if device.law == "hp_linear" else 1e-13)
    assert abs(found - float(LAWS[device.law].state_at_flux(phi, p))) <= 1e-13
    assert float(LAWS[device.law].flux(found, p)) == pytest.approx(phi, rel=1e-13, abs=1e-300)


@pytest.mark.parametrize("ratio", [1.5, 100.0, 1e6])
def test_the_iterated_inverse_holds_for_any_ratio(ratio):
    law, p = LAWS["peo_pani_mirror"], np.array([1e3, ratio * 1e3, 1e-5])
    for s in np.concatenate([np.geomspace(1e-12, 1.0, 60), np.linspace(0.0, 1.0, 61)]):
        found = events.state_at_any_flux(LAW_INDEX["peo_pani_mirror"], float(law.flux(s, p)), p)
        assert found == pytest.approx(s, rel=1e-13, abs=0.0)  # rounding of the flux, at most 16 of its own


@pytest.mark.parametrize("name", LAWS)
def test_only_an_ideal_law_has_a_state_at_a_flux(name):
    p = np.array([parameter.default for parameter in LAWS[name].parameters])
    assert math.isnan(events.state_at_any_flux(LAW_INDEX[name], 0.0, p)) == (name not in IDEAL)


@pytest.mark.parametrize("name", ["hp_tio2", "linear", "peo_pani"])
def test_flux_events_rest_on_walls(name):
    device, law, p = setup(name)
    top = float(LAWS[device.law].flux(1.0, p))
    state, origin, count = events.event_state(law, events.FLUX, 0.0, 1.0, top * 2.0, p, 0.0, top)
    assert (state, origin, count) == (1.0, top, 0.0)
    assert events.event_state(law, events.FLUX, top, -1.0, top, p, 0.0, top) == (0.0, 0.0, 0.0)


@settings(max_examples=200, deadline=None)
@given(origin=st.floats(0.0, 1.0), count=st.integers(-1500, 1500))
def test_charge_events_are_thousandths_and_rest_on_walls(origin, count):
    _, law, p = setup("hp_tio2")
    s, after, left = events.event_state(law, events.CHARGE, origin, float(count), 0.0, p, 0.0, 1.0)
    exact = Fraction(origin) + Fraction(count, 1000)
    assert abs(Fraction(s) - min(max(exact, Fraction(0)), Fraction(1))) <= Fraction(3, 10**16)  # two roundings
    if s in (0.0, 1.0):
        assert (after, left) == (s, 0.0)
    else:
        assert (after, left) == (origin, float(count))


@pytest.mark.parametrize("name", CARDS)
def test_flux_events_add_up_to_the_flux_of_all(name):
    device, law, p = setup(name)
    phi = LAWS[device.law].flux
    top, start = float(phi(1.0, p)), float(phi(0.3, p))
    event = top / 3000
    for count in (-400.0, -1.0, 0.0, 1.0, 7.0, 400.0):
        s, origin, left = events.event_state(law, events.FLUX, start, count, event, p, 0.0, top)
        x = start + count * event
        if 0.0 < x < top:
            assert (origin, left) == (start, count)
            assert s == pytest.approx(float(LAWS[device.law].state_at_flux(x, p)), abs=1e-13)  # of a range of 1
        else:
            assert s == (1.0 if x >= top else 0.0)
            assert (origin, left) == (top if s else 0.0, 0.0)


def test_a_weight_is_exact_at_both_ends():
    g_on, g_off = 1e-4, 1e-6
    assert events.read_weight(g_on, g_off, g_on) == events.read_weight(g_on, 0.0, g_on) == 1.0
    assert events.read_weight(g_off, g_off, g_on) == 0.0
    assert events.read_weight(g_off, 0.0, g_on) == g_off / g_on
    assert events.read_weight(3e-5, g_off, g_on) == plain(events.read_weight, 3e-5, g_off, g_on)


TABLE = """
import numpy as np
from ohmloom.devices import Device
from ohmloom.devices import _event_kernels as e
from ohmloom.devices import _kernels as k
for name in ("hp_tio2", "linear", "peo_pani"):
    d = Device.load(name)
    law, p = k.LAW_INDEX[d.law], np.array(list(d.parameters.values()))
    top = float(k.flux(law, 1.0, p))
    for family, wall in ((e.CHARGE, 1.0), (e.FLUX, top)):
        for count in (-700.0, -3.0, 0.0, 1.0, 250.0, 700.0):
            x = e.event_state(law, family, 0.4 * wall, count, top / 1000, p, 0.0, wall)
            g = k.conductance(law, x[0], 0.0, p)
            print(*(float(y).hex() for y in (*x, g, e.read_weight(g, 0.0, k.conductance(law, 1.0, 0.0, p)))))
"""


def test_compiled_events_equal_the_plain_functions():
    def run(**extra):
        environment = {**{key: v for key, v in os.environ.items() if key != "NUMBA_DISABLE_JIT"}, **extra}
        command = [sys.executable, "-c", TABLE]
        lines = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.splitlines()
        return np.array([[float.fromhex(word) for word in line.split()] for line in lines])

    plain_table = run(NUMBA_DISABLE_JIT="1")
    assert plain_table.shape == (36, 5)
    # NumPy's exponential and logarithm are not the compiler's to the last bit.
    np.testing.assert_allclose(run(), plain_table, rtol=1e-14, atol=0.0)
