"""What happens in time: arena, robot, trials, evolution, agreement, feasibility."""

from ohmloom.sim.arena import Arena
from ohmloom.sim.trial import Trial, run_trial

__all__ = ["Arena", "Trial", "run_trial"]
