"""Programming waveforms: which pairs of ls values make a device see more than its threshold.

A waveform is a sequence of phases; in each, every row and every column is held at a level that depends on its neuron's
ls. The device sees column - row, positive for potentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray
from ohmloom.errors import MappingError, ParameterError, expect_integer
from ohmloom.neurocontroller import Readings
from ohmloom.neurocontroller.plain import stdp_sign

MOST_LEVELS = 2_000_000  # sets of levels that `widest_levels` tries


@dataclass(frozen=True, kw_only=True)
class Phase:
    """A part of a waveform in which no line changes.

    Attributes
    ----------
    row, column
        Level for ls = 0, 1, ..., last_spike, in multiples of the waveform's unit.
    duration
        Fraction of an event's pulse, > 0.
    """

    row: tuple[float, ...]
    column: tuple[float, ...]
    duration: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Waveform:
    """What rows and columns do at the end of a step.

    Attributes
    ----------
    phases
        One after the other.
    event
        Largest level that a device sees, that of an STDP event; the pulse voltage divided by it is the unit.
    """

    phases: tuple[Phase, ...]
    event: float = field(init=False)

    def __post_init__(self) -> None:
        widths = {len(levels) for phase in self.phases for levels in (phase.row, phase.column)}
        if len(widths) != 1 or min(widths) < 2 or any(phase.duration <= 0.0 for phase in self.phases):
            raise MappingError("Waveform.phases: expected at least one phase of a duration > 0, all with a level "
                               "for the same "
                               f"ls values from 0, got {self.phases}. Correct them.")  # fmt: skip
        if not np.isfinite([x for p in self.phases for x in (*p.row, *p.column, p.duration)]).all():
            raise MappingError(f"Waveform.phases: expected finite levels, got {self.phases}. Correct them.")
        largest = max(abs(b - a) for phase in self.phases for a in phase.row for b in phase.column)
        if largest == 0.0:
            raise MappingError("Waveform.phases: expected a level other than 0, got none. Nothing would be written.")
        object.__setattr__(self, "event", largest)

    @classmethod
    def of_levels(cls, levels: Sequence[float]) -> Waveform:
        """One phase with the same levels f(ls) on rows and columns.

        >>> Waveform.of_levels((0, 0, -1, 1)).event
        2
        """
        return cls(phases=(Phase(row=tuple(levels), column=tuple(levels)),))

    @property
    def last_spike(self) -> int:
        """Largest ls that has a level."""
        return len(self.phases[0].row) - 1

    @property
    def duration(self) -> float:
        """Length of the whole waveform in multiples of an event's pulse."""
        return sum(phase.duration for phase in self.phases)

    @property
    def is_one_phase(self) -> bool:
        """Whether events of both signs are written at once."""
        return len(self.phases) == 1

    def scaled(self, unit: float) -> Waveform:
        """The same in volts, for a unit in V."""
        return Waveform(
            phases=tuple(
                Phase(row=tuple(unit * x for x in p.row), column=tuple(unit * x for x in p.column), duration=p.duration)
                for p in self.phases
            )
        )


# Levels for ls = 0, 1, 2, 3. "half": head and tail of one volt half each. "two_part": the numbers of the paper's
# Section V-A. "two_slot": the same, with a slot for each sign, so that no line needs both polarities at once. "pwm":
# one level, the tail's width says how recent the spike is (1 for ls = 2, else 0).
WAVEFORMS = MappingProxyType(
    {
        "half": Waveform.of_levels((0, 0, -1, 1)),
        "two_part": Waveform.of_levels((0, -1, -2, 3)),
        "two_slot": Waveform(
            phases=(Phase(row=(0, -1, -2, 0), column=(0, 0, 0, 3)), Phase(row=(0, 0, 0, 3), column=(0, -1, -2, 0)))
        ),
        "pwm": Waveform(
            phases=(Phase(row=(0, 0, -1, 0), column=(0, 0, 0, 1)), Phase(row=(0, 0, 0, 1), column=(0, 0, -1, 0)))
        ),
    }
)


def event_table(waveform: Waveform | Sequence[float], threshold: float) -> list[list[float]]:
    """Signed part of an event that is written, axes (ls_pre, ls_post), for a device that switches above `threshold`.

    Parameters
    ----------
    waveform
        A waveform, or the levels of one with the same ones on rows and columns.
    threshold
        In the unit of the levels.

    >>> event_table((0, 0, -1, 1), 1.5)[2][3]
    1.0
    """
    waveform = waveform if isinstance(waveform, Waveform) else Waveform.of_levels(waveform)
    size = waveform.last_spike + 1
    table = np.zeros((size, size))
    for phase in waveform.phases:
        v = np.subtract.outer(np.array(phase.column), np.array(phase.row)).T
        table += phase.duration * ((v > threshold).astype(float) - (v < -threshold))
    return [[float(x) for x in row] for row in table]


@dataclass(frozen=True, kw_only=True)
class Separability:
    """Whether a threshold exists at which a waveform follows a rule.

    Attributes
    ----------
    least_event
        Smallest level that a device sees in the phases that must write an event, in the waveform's unit.
    largest_other
        Largest level that it sees where nothing may be written.
    is_separable
        Whether every threshold from `largest_other` to below `least_event` gives exactly the rule.
    wrong
        Pairs (ls_pre, ls_post) that no such threshold gets right.
    """

    least_event: float
    largest_other: float
    is_separable: bool
    wrong: tuple[tuple[int, int], ...]


def separability(waveform: Waveform | Sequence[float], *, stdp_threshold: int = 4) -> Separability:
    """Try all pairs of ls values against eqs. 10 and 11 with last_spike = that of the waveform.

    >>> separability((0, -1, -2, 3))
    Separability(least_event=5.0, largest_other=4.0, is_separable=True, wrong=())
    """
    waveform = waveform if isinstance(waveform, Waveform) else Waveform.of_levels(waveform)
    wrong = []
    least, other = float("inf"), 0.0
    for pre, post in product(range(waveform.last_spike + 1), repeat=2):
        wanted = stdp_sign(pre, post, stdp_threshold)
        seen = [(phase.column[post] - phase.row[pre], phase.duration) for phase in waveform.phases]
        # Of the phases with the right sign, the strongest that make up one whole event must write; no other may.
        right = sorted(((abs(v), d) for v, d in seen if v * wanted > 0), reverse=True)
        written, used = 0.0, 0
        while used < len(right) and written < abs(wanted):
            written += right[used][1]
            used += 1
        if written != abs(wanted):
            wrong.append((pre, post))
        if used:
            least = min(least, right[used - 1][0])
        other = max([other, *(v for v, _ in right[used:]), *(abs(v) for v, _ in seen if v * wanted <= 0)])
    if least <= other:
        wrong += [pair for pair in _pairs_beyond(waveform, least, stdp_threshold) if pair not in wrong]
    return Separability(least_event=float(least), largest_other=float(other),
                        is_separable=not wrong and other < least < float("inf"), wrong=tuple(wrong))  # fmt: skip


def _pairs_beyond(waveform: Waveform, least: float, stdp_threshold: int) -> list[tuple[int, int]]:
    """Pairs that fire wrongly when everything that must be written is: at a threshold just below `least`."""
    table = event_table(waveform, np.nextafter(least, 0.0))
    size = range(waveform.last_spike + 1)
    return [(a, b) for a, b in product(size, repeat=2) if table[a][b] != stdp_sign(a, b, stdp_threshold)]


def widest_levels(*, last_spike: int = 3, stdp_threshold: int = 4, largest: int = 6) -> tuple[int, ...] | None:
    """Integer levels, the same on rows and columns and 0 for ls = 0, with the widest window for the threshold.

    Parameters
    ----------
    last_spike, stdp_threshold
        The rule of eqs. 10 and 11.
    largest
        Largest level tried, >= 1.

    Returns
    -------
    tuple of int, or None
        Levels for ls = 0 to last_spike with the largest ratio of event to other, the smallest such; None if no single
        phase with levels up to `largest` can follow the rule.

    Raises
    ------
    ParameterError
        If a number is too small, or there are more than two million sets of levels.

    >>> widest_levels(largest=3)
    (0, 0, -1, 1)
    """
    last_spike = expect_integer("widest_levels.last_spike", last_spike, 1)
    largest = expect_integer("widest_levels.largest", largest, 1)
    stdp_threshold = expect_integer("widest_levels.stdp_threshold", stdp_threshold, 0)
    tried = (2 * largest + 1) ** last_spike
    if tried > MOST_LEVELS:
        raise ParameterError(f"widest_levels.largest: expected at most {MOST_LEVELS:,} sets of levels, got {tried:,}. "
                             "Lower it.")  # fmt: skip
    f = _all_levels(last_spike, largest)
    event, other = np.full(len(f), np.inf), np.zeros(len(f))
    right = np.ones(len(f), dtype=bool)
    for pre, post in product(range(last_spike + 1), repeat=2):
        v, wanted = f[:, post] - f[:, pre], stdp_sign(pre, post, stdp_threshold)
        if wanted:
            right &= wanted * v > 0
            event = np.minimum(event, np.abs(v))
        else:
            other = np.maximum(other, np.abs(v))
    right &= (event > other) & np.isfinite(event)
    if not right.any():
        return None
    f, ratio = f[right], event[right] / np.maximum(other[right], 1e-300)
    best = np.flatnonzero(ratio == ratio.max())
    smallest = best[np.lexsort((*f[best].T[::-1], np.abs(f[best]).sum(axis=1)))][0]
    return tuple(int(x) for x in f[smallest])


def _all_levels(last_spike: int, largest: int) -> npt.NDArray[np.int64]:
    axes = np.meshgrid(*[np.arange(-largest, largest + 1)] * last_spike, indexing="ij")
    return np.stack([np.zeros(axes[0].size, dtype=np.int64), *(axis.ravel() for axis in axes)], axis=1)


def check_rule(waveform: Waveform | Sequence[float], threshold: float, readings: Readings) -> None:
    """Check by brute force that a waveform gives exactly the events of eqs. 10 and 11.

    Raises
    ------
    MappingError
        Names the first pair of ls values that fires wrongly, or a last_spike without a level.
    """
    waveform = waveform if isinstance(waveform, Waveform) else Waveform.of_levels(waveform)
    if waveform.last_spike != readings.last_spike:
        raise MappingError(f"drive.waveform: expected a level for ls = 0 to {readings.last_spike}, got "
                           f"{waveform.last_spike + 1} levels. The network's last_spike needs another "
                           "waveform.")  # fmt: skip
    for pre, post in product(range(readings.last_spike + 1), repeat=2):
        wanted = stdp_sign(pre, post, readings.stdp_threshold)
        seen = [phase.column[post] - phase.row[pre] for phase in waveform.phases]
        fired = [(v > threshold) - (v < -threshold) for v in seen]
        written = sum(sign * phase.duration for sign, phase in zip(fired, waveform.phases, strict=True))
        if written != wanted or any(sign * wanted < 0 for sign in fired):
            most = max(seen, key=abs)
            raise MappingError(
                f"drive.threshold: expected {_words(wanted)} for ls (pre, post) = ({pre}, {post}), "
                f"got {_words(written)} at {most:g} V against a threshold of "
                f"{threshold:g} V. {_advice(waveform, readings.stdp_threshold)}"
            )


def _advice(waveform: Waveform, stdp_threshold: int) -> str:
    found = separability(waveform, stdp_threshold=stdp_threshold)
    if found.is_separable:
        return (f"Choose a threshold from {found.largest_other:g} V, the half-select voltage, to below "
                f"{found.least_event:g} V, the full voltage.")  # fmt: skip
    pairs = ", ".join(f"({pre}, {post})" for pre, post in found.wrong[:3])
    return f"No threshold separates this waveform: {pairs} fire wrongly at any. Use another waveform."


def _words(written: float) -> str:
    whole = {1.0: "a positive event", -1.0: "a negative event", 0.0: "no event"}
    return whole.get(float(written), f"{written:g} of an event")


def phase_arrays(waveform: Waveform) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Durations (phase,), row and column levels (phase, ls), for kernels."""
    return (
        np.array([phase.duration for phase in waveform.phases]),
        np.array([phase.row for phase in waveform.phases], dtype=np.float64),
        np.array([phase.column for phase in waveform.phases], dtype=np.float64),
    )
