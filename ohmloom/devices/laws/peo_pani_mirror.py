"""The paper's PEO-PANI memristor: the mirror image of the HP law, steep where that one is flat.

Equation: ``G = 1/R_on + 1/R_off - 1/(R_on + R_off - M)`` with ``M = R_off - (R_off - R_on) s``: Howard et al.
2012, eq. 9, read so that G runs from 1/R_off to 1/R_on. It follows that ``G(s) = 1/R_on + 1/R_off - G_HP(1 -
s)``. ``dq/dt = i``: positive current, into the first terminal, raises G.

Range of validity: the paper's networks, clip walls. Measured PANI follows this conductance, but its state is
moved by the Faradaic part of the current alone, so loops of real devices are not reproduced.
"""

from __future__ import annotations

import numpy as np

from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import Q_D, R_OFF, R_ON


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G = 1/R_on + 1/R_off - 1/(R_on + R_off - M), the outer two joined: nothing cancels near s = 0."""
    return 1.0 / p[1] + (p[1] - p[0]) * s / (p[0] * (p[0] + (p[1] - p[0]) * s))


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """The state charge is the transported charge: dq/dt = i."""
    return i


def charge_scale(p: Parameters) -> Value:
    """q_d is a parameter of its own."""
    return p[2]


def flux(s: Value, p: Parameters) -> Value:
    """The integral of q_d/G: with y = (1/R_on + 1/R_off)(R_on + (R_off - R_on) s) - 1, from y0 = R_on/R_off at s = 0,

    phi = q_d/(R_off - R_on) (y - y0 + ln(y/y0)) / (1/R_on + 1/R_off)^2.
    """
    total = 1.0 / p[0] + 1.0 / p[1]
    growth = total * (p[1] - p[0]) * s
    return p[2] / (p[1] - p[0]) / total**2 * (growth + np.log1p(growth * p[1] / p[0]))


def state_at_flux(phi: Value, p: Parameters) -> Value:
    """The inversion: y + ln y = K is solved by Wright's omega function of K."""
    from scipy.special import wrightomega

    total, start = 1.0 / p[0] + 1.0 / p[1], p[0] / p[1]
    y = wrightomega(phi * total**2 * (p[1] - p[0]) / p[2] + start + np.log(start))
    return (y - start) / (total * (p[1] - p[0]))


LAW = Law(
    name="peo_pani_mirror",
    parameters=(R_ON, R_OFF, Q_D),
    flux=flux,
    state_at_flux=state_at_flux,
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="PEO-PANI of the paper: mirror image of the HP law (Howard et al. 2012, eq. 9)",
)
