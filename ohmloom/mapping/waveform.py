"""Two-part spikes: which pairs of ls values make a device see more than its threshold.

Row and column carry the same levels f(ls); the device sees f(ls_post) - f(ls_pre), positive for potentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ohmloom.errors import MappingError
from ohmloom.neurocontroller import Readings
from ohmloom.neurocontroller.plain import stdp_sign


@dataclass(frozen=True, kw_only=True)
class Waveform:
    """Levels of a spike's tail and head in multiples of a unit voltage.

    Attributes
    ----------
    levels
        Level for ls = 0, 1, 2, 3.
    event
        Level that an STDP event puts on the device; the pulse voltage divided by it is the unit.
    """

    levels: tuple[int, ...]
    event: int


WAVEFORMS = MappingProxyType(
    {
        "half": Waveform(levels=(0, 0, -1, 1), event=2),
        "two_part": Waveform(levels=(0, -1, -2, 3), event=5),
    }
)


def event_table(levels: Sequence[float], threshold: float) -> list[list[int]]:
    """Sign of the event, axes (ls_pre, ls_post), for a device that switches above `threshold`.

    >>> event_table((0, 0, -1, 1), 1.5)[2][3]
    1
    """
    table = []
    for pre in levels:
        differences = [post - pre for post in levels]
        table.append([(d > threshold) - (d < -threshold) for d in differences])
    return table


def check_rule(levels: Sequence[float], threshold: float, readings: Readings) -> None:
    """Check by brute force that a waveform gives exactly the events of eqs. 10 and 11.

    Raises
    ------
    MappingError
        Names the first pair of ls values that fires wrongly, or a last_spike without a level.
    """
    if len(levels) != readings.last_spike + 1:
        raise MappingError(f"drive.waveform: expected a level for ls = 0 to {readings.last_spike}, got {len(levels)} "
                           "levels. The network's last_spike needs another waveform.")  # fmt: skip
    table = event_table(levels, threshold)
    for pre in range(len(levels)):
        for post in range(len(levels)):
            wanted = stdp_sign(pre, post, readings.stdp_threshold)
            if table[pre][post] != wanted:
                raise MappingError(
                    f"drive.threshold: expected {_words(wanted)} for ls (pre, post) = ({pre}, {post}), "
                    f"got {_words(table[pre][post])} at {levels[post] - levels[pre]:g} V against a threshold of "
                    f"{threshold:g} V. Choose a threshold between the half-select and the full voltage."
                )


def _words(sign: int) -> str:
    return {1: "a positive event", -1: "a negative event", 0: "no event"}[sign]
