"""The folder of a study: what it was asked, from which it can be gone on with on any machine that sees the folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, remove_temporaries, validate
from ohmloom.errors import FileFormatError
from ohmloom.mapping import Plan
from ohmloom.sim.run_folder import FORMAT, VERSION, claim
from ohmloom.sim.work import FAILED, UNITS

FILES = ("run.json", "plan.json", "report.json", "report.html")


class StudySettings(StrictModel):
    """What determines a study, beside network and hardware; `arena` has all constants of the world.

    Where `dies` is None, the study chooses.
    """

    network: str
    network_sha256: str
    hardware: str
    hardware_sha256: str
    seed: int
    dies: int | None
    starts: int
    study: Literal["default", "full"]
    task: str
    arena: dict[str, Any]


def claim_study(folder: Path, plan: Plan, settings: StudySettings) -> None:
    """Write what is asked into the folder, or check that the same was asked before; errors as of `claim`."""
    claim(
        folder, {"command": "evaluate", "settings": settings.model_dump()}, may_hold_others=True,
        tidy=lambda: remove_temporaries(folder, lambda name: name in FILES),
        begin=lambda: plan.save(folder / "plan.json"),
    )  # fmt: skip


def read_run(folder: Path) -> dict[str, Any]:
    """What ``run.json`` of an evolution or a study says, as plain values."""
    path = folder / "run.json"
    found = parse_json(read_bytes(path, "run"), str(path))
    check_format(found, str(path), FORMAT, VERSION)
    table: dict[str, Any] = found
    return table


def read_study(folder: Path) -> tuple[Plan, StudySettings]:
    """What is to be done in a folder that `claim_study` claimed.

    Raises
    ------
    MissingFileError, FileFormatError
        If it holds no study, or one of another network or hardware than its settings say.
    """
    path = folder / "run.json"
    settings = validate(StudySettings, read_run(folder).get("settings"), f"{path}: settings")
    plan = Plan.load(folder / "plan.json")
    if (plan.network.sha256, plan.hardware.sha256) != (settings.network_sha256, settings.hardware_sha256):
        raise FileFormatError(f"{folder / 'plan.json'}: expected the network and hardware of run.json, got others. "
                              "Delete it and evaluate again.")  # fmt: skip
    return plan, settings


@dataclass(frozen=True, kw_only=True)
class BatchStatus:
    """How much of a batch is done, and which units failed in all tries."""

    name: str
    done: int
    units: int
    failed: tuple[Path, ...]


def batches(folder: Path) -> list[BatchStatus]:
    """Every batch that was begun in a run folder, by the name of its folder."""
    found = []
    for path in sorted((folder / UNITS).glob("*/batch.json")):
        table: Mapping[str, Any] = parse_json(read_bytes(path, "batch", limit=None), str(path))
        items = table["items"]
        done = sum((path.parent / f"{item:06}.json").exists() for item in items)
        failed = tuple(sorted(path.parent.glob(f"*.{FAILED}")))
        found.append(BatchStatus(name=path.parent.name, done=done, units=len(items), failed=failed))
    return found
