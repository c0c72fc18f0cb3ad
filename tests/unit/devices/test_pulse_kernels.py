"""Pulses on laws that the table does not have yet: rates and conductances that vary with state and voltage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ohmloom._jit import inner_kernel
from ohmloom.devices import _pulse_kernels as pulse
from ohmloom.devices._pulse_kernels import build_port_voltage, build_pulses


# A law that the table does not have: conduction steepens with the voltage, the rate varies with the state.
@inner_kernel
def sinh_conductance(law_index, s, v, p):
    low_field = 1e-6 + 1e-4 * s
    return low_field if v == 0.0 else low_field * math.sinh(p[0] * v) / (p[0] * v)


@inner_kernel
def windowed_rate(law_index, s, v, i, p):
    return i * (1.0 - s**4) if i > 0.0 else i * (1.0 - (1.0 - s) ** 4)


@inner_kernel
def growing_rate(law_index, s, v, i, p):
    return i * (1.0 + 20.0 * s * s)


def plain_reference(rate, s0, charge, volts, p, q_d):
    """SciPy on the same equations, charge as the independent variable: (s, duration)."""

    def slopes(_, y):
        i = sinh_conductance(0, y[0], volts, p) * volts
        return [rate(0, y[0], volts, i, p) / abs(i) / q_d, 1.0 / abs(i)]

    wall = [lambda _, y: y[0] - 1.0, lambda _, y: y[0]]
    for event in wall:
        event.terminal = True
    done = solve_ivp(slopes, (0.0, charge), [s0, 0.0], "DOP853", rtol=1e-12, atol=1e-14, events=wall)
    s, duration = done.y[:, -1]
    if done.status == 1:
        s = round(s)
        duration += (charge - done.t[-1]) / abs(sinh_conductance(0, s, volts, p) * volts)
    return s, duration


@pytest.mark.parametrize("rate", [windowed_rate, growing_rate])
@pytest.mark.parametrize("volts", [1.0, -1.0])
@pytest.mark.parametrize("size", [1e-3, 0.1, 2.0])
def test_pulses_follow_a_law_whose_rate_and_conductance_vary(rate, volts, size):
    p, q_d = np.array([3.0]), 1e-6
    metered, _, _ = build_pulses(sinh_conductance, rate, rate.__name__)
    s_new, duration, _ = metered(0, 0.4, p, q_d, volts, math.copysign(size * q_d, volts))
    s_wanted, duration_wanted = plain_reference(rate, 0.4, size * q_d, volts, p, q_d)
    assert s_new == pytest.approx(s_wanted, abs=1e-10)
    assert duration == pytest.approx(duration_wanted, rel=1e-8)
    if rate is growing_rate and size == 2.0:
        assert s_new == (1.0 if volts > 0 else pytest.approx(s_wanted))


@pytest.mark.parametrize("size", [0.1, 2.0])
def test_current_pulses_follow_such_a_law_too(size):
    p, q_d, current = np.array([3.0]), 1e-6, 1e-4
    _, pulse, _ = build_pulses(sinh_conductance, windowed_rate, "sinh")
    s_new, energy, peak = pulse(0, 0.4, p, q_d, current, size * q_d / current)

    def volts(s):
        return math.asinh(current * 3.0 / (1e-6 + 1e-4 * s)) / 3.0

    def slopes(_, y):
        return [current * (1 - y[0] ** 4) / q_d, volts(y[0]) * current]

    done = solve_ivp(slopes, (0.0, size * q_d / current), [0.4, 0.0], "DOP853", rtol=1e-12, atol=1e-16)
    assert s_new == pytest.approx(done.y[0, -1], abs=1e-10)
    assert energy == pytest.approx(done.y[1, -1], rel=1e-8)
    assert peak == pytest.approx(volts(0.4), rel=1e-14)


@pytest.mark.parametrize("current", [1e-9, 1e-5, 1e-2, -1e-2])
def test_port_voltage_solves_for_a_steep_conduction(current):
    port_voltage = build_port_voltage(sinh_conductance, "sinh")
    wanted = math.asinh(current * 3.0 / (1e-6 + 1e-4 * 0.5)) / 3.0
    assert port_voltage(0, 0.5, np.array([3.0]), current) == pytest.approx(wanted, rel=1e-13)


def test_the_order_of_the_collocation_is_six():
    """The weights integrate powers up to 5 exactly, the stages up to 2."""
    nodes = [0.5 - math.sqrt(15) / 10, 0.5, 0.5 + math.sqrt(15) / 10]
    weights = [pulse.B1, pulse.B2, pulse.B3]
    stages = [
        [pulse.A11, pulse.A12, pulse.A13],
        [pulse.A21, pulse.A22, pulse.A23],
        [pulse.A31, pulse.A32, pulse.A33],
    ]
    for power in range(6):
        assert sum(w * c**power for w, c in zip(weights, nodes, strict=True)) == pytest.approx(
            1 / (power + 1), rel=1e-14
        )
    for row, node in zip(stages, nodes, strict=True):
        for power in range(3):
            total = sum(a * c**power for a, c in zip(row, nodes, strict=True))
            assert total == pytest.approx(node ** (power + 1) / (power + 1), rel=1e-13)
