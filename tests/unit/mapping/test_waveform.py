"""Waveforms against the paper's rule, pair by pair and history by history."""

import itertools

import pytest

from ohmloom.errors import MappingError
from ohmloom.mapping import WAVEFORMS, event_table
from ohmloom.mapping.waveform import Phase, Separability, Waveform, check_rule, separability, widest_levels
from ohmloom.neurocontroller import Readings

# Eqs. 10 and 11 with last_spike = 3 and threshold 4: only one step apart, by hand.
RULE = {(2, 3): 1, (3, 2): -1}


@pytest.mark.parametrize("name", WAVEFORMS)
def test_waveform_gives_the_rule(name):
    waveform = WAVEFORMS[name]
    table = event_table(waveform, waveform.event - 0.5)
    for pre, post in itertools.product(range(4), repeat=2):
        assert table[pre][post] == RULE.get((pre, post), 0)


@pytest.mark.parametrize(
    ("name", "best", "worst"), [("half", 2, 1), ("two_part", 5, 4), ("two_slot", 5, 4), ("pwm", 2, 1)]
)
def test_window_of_the_threshold(name, best, worst):
    found = separability(WAVEFORMS[name])
    assert found == Separability(least_event=best, largest_other=worst, is_separable=True, wrong=())


@pytest.mark.parametrize("name", WAVEFORMS)
def test_all_histories_of_eight_steps(name):
    """65,536 pairs of spike trains: events of the waveform equal events of one-step-apart spikes."""
    waveform = WAVEFORMS[name]
    table = event_table(waveform, waveform.event - 0.5)
    trains = list(itertools.product((0, 1), repeat=8))
    traces = []
    for train in trains:
        ls, trace = 0, []
        for spike in train:
            ls = 3 if spike else ls
            trace.append(ls)
            ls = max(ls - 1, 0)
        traces.append(trace)
    for a, pre in enumerate(trains):
        for b, post in enumerate(trains):
            for t in range(8):
                late = t > 0 and post[t] and not pre[t] and pre[t - 1]
                early = t > 0 and pre[t] and not post[t] and post[t - 1]
                assert table[traces[a][t]][traces[b][t]] == int(bool(late)) - int(bool(early))


@pytest.mark.parametrize(("threshold", "pair"), [(0.4, r"\(0, 2\)"), (1.2, r"\(2, 3\)")])
def test_threshold_outside_the_window_names_the_pair(threshold, pair):
    with pytest.raises(MappingError, match=rf"drive\.threshold: expected .* for ls \(pre, post\) = {pair}"):
        check_rule((0.0, 0.0, -0.5, 0.5), threshold, Readings())


def test_other_last_spike_needs_another_waveform():
    with pytest.raises(MappingError, match=r"drive\.waveform: expected a level for ls = 0 to 5, got 4 levels"):
        check_rule((0.0, 0.0, -0.5, 0.5), 0.75, Readings(last_spike=5))


def test_a_graded_width_is_not_the_rule():
    """A tail that is half as wide for ls = 1 moves half an event at (1, 3)."""
    wide, narrow, head = (0, -1, -1, 0), (0, 0, -1, 0), (0, 0, 0, 1)
    up = [Phase(row=tail, column=head, duration=0.5) for tail in (wide, narrow)]
    down = [Phase(row=head, column=tail, duration=0.5) for tail in (wide, narrow)]
    graded = Waveform(phases=(*up, *down))
    assert event_table(graded, 1.5)[1][3] == 0.5
    assert event_table(graded, 1.5)[2][3] == 1.0
    assert separability(graded).wrong == ((1, 3), (3, 1))
    with pytest.raises(
        MappingError, match=r"\(1, 3\), got 0\.5 of an event at 2 V .*\(1, 3\), \(3, 1\) fire wrongly at any"
    ):
        check_rule(graded, 1.5, Readings())


def test_levels_that_only_add_up_lose_the_sign():
    """ls on both ends, the letter of eq. 10, fires where both are equal."""
    plus = Waveform(phases=(Phase(row=(0, -1, -2, -3), column=(0, 1, 2, 3)),))
    found = separability(plus)
    assert not found.is_separable
    assert (3, 2) in found.wrong


@pytest.mark.parametrize(("last_spike", "threshold"), [(3, 4), (3, 3), (3, 5), (2, 2), (4, 6), (5, 8)])
def test_widest_levels_are_found_by_trying(last_spike, threshold):
    levels = widest_levels(last_spike=last_spike, stdp_threshold=threshold, largest=4)
    if levels is None:
        # No pair fires at (3, 5); no single phase follows the others.
        assert (last_spike, threshold) in {(3, 5), (4, 6), (5, 8)}
        return
    found = separability(levels, stdp_threshold=threshold)
    assert found.is_separable
    check_rule(
        levels,
        0.5 * (found.least_event + found.largest_other),
        Readings(last_spike=last_spike, stdp_threshold=threshold),
    )
