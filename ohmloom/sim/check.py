"""Discrete against continuous: what is exact, and how far the specified hardware departs from the paper's rules."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ohmloom import __version__
from ohmloom._files import check_format, parse_json, read_bytes, write_atomic
from ohmloom.devices import LAWS
from ohmloom.errors import FileFormatError, ParameterError, expect_integer, expect_number
from ohmloom.mapping import EmulatedController, Hardware, Plan, place
from ohmloom.neurocontroller import Network
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.sim.agreement import Agreement, agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.exact_case import Case, Rule, exact_variant
from ohmloom.sim.exactness import exact_box
from ohmloom.sim.trial import draw_trial_key, run_trial

FORMAT, VERSION = "ohmloom.check", 1
AS_SPECIFIED = "as_specified"


@dataclass(frozen=True, kw_only=True)
class Scheme:
    """One way to write events, beside the paper's discrete model, on the nominal die.

    Attributes
    ----------
    worst_rms, final_rms
        By kind: root mean square difference of the weights over a trial on the same sensor stream, worst and final.
    at_bounds
        By plastic kind: fraction of time that devices stand at an end of their range.
    spike_agreement, action_agreement
        Fractions of neuron-steps and timesteps that are equal on that stream.
    first_divergence
        Timestep, step and neuron of the first spike that differs and is no tie, or None.
    lost, spurious, events
        Events asked for and not written, written and not asked for, and written, on that stream.
    closed_loop
        Where each drives its own robot from the same start: ``solved``, ``timesteps``, ``fitness`` of ``ideal`` and
        ``hardware``, and the fraction of equal actions up to the end of the shorter trial.
    """

    worst_rms: Mapping[str, float]
    final_rms: Mapping[str, float]
    at_bounds: Mapping[str, float]
    spike_agreement: float
    action_agreement: float
    first_divergence: Mapping[str, int] | None
    lost: int
    spurious: int
    events: int
    closed_loop: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Check:
    """Outcome of `check`.

    Attributes
    ----------
    exact
        Name -> whether it holds. All of them together are the verdict; divergence never is.
    not_applicable
        Name -> why the spec does not claim it.
    ties
        Steps in which rounding decided, by network entry of `exact`.
    schemes
        Name -> what it does: ``as_specified``, and the spec's cards driven by charge and by fixed voltage without
        wires.
    agreements
        The comparisons behind them; empty in a loaded check.
    provenance
        Version, digests, trial's key, perturbation.
    """

    exact: Mapping[str, bool]
    not_applicable: Mapping[str, str]
    ties: Mapping[str, int]
    schemes: Mapping[str, Scheme]
    agreements: Mapping[str, Agreement] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def passes(self) -> bool:
        """Whether all exact equivalences hold."""
        return all(self.exact.values())

    @property
    def divergence(self) -> dict[str, dict[str, float]]:
        """Scheme -> kind -> worst rms of the weights over the trial."""
        return {name: dict(scheme.worst_rms) for name, scheme in self.schemes.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain values; the object of ``check --json``."""
        return {
            "format": FORMAT, "version": VERSION, "passes": self.passes, "exact": dict(self.exact),
            "not_applicable": dict(self.not_applicable), "ties": dict(self.ties), "divergence": self.divergence,
            "schemes": {name: asdict(scheme) for name, scheme in self.schemes.items()},
            "provenance": dict(self.provenance),
        }  # fmt: skip

    def save(self, path: Path | str) -> None:
        """Write it as JSON, whole or not at all."""
        write_atomic(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def load(cls, path: Path | str) -> Check:
        """Read what `save` wrote, without the traces.

        Raises
        ------
        MissingFileError, FileFormatError
            If the file does not exist, or is no saved check.
        """
        where = str(path)
        table = check_format(parse_json(read_bytes(path, "check"), where), where, FORMAT, VERSION)
        try:
            return cls(
                exact=table["exact"], not_applicable=table["not_applicable"], ties=table["ties"],
                schemes={name: Scheme(**one) for name, one in table["schemes"].items()},
                provenance=table["provenance"],
            )  # fmt: skip
        except (AttributeError, KeyError, TypeError) as error:
            raise FileFormatError(f"{path}: expected a check saved by ohmloom, got {error}. Check again.") from error

    def plot(self, ax: Any = None) -> Any:
        """Draw the weights' rms difference over the trial, one line a scheme; needs the traces."""
        from matplotlib.figure import Figure

        axes = Figure(figsize=(7, 3.5)).add_subplot() if ax is None else ax
        for name, one in self.agreements.items():
            rms = np.sqrt(((one.emulated_weights - one.weights) ** 2).mean(axis=1)) if one.weights.size else []
            axes.plot(rms, label=name.replace("_", " "))
        axes.set_xlabel("timestep")
        axes.set_ylabel("rms difference of W")
        axes.set_title("Emulated beside the paper's discrete rule, same sensors")
        if self.agreements:
            axes.legend()
        return axes

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{name}</th><td>{'holds' if ok else 'DOES NOT HOLD'}</td></tr>"
                       for name, ok in self.exact.items())  # fmt: skip
        return f"<table><caption>Exact</caption>{rows}</table>"


def check(
    network: Network,
    hardware: Hardware,
    *,
    seed: int = 0,
    perturb: float = 0.0,
    arena: Arena | None = None,
    rule: Rule = stdp_sign,
    progress: Callable[[str], None] | None = None,
) -> Check:
    """Check the exact equivalences on the spec's own cards, and measure what its drive does beside the paper's rules.

    Parameters
    ----------
    network, hardware
        What is checked on what.
    seed
        Draws the trial's key.
    perturb
        Relative error of every event's charge: anything but 0 must fail, for the networks and for the pulses.
    arena
        The paper's arena of the network's task by default.
    rule
        ``rule(ls_pre, ls_post, stdp_threshold) -> sign`` that the waveform is held against; another one than eqs. 10
        and 11 turns the box red.
    progress
        Called with the name of what is done next.

    Raises
    ------
    MappingError
        If the network cannot be placed.
    ParameterError
        If `seed` is no integer >= 0 or `perturb` no number.
    """
    key = draw_trial_key(np.random.default_rng(expect_integer("check.seed", seed)))
    perturb = expect_number("check.perturb", perturb, "a number > -1, at most 1e6")
    if not -1.0 < perturb <= 1e6:
        raise ParameterError(f"check.perturb: expected a number > -1, at most 1e6, got {perturb}. Use 0.001 or so.")
    if arena is None:
        arena = Arena.paper(task="dynamic" if network.provenance.get("task") == "dynamic" else "static")
    plan = place(network, hardware)
    case = Case(plan=plan, trial_key=key, arena=arena, perturb=perturb, integrate=True, rule=rule)
    exact, skipped = exact_box(case, progress)
    ties: dict[str, int] = {name: getattr(case, name.removeprefix("network_")).ties
            for name in ("network_charge", "network_flux") if name in exact}  # fmt: skip
    agreements = {}
    for name, spec in _schemes(case).items():
        if progress is not None:
            progress(f"divergence {name}")
        agreements[name] = agreement(network, spec, arena=arena, trial_key=key, perturb=perturb)
    return Check(
        exact=exact, not_applicable=skipped, ties=ties, agreements=agreements,
        schemes={name: _scheme(plan, _schemes(case)[name], one, arena, perturb) for name, one in agreements.items()},
        provenance={
            "ohmloom": __version__, "network": network.name, "network_sha256": network.sha256,
            "hardware": hardware.name, "hardware_sha256": hardware.sha256, "seed": seed, "trial_key": key,
            "perturb": perturb, "task": arena.task,
        },
    )  # fmt: skip


def _schemes(case: Case) -> dict[str, Hardware]:
    schemes = {AS_SPECIFIED: case.hardware}
    if case.plastic:
        ideal = all(LAWS[device.law].flux is not None for device in case.plastic.values())
        schemes |= {mode: exact_variant(case.hardware, mode) for mode in ("charge_metered", "voltage")}
        if ideal:
            schemes["exact_width"] = exact_variant(case.hardware, "exact_width")
    return schemes


def _scheme(plan: Plan, spec: Hardware, one: Agreement, arena: Arena, perturb: float) -> Scheme:
    own = run_trial(
        EmulatedController(place(plan.network, spec).nominal(), perturb=perturb), arena, trial_key=one.trial.trial_key
    )
    shorter = min(len(own.actions), len(one.trial.actions))
    equal = float((own.actions[:shorter] == one.trial.actions[:shorter]).mean()) if shorter else 1.0
    ends = {
        name: {"solved": bool(trial.solved), "timesteps": trial.timesteps, "fitness": trial.fitness}
        for name, trial in (("ideal", one.trial), ("hardware", own))
    }
    return Scheme(
        worst_rms=one.worst_rms_of, final_rms=one.final_rms_of, at_bounds=one.at_bounds,
        spike_agreement=one.spike_agreement, action_agreement=one.action_agreement,
        first_divergence=None if one.first_divergence is None else asdict(one.first_divergence),
        lost=one.ledger.lost, spurious=one.ledger.spurious, events=one.ledger.events,
        closed_loop={**ends, "action_agreement": equal},
    )  # fmt: skip
