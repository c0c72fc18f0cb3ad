"""A TiO2-like device as measured: field-enhanced conduction, and a state that moves only beyond a threshold.

Equation: ``G = (1/R_off + (1/R_on - 1/R_off) s) sinh(b v)/(b v)``; ``dq/dt = i theta(v - v_set)`` for v > 0 and
``(q_set /q_reset) i theta(-v - v_reset)`` for v < 0, theta a logistic step that opens over 20 mV. Positive current,
into the first terminal, raises G. The threshold is that of Y. V. Pershin, M. Di Ventra (Phys. Rev. E 79 (2009)
021912) on the current instead of the voltage; the sine is that of C. Yakopcic et al. (IEEE Electron Device Lett. 32
(2011) 1436).

Range of validity: measured and simulated TiO2-like loops at one frequency; a threshold stands for an activated process,
so it moves with the time that a sweep takes.
"""

from __future__ import annotations

from ohmloom.devices.laws import linear
from ohmloom.devices.laws._functions import sinhc
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import Q_RESET, Q_SET, R_OFF, R_ON, V_RESET, V_SET, thresholded


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G linear in s, times sinh(b v)/(b v)."""
    return linear.conductance(s, v, p) * sinhc(p[2] * v)


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """Current beyond the threshold."""
    return thresholded(v, i, p[3], p[4], p[5], p[6])


def charge_scale(p: Parameters) -> Value:
    """q_d = q_set."""
    return p[5]


LAW = Law(
    name="tio2_threshold",
    parameters=(
        R_ON,
        R_OFF,
        Parameter(
            name="b",
            unit="1/V",
            default=2.0,
            lower=1e-3,
            upper=100.0,
            scale="log",
            doc="field enhancement: the current grows as sinh(b v)",
        ),
        V_SET,
        V_RESET,
        Q_SET,
        Q_RESET,
    ),
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="TiO2-like: G linear in s times sinh(b v)/(b v), charge counted beyond two thresholds",
)
