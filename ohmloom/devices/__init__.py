"""One memristor: laws, device cards, simulation, measurements, fitting.

A law (`LAWS`) is a pair of small functions; a card gives it parameters with their sources; a `Device` is a card that
can be asked and driven; `fit` makes one from a `Measurement`. Current counts positive into the first terminal; all
quantities are SI.
"""

from __future__ import annotations

from ohmloom.devices.card import CardValue, DataFile
from ohmloom.devices.device import Device
from ohmloom.devices.fitting import Comparison, Fit, compare, fit
from ohmloom.devices.laws import LAWS, Law, Parameter
from ohmloom.devices.measurement import Measurement
from ohmloom.devices.revisit import Revisit, charge_revisit
from ohmloom.devices.trace import Trace

__all__ = [
    "LAWS",
    "CardValue",
    "Comparison",
    "DataFile",
    "Device",
    "Fit",
    "Law",
    "Measurement",
    "Parameter",
    "Revisit",
    "Trace",
    "charge_revisit",
    "compare",
    "fit",
]
