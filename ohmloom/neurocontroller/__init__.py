"""The spiking net: network files, discrete controller (plain and compiled), variation."""

from ohmloom.neurocontroller.champions import champion
from ohmloom.neurocontroller.controller import ACTIONS, SpikingController
from ohmloom.neurocontroller.kinds import KINDS, LATTICES, SYSTEMS, Lattice
from ohmloom.neurocontroller.network import Adaptation, Network
from ohmloom.neurocontroller.readings import Readings
from ohmloom.neurocontroller.rules import Synapse
from ohmloom.neurocontroller.variation import mutate

__all__ = [
    "ACTIONS",
    "KINDS",
    "LATTICES",
    "SYSTEMS",
    "Adaptation",
    "Lattice",
    "Network",
    "Readings",
    "SpikingController",
    "Synapse",
    "champion",
    "mutate",
]
