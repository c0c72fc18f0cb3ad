"""Parameters that several laws have."""

from __future__ import annotations

from ohmloom.devices.laws._law import Parameter

R_ON = Parameter(
    name="r_on", unit="Ohm", default=100.0, lower=1e-3, upper=1e12, scale="log", doc="memristance at s = 1"
)
R_OFF = Parameter(
    name="r_off", unit="Ohm", default=16e3, lower=1e-3, upper=1e12, scale="log", doc="memristance at s = 0"
)
Q_D = Parameter(
    name="q_d",
    unit="C",
    default=1e-4,
    lower=1e-18,
    upper=1e6,
    scale="log",
    doc="charge that takes s from 0 to 1",
)
