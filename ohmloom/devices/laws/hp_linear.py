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

from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import R_OFF, R_ON


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """G = 1/(R_off - (R_off - R_on) s), in a form that is exact at both walls."""
    return 1.0 / (p[1] * (1.0 - s) + p[0] * s)


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """The state charge is the transported charge: dq/dt = i."""
    return i


def charge_scale(p: Parameters) -> Value:
    """q_d = (R_off - R_on)/(R_off R_on beta), eq. 8."""
    return (p[1] - p[0]) / (p[1] * p[0] * p[2])


LAW = Law(
    name="hp_linear",
    parameters=(
        R_ON,
        R_OFF,
        Parameter(
            name="beta",
            unit="1/(V s)",
            default=100.0,
            lower=1e-9,
            upper=1e15,
            scale="log",
            doc="mu_v/D^2: ion mobility over film thickness squared",
        ),
    ),
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="HP TiO2, linear drift: M linear in the charge (Howard et al. 2012, eqs. 7 and 8)",
)
