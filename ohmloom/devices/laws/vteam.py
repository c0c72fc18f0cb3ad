"""VTEAM: a threshold on the voltage, and a power of the excess beyond it.

Equation (S. Kvatinsky et al., IEEE Trans. Circuits Syst. II 62 (2015) 786, eqs. 2 and 4): ``ds/dt = k_set (v/v_set -
1)^ a_set`` for v > v_set, ``-k_reset (-v/v_reset - 1)^a_reset`` for v < -v_reset, else 0; ``M = R_off - (R_off -
R_on) s``. Published, a positive voltage switches off and w is a width; here the terminals are exchanged, ``s =
(w_off - w)/(w_off - w_on)``, and rates are per second: ``k_set = -k_on/(w_off - w_on)``, ``v_set = -v_on``,
``k_reset = k_off/(w_off - w_on)``. Positive current, into the first terminal, lowers M.

Range of validity: a reference generator, with the defaults of MemTorch (C. Lammie et al., Neurocomputing 485 (2022)
124): w_off - w_on = 3 nm, k_on = -10 m/s, k_off = 5e-4 m/s. A width has no charge: q_d = 1 C, nominal.
"""

from __future__ import annotations

from ohmloom.devices.laws import hp_linear
from ohmloom.devices.laws._functions import larger
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import NOMINAL_CHARGE, R_OFF, R_ON, V_RESET, V_SET

# Under it the excess counts as this much, where a power's derivative in its exponent would be 0 times log 0.
SMALLEST_EXCESS = 1e-12


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """A power of the excess over either threshold."""
    above, below = v / p[2] - 1.0, -v / p[3] - 1.0
    rising = (above > 0.0) * p[4] * larger(above, SMALLEST_EXCESS) ** p[6]
    falling = (below > 0.0) * p[5] * larger(below, SMALLEST_EXCESS) ** p[7]
    return (rising - falling) * NOMINAL_CHARGE


def charge_scale(p: Parameters) -> Value:
    """q_d = 1 C, nominal."""
    return NOMINAL_CHARGE


def _rate(name: str, default: float, doc: str) -> Parameter:
    return Parameter(name=name, unit="1/s", default=default, lower=1e-9, upper=1e15, scale="log", doc=doc)


def _power(name: str, default: float, doc: str) -> Parameter:
    return Parameter(name=name, unit="1", default=default, lower=0.1, upper=20.0, scale="log", doc=doc)


LAW = Law(
    name="vteam",
    parameters=(
        R_ON,
        R_OFF,
        V_SET,
        V_RESET,
        _rate("k_set", 10.0 / 3e-9, "rate of setting at twice v_set"),
        _rate("k_reset", 5e-4 / 3e-9, "rate of resetting at twice v_reset"),
        _power("a_set", 3.0, "power of the excess over v_set"),
        _power("a_reset", 1.0, "power of the excess over v_reset"),
    ),
    conductance=hp_linear.conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="VTEAM: rates that are a power of the voltage beyond a threshold (reference generator)",
)
