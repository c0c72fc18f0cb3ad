"""The report of a feasibility study: one HTML file that opens by double click and asks nothing of the network."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ohmloom._files import write_atomic
from ohmloom.report import _page_maps as maps
from ohmloom.report import _page_pictures as pictures
from ohmloom.report import _page_tables as tables
from ohmloom.report import _page_words as words
from ohmloom.report._page_run import DieRun, Run, die_run, ideal_run
from ohmloom.report._page_study import study_context
from ohmloom.report._replay_data import ACTIONS
from ohmloom.report._replay_page import json_text, kind_legend, render, replay_data, template
from ohmloom.sim import Feasibility, Trial

MOST_WEIGHTS: Final = 400  # rows of weights in a replay, so that a trial of 4000 timesteps keeps the file small
CONTENTS: Final = {
    "figures": "Figures", "requirements": "Requirements", "replay": "Arena", "success": "Success", "yield": "Yield",
    "corners": "Corners", "sensitivity": "Sensitivity", "lifetime": "Lifetime", "crossbars": "Crossbars",
    "weights": "Weights", "exactness": "Exactness", "assumed": "Assumed", "spec": "Spec", "cards": "Devices",
    "not-modelled": "Not modelled", "reproduce": "Reproduce",
}  # fmt: skip


def write_report(study: Feasibility, path: Path | str, *, command: str) -> None:
    """Write the report: verdict and reasons, figures, replay, success, curves, crossbars, exactness, sources.

    Style, script and pictures are inside the file. The same study and command give the same bytes with the same
    matplotlib. The trial of the study's first die is run once more, for what a study does not keep of it.

    Parameters
    ----------
    study
        From `feasibility`; one that was loaded from a file has no pictures and no spec, and the report says so.
    path
        Where to; replaced as a whole.
    command
        The command line that makes the study again, shown as text.

    Raises
    ------
    OperationError
        If the file cannot be written.
    """
    write_atomic(path, report_page(study, command=command))


def report_page(study: Feasibility, *, command: str, runs: tuple[Run | None, DieRun | None] | None = None) -> str:
    """Compose the page that `write_report` writes; `runs`, the ideal and the die's, saves running these again."""
    from markupsafe import Markup

    ideal, die = (ideal_run(study), die_run(study)) if runs is None else runs

    scripts = [template(name) for name in ("replay_draw.js", "replay.js", "report.js")]
    page = render(
        "report.html",
        style=Markup(template("report.css") + template("replay_parts.css")),
        scripts=[Markup(script) for script in scripts],
        script_hashes=Markup(" ".join(_hash(script) for script in scripts)),
        **_context(study, command),
        **_replay(study, ideal, die),
        **_maps(study, die),
    )
    # A name that came from a file's may hold bytes that no text file can.
    return page.encode(errors="replace").decode()


def _hash(script: str) -> str:
    """Source for the page's policy: this script may run, and no other."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _context(study: Feasibility, command: str) -> dict[str, Any]:
    given = study.provenance
    names = [figure.name for figure in study.figures]
    hardware = study.plan.hardware if study.plan is not None else None
    used = {tile.kind for tile in study.plan.tiles} if study.plan is not None else set()
    devices = {kind: device for kind, device in hardware.devices.items() if kind in used} if hardware else {}
    more = study_context(study, study.to_dict())
    return {
        "network": given.get("network", "network"), "hardware": given.get("hardware", "hardware"),
        "task": given.get("task", "unknown"), "dies": given.get("dies", 0), "given": given, "command": command,
        "verdict": study.verdict, "verdict_line": words.verdict_line(study),
        "reasons": [_split(reason, names) for reason in study.reasons],
        "count_line": words.count_line([figure.status for figure in study.figures]),
        "figures": [tables.figure_row(figure) for figure in study.figures], "statuses": words.STATUSES,
        "success": study.success, "success_rows": tables.success_rows(study),
        "success_line": words.success_line(study.success) if study.success else "",
        "p_line": words.p_line(study.success) if study.success else "",
        "exactness": [(name, words.EXACTNESS.get(name, ""), holds) for name, holds in study.exactness.items()],
        "not_applicable": dict(study.not_applicable),
        "agreement_line": words.agreement_line(study.agreement) if study.agreement else "",
        "weights": pictures.weights(study),
        "plan": study.plan, "spec": tables.spec_rows(hardware) if hardware else [],
        "description": hardware.description if hardware else "",
        "assumed": tables.assumed_rows(hardware, devices) if hardware else [],
        "cards": [tables.card(kind, device) for kind, device in devices.items()],
        "unused": [device.name for kind, device in hardware.devices.items() if kind not in used] if hardware else [],
        "not_modelled": study.not_modelled, "contents": _contents(more), **more,
    }  # fmt: skip


def _contents(more: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Sections of this page, in their order."""
    absent = {name for name in ("requirements", "corners", "sensitivity", "lifetime") if not more[name]}
    absent |= set() if more["yield_rows"] else {"yield"}
    return [(key, name) for key, name in CONTENTS.items() if key not in absent]


def _replay(study: Feasibility, ideal: Run | None, die: DieRun | None) -> dict[str, Any]:
    runs: list[tuple[str, str, Run, Trial]] = []
    if ideal is not None and study.agreement is not None:
        runs.append(("Ideal network", "ideal", ideal, study.agreement.trial))
    if die is not None and study.hardware_trial is not None:
        runs.append((f"Hardware, die {die.die}", f"die {die.die}", die, study.hardware_trial))
    events = pictures.events(ideal, die)
    return {
        "sides": [
            {"name": name, "short": short, "outcome": words.outcome(trial),
             "kinds": kind_legend(run.recording)}
            for name, short, run, trial in runs
        ],
        "actions": ACTIONS, "last_row": max((run.recording.timesteps for _, _, run, _ in runs), default=0),
        "replay_data": [
            _markup(json_text(replay_data(run.recording, run.arena, most_weights=MOST_WEIGHTS, is_deflated=True)))
            for _, _, run, _ in runs
        ],
        "paths": pictures.paths(study), "events": None if events is None else events[0],
        "events_caption": "" if events is None else events[1],
    }  # fmt: skip


def _maps(study: Feasibility, die: DieRun | None) -> dict[str, Any]:
    known = maps.device_values(study, die)
    return {
        "tiles": maps.tiles(study, known), "maps": _markup(json_text(maps.hover(study, known))),
        "worst": maps.worst_rows(study, known), "has_drop": known is not None and bool(known.error.any()),
    }  # fmt: skip


def _markup(text: str) -> Any:
    from markupsafe import Markup

    return Markup(text)


def _split(reason: str, names: list[str]) -> tuple[str, str]:
    """The figure's name at the start of a reason, if there is one, and the rest."""
    name = next((name for name in names if reason.startswith(name)), "")
    return name, reason.removeprefix(name)
