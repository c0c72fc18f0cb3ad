"""What the report says in words: names, verdicts, and what the statistics mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ohmloom.sim import Agreement, Feasibility, Trial
from ohmloom.sim.figures import FAIL, NON_INFERIORITY, PASS
from ohmloom.sim.statistics import Success, pairs_needed

FIGURES: Final = {
    "event_fidelity": "Learning events lost or invented",
    "weight_divergence": "Distance of the weights from the model's",
    "threshold_margin": "Pulses on the wrong side of the threshold",
    "read_error": "Read voltage lost on the wires",
    "disturb": "Learning by reads and half-selects",
    "wake_up": "Weight of crossings without a synapse",
    "useful_event_range": "Learning events over the useful range",
    "time_per_step": "Time for one step",
    "programming_power": "Power in real time",
    "energy_per_timestep": "Energy for one timestep",
    "pulses_per_device": "Pulses on the busiest device",
    "endurance": "Trials until the busiest device wears out",
    "yield": "Dies without a faulty synapse",
    "closed_loop_success": "Success, hardware less ideal: lower 95 % bound",
    "sensitivity": "Largest effect of a spread",
}
STATUSES: Final = {
    "PASS": "keeps its limit with at least 20 % to spare",
    "MARGINAL": "keeps its limit with less than 20 % to spare",
    "FAIL": "breaks its limit",
    "ASSUMED": "rests on an assumed input or has no limit in the spec; a measurement could change it",
    "NOT_RUN": "not decided by this study",
}
EXACTNESS: Final = {
    "rule_table": "The write pulses change a device exactly when the learning rule asks for it, and in its direction.",
    "pair_histories": "All pairs of eight-step spike trains give the same events by pulses and by the rule.",
    "current_pulse": "A current pulse, integrated, moves the charge by one event, and not beyond the ends.",
    "voltage_pulse": "A pulse of fixed voltage, integrated, ends where the closed form says.",
    "exact_width_pulse": "A voltage pulse of the computed width, integrated, moves the charge by one event.",
    "lattice": "Each device card gives the network's weights, level by level.",
    "network_charge": "Over a whole trial every neuron of the hardware spikes exactly when the ideal network's does.",
    "network_flux": "Driven by fixed-voltage pulses, the hardware spikes exactly as the flux-discrete model does.",
    "wire_limit": "The read errors vanish in proportion to the resistance of the wires.",
    "ladder": "One word line draws the current of the continued fraction.",
    "column_serial_delay": "Columns that are read one after the other see every spike after its delay.",
    "kirchhoff": "All current that enters the word lines leaves through the bit lines.",
}


def verdict_line(study: Feasibility) -> str:
    """What the verdict means, in one sentence."""
    if not all(study.exactness.values()):
        return "The study is void: an exactness check does not hold, so the figures below mean nothing."
    if study.verdict == PASS:
        return "Every figure keeps its limit with at least 20 % to spare, anywhere in the ranges of what is assumed."
    if study.verdict == FAIL:
        return "At least one figure breaks its limit: as specified, this hardware does not do what the network needs."
    return "No figure breaks its limit, but not every one is shown to keep it with enough to spare."


def percent(fraction: float, *, sign: bool = False) -> str:
    """A fraction in percent, three digits at most; thousands apart.

    >>> percent(0.0458), percent(-768.78, sign=True), percent(1.0, sign=True)
    ('4.58 %', '−76 900 %', '+100 %')
    """
    rounded = float(f"{100.0 * fraction:.3g}")
    text = f"{abs(rounded):,.0f}".replace(",", " ") if abs(rounded) >= 1000 else f"{abs(rounded):g}"
    return f"{'−' if rounded < 0 else '+' if sign and rounded > 0 else ''}{text} %"


def margin(value: float | None) -> str:
    """A figure's margin; how far beyond comfort does not matter.

    >>> margin(-7.5), margin(47.2), margin(None)
    ('−750 %', 'over 1000 %', '–')
    """
    if value is None:
        return "–"
    return "over 1000 %" if value > 10.0 else percent(value, sign=True)


def points(fraction: float) -> str:
    """A difference of fractions in percentage points.

    >>> points(-0.0458), points(0.5)
    ('−4.6', '+50')
    """
    value = float(f"{100.0 * fraction:.2g}")
    return f"{'−' if value < 0 else '+' if value > 0 else ''}{abs(value):g}"


def success_line(success: Success) -> str:
    """What a paired comparison shows, in plain words."""
    low, high = success.interval
    allowed = -100.0 * NON_INFERIORITY
    if success.ideal == 0.0 and success.hardware == 0.0:
        return ("Neither the ideal network nor the hardware reached the goal from any of these starts, so the "
                "comparison cannot show whether building the network costs anything.")  # fmt: skip
    if low >= NON_INFERIORITY:
        return (f"The hardware is not worse than the ideal network by more than {allowed:g} points: it reaches the "
                "goal as often, as far as this many starts can tell.")  # fmt: skip
    if high < 0.0:
        return (f"The hardware reaches the goal less often than the ideal network, by {abs(100 * high):.2g} to "
                f"{abs(100 * low):.2g} points.")  # fmt: skip
    text = (f"It is not shown that the hardware is good enough: from {success.n} starts, it may be up to "
            f"{abs(100 * low):.2g} points worse than the ideal network, and {allowed:g} are allowed.")  # fmt: skip
    needed = pairs_needed(success.only_hardware, success.only_ideal, success.n, NON_INFERIORITY)
    return f"{text} If it went on like this, {needed} starts would show it." if needed else text


def p_line(success: Success) -> str:
    """What McNemar's test says about this comparison."""
    split = success.only_ideal + success.only_hardware
    if split == 0:
        return "The two ended alike on every start."
    return (f"The two ended differently on {split} of {success.n} starts. If both were equally good, a split this "
            f"uneven or more would come up with probability {success.p:.2g}.")  # fmt: skip


def agreement_line(agreement: Agreement) -> str:
    """How the nominal hardware and the discrete network agree over the trial."""
    share = f"{percent(agreement.spike_agreement)} of spikes and {percent(agreement.action_agreement)} of actions equal"
    ties = "no tie" if agreement.ties == 0 else f"{agreement.ties} tie" + ("" if agreement.ties == 1 else "s")
    text = f"Side by side over {len(agreement.trial.actions)} timesteps: {share}, {ties}; the weights differ by "
    text += f"{agreement.worst_rms:.2g} at worst (root mean square)."
    if (first := agreement.first_divergence) is not None:
        text += f" They part at timestep {first.timestep}, step {first.step}, neuron {first.neuron}."
    return text


def outcome(trial: Trial) -> str:
    """How a trial ended."""
    ended = "reached the goal" if trial.solved else "did not reach the goal"
    bumps = f"{trial.bumps} bump" + ("" if trial.bumps == 1 else "s")
    return f"{ended}: {trial.timesteps} timesteps counted, {bumps}, fitness {trial.fitness:.5g}"


def count_line(statuses: list[str]) -> str:
    """How many figures have which status.

    >>> count_line(["PASS", "FAIL", "PASS"])
    '3 figures: 2 PASS, 1 FAIL'
    """
    found: Mapping[str, int] = {status: statuses.count(status) for status in STATUSES}
    shares = ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in found.items() if n)
    return f"{len(statuses)} figures: {shares}"
