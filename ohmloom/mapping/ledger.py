"""What a die spent: events, charge, energy and time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """What programming and reading cost since the last reset.

    Attributes
    ----------
    events, ideal_events, lost, spurious
        Events written; events that eqs. 10 and 11 ask for on the same spikes; asked for and not (or wrongly)
        written; written and not (or wrongly) asked for.
    charge, programming_energy, read_energy
        Transported charge [C], energy in the devices [J].
    spikes, steps
        Spikes of all neurons; steps of 1/21 timestep.
    reading_time
        Time to read the columns of the widest tile one after the other, the same in every step [s].
    mean_programming_time, worst_programming_time
        Programming time of a step [s]; tiles are programmed side by side.
    most_pulses, pulses
        Of the device that has most; of all.
    disabled_events
        Events that devices took at crosspoints without a synapse.
    half_selects_row, half_selects_column, half_selects_both
        Pulses below the threshold, where all lines are driven: with a level on the row only, the column only, or both.
    """

    events: int
    ideal_events: int
    lost: int
    spurious: int
    charge: float
    programming_energy: float
    read_energy: float
    spikes: int
    steps: int
    reading_time: float
    mean_programming_time: float
    worst_programming_time: float
    most_pulses: int
    pulses: int
    disabled_events: int = 0
    half_selects_row: int = 0
    half_selects_column: int = 0
    half_selects_both: int = 0
