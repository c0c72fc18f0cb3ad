"""Pulses on a law whose state relaxes much faster than the pulse lasts, against SciPy's implicit method."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ohmloom.devices import LAWS, Device
from ohmloom.devices import _kernels as kernels

# At -1 V the card reduces a hundred thousand times a second, and a pulse lasts 0.2 s.
REDOX = Device.load("peo_pani_redox")


def by_scipy(s, volts, charge):
    """(s, duration) with the charge as the independent variable."""
    law, p, q_d = LAWS[REDOX.law], tuple(REDOX.parameters.values()), REDOX.charge_scale

    def slopes(_, y):
        held = min(max(y[0], 0.0), 1.0)
        i = law.conductance(held, volts, p) * volts
        return [law.charge_rate(held, volts, i, p) / q_d / abs(i), 1.0 / abs(i)]

    done = solve_ivp(slopes, (0.0, abs(charge)), [s, 0.0], "Radau", rtol=1e-10, atol=[1e-14, 1e-14])
    return done.y[:, -1]


@pytest.mark.parametrize("volts", [1.0, 0.5, -0.2, -1.0])
@pytest.mark.parametrize("s", [0.0, 1e-3, 0.3, 0.9, 1.0])
def test_a_metered_pulse_relaxes_to_where_an_implicit_method_does(s, volts):
    charge = np.copysign(REDOX.charge_scale / 1000, volts)
    index, p = kernels.LAW_INDEX[REDOX.law], np.array(list(REDOX.parameters.values()))
    s_new, duration, energy = kernels.metered_pulse(index, s, p, REDOX.charge_scale, volts, charge)
    wanted = by_scipy(s, volts, charge)
    # A hundredth of an event's millionth: both methods are good to about 1e-10 of s.
    assert s_new == pytest.approx(wanted[0], abs=1e-9)
    assert duration == pytest.approx(wanted[1], rel=1e-7)
    assert energy == pytest.approx(volts * charge, rel=1e-12)
