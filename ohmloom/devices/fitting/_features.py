"""What the sweeps say about the size of each parameter, before any fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ohmloom.devices.laws import Law, Parameter
from ohmloom.devices.measurement import Measurement


@dataclass(frozen=True, kw_only=True)
class Features:
    """Sizes read from the data, SI: chord conductances, half the charge and flux that pass, voltage, current, time."""

    g_low: float
    g_high: float
    charge: float
    voltage: float
    current: float
    duration: float

    @classmethod
    def of(cls, sweeps: Sequence[Measurement]) -> Features:
        """Read them from sweeps: extremes over all of them, charge and time as their geometric mean."""
        chords, charges, durations = [], [], []
        for sweep in sweeps:
            v = sweep.device_voltage
            # Near v = 0 the chord is noise over nothing.
            clear = np.abs(v) > 0.1 * np.abs(v).max()
            chords.append(np.abs(sweep.i[clear] / v[clear]))
            charges.append(0.5 * np.trapezoid(np.abs(sweep.i), sweep.t))
            durations.append(sweep.t[-1] - sweep.t[0])
        g_low, g_high = np.percentile(np.concatenate(chords), [5.0, 95.0])
        tiny = np.finfo(float).tiny
        return cls(
            g_low=max(float(g_low), 1e-6 * float(g_high), tiny),
            g_high=max(float(g_high), tiny),
            charge=float(np.exp(np.mean(np.log(np.maximum(charges, tiny))))),
            voltage=max(float(np.abs(sweep.device_voltage).max()) for sweep in sweeps),
            current=max(float(np.abs(sweep.i).max()) for sweep in sweeps),
            duration=float(np.exp(np.mean(np.log(durations)))),
        )

    def suggest(self, parameter: Parameter, law: Law) -> float:
        """A value for a parameter by its unit; the law's default for what has no size in the data."""
        if parameter.name in ("r_on", "r_off"):
            return 1.0 / (self.g_high if parameter.name == "r_on" else self.g_low)
        by_unit = {
            "C": self.charge,
            "V": 0.5 * self.voltage if parameter.lower < 0.0 else 0.25 * self.voltage,
            "1/V": 2.0 / self.voltage,
            "1/s": 5.0 / self.duration,
            # Where beta sets the charge scale, q_d = (r_off - r_on)/(r_off r_on beta).
            "1/(V s)": (self.g_high - self.g_low) / self.charge,
            "A": self.current,
        }
        return by_unit.get(parameter.unit, parameter.default)
