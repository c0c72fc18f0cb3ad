"""HP's TiO2 memristor with Biolek's window: the drift slows towards the wall that it approaches, and only there.

Equation: M as in `hp_linear`; ``dq/dt = i (1 - (s - H(-i))^(2 p))``, H the unit step (Z. Biolek, D. Biolek, V.
Biolkova, Radioengineering 18 (2009) 210; as eq. 6 of S. Kvatinsky et al., TEAM, IEEE Trans. Circuits Syst. I 60
(2013) 211). Positive current, into the first terminal, lowers M.

Range of validity: low fields; a state at a wall leaves it at once when the current turns.
"""

from __future__ import annotations

from ohmloom.devices.laws import hp_linear
from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import BETA, EXPONENT, R_OFF, R_ON, even_power


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """dq/dt = i (1 - (s - H(-i))^(2 p))."""
    return i * (1.0 - even_power(s - (i < 0.0) * 1.0, p[3]))


LAW = Law(
    name="hp_biolek",
    parameters=(R_ON, R_OFF, BETA, EXPONENT),
    conductance=hp_linear.conductance,
    charge_rate=charge_rate,
    charge_scale=hp_linear.charge_scale,
    doc="HP TiO2 with Biolek's window, which lets the state leave a wall",
)
