"""The verdict: would this network work on this hardware, and why (not)?"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from ohmloom import __version__
from ohmloom._files import check_format, parse_json, read_bytes, write_atomic
from ohmloom.errors import FileFormatError, UnknownNameError, expect_integer
from ohmloom.mapping import Hardware, Plan, place
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.sim import figures as f
from ohmloom.sim.agreement import Agreement, agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.corners import corner, run_corners
from ohmloom.sim.exact_case import Case
from ohmloom.sim.exactness import exact_box
from ohmloom.sim.inversion import Needs, requirements
from ohmloom.sim.lifetime import lifetime
from ohmloom.sim.sampling import NOT_SAMPLED, DieOutcome, sample_dies, start_key
from ohmloom.sim.sensitivity import screen
from ohmloom.sim.statistics import Success
from ohmloom.sim.study_files import StudySettings, claim_study
from ohmloom.sim.trial import Trial, run_trial
from ohmloom.sim.verdict import of_whole_trial, study_figures, study_verdict
from ohmloom.sim.work import Progress, Shard, Work, open_work
from ohmloom.sim.yield_study import yield_curves

STUDIES = ("default", "full")
EXACT_TIMESTEPS = 100  # at most, of the exact box: `check` runs the whole trial
QUICK_TIMESTEPS = 200  # at most, of the nominal die without sampling; what counts per trial is then scaled
DIES, WIRED_DIES, FAILED_DIES = 200, 96, 24
CURVE_DIES = {"default": 50, "full": 400}
Stage = Callable[[str, int, int], None]
NOT_MODELLED = (
    "sneak paths while lines float: idle lines are held at 0 V",
    "cells on a shared line that are programmed at the same instant, beyond their own wires",
    "capacitance of lines but for a settling time, and crosstalk",
    "self-heating, and temperature beyond one factor on drift and retention",
    "random telegraph noise and its spectra",
    "disabled devices with spreads of their own",
    "routing, clock and control logic",
)


@dataclass(frozen=True, kw_only=True)
class Feasibility:
    """Outcome of a study.

    Attributes
    ----------
    verdict
        PASS, MARGINAL or FAIL.
    reasons
        The binding figures, worst first, at most three, one sentence each; empty on PASS.
    figures
        All figures.
    success
        Closed-loop success on paired starts, or None if no die was sampled.
    exactness
        Name of an exact equivalence -> whether it holds on the nominal die.
    not_applicable
        Equivalences that this spec does not claim, each with the reason.
    not_modelled
        What this study leaves out.
    dies
        Outcome of every start of every sampled die.
    yield_
        Share of dies of which every synapse stands on a working device, by rate of faults, repair and spare lines: each
        with ``fault_rate``, ``repair`` (``none`` or ``permuted``), ``spare_rows``, ``spare_columns``, ``value``, Wilson
        ``interval``, ``n``. Empty without dies.
    corners
        Each with ``name``, ``description``, ``success``, ``figures``, ``verdict``;
        of a full study, like all that follows.
    sensitivity
        Morris screening, and Sobol indices of the leaders; see `ohmloom.sim.sensitivity`.
    requirements
        For figures that fail or are marginal: ``figure``, ``parameter``, ``unit``, ``now``, ``needed``, ``sentence``.
    lifetime
        Retention and wear after so many trials.
    ledger
        What the nominal die spent, by the names of `Ledger`.
    plan, agreement, hardware_trial
        What was placed where; the discrete and the emulated controller side by side; one sampled die's trial on the
        same start. None in a loaded study.
    provenance
        Version, seed, dies and digests of the inputs.
    """

    verdict: str
    reasons: tuple[str, ...]
    figures: tuple[f.Figure, ...]
    success: Success | None
    exactness: Mapping[str, bool]
    not_applicable: Mapping[str, str]
    not_modelled: tuple[str, ...] = NOT_MODELLED
    dies: tuple[DieOutcome, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    ledger: Mapping[str, Any] | None = None
    yield_: tuple[Mapping[str, Any], ...] = ()
    corners: tuple[Mapping[str, Any], ...] = ()
    sensitivity: Mapping[str, Any] | None = None
    requirements: tuple[Mapping[str, Any], ...] = ()
    lifetime: tuple[Mapping[str, Any], ...] | None = None
    plan: Plan | None = None
    agreement: Agreement | None = None
    hardware_trial: Trial | None = None

    def to_dict(self) -> dict[str, Any]:
        """Everything but plan and traces, as plain values; the object of ``evaluate --json``."""
        return {
            "format": "ohmloom.feasibility", "version": 1, "verdict": self.verdict, "reasons": list(self.reasons),
            "figures": [asdict(figure) for figure in self.figures],
            "success": None if self.success is None else asdict(self.success), "exactness": dict(self.exactness),
            "not_applicable": dict(self.not_applicable), "not_modelled": list(self.not_modelled),
            "dies": [asdict(die) for die in self.dies], "ledger": self.ledger,
            "yield_": list(self.yield_), "corners": list(self.corners), "sensitivity": self.sensitivity,
            "requirements": list(self.requirements),
            "lifetime": None if self.lifetime is None else list(self.lifetime),
            "provenance": dict(self.provenance),
        }  # fmt: skip

    def save(self, path: Path | str) -> None:
        """Write the study as JSON, whole or not at all."""
        write_atomic(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def load(cls, path: Path | str) -> Feasibility:
        """Read what `save` wrote, without plan and traces."""
        where = str(path)
        table = check_format(parse_json(read_bytes(path, "feasibility"), where), where, "ohmloom.feasibility", 1)
        try:
            saved: dict[str, Any] | None = table["success"]
            success = None if saved is None else Success(**{k: _tuple(v) for k, v in saved.items()})
            return cls(
                verdict=table["verdict"], reasons=tuple(table["reasons"]),
                figures=tuple(f.Figure(**figure) for figure in table["figures"]), success=success,
                exactness=table["exactness"], not_applicable=table["not_applicable"],
                not_modelled=tuple(table["not_modelled"]), dies=tuple(DieOutcome(**die) for die in table["dies"]),
                ledger=table["ledger"], provenance=table["provenance"], yield_=tuple(table["yield_"]),
                corners=tuple(table["corners"]), sensitivity=table["sensitivity"],
                requirements=tuple(table["requirements"]), lifetime=_tuple(table["lifetime"]),
            )  # fmt: skip
        except (KeyError, TypeError) as error:
            raise FileFormatError(f"{path}: expected a study saved by ohmloom, got {error}. Evaluate again.") from error

    def _repr_html_(self) -> str:
        from html import escape

        rows = "".join(
            f"<tr><td>{figure.name}</td><td>{figure.value}</td><td>{figure.limit}</td><td>{figure.status}</td></tr>"
            for figure in self.figures
        )
        reasons = "".join(f"<li>{escape(reason)}</li>" for reason in self.reasons)
        return f"<b>{self.verdict}</b><ul>{reasons}</ul><table>{rows}</table>"


def feasibility(
    network: Network,
    hardware: Hardware,
    *,
    dies: int | None = None,
    seed: int = 0,
    starts: int = 1,
    study: Literal["default", "full"] = "default",
    workers: int = 1,
    engine: str = "processes",
    address: str | None = None,
    out: Path | str | None = None,
    shard: Shard | None = None,
    arena: Arena | None = None,
    progress: Progress | None = None,
    stage: Stage | None = None,
) -> Feasibility:
    """Evaluate a network on hardware.

    Parameters
    ----------
    network, hardware
        What to build, and of what.
    dies
        Sampled pieces of hardware, each tried from starts of its own beside the ideal controller. 0 gives the
        figures without sampling; None lets `default_dies` choose.
    seed
        Every start and every die follows from it.
    starts
        Starts of each die. With several, dies are what was sampled, and intervals come from a bootstrap over them.
    study
        ``full`` adds corners, sensitivity, requirements and lifetime.
    workers, engine, address
        How many share the work: ``processes`` of this machine, or the workers of a ``dask`` cluster, which is one of
        this machine unless `address` says where it is. They do not change the result.
    out
        Folder in which the outcome of every unit of work is kept, so that the same call goes on where one was stopped.
    shard
        What to do first, where several drivers share `out`.
    arena
        The paper's arena of the network's task by default.
    progress
        Called with the number of dies done and of all.
    stage
        Called with the name of a part of a full study, how much of it is done, and all of it.

    Raises
    ------
    MappingError
        If the network cannot be placed.
    ParameterError
        If `dies` or `seed` is negative, `starts` or `workers` is not positive.
    UnknownNameError
        If there is no such `study` or `engine`.
    SettingsConflictError
        If `out` holds a study of something else; names the first field that differs.
    OperationError
        If a unit of work fails again and again, or a file cannot be written; what is done is kept in `out`.
    Interrupted, KeyboardInterrupt
        After Ctrl-C; the first if what is done is kept.
    """
    if dies is not None:
        expect_integer("feasibility.dies", dies)
    expect_integer("feasibility.seed", seed)
    expect_integer("feasibility.starts", starts, 1)
    expect_integer("feasibility.workers", workers, 1)
    if study not in STUDIES:
        raise UnknownNameError.of("feasibility.study", study, list(STUDIES))
    if arena is None:
        arena = Arena.paper(task="dynamic" if network.provenance.get("task") == "dynamic" else "static")
    plan = place(network, hardware)
    constants = json.loads(json.dumps(arena.settings()))
    settings = StudySettings(
        network=network.name, network_sha256=network.sha256, hardware=hardware.name, hardware_sha256=hardware.sha256,
        seed=seed, dies=dies, starts=starts, study=study, task=arena.task, arena=constants,
    )  # fmt: skip
    folder = None if out is None else Path(out)
    if folder is not None:
        claim_study(folder, plan, settings)
    with open_work(workers=workers, engine=engine, address=address, folder=folder, shard=shard) as work:
        return _study(plan, arena, settings, work, progress, stage)


def default_dies(hardware: Hardware, nominal: tuple[f.Figure, ...]) -> int:
    """Dies of a study that asks for no number, so that it takes about two minutes.

    Without wires 200. Where every step has to solve the potentials of wires, 96: hardly fewer can show with a margin
    that hardware keeps the ideal controller's success, since without a pair that differs it takes 93; but where a
    figure of the nominal die FAILs, and so the verdict, 24.
    """
    if hardware.wires.is_ideal:
        return DIES
    return FAILED_DIES if any(figure.status == f.FAIL for figure in nominal) else WIRED_DIES


def _study(
    plan: Plan, arena: Arena, settings: StudySettings, work: Work, progress: Progress | None, stage: Stage | None
) -> Feasibility:
    network, hardware, dies, seed = plan.network, plan.hardware, settings.dies, settings.seed
    key = start_key(seed, 0)
    seen = _cut(arena, QUICK_TIMESTEPS) if dies == 0 else arena
    check = agreement(network, hardware, arena=seen, die=plan.nominal(), trial_key=key)
    whole = len(run_trial(SpikingController(network), arena, trial_key=key).actions)
    # By closed forms: `check` follows the differential equations too.
    exactness, not_applicable = exact_box(Case(plan=plan, trial_key=key, arena=_cut(arena, EXACT_TIMESTEPS)))
    if dies is None:
        nominal = () if hardware.wires.is_ideal else study_figures(plan, check, NOT_SAMPLED, seed=seed, whole=whole)
        dies = default_dies(hardware, nominal)
    sampled = sample_dies(plan, arena, dies=dies, seed=seed, starts=settings.starts, work=work, progress=progress)
    is_full = settings.study == "full"
    screened = screen(plan, arena, seed=seed, work=work, progress=_named("sensitivity", stage)) if is_full else None
    found = study_figures(plan, check, sampled, seed=seed, whole=whole, screened=screened)
    verdict, reasons = study_verdict(found, exactness)
    curves = yield_curves(plan, dies=CURVE_DIES[settings.study], seed=seed, work=work) if dies else ()
    corners: tuple[Mapping[str, Any], ...] = ()
    needs: tuple[Mapping[str, Any], ...] = ()
    if is_full:
        typical = corner("typical", "the spec as it is", found, sampled.success, verdict)
        others = run_corners(
            network, hardware, arena, dies=dies, seed=seed, work=work, progress=_named("corners", stage)
        )
        corners = (typical, *others)
        needs = requirements(
            found, Needs(plan=plan, arena=arena, seed=seed, check=check, sampled=sampled, whole=whole, work=work)
        )
    return Feasibility(
        verdict=verdict, reasons=reasons, figures=found, success=sampled.success, exactness=exactness,
        not_applicable=not_applicable, dies=sampled.outcomes, ledger=asdict(check.ledger), plan=plan, agreement=check,
        hardware_trial=sampled.first_trial, yield_=tuple(point.to_dict() for point in curves), corners=corners,
        sensitivity=screened, requirements=needs,
        lifetime=lifetime(plan, of_whole_trial(check, whole)) if is_full else None,
        provenance={"ohmloom": __version__, **settings.model_dump(exclude={"arena"}), "dies": dies},
    )  # fmt: skip


def _cut(arena: Arena, timesteps: int) -> Arena:
    return arena.replace(max_timesteps=min(timesteps, arena.max_timesteps))


def _named(name: str, stage: Stage | None) -> Progress | None:
    return None if stage is None else lambda done, whole: stage(name, done, whole)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
