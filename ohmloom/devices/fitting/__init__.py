"""Fitting of device laws to measured sweeps, with what is known of the result."""

from __future__ import annotations

from ohmloom.devices.fitting.compare import Comparison, compare
from ohmloom.devices.fitting.fit import fit
from ohmloom.devices.fitting.result import Fit

__all__ = ["Comparison", "Fit", "compare", "fit"]
