"""A device that saturates early: the mirror law's conductance, moved only beyond a threshold.

Equation: G as in `peo_pani_mirror`; ``dq/dt`` as in `tio2_threshold`. Positive current, into the first terminal, raises
G.

Range of validity: measured loops at one frequency; a threshold stands for an activated process, so it moves with the
time that a sweep takes.
"""

from __future__ import annotations

from ohmloom.devices.laws import peo_pani_mirror
from ohmloom.devices.laws._law import Law, Parameters, Value
from ohmloom.devices.laws._shared import Q_RESET, Q_SET, R_OFF, R_ON, V_RESET, V_SET, thresholded


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """Current beyond the threshold."""
    return thresholded(v, i, p[2], p[3], p[4], p[5])


def charge_scale(p: Parameters) -> Value:
    """q_d = q_set."""
    return p[4]


LAW = Law(
    name="mirror_threshold",
    parameters=(R_ON, R_OFF, V_SET, V_RESET, Q_SET, Q_RESET),
    conductance=peo_pani_mirror.conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="mirror image of the HP law, charge counted beyond two thresholds",
)
