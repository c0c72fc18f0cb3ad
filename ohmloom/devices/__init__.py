"""One memristor: laws, device cards, simulation.

A law (`LAWS`) is a pair of small functions; a card gives it parameters with their sources; a `Device` is a
card that can be asked and driven. Current counts positive into the first terminal; all quantities are SI.
"""

from __future__ import annotations

from ohmloom.devices.card import CardValue
from ohmloom.devices.device import Device
from ohmloom.devices.laws import LAWS, Law, Parameter
from ohmloom.devices.trace import Trace

__all__ = ["LAWS", "CardValue", "Device", "Law", "Parameter", "Trace"]
