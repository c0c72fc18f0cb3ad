"""From what a die and sampled dies did to figures, and from figures to a verdict with its reasons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from ohmloom.mapping import Ledger, Plan
from ohmloom.sim import figures as f
from ohmloom.sim import figures_array as array
from ohmloom.sim import figures_behaviour as behaviour
from ohmloom.sim import figures_cost as cost
from ohmloom.sim.agreement import Agreement
from ohmloom.sim.sampling import Sampled
from ohmloom.sim.writing import writing_divergence

# Each of these has the margin of another figure: the power, and the endurance.
OTHER_FORMS = ("energy_per_timestep", "pulses_per_device")
NEVER_BINDING = ("sensitivity",)
# Causes come before symptoms: what is wrong on the nominal die, then what spreads do to thresholds, disturbs and yield,
# then what follows from all of it. Weights diverge because events are lost, and trials fail because weights diverge.
DEPTH = {"threshold_margin": 1, "disturb": 1, "yield": 1, "weight_divergence": 2, "closed_loop_success": 2}


def study_figures(
    plan: Plan,
    check: Agreement,
    sampled: Sampled,
    *,
    seed: int,
    whole: int | None = None,
    screened: Mapping[str, Any] | None = None,
) -> tuple[f.Figure, ...]:
    """All figures of a study, in the order in which they are shown.

    Parameters
    ----------
    plan, check, sampled
        What is placed where; the nominal die; the sampled ones.
    seed
        Of sampled yield.
    whole
        Timesteps of the whole trial, where `check` saw only its beginning.
    screened
        What `ohmloom.sim.sensitivity.screen` found.
    """
    nominal = of_whole_trial(check, whole)
    hardware = plan.hardware
    ledgers = all_ledgers(check, sampled, whole)
    counted = sampled.ledgers or (check.ledger,)
    found = (
        behaviour.event_fidelity(
            hardware, sum(one.lost for one in counted), sum(one.spurious for one in counted),
            sum(one.ideal_events for one in counted), len({one.die for one in sampled.outcomes}),
        ),
        behaviour.weight_divergence(check, writing_divergence(plan.nominal(), check.trial.sensors)),
        array.threshold_margin(hardware, nominal),
        array.read_error(hardware, plan),
        array.disturb(hardware, plan, nominal, check.spikes),
        array.wake_up(hardware, check.disabled_weights),
        array.useful_event_range(hardware, plan),
        cost.time_per_step(hardware, ledgers),
        cost.programming_power(hardware, ledgers),
        cost.energy_per_timestep(hardware, ledgers),
        cost.pulses_per_device(hardware, ledgers),
        cost.endurance(hardware, ledgers),
        array.yield_(hardware, plan, seed=seed, dies=len(sampled.outcomes)),
        behaviour.sensitivity(screened),
        behaviour.closed_loop_success(hardware, sampled.success),
    )  # fmt: skip
    return tuple(f.capped_by_cards(figure, plan) for figure in found)


def all_ledgers(check: Agreement, sampled: Sampled, whole: int | None = None) -> dict[str, Ledger]:
    """What the nominal and the sampled dies spent in a trial, by names for people."""
    names = [f"die {one.die}" + (f", start {one.start}" if one.start else "") for one in sampled.outcomes]
    seen = len(check.trial.actions)
    nominal = "the nominal die" + (f" (scaled from {seen} timesteps)" if whole is not None and whole > seen else "")
    return {nominal: of_whole_trial(check, whole), **dict(zip(names, sampled.ledgers, strict=True))}


def of_whole_trial(check: Agreement, whole: int | None) -> Ledger:
    """What the nominal die spends in a trial of so many timesteps, if it goes on as it began."""
    ledger, seen = check.ledger, len(check.trial.actions)
    if whole is None or whole <= seen:
        return ledger
    scaled = {
        name: type(value)(value * whole / seen)
        for name, value in asdict(ledger).items()
        if not name.endswith("_time")
    }  # fmt: skip
    return replace(ledger, **scaled)


def study_verdict(found: tuple[f.Figure, ...], exactness: Mapping[str, bool]) -> tuple[str, tuple[str, ...]]:
    """PASS, MARGINAL or FAIL, and the binding figures in a sentence each, at most three."""
    broken = [name for name, holds in exactness.items() if not holds]
    if broken:
        return f.FAIL, (f"exactness: {', '.join(broken)} does not hold, so the study is void.",)
    rank = {f.FAIL: 0, f.MARGINAL: 1, f.NOT_RUN: 2, f.ASSUMED: 3}
    binding = sorted(
        (figure for figure in found if figure.status in rank and figure.name not in NEVER_BINDING),
        key=lambda figure: (
            rank[figure.status],
            DEPTH.get(figure.name, 0) if figure.status == f.FAIL else 0,
            figure.margin if figure.margin is not None else 0.0,
        ),
    )
    if not binding:
        return f.PASS, ()
    verdict = f.FAIL if binding[0].status == f.FAIL else f.MARGINAL
    # What only leaves a doubt is no reason for a FAIL, and the other form of one figure is no second reason.
    reasons = [
        figure
        for figure in binding
        if (verdict == f.MARGINAL or figure.status == f.FAIL) and figure.name not in OTHER_FORMS
    ]
    return verdict, tuple(figure.sentence for figure in reasons[:3])
