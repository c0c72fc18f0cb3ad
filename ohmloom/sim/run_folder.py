"""A run folder belongs to one set of settings: the same ones resume it, others are refused by name."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ohmloom import __version__
from ohmloom._files import check_format, parse_json, read_bytes, write_atomic
from ohmloom.errors import SettingsConflictError

FORMAT, VERSION = "ohmloom.run", 2  # of run.json, whose `command` says what was run


def claim(
    folder: Path,
    contents: Mapping[str, Any],
    *,
    tidy: Callable[[], None] = lambda: None,
    begin: Callable[[], None] = lambda: None,
    may_hold_others: bool = False,
) -> None:
    """Make `folder` a run folder of these contents, or see that it is one.

    `tidy` removes half-written files of a run, `begin` writes what a new one needs before ``run.json`` says that it is
    one; `may_hold_others` allows a folder with other files.

    Raises
    ------
    SettingsConflictError
        If it holds a run with other contents (names the first that differs), or other files where that may not be.
    FileFormatError
        If its ``run.json`` is not of this format and version.
    """
    path = folder / "run.json"
    wanted: dict[str, Any] = {"format": FORMAT, "version": VERSION, "ohmloom": __version__, **contents}
    if os.path.exists(path):
        found = parse_json(read_bytes(path, "run"), str(path))
        check_format(found, str(path), FORMAT, VERSION)
        tidy()
        difference = _first_difference(found, json.loads(json.dumps(wanted)))
        if difference:
            raise SettingsConflictError(f"{path}: {difference}. Use another --out, or the settings of that run.")
        return
    if os.path.exists(folder):
        if not folder.is_dir():
            raise SettingsConflictError(f"{folder}: expected a new folder or a run folder, got a file. "
                                        "Use another --out.")  # fmt: skip
        leftover = re.compile(r"\.run\.json\.[a-z0-9_]{8}")  # of a write of run.json that was killed
        if not may_hold_others and any(not leftover.fullmatch(entry.name) for entry in folder.iterdir()):
            raise SettingsConflictError(f"{folder}: expected a new folder or a run folder, "
                                        "got one with other files. Use another --out.")  # fmt: skip
        tidy()
    begin()
    write_atomic(path, json.dumps(wanted, indent=1) + "\n")


def _first_difference(found: Any, wanted: Any, field: str = "") -> str | None:
    """First field in which two JSON values differ, with both values, or None."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in [*wanted, *(k for k in found if k not in wanted)]:
            name = f"{field}.{key}" if field else key
            if key not in found or key not in wanted:
                return f"{name}: expected {wanted.get(key)!r}, got {found.get(key)!r}"
            deeper = _first_difference(found[key], wanted[key], name)
            if deeper:
                return deeper
        return None
    return None if found == wanted else f"{field}: expected {wanted!r}, got {found!r}"
