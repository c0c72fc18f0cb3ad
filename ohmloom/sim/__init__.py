"""What happens in time: arena, robot, trials, evolution, agreement, feasibility."""

from ohmloom.sim.agreement import Agreement, Divergence, agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.evolution import Evolution, EvolutionSettings, OpenSettings, evolve
from ohmloom.sim.feasibility import Feasibility, feasibility
from ohmloom.sim.figures import Figure
from ohmloom.sim.trial import Controller, Score, Trial, TrialArena, run_trial

__all__ = [
    "Agreement",
    "Arena",
    "Controller",
    "Divergence",
    "Evolution",
    "EvolutionSettings",
    "Feasibility",
    "Figure",
    "OpenSettings",
    "Score",
    "Trial",
    "TrialArena",
    "agreement",
    "evolve",
    "feasibility",
    "run_trial",
]
