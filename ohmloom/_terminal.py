"""What the command line needs of a terminal and of folders: progress, and places checked before any work is done."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ohmloom.errors import ParameterError


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def bars(names: dict[int, str], total: int, *, patience: float = 0.0) -> Iterator[Any]:
    """One progress bar per name on a terminal, else a line per fifth of the way; both on stderr.

    Yields a function of key, steps done, a note, and another total if it is known by then. With `patience`, nothing is
    shown to a file before so many seconds.
    """
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description:8}"), BarColumn(), TextColumn("{task.completed:.0f}/{task.total:.0f}"),
                   TimeRemainingColumn(), TextColumn("{task.fields[note]}"))  # fmt: skip
        with Progress(*columns, console=Console(stderr=True)) as progress:
            bars = {key: progress.add_task(name, total=total, note="") for key, name in names.items()}
            yield lambda key, done, note, total=None: progress.update(bars[key], completed=done, note=note, total=total)
        return
    shown: dict[int, int] = {}
    begin = time.monotonic()

    def line(key: int, done: int, note: str, whole: int | None = None) -> None:
        of = total if whole is None else whole
        fifth = 5 * done // max(of, 1)
        if (fifth > shown.get(key, 0) or done == of) and time.monotonic() - begin >= patience:
            shown[key] = fifth
            say(f"{names[key]}: {done} of {of}{', ' if note else ''}{note}")

    yield line


def study_folders(out: Path | None, nets: list[Path], hardware: list[str]) -> list[Path]:
    """A folder for each pair of network and spec, named after their files."""
    if out is None:
        return []
    if len(nets) * len(hardware) == 1:
        return [out]
    folders = [out / f"{_stem(net)}_{_stem(name)}" for net in nets for name in hardware]
    twice = next((folder for folder in folders if folders.count(folder) > 1), None)
    if twice is not None:
        raise ParameterError(f"--out: expected another name for every pair, got {twice.name} twice. Rename a file.")
    return folders


def _stem(path: Path | str) -> str:
    return Path(path).name.removesuffix(".json").removesuffix(".toml").removesuffix(".net")


def check_targets(targets: list[Path], inputs: list[Path]) -> None:
    """Refuse to write onto a file that is an input of the same command."""
    for target in targets:
        for source in inputs:
            if target.exists() and source.exists() and target.samefile(source):
                raise ParameterError(f"--out: expected to leave the input {source} alone, got a place where "
                                     f"{target.name} would replace it. Use another path.")  # fmt: skip


def check_folder(folder: Path) -> None:
    """Refuse a place that cannot be a folder before any work is done for it."""
    # A link that leads nowhere is there, and is no folder.
    inside = next((p for p in [folder, *folder.parents] if os.path.lexists(p)), Path())
    if inside.is_symlink() and not inside.exists():
        raise ParameterError(f"--out: expected a folder, got the broken link {inside}. Use another path.")
    if not inside.is_dir():
        raise ParameterError(f"--out: expected a folder, got the file {inside}. Use another path.")
    if not os.access(inside, os.W_OK):
        raise ParameterError(f"--out: expected a folder that can be written, got {inside}. Use another path.")
