"""Network to hardware: specs, placement, waveforms, dies, and the emulated controller."""

from ohmloom.mapping.die import Die
from ohmloom.mapping.emulated import EmulatedController
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.ledger import Ledger
from ohmloom.mapping.plan import Crosspoint, Plan, Tile, place
from ohmloom.mapping.quantity import Quantity
from ohmloom.mapping.waveform import WAVEFORMS, Waveform, event_table

__all__ = [
    "WAVEFORMS",
    "Crosspoint",
    "Die",
    "EmulatedController",
    "Hardware",
    "Ledger",
    "Plan",
    "Quantity",
    "Tile",
    "Waveform",
    "event_table",
    "place",
]
