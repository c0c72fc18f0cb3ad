"""What happens in time: arena, robot, trials, evolution, agreement, feasibility."""

from ohmloom.sim.agreement import Agreement, Divergence, agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.batch import DieRuns, run_dies
from ohmloom.sim.check import Check, Scheme, check
from ohmloom.sim.evolution import Evolution, EvolutionSettings, OpenSettings, evolve
from ohmloom.sim.feasibility import Feasibility, feasibility
from ohmloom.sim.figures import Figure
from ohmloom.sim.trial import Controller, Score, Trial, TrialArena, run_trial

__all__ = [
    "Agreement",
    "Arena",
    "Check",
    "Controller",
    "DieRuns",
    "Divergence",
    "Evolution",
    "EvolutionSettings",
    "Feasibility",
    "Figure",
    "OpenSettings",
    "Scheme",
    "Score",
    "Trial",
    "TrialArena",
    "agreement",
    "check",
    "evolve",
    "feasibility",
    "run_dies",
    "run_trial",
]
