"""HP's TiO2 memristor with Prodromakis' window: as Joglekar's, with a height of its own.

Equation: M as in `hp_linear`; ``dq/dt = i j (1 - ((s - 1/2)^2 + 3/4)^p)`` (T. Prodromakis et al., IEEE Trans. Electron
Devices 58 (2011) 3099; as eq. 8 of S. Kvatinsky et al., TEAM, IEEE Trans. Circuits Syst. I 60 (2013) 211). Positive
current, into the first terminal, lowers M.

Range of validity: away from the walls, where the window is zero: this law traps.
"""

from __future__ import annotations

from ohmloom.devices.laws import hp_linear
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import BETA, EXPONENT, R_OFF, R_ON


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """dq/dt = i j (1 - ((s - 1/2)^2 + 3/4)^p); with s (1 - s) so that it is exactly zero at both walls."""
    return i * p[4] * (1.0 - (1.0 - s * (1.0 - s)) ** p[3])


LAW = Law(
    name="hp_prodromakis",
    parameters=(
        R_ON,
        R_OFF,
        BETA,
        EXPONENT,
        Parameter(
            name="height", unit="1", default=1.0, lower=1e-3, upper=1e3, scale="log", doc="the window's factor j"
        ),
    ),
    conductance=hp_linear.conductance,
    charge_rate=charge_rate,
    charge_scale=hp_linear.charge_scale,
    doc="HP TiO2 with Prodromakis' window, which traps the state at the walls",
)
