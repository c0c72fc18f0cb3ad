"""What a source does over time: continuous functions with named corners, between which they are smooth.

A new waveform is a class here and a line in `WAVEFORMS`. Edges take time: a jump has no slope that a capacitor could
follow, and no simulator resolves it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from ohmloom.errors import ParameterError, expect_number, expect_type, shown

# A train of more corners is no circuit simulation; it is also 16 MB of a deck.
MOST_CORNERS = 200_000
Corners = tuple[tuple[float, float], ...]


class Waveform(ABC):
    """A source's value over time, for t >= 0."""

    @abstractmethod
    def value(self, t: float) -> float:
        """Volts or amperes at the time `t` in s."""

    @abstractmethod
    def slope(self, t: float) -> float:
        """Derivative of the value at `t`, per second; at a corner that of what follows."""

    @abstractmethod
    def breakpoints(self, t_end: float) -> list[float]:
        """Times in (0, t_end) at which the slope jumps, or beyond which the value may surprise an integrator."""

    @abstractmethod
    def shortest_edge(self) -> float:
        """Length in s of the shortest piece; infinite for a constant."""

    @abstractmethod
    def to_spice(self, t_end: float) -> str:
        """The same for ngspice, valid up to `t_end`."""


@dataclass(frozen=True, kw_only=True)
class Constant(Waveform):
    """The same level at all times.

    >>> Constant(level=0.5).value(3.0)
    0.5
    """

    level: float

    def __post_init__(self) -> None:
        _numbers(self, "level")

    def value(self, t: float) -> float:
        return self.level

    def slope(self, t: float) -> float:
        return 0.0

    def breakpoints(self, t_end: float) -> list[float]:
        return []

    def shortest_edge(self) -> float:
        return math.inf

    def to_spice(self, t_end: float) -> str:
        return f"DC {self.level!r}"


@dataclass(frozen=True, kw_only=True)
class Sine(Waveform):
    """``offset + amplitude sin(2 pi frequency (t - delay))``, and `offset` before `delay`; frequency in Hz, delay in s.

    >>> round(Sine(amplitude=2.0, frequency=50.0).value(0.005), 12)
    2.0
    """

    amplitude: float
    frequency: float
    offset: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        _numbers(self, "amplitude", "offset")
        _durations(self, "frequency", unit="Hz")
        _durations(self, "delay", zero=True)

    def value(self, t: float) -> float:
        return self.offset + (self.amplitude * math.sin(self._phase(t)) if t > self.delay else 0.0)

    def slope(self, t: float) -> float:
        rate = 2.0 * math.pi * self.frequency
        return self.amplitude * rate * math.cos(self._phase(t)) if t >= self.delay else 0.0

    def breakpoints(self, t_end: float) -> list[float]:
        """Quarter periods: what a device does turns at the zeros and at the peaks."""
        count = max(t_end - self.delay, 0.0) * self.frequency * 4.0
        _check_count(self, count)
        times = (self.delay + 0.25 * k / self.frequency for k in range(math.ceil(count)))
        return [t for t in times if 0.0 < t < t_end]

    def shortest_edge(self) -> float:
        return 0.25 / self.frequency

    def to_spice(self, t_end: float) -> str:
        return f"SIN({self.offset!r} {self.amplitude!r} {self.frequency!r} {self.delay!r})"

    def _phase(self, t: float) -> float:
        return 2.0 * math.pi * self.frequency * (t - self.delay)


class _Polyline(Waveform):
    """Straight lines between corners, after a delay, once or periodically."""

    @abstractmethod
    def corners(self) -> Corners:
        """(time after the delay, value), times rising; the last value is kept until the next period."""

    @abstractmethod
    def _train(self) -> tuple[float, float | None]:
        """Delay and period."""

    def value(self, t: float) -> float:
        corners, phase = self.corners(), self._phase(t)
        k = bisect_right(corners, phase, key=_time)
        if k == 0 or k == len(corners):
            return corners[max(k - 1, 0)][1]
        (t0, v0), (t1, v1) = corners[k - 1], corners[k]
        return v0 + (v1 - v0) * ((phase - t0) / (t1 - t0))

    def slope(self, t: float) -> float:
        corners, phase = self.corners(), self._phase(t)
        k = bisect_right(corners, phase, key=_time)
        if k == 0 or k == len(corners):
            return 0.0
        (t0, v0), (t1, v1) = corners[k - 1], corners[k]
        return (v1 - v0) / (t1 - t0)

    def breakpoints(self, t_end: float) -> list[float]:
        return [t for t, _ in self._all_corners(t_end) if 0.0 < t < t_end]

    def shortest_edge(self) -> float:
        times = [t for t, _ in self.corners()]
        gaps = [b - a for a, b in pairwise(times)]
        return min(gaps, default=math.inf)

    def to_spice(self, t_end: float) -> str:
        points = list(self._all_corners(t_end))
        if points[0][0] > 0.0:
            points.insert(0, (0.0, points[0][1]))
        # A period may begin where the last one ended: one point, not two at one time.
        kept = [points[0], *(b for a, b in pairwise(points) if b[0] > a[0])]
        return "PWL(" + "\n+ ".join(f"{t!r} {v!r}" for t, v in kept) + ")"

    def _phase(self, t: float) -> float:
        delay, period = self._train()
        phase = t - delay
        return phase if period is None or phase < 0.0 else phase % period

    def _all_corners(self, t_end: float) -> Iterator[tuple[float, float]]:
        corners = self.corners()
        delay, period = self._train()
        rounds = 1 if period is None else max(math.ceil((t_end - delay) / period), 1)
        _check_count(self, float(rounds * len(corners)))
        for k in range(rounds):
            begin = delay + (0.0 if period is None else k * period)
            yield from ((begin + t, v) for t, v in corners)


@dataclass(frozen=True, kw_only=True)
class Pulse(_Polyline):
    """From `low` to `high` over `rise`, there for `width`, back over `fall`; again after each `period`, if given.

    Times in s; `delay` before the first edge.

    >>> pulse = Pulse(low=0.0, high=1.0, rise=1e-9, width=1e-6, fall=1e-9)
    >>> pulse.value(0.5e-9), pulse.value(0.5e-6), pulse.value(1.0)
    (0.5, 1.0, 0.0)
    """

    high: float
    rise: float
    width: float
    fall: float
    low: float = 0.0
    delay: float = 0.0
    period: float | None = None

    def __post_init__(self) -> None:
        _numbers(self, "low", "high")
        _durations(self, "rise", "width", "fall")
        _durations(self, "delay", zero=True)
        _check_period(self, self.period, self.rise + self.width + self.fall)

    def corners(self) -> Corners:
        top = self.rise + self.width
        return (0.0, self.low), (self.rise, self.high), (top, self.high), (top + self.fall, self.low)

    def _train(self) -> tuple[float, float | None]:
        return self.delay, self.period


@dataclass(frozen=True, kw_only=True)
class TwoPartSpike(_Polyline):
    """A spike of two parts: `first` for `first_width`, then `second` for `second_width`, 0 otherwise.

    Each of the three edges takes `edge`, inside the parts' widths on the way in. Times in s; `delay` before the first
    edge, again after each `period`, if one is given.

    >>> spike = TwoPartSpike(first=1.0, second=-1.0, first_width=1e-3, second_width=1e-3, edge=1e-6)
    >>> spike.value(0.5e-3), spike.value(1.5e-3), spike.value(3e-3)
    (1.0, -1.0, 0.0)
    """

    first: float
    second: float
    first_width: float
    second_width: float
    edge: float
    delay: float = 0.0
    period: float | None = None

    def __post_init__(self) -> None:
        _numbers(self, "first", "second")
        _durations(self, "first_width", "second_width", "edge")
        _durations(self, "delay", zero=True)
        for name in ("first_width", "second_width"):
            if getattr(self, name) <= self.edge:
                raise ParameterError(f"TwoPartSpike.{name}: expected more than edge = {self.edge:g} s, got "
                                     f"{getattr(self, name):g} s. Shorten the edge.")  # fmt: skip
        _check_period(self, self.period, self.first_width + self.second_width + self.edge)

    def corners(self) -> Corners:
        middle = self.first_width
        end = middle + self.second_width
        return ((0.0, 0.0), (self.edge, self.first), (middle, self.first), (middle + self.edge, self.second),
                (end, self.second), (end + self.edge, 0.0))  # fmt: skip

    def _train(self) -> tuple[float, float | None]:
        return self.delay, self.period


@dataclass(frozen=True, kw_only=True)
class PiecewiseLinear(_Polyline):
    """Straight lines between the `values` at the `times` in s, which rise; the first and the last value are kept.

    >>> PiecewiseLinear(times=(0.0, 1.0), values=(0.0, 4.0)).value(0.25)
    1.0
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            given = getattr(self, name)
            expect_type(f"PiecewiseLinear.{name}", given, tuple, list)
            numbers = tuple(expect_number(f"PiecewiseLinear.{name}", x) for x in given)
            object.__setattr__(self, name, numbers)
        if not self.times or len(self.times) != len(self.values):
            raise ParameterError(f"PiecewiseLinear.values: expected one value for each of {len(self.times)} times, at "
                                 f"least one, got {len(self.values)}. Give them in pairs.")  # fmt: skip
        steps = [b - a for a, b in pairwise(self.times)]
        if self.times[0] < 0.0 or min(steps, default=1.0) <= 0.0:
            raise ParameterError(f"PiecewiseLinear.times: expected times in s from 0 on, each above the last, got "
                                 f"{shown(self.times)}. An edge takes time.")  # fmt: skip

    def corners(self) -> Corners:
        return tuple(zip(self.times, self.values, strict=True))

    def _train(self) -> tuple[float, float | None]:
        return 0.0, None


WAVEFORMS: dict[str, type[Waveform]] = {
    "constant": Constant,
    "pulse": Pulse,
    "piecewise_linear": PiecewiseLinear,
    "sine": Sine,
    "two_part_spike": TwoPartSpike,
}


def as_waveform(where: str, value: object, unit: str) -> Waveform:
    """A number as a `Constant`, a waveform as it is."""
    if isinstance(value, Waveform):
        return value
    return Constant(level=expect_number(where, value, f"a waveform, or a finite number in {unit}"))


def _time(corner: tuple[float, float]) -> float:
    return corner[0]


def _numbers(waveform: Waveform, *names: str) -> None:
    for name in names:
        where = f"{type(waveform).__name__}.{name}"
        object.__setattr__(waveform, name, expect_number(where, getattr(waveform, name), "a finite number in V or A"))


def _durations(waveform: Waveform, *names: str, unit: str = "s", zero: bool = False) -> None:
    rule = f"0 {unit} or more" if zero else f"a number above 0 {unit}"
    for name in names:
        where = f"{type(waveform).__name__}.{name}"
        number = expect_number(where, getattr(waveform, name), rule)
        if number < 0.0 or (number == 0.0 and not zero):
            advice = "Correct it." if zero or unit != "s" else "Edges and levels take time."
            raise ParameterError(f"{where}: expected {rule}, got {number:g} {unit}. {advice}")
        object.__setattr__(waveform, name, number)


def _check_period(waveform: Waveform, period: float | None, busy: float) -> None:
    if period is None:
        return
    where = f"{type(waveform).__name__}.period"
    number = expect_number(where, period, "a period in s, or None for a single one")
    # Parts that add up to the period fill it but for rounding.
    if number < busy * (1.0 - 1e-12):
        raise ParameterError(f"{where}: expected at least the pulse's own {busy:g} s, got {number:g} s. Lengthen it.")
    object.__setattr__(waveform, "period", number)


def _check_count(waveform: Waveform, count: float) -> None:
    if count > MOST_CORNERS:
        raise ParameterError(f"{type(waveform).__name__}: expected at most {MOST_CORNERS} corners until t_end, got "
                             f"{count:.3g}. Shorten t_end.")  # fmt: skip
