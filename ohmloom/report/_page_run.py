"""The sampled die whose trial a report shows, run once more with everything written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.mapping import EmulatedController
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.report._replay_data import Recording
from ohmloom.sim import Arena, Feasibility, Trial, run_trial

Counter = Callable[[], tuple[int, ...]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One controller's trial.

    Attributes
    ----------
    recording, arena
        What the replay shows.
    events
        (timestep, count): events so far. Of the ideal network: those of its rule. Of a die: asked for by the rule on
        the same spikes, written, lost, spurious.
    """

    recording: Recording
    arena: Arena
    events: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class DieRun(Run):
    """A die's trial.

    Attributes
    ----------
    die
        Its number in the study.
    pulses, conductances, weights
        (synapse,) of each device at the end: pulses that it had, conductance [S], weight.
    """

    die: int
    pulses: IntArray
    conductances: FloatArray
    weights: FloatArray


def arena_of(trial: Trial) -> Arena:
    """The arena that a trial was run in."""
    settings = trial.provenance.get("arena")
    return Arena.paper() if settings is None else Arena(**settings)


def ideal_run(study: Feasibility) -> Run | None:
    """The ideal network's trial, or None in a study that was loaded."""
    if study.plan is None or study.agreement is None:
        return None
    controller = SpikingController(study.plan.network)
    trial, weights, spikes, events = _recorded(controller, study.agreement.trial, lambda: (sum(controller.events),))
    recording = _recording(study.plan.network, study.plan.network.name, trial, weights, spikes)
    return Run(recording=recording, arena=arena_of(study.agreement.trial), events=events)


def die_run(study: Feasibility) -> DieRun | None:
    """The trial of the study's first die, or None if none was sampled or the study was loaded."""
    plan, known = study.plan, study.hardware_trial
    if plan is None or known is None:
        return None
    number = study.dies[0].die
    controller = EmulatedController(plan.sample(seed=int(study.provenance["seed"]), die=number))

    def counts() -> tuple[int, ...]:
        ledger = controller.ledger
        return ledger.ideal_events, ledger.events, ledger.lost, ledger.spurious

    trial, weights, spikes, events = _recorded(controller, known, counts)
    recording = _recording(plan.network, f"{plan.network.name} on {plan.hardware.name}", trial, weights, spikes)
    return DieRun(
        recording=recording, arena=arena_of(known), events=events, die=number, pulses=controller.pulses,
        conductances=controller.conductances, weights=controller.weights,
    )  # fmt: skip


def _recording(network: Network, name: str, trial: Trial, weights: FloatArray, spikes: IntArray) -> Recording:
    labels = network.labels()
    return Recording(
        trial=trial, weights=weights, spikes=spikes, network_name=name, neuron_labels=tuple(labels),
        synapse_labels=tuple(f"{labels[s.pre]} → {labels[s.post]}" for s in network.synapses),
        synapse_kinds=tuple(s.kind for s in network.synapses),
    )  # fmt: skip


def _recorded(
    controller: SpikingController | EmulatedController, known: Trial, counts: Counter
) -> tuple[Trial, FloatArray, IntArray, IntArray]:
    """A trial of the study again: the trial, weights, spikes and counts after each timestep."""
    weights, spikes, events = [], [], []

    def record(_: int) -> None:
        weights.append(controller.weights)
        spikes.append(controller.spike_counts)
        events.append(counts())

    trial = run_trial(controller, arena_of(known), trial_key=known.trial_key, on_timestep=record)
    # The page shows the study, not another trial.
    assert np.array_equal(trial.path, known.path), "the trial of a study, run again, took another path"
    return trial, np.array(weights), np.array(spikes), np.array(events)
