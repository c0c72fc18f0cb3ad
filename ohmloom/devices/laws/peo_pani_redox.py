"""Polyaniline as measured: the state is moved by a redox reaction, not by the total current.

Equation: ``ds/dt = k0 (e^((v - e0)/(2 slope)) (1 - s) - e^(-(v - e0)/(2 slope asymmetry)) s)``, oxidation and
reduction of Butler and Volmer (A. J. Bard, L. R. Faulkner, Electrochemical Methods, ch. 3), so that the Faradaic
current is ``dq/dt = q_d ds/dt``; ``G = (1 - mirror) G_linear(s) + mirror G_mirror(s)``, the laws `linear` and
`peo_pani_mirror`. Positive current, into the first terminal, oxidises the polyaniline once v > e0, and raises G. The
port current is ``G v`` alone: the Faradaic part is small beside it.

With ``asymmetry = 1`` the state tends to ``1/(1 + e^(-(v - e0)/slope))`` at the rate ``2 k0 cosh((v - e0)/(2
slope))``. At v = 0 it relaxes too: this memristance is volatile.

Range of validity: loops and staircases of single polyaniline devices, to 4-7 %; repeated pulses need a second, slow
state. q_d moves nothing that can be seen at the port, and its default is the estimate of the card `peo_pani`.
"""

from __future__ import annotations

from ohmloom.devices.laws import linear, peo_pani_mirror
from ohmloom.devices.laws._functions import bounded_exp
from ohmloom.devices.laws._law import Law, Parameter, Parameters, Value
from ohmloom.devices.laws._shared import R_OFF, R_ON


def conductance(s: Value, v: Value, p: Parameters) -> Value:
    """The linear law's G, the mirror law's, or a weighted mean of both."""
    return (1.0 - p[6]) * linear.conductance(s, v, p) + p[6] * peo_pani_mirror.conductance(s, v, p)


def charge_rate(s: Value, v: Value, i: Value, p: Parameters) -> Value:
    """Faradaic current: q_d times the difference of oxidation and reduction."""
    half = 0.5 * (v - p[2]) / p[3]
    return p[5] * p[4] * (bounded_exp(half) * (1.0 - s) - bounded_exp(-half / p[7]) * s)


def charge_scale(p: Parameters) -> Value:
    """q_d is a parameter of its own."""
    return p[5]


LAW = Law(
    name="peo_pani_redox",
    parameters=(
        R_ON,
        R_OFF,
        Parameter(
            name="e0",
            unit="V",
            default=0.5,
            lower=-10.0,
            upper=10.0,
            scale="linear",
            doc="voltage at which oxidation and reduction balance at s = 1/2",
        ),
        Parameter(
            name="slope",
            unit="V",
            default=0.05,
            lower=1e-3,
            upper=10.0,
            scale="log",
            doc="voltage over which the balance tips, 25.7 mV for one electron at 298 K",
        ),
        Parameter(
            name="k0", unit="1/s", default=0.01, lower=1e-9, upper=1e9, scale="log", doc="rate of either reaction at e0"
        ),
        Parameter(
            name="q_d",
            unit="C",
            default=3.4e-4,
            lower=1e-18,
            upper=1e6,
            scale="log",
            doc="Faradaic charge that takes s from 0 to 1",
            fitted=False,
        ),
        Parameter(
            name="mirror",
            unit="1",
            default=0.0,
            lower=0.0,
            upper=1.0,
            scale="linear",
            doc="share of the mirror law in G: 0 for linear, 1 for mirror",
            fitted=False,
        ),
        Parameter(
            name="asymmetry",
            unit="1",
            default=1.0,
            lower=0.05,
            upper=20.0,
            scale="log",
            doc="slope of the reduction over that of the oxidation",
            fitted=False,
        ),
    ),
    conductance=conductance,
    charge_rate=charge_rate,
    charge_scale=charge_scale,
    doc="measured PEO-PANI: G linear or mirror in s, s moved by oxidation and reduction",
)
