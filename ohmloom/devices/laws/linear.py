"""The paper's linear resistor: a programmable conductance that moves in equal steps.

Equation: ``G = 1/R_off + (1/R_on - 1/R_off) s``, ``dq/dt = i`` (Howard et al. 2012, the "linear resistor" of
section V). Positive current, into the first terminal, raises G.

Range of validity: theoretical; a resistor with a non-volatile memory beside it, within clip walls.
"""

from __future__ import annotations

import numpy as np

from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import Q_D, R_OFF, R_ON


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G = 1/R_off + (1/R_on - 1/R_off) s, in a form that is exact at both walls."""
    return (1.0 - s) / p[1] + s / p[0]


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """The state charge is the transported charge: dq/dt = i."""
    return i


def charge_scale(p: Parameters) -> Value:
    """q_d is a parameter of its own."""
    return p[2]


def flux(s: Value, p: Parameters) -> Value:
    """phi = q_d/(G_on - G_off) ln(1 + (G_on/G_off - 1) s)."""
    return p[2] * p[0] * p[1] / (p[1] - p[0]) * np.log1p((p[1] / p[0] - 1.0) * s)


def state_at_flux(phi: Value, p: Parameters) -> Value:
    """The inverse: s grows exponentially with the flux."""
    return np.expm1(phi * (p[1] - p[0]) / (p[2] * p[0] * p[1])) / (p[1] / p[0] - 1.0)


LAW = Law(
    name="linear",
    parameters=(R_ON, R_OFF, Q_D),
    flux=flux,
    state_at_flux=state_at_flux,
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="conductance linear in the charge (the paper's linear resistor)",
)
