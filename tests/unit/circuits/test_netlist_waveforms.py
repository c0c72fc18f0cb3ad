"""Waveforms of sources: values at and between corners, slopes, corners, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.circuits import Constant, PiecewiseLinear, Pulse, Sine, TwoPartSpike
from ohmloom.circuits.waveforms import WAVEFORMS
from ohmloom.errors import ParameterError

TRAIN = Pulse(low=-1.0, high=1.0, rise=1.0, width=2.0, fall=1.0, delay=0.5, period=8.0)
SPIKE = TwoPartSpike(first=2.0, second=-1.0, first_width=2.0, second_width=3.0, edge=0.5, delay=1.0, period=10.0)
EXAMPLES = {
    "constant": Constant(level=0.25),
    "pulse": TRAIN,
    "piecewise_linear": PiecewiseLinear(times=(1.0, 2.0, 5.0), values=(0.0, 3.0, -3.0)),
    "sine": Sine(amplitude=2.0, frequency=0.25, offset=1.0, delay=1.5),
    "two_part_spike": SPIKE,
}


def test_every_waveform_has_an_example():
    assert EXAMPLES.keys() == WAVEFORMS.keys()
    assert all(type(EXAMPLES[name]) is kind for name, kind in WAVEFORMS.items())


def test_pulse_rises_stays_falls_and_repeats():
    times = [0.0, 0.5, 1.0, 1.5, 3.0, 4.0, 4.5, 8.5, 9.0, 11.0]
    assert [TRAIN.value(t) for t in times] == [-1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0, 1.0]
    assert TRAIN.breakpoints(10.0) == [0.5, 1.5, 3.5, 4.5, 8.5, 9.5]


def test_spike_has_two_parts():
    assert [SPIKE.value(t) for t in (0.5, 1.25, 2.0, 3.25, 4.0, 6.25, 8.0, 12.0)] == [0, 1, 2, 0.5, -1, -0.5, 0, 2]


@pytest.mark.parametrize("name", EXAMPLES)
def test_waveform_is_continuous_and_its_slope_its_derivative(name):
    waveform = EXAMPLES[name]
    corners = np.array([0.0, *waveform.breakpoints(25.0), 25.0])
    for corner in corners[1:-1]:
        # Slopes here are at most 4 per second.
        assert waveform.value(corner - 1e-9) == pytest.approx(waveform.value(corner + 1e-9), abs=1e-8)
    for t in 0.5 * (corners[1:] + corners[:-1]):
        estimate = (waveform.value(t + 1e-6) - waveform.value(t - 1e-6)) / 2e-6
        assert waveform.slope(t) == pytest.approx(estimate, abs=1e-8)


ERRORS = {
    "zero rise": (lambda: Pulse(high=1.0, rise=0.0, width=1.0, fall=1.0), "Pulse.rise: expected a number above 0 s"),
    "zero width": (lambda: Pulse(high=1.0, rise=1.0, width=0.0, fall=1.0), "Pulse.width: expected a number above 0 s"),
    "short period": (
        lambda: Pulse(high=1.0, rise=1.0, width=1.0, fall=1.0, period=2.0),
        "Pulse.period: expected at least the pulse's own 3 s, got 2 s",
    ),
    "jump": (
        lambda: PiecewiseLinear(times=(0.0, 0.0), values=(0.0, 1.0)), "PiecewiseLinear.times: expected times in s"
    ),
    "lengths": (lambda: PiecewiseLinear(times=(0.0, 1.0), values=(0.0,)), "expected one value for each of 2 times"),
    "frequency": (lambda: Sine(amplitude=1.0, frequency=0.0), "Sine.frequency: expected a number above 0 Hz, got 0 Hz"),
    "infinite": (lambda: Constant(level=float("inf")), "Constant.level: expected a finite number in V or A, got inf"),
    "edge": (
        lambda: TwoPartSpike(first=1.0, second=-1.0, first_width=1.0, second_width=1.0, edge=1.0),
        "TwoPartSpike.first_width: expected more than edge = 1 s, got 1 s",
    ),
    "too many corners": (lambda: TRAIN.breakpoints(1e9), "Pulse: expected at most 200000 corners until t_end"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_bad_waveform_is_named(case):
    call, text = ERRORS[case]
    with pytest.raises(ParameterError) as caught:
        call()
    assert text in str(caught.value)
