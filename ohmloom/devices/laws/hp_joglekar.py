"""HP's TiO2 memristor with Joglekar's window: the drift slows towards both walls.

Equation: M as in `hp_linear`; ``dq/dt = i (1 - (2 s - 1)^(2 p))`` (Y. N. Joglekar, S. J. Wolf, Eur. J. Phys. 30
(2009) 661; as eq. 5 of S. Kvatinsky et al., TEAM, IEEE Trans. Circuits Syst. I 60 (2013) 211). Positive current, into
the first terminal, lowers M.

Range of validity: away from the walls. The window is zero on them, so a state that reaches a wall stays there for
good: this law traps.
"""

from __future__ import annotations

from ohmloom.devices.laws import hp_linear
from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import BETA, EXPONENT, R_OFF, R_ON, even_power


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """dq/dt = i (1 - (2 s - 1)^(2 p))."""
    return i * (1.0 - even_power(2.0 * s - 1.0, p[3]))


LAW = Law(
    name="hp_joglekar",
    parameters=(R_ON, R_OFF, BETA, EXPONENT),
    conductance=hp_linear.conductance,
    charge_rate=charge_rate,
    charge_scale=hp_linear.charge_scale,
    doc="HP TiO2 with Joglekar's window, which traps the state at the walls",
)
