"""Compiled kernels against their plain selves, and pulses against closed forms and SciPy."""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from ohmloom.devices import LAWS, Device
from ohmloom.devices import _kernels as kernels

CARDS = ["hp_tio2", "hp_tio2_10k", "hp_tio2_paper", "linear", "linear_paper", "peo_pani", "peo_pani_paper"]
# Of an event: the paper's memristors take a thousand to cross.
EVENT = 1e-3
STATE = 1e-12 * EVENT
DURATION = 1e-9


def setup(name):
    device = Device.load(name)
    return (
        device,
        kernels.LAW_INDEX[device.law],
        np.array(list(device.parameters.values())),
        device.charge_scale,
    )


def resistance_integral(device, s0, ds):
    """Integral of M over the state from s0 to s0 + ds, the state resting at a wall, by quadrature."""
    law, p = LAWS[device.law], tuple(device.parameters.values())
    end = min(max(s0 + ds, 0.0), 1.0)

    def memristance(s):
        return 1.0 / law.conductance(s, 0.0, p)

    if abs(end - s0) < 1e-12:
        return memristance(s0) * ds
    # Split, because the mirror law has a pole just beyond s = 0.
    splits = [s0 + (end - s0) * f for f in (0.0, 0.1, 0.5, 0.9, 0.99, 1.0)]
    pieces = [quad(memristance, a, b, epsrel=1e-12, epsabs=0.0)[0] for a, b in itertools.pairwise(splits)]
    return math.fsum(pieces) + memristance(end) * (s0 + ds - end)


@pytest.mark.parametrize("name", LAWS)
def test_dispatch_answers_each_index_with_its_own_law(name):
    law = LAWS[name]
    p = np.array([parameter.default for parameter in law.parameters])
    index = kernels.LAW_INDEX[name]
    assert kernels.LAW_NAMES[index] == name
    for s in (0.0, 0.1, 0.37, 1.0):
        assert kernels.conductance(index, s, 0.3, p) == law.conductance(s, 0.3, p)
        assert kernels.charge_rate(index, s, 0.3, 2e-3, p) == law.charge_rate(s, 0.3, 2e-3, p)


@pytest.mark.parametrize("index", [-1, len(LAWS)])
def test_an_index_without_a_law_gives_nan(index):
    p = np.array([1.0, 2.0, 3.0])
    assert math.isnan(kernels.conductance(index, 0.5, 0.0, p))
    assert math.isnan(kernels.charge_rate(index, 0.5, 0.0, 1.0, p))


TABLE = """
import numpy as np
from ohmloom.devices import Device
from ohmloom.devices import _kernels as k
for name in ("hp_tio2", "linear", "peo_pani"):
    d = Device.load(name)
    law, p, q = k.LAW_INDEX[d.law], np.array(list(d.parameters.values())), d.charge_scale
    for s in (0.0, 0.0004, 0.3, 0.9996, 1.0):
        for sign in (1.0, -1.0):
            m = k.metered_pulse(law, s, p, q, sign * 0.7, sign * q / 1000)
            c = k.current_pulse(law, s, p, q, sign * q, 0.001)
            print(*(float(x).hex() for x in (*m, *c)))
"""


def test_compiled_pulses_equal_the_plain_functions_bit_for_bit():
    def run(**extra):
        environment = {**{key: v for key, v in os.environ.items() if key != "NUMBA_DISABLE_JIT"}, **extra}
        command = [sys.executable, "-c", TABLE]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout

    plain = run(NUMBA_DISABLE_JIT="1")
    assert len(plain.splitlines()) == 30
    assert run() == plain


MIXED = """
import sys
from numba.core import types
from numba.extending import intrinsic
from ohmloom._jit import COMPILED, closure_kernel, kernel

def stay_apart():
    pass

def compiled_form(typingctx):
    def codegen(context, builder, signature, args):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()
    return types.none(), codegen

if COMPILED:  # what is inlined has no name that the linker could mistake
    stay_apart = intrinsic(compiled_form)

def make(value):
    @closure_kernel(str(value))
    def add(x):
        stay_apart()
        return x + value
    return add

add_one, add_two = make(1), make(2)

@kernel
def one(x):
    return add_one(x)

@kernel
def two(x):
    return add_two(x)

for word in sys.argv[1:]:
    print(word, globals()[word](10.0))
"""


def test_a_kernel_from_the_cache_and_a_fresh_one_are_not_taken_for_each_other(tmp_path):
    """Both hold closures of one factory; the linker knows machine code by name only."""
    (tmp_path / "mixed.py").write_text(MIXED)
    environment = {key: v for key, v in os.environ.items() if key not in ("NUMBA_DISABLE_JIT", "NUMBA_CACHE_DIR")}
    environment["OHMLOOM_CACHE"] = str(tmp_path / "cache")

    def run(*words):
        command = [sys.executable, str(tmp_path / "mixed.py"), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.split()

    run("two")
    assert run("one", "two") == ["one", "11.0", "two", "12.0"]


@pytest.mark.parametrize("name", CARDS)
@settings(max_examples=40, deadline=None)
@given(s=st.floats(0.0, 1.0), events=st.floats(0.01, 3.0), positive=st.booleans(), volts=st.floats(0.05, 5.0))
def test_a_metered_pulse_moves_the_charge_it_metered(name, s, events, positive, volts):
    device, law, p, q_d = setup(name)
    sign = 1.0 if positive else -1.0
    charge = sign * events * EVENT * q_d
    s_new, duration, energy = kernels.metered_pulse(law, s, p, q_d, sign * volts, charge)
    exact = min(max(Fraction(s) + Fraction(charge) / Fraction(q_d), Fraction(0)), Fraction(1))
    assert abs(Fraction(s_new) - exact) <= STATE
    # T = phi/v: the flux is the integral of M over the transported charge.
    flux = q_d * resistance_integral(device, s, charge / q_d)
    assert duration == pytest.approx(flux / (sign * volts), rel=DURATION)
    assert energy == pytest.approx(volts * abs(charge), rel=1e-15)


@pytest.mark.parametrize("name", ["hp_tio2", "hp_tio2_paper"])
@pytest.mark.parametrize("s", [0.0, 0.5, 0.9, 0.9895, 0.9996])
def test_hp_durations_are_the_closed_form_of_the_flux(name, s):
    device, law, p, q_d = setup(name)
    r_on, r_off = (Fraction(device.parameters[key]) for key in ("r_on", "r_off"))
    start, end = Fraction(s), min(Fraction(s) + Fraction(EVENT), Fraction(1))
    mean = r_off - (r_off - r_on) * (start + end) / 2
    rest = Fraction(s) + Fraction(EVENT) - end
    flux = float(Fraction(q_d) * (mean * (end - start) + r_on * rest))
    assert kernels.metered_pulse(law, s, p, q_d, 0.5, EVENT * q_d)[1] == pytest.approx(flux / 0.5, rel=DURATION)


def test_pulse_widths_at_one_volt_follow_the_memristance():
    # R_u = 10 kOhm with beta = 100: one event is 99 nC and lasts 0.99 ms at s = 0, 0.108 ms at s = 0.9.
    device = Device.load("hp_tio2").replace(r_off=1e4)
    p, q_d = np.array(list(device.parameters.values())), device.charge_scale
    assert q_d == pytest.approx(99e-6, rel=1e-14)
    assert kernels.metered_pulse(0, 0.0, p, q_d, 1.0, 99e-9)[1] == pytest.approx(0.99e-3, rel=1e-3)
    assert kernels.metered_pulse(0, 0.5, p, q_d, 1.0, 99e-9)[1] == pytest.approx(0.50e-3, rel=2e-3)
    assert kernels.metered_pulse(0, 0.9, p, q_d, 1.0, 99e-9)[1] == pytest.approx(0.108e-3, rel=1e-2)


@pytest.mark.parametrize("name", CARDS)
@settings(max_examples=40, deadline=None)
@given(s=st.floats(0.0, 1.0), events=st.floats(0.01, 3.0), positive=st.booleans())
def test_a_current_pulse_moves_current_times_duration(name, s, events, positive):
    device, law, p, q_d = setup(name)
    duration = 1e-3
    current = (1.0 if positive else -1.0) * events * EVENT * q_d / duration
    s_new, energy, peak = kernels.current_pulse(law, s, p, q_d, current, duration)
    moved = Fraction(current) * Fraction(duration)
    exact = min(max(Fraction(s) + moved / Fraction(q_d), Fraction(0)), Fraction(1))
    assert abs(Fraction(s_new) - exact) <= STATE
    flux = q_d * resistance_integral(device, s, float(moved) / q_d)
    assert energy == pytest.approx(current * flux, rel=DURATION)
    assert peak == pytest.approx(abs(current) * max(device.memristance(s), device.memristance(s_new)), rel=1e-14)


@pytest.mark.parametrize("name", CARDS)
def test_a_pulse_across_the_whole_range_lands_on_the_wall(name):
    device, law, p, q_d = setup(name)
    s_new, duration, _ = kernels.metered_pulse(law, 0.2, p, q_d, 1.0, 1.5 * q_d)
    assert s_new == 1.0
    assert duration == pytest.approx(q_d * resistance_integral(device, 0.2, 1.5), rel=DURATION)
    assert kernels.metered_pulse(law, 0.2, p, q_d, -1.0, -1.5 * q_d)[0] == 0.0


@pytest.mark.parametrize("name", CARDS)
def test_no_wall_traps_a_pulse(name):
    _, law, p, q_d = setup(name)
    assert kernels.metered_pulse(law, 1.0, p, q_d, -1.0, -EVENT * q_d)[0] == pytest.approx(1 - EVENT, abs=STATE)
    assert kernels.current_pulse(law, 0.0, p, q_d, EVENT * q_d, 1.0)[0] == pytest.approx(EVENT, abs=STATE)


def test_pulses_of_nothing_do_nothing():
    _, law, p, q_d = setup("peo_pani")
    assert kernels.metered_pulse(law, 0.3, p, q_d, 1.0, 0.0) == (0.3, 0.0, 0.0)
    assert kernels.current_pulse(law, 0.3, p, q_d, 0.0, 1.0) == (0.3, 0.0, 0.0)
    assert kernels.current_pulse(law, 0.3, p, q_d, 1e-6, 0.0)[:2] == (0.3, 0.0)


def test_a_meter_that_would_never_stop_gives_nan():
    _, law, p, q_d = setup("peo_pani")
    assert np.isnan(kernels.metered_pulse(law, 0.3, p, q_d, 1.0, -1e-9)).all()
    assert np.isnan(kernels.metered_pulse(law, 0.3, p, q_d, 0.0, 1e-9)).all()
    assert math.isnan(kernels.metered_pulse(law, math.nan, p, q_d, 1.0, 1e-9)[0])


@pytest.mark.parametrize("name", LAWS)
def test_the_compiled_inverse_of_the_flux_gives_the_state_back_or_nan(name):
    law, index = LAWS[name], kernels.LAW_INDEX[name]
    p = tuple(parameter.default for parameter in law.parameters)
    for s in (0.0, 0.3, 0.9, 1.0):
        phi = law.flux(s, p) if law.is_ideal else 1.0
        found = kernels.state_at_flux(index, phi, p)
        if name in kernels.CLOSED_INVERSES:
            assert found == pytest.approx(s, abs=1e-12)  # rounding of a square root's argument
        else:
            assert math.isnan(found)
