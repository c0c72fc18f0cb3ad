"""Network to hardware: specs, placement, waveforms, dies, and the emulated controller."""

from ohmloom.mapping.cost import Cost, CostLine, plan_cost
from ohmloom.mapping.die import Die
from ohmloom.mapping.emulated import EmulatedController
from ohmloom.mapping.grid import Grid, tile_crossbar, tile_deck, tile_grid, tile_netlist
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.ledger import Ledger
from ohmloom.mapping.placing import place
from ohmloom.mapping.plan import Crosspoint, Plan, ReadErrors, Tile
from ohmloom.mapping.plan_yield import plan_yield
from ohmloom.mapping.quantity import Quantity
from ohmloom.mapping.reset import ResetPlan, plan_reset
from ohmloom.mapping.schedule import Schedule, Slot, pulse_schedule
from ohmloom.mapping.waveform import WAVEFORMS, Waveform, event_table

__all__ = [
    "WAVEFORMS",
    "Cost",
    "CostLine",
    "Crosspoint",
    "Die",
    "EmulatedController",
    "Grid",
    "Hardware",
    "Ledger",
    "Plan",
    "Quantity",
    "ReadErrors",
    "ResetPlan",
    "Schedule",
    "Slot",
    "Tile",
    "Waveform",
    "event_table",
    "place",
    "plan_cost",
    "plan_reset",
    "plan_yield",
    "pulse_schedule",
    "tile_crossbar",
    "tile_deck",
    "tile_grid",
    "tile_netlist",
]
