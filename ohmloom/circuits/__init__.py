"""Many devices: crossbars with wire resistance, and general netlists.

Axes are ``(..., word_line, bit_line)``; leading axes are a batch. Current is positive into the sense of a column, and
from node p to node n through an element of a netlist.
"""

from __future__ import annotations

from ohmloom.circuits.array_netlist import crossbar_netlist, memristor_netlist
from ohmloom.circuits.conduction import Conduction, SelectorConduction, SinhConduction
from ohmloom.circuits.crossbar import Crossbar
from ohmloom.circuits.crossbar_read import Read
from ohmloom.circuits.elements import (
    VCCS,
    VCVS,
    Capacitor,
    CurrentSource,
    Memristor,
    Resistor,
    Subcircuit,
    VoltageSource,
)
from ohmloom.circuits.memristor_crossbar import CrossbarTrace, MemristorCrossbar
from ohmloom.circuits.netlist import Netlist
from ohmloom.circuits.netlist_trace import NetlistTrace, OperatingPoint
from ohmloom.circuits.plots import plot_crossbar, plot_schematic
from ohmloom.circuits.pulses import PulseTrain
from ohmloom.circuits.spice import run_ngspice
from ohmloom.circuits.waveforms import Constant, PiecewiseLinear, Pulse, Sine, TwoPartSpike

__all__ = [
    "VCCS",
    "VCVS",
    "Capacitor",
    "Conduction",
    "Constant",
    "Crossbar",
    "CrossbarTrace",
    "CurrentSource",
    "Memristor",
    "MemristorCrossbar",
    "Netlist",
    "NetlistTrace",
    "OperatingPoint",
    "PiecewiseLinear",
    "Pulse",
    "PulseTrain",
    "Read",
    "Resistor",
    "SelectorConduction",
    "Sine",
    "SinhConduction",
    "Subcircuit",
    "TwoPartSpike",
    "VoltageSource",
    "crossbar_netlist",
    "memristor_netlist",
    "plot_crossbar",
    "plot_schematic",
    "run_ngspice",
]
