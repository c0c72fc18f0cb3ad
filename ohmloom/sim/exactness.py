"""The exact box: what must hold before any figure of an emulation means anything, on a spec's own cards.

Each entry of `EXACT` is one function of a `Case`; it returns whether it holds, or a text that says why it does not
apply.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from ohmloom.sim._exact_lines import column_serial_delay, kirchhoff, ladder, wire_limit
from ohmloom.sim._exact_pulses import current_pulse, exact_width_pulse, lattice, voltage_pulse
from ohmloom.sim.exact_case import NO_PLASTIC, Case, not_claimed

HISTORY = 8  # steps: 65,536 pairs of spike trains


def rule_table(case: Case) -> bool | str:
    """The waveform writes exactly what the rule asks for, for every pair of ls values."""
    return _signs(case) if case.plastic else NO_PLASTIC


def _signs(case: Case) -> bool:
    readings = case.network.readings
    size = range(readings.last_spike + 1)
    return all(
        _written(case, pre, post) == case.rule(pre, post, readings.stdp_threshold)
        for pre, post in itertools.product(size, size)
    )


def _written(case: Case, pre: int, post: int) -> float:
    drive = case.hardware.drive
    written = 0.0
    for phase in drive.volts.phases:
        v = phase.column[post] - phase.row[pre]
        written += phase.duration * ((v > drive.threshold.value) - (v < -drive.threshold.value))
    return written


def pair_histories(case: Case) -> bool | str:
    """All pairs of eight-step spike trains, followed step by step, give the same events by waveform and by rule."""
    if not case.plastic:
        return NO_PLASTIC
    last, threshold = case.network.readings.last_spike, case.network.readings.stdp_threshold
    trains = np.array(list(itertools.product((0, 1), repeat=HISTORY)))
    ls = np.zeros(len(trains), dtype=np.int64)
    for step in range(HISTORY):
        ls = np.where(trains[:, step] == 1, last, ls)
        pre, post = np.meshgrid(ls, ls, indexing="ij")
        written = np.zeros(pre.shape)
        for phase in case.hardware.drive.volts.phases:
            v = np.array(phase.column)[post] - np.array(phase.row)[pre]
            limit = case.hardware.drive.threshold.value
            written += phase.duration * ((v > limit).astype(float) - (v < -limit))
        asked = np.array([[case.rule(a, b, threshold) for b in range(last + 1)] for a in range(last + 1)])
        if (written != asked[pre, post]).any():
            return False
        ls = np.maximum(ls - 1, 0)
    return True


def network_charge(case: Case) -> bool | str:
    """Charge-exact drive on selected cells is the discrete model of the same cards, spike for spike."""
    return not_claimed(case) or case.charge.exact


def network_flux(case: Case) -> bool | str:
    """Pulses of fixed voltage are the flux-discrete model of the same cards, spike for spike."""
    if not case.plastic:
        return NO_PLASTIC
    return not_claimed(case) or case.flux.exact


EXACT: Mapping[str, Callable[[Case], bool | str]] = MappingProxyType(
    {
        one.__name__: one
        for one in (
            rule_table, pair_histories, current_pulse, voltage_pulse, exact_width_pulse, network_charge, network_flux,
            lattice, wire_limit, ladder, column_serial_delay, kirchhoff,
        )
    }
)  # fmt: skip


def exact_box(case: Case, progress: Callable[[str], None] | None = None) -> tuple[dict[str, bool], dict[str, str]]:
    """What holds, by name, and what does not apply, with the reason; `progress` is called with each name."""
    holds: dict[str, bool] = {}
    skipped: dict[str, str] = {}
    for name, test in EXACT.items():
        if progress is not None:
            progress(name)
        found = test(case)
        if isinstance(found, str):
            skipped[name] = found
        else:
            holds[name] = bool(found)
    return holds, skipped
