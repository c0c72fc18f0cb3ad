"""HP's TiO2 memristor with linear drift: the memristance falls linearly with the charge.

Equation: ``M = R_off - R_off R_on beta q`` for ``0 <= q <= q_d`` (Howard et al. 2012, eq. 7) with ``q_d =
(R_off - R_on)/(R_off R_on beta)`` (eq. 8), so that with ``s = q/q_d`` it reads ``M = R_off - (R_off - R_on)
s`` and reaches R_on exactly at the wall. ``dq/dt = i``: positive current, into the first terminal, lowers M.

``beta = mu_v/D^2``, ion mobility over film thickness squared, is Strukov's constant: 1e-14 m2/(V s) and 10 nm
give 100 1/(V s). His charge scale ``D^2/(mu_v R_on)`` is larger than q_d by ``1/(1 - R_on/R_off)`` and is not
used here.

Range of validity: clip walls, low fields, no window and no threshold; measured TiO2 loops differ from it by
15-90 %.
"""

from __future__ import annotations

import numpy as np

from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import BETA, R_OFF, R_ON


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G = 1/(R_off - (R_off - R_on) s), in a form that is exact at both walls."""
    return 1.0 / (p[1] * (1.0 - s) + p[0] * s)


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """The state charge is the transported charge: dq/dt = i."""
    return i


def charge_scale(p: Parameters) -> Value:
    """q_d = (R_off - R_on)/(R_off R_on beta), eq. 8."""
    return (p[1] - p[0]) / (p[1] * p[0] * p[2])


def flux(s: Value, p: Parameters) -> Value:
    """phi = q_d (R_off s - (R_off - R_on) s^2/2), which is M^2 = M0^2 - 2 (R_off - R_on)/q_d phi."""
    return charge_scale(p) * s * (p[1] - 0.5 * (p[1] - p[0]) * s)


def state_at_flux(phi: Value, p: Parameters) -> Value:
    """s = (R_off - M)/(R_off - R_on) with M from the quadratic, written so that nothing cancels near s = 0."""
    scaled = phi / charge_scale(p)
    return 2.0 * scaled / (p[1] + np.sqrt(p[1] ** 2 - 2.0 * (p[1] - p[0]) * scaled))


LAW = Law(
    name="hp_linear",
    parameters=(R_ON, R_OFF, BETA),
    flux=flux,
    state_at_flux=state_at_flux,
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="HP TiO2, linear drift: M linear in the charge (Howard et al. 2012, eqs. 7 and 8)",
)
