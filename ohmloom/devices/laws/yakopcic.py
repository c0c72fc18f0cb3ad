"""Yakopcic's model: sinh conduction, exponential rates beyond a threshold, and motion that fades near the ends.

Equation (C. Yakopcic, T. M. Taha, G. Subramanyam, R. E. Pino, S. Rogers, IEEE Electron Device Lett. 32 (2011) 1436):
``i = a1 x sinh(b v)`` for v >= 0, ``a2 x sinh(b v)`` for v < 0; ``dx/dt = g(v) f(x)`` with ``g = Ap (e^v - e^Vp)``
for v > Vp, ``-An (e^-v - e^Vn)`` for v < -Vn, else 0; rising, ``f = e^(-alpha_p (x - x_p)) ((x_p - x)/(1 - x_p) +
1)`` for x > x_p, falling, ``f = e^(alpha_n (x + x_n - 1)) x/(1 - x_n)`` for x < 1 - x_n, else 1. Here ``x = x_min +
(1 - x_min) s``: at x = 0 the published device is an open circuit. Positive current, into the first terminal, raises
G.

Range of validity: a reference generator. The defaults are those published for the device of Miao et al. (2011), as in
the presets of the public repository thomast8/Memristor-Models. q_d = 1 C, nominal.
"""

from __future__ import annotations

from typing import Literal

from ohmloom.devices.laws._functions import bounded_exp, larger, sinhc
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import NOMINAL_CHARGE


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G = a x b sinh(b v)/(b v), with a1 or a2 by the sign of v."""
    x = p[11] + (1.0 - p[11]) * s
    amplitude = (v >= 0.0) * p[0] + (v < 0.0) * p[1]
    return amplitude * x * p[2] * sinhc(p[2] * v)


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """g(v) f(x), in units of the nominal charge."""
    x = p[11] + (1.0 - p[11]) * s
    over, under = larger(x - p[9], 0.0), larger(1.0 - p[10] - x, 0.0)
    up = bounded_exp(-p[7] * over) * (1.0 - over / (1.0 - p[9]))
    down = bounded_exp(-p[8] * under) * (1.0 - under / (1.0 - p[10]))
    rising = (v > p[5]) * p[3] * (bounded_exp(v) - bounded_exp(p[5])) * up
    falling = (v < -p[6]) * p[4] * (bounded_exp(-v) - bounded_exp(p[6])) * down
    return (rising - falling) / (1.0 - p[11]) * NOMINAL_CHARGE


def charge_scale(p: Parameters) -> Value:
    """q_d = 1 C, nominal."""
    return NOMINAL_CHARGE


def _make(
    name: str, unit: str, default: float, lower: float, upper: float, scale: Literal["log", "linear"], doc: str
) -> Parameter:
    return Parameter(name=name, unit=unit, default=default, lower=lower, upper=upper, scale=scale, doc=doc)


LAW = Law(
    name="yakopcic",
    parameters=(
        _make("a1", "A", 0.11, 1e-15, 1e3, "log", "amplitude of the current for v >= 0"),
        _make("a2", "A", 0.11, 1e-15, 1e3, "log", "amplitude of the current for v < 0"),
        _make("b", "1/V", 0.5, 1e-3, 100.0, "log", "field enhancement: the current grows as sinh(b v)"),
        _make("rate_p", "1/s", 7.5, 1e-9, 1e12, "log", "Ap: rate beyond v_p"),
        _make("rate_n", "1/s", 2.0, 1e-9, 1e12, "log", "An: rate beyond v_n"),
        _make("v_p", "V", 0.09, 1e-4, 100.0, "log", "Vp: voltage above which x rises"),
        _make("v_n", "V", 0.75, 1e-4, 100.0, "log", "Vn: size of the negative voltage below which x falls"),
        _make("alpha_p", "1", 1.0, 1e-3, 100.0, "log", "how fast rising motion fades beyond x_p"),
        _make("alpha_n", "1", 5.0, 1e-3, 100.0, "log", "how fast falling motion fades beyond 1 - x_n"),
        _make("x_p", "1", 0.3, 0.0, 0.99, "linear", "state beyond which rising motion fades"),
        _make("x_n", "1", 0.5, 0.0, 0.99, "linear", "1 - x_n: state under which falling motion fades"),
        _make("x_min", "1", 0.01, 1e-6, 0.5, "log", "lowest value of the published state x"),
    ),
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="Yakopcic: sinh conduction, exponential rates beyond thresholds (reference generator)",
)
