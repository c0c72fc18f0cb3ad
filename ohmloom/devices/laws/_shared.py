"""Parameters that several laws have, and the threshold that two of them share."""

from __future__ import annotations

from ohmloom.devices.laws._functions import larger, logistic
from ohmloom.devices.laws._law import Parameter, Value

R_ON = Parameter(
    name="r_on", unit="Ohm", default=100.0, lower=1e-3, upper=1e12, scale="log", doc="memristance at s = 1"
)
R_OFF = Parameter(
    name="r_off", unit="Ohm", default=16e3, lower=1e-3, upper=1e12, scale="log", doc="memristance at s = 0"
)
Q_D = Parameter(
    name="q_d",
    unit="C",
    default=1e-4,
    lower=1e-18,
    upper=1e6,
    scale="log",
    doc="charge that takes s from 0 to 1",
)
BETA = Parameter(
    name="beta",
    unit="1/(V s)",
    default=100.0,
    lower=1e-9,
    upper=1e15,
    scale="log",
    doc="mu_v/D^2: ion mobility over film thickness squared",
)
EXPONENT = Parameter(
    name="exponent", unit="1", default=1.0, lower=0.1, upper=100.0, scale="log", doc="the window's exponent p"
)
V_SET = Parameter(
    name="v_set", unit="V", default=0.2, lower=1e-4, upper=100.0, scale="linear", doc="voltage above which s rises"
)
V_RESET = Parameter(
    name="v_reset",
    unit="V",
    default=0.1,
    lower=1e-4,
    upper=100.0,
    scale="linear",
    doc="size of the negative voltage below which s falls",
)
Q_SET = Parameter(
    name="q_set",
    unit="C",
    default=1e-6,
    lower=1e-18,
    upper=1e6,
    scale="log",
    doc="charge above the threshold that takes s from 0 to 1; the charge scale q_d",
)
Q_RESET = Parameter(
    name="q_reset",
    unit="C",
    default=1e-6,
    lower=1e-18,
    upper=1e6,
    scale="log",
    doc="charge below the negative threshold that takes s from 1 to 0",
)
# Published states that are widths have no charge of their own.
NOMINAL_CHARGE = 1.0  # C
SMALLEST_BASE = 1e-12
# Voltage over which a threshold opens: a hard step would hide v_set and v_reset from a fit's derivatives.
OPENING = 0.02  # V


def thresholded(v: Value, i: Value, v_set: Value, v_reset: Value, q_set: Value, q_reset: Value) -> Value:
    """dq/dt = i theta(v - v_set) for v > 0, (q_set/q_reset) i theta(-v - v_reset) for v < 0, theta a logistic step."""
    rising = (v > 0.0) * i * logistic((v - v_set) / OPENING)
    falling = (v < 0.0) * i * logistic((-v - v_reset) / OPENING)
    return rising + falling * q_set / q_reset


def even_power(x: Value, exponent: Value) -> Value:
    """x^(2 p) for any real p; the base is kept off 0, where the derivative in p would be 0 times log 0."""
    return larger(abs(x), SMALLEST_BASE) ** (2.0 * exponent)
