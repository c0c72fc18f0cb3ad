"""Waveforms against the paper's rule, pair by pair and history by history."""

import itertools

import pytest

from ohmloom.errors import MappingError
from ohmloom.mapping import WAVEFORMS, event_table
from ohmloom.mapping.waveform import check_rule
from ohmloom.neurocontroller import Readings

# Eqs. 10 and 11 with last_spike = 3 and threshold 4: only one step apart, by hand.
RULE = {(2, 3): 1, (3, 2): -1}


@pytest.mark.parametrize("name", WAVEFORMS)
def test_waveform_gives_the_rule(name):
    waveform = WAVEFORMS[name]
    table = event_table(waveform.levels, waveform.event - 0.5)
    for pre, post in itertools.product(range(4), repeat=2):
        assert table[pre][post] == RULE.get((pre, post), 0)


@pytest.mark.parametrize(("name", "worst"), [("half", 1), ("two_part", 4)])
def test_largest_level_without_an_event(name, worst):
    levels = WAVEFORMS[name].levels
    silent = [abs(levels[b] - levels[a]) for a, b in itertools.product(range(4), repeat=2) if (a, b) not in RULE]
    assert max(silent) == worst


@pytest.mark.parametrize("name", WAVEFORMS)
def test_all_histories_of_eight_steps(name):
    """65,536 pairs of spike trains: events of the waveform equal events of one-step-apart spikes."""
    waveform = WAVEFORMS[name]
    table = event_table(waveform.levels, waveform.event - 0.5)
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
