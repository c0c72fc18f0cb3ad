"""A process of its own for everything that runs an FMU's native code: limited, timed, and cleaned up after."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Protocol

from ohmloom.errors import OperationError


class Unpackable(Protocol):
    """An FMU's archive, or a system's."""

    @property
    def path(self) -> Path: ...

    def extract(self, folder: Path) -> None: ...


MEMORY = 4_000_000_000  # bytes of address space; Python with its libraries needs 1.5e9
TIMEOUT = 60.0  # s


def run_probe(
    archive: Unpackable, what: str, options: dict[str, Any], *, timeout: float = TIMEOUT, memory: int = MEMORY
) -> dict[str, Any]:
    """What `_probe` finds out about an FMU in a process of its own.

    The FMU is unpacked into a temporary folder, where the process also puts its own temporary files; the folder is gone
    afterwards, however the process ends.

    Raises
    ------
    OperationError
        If the process crashes, takes longer than `timeout` in s, or finds the FMU at fault; it names the cause.
    FileFormatError
        If the archive is damaged.
    """
    with tempfile.TemporaryDirectory(prefix="ohmloom-fmu-") as folder:
        place = Path(folder)
        archive.extract(place / "fmu")
        question = {"what": what, "file": str(archive.path.resolve()), "folder": str(place / "fmu"), "memory": memory,
                    "answer": str(place / "answer.json"), **options}  # fmt: skip
        (place / "tmp").mkdir()
        (place / "question.json").write_text(json.dumps(question))
        environment = {**os.environ, "TMPDIR": str(place / "tmp"), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        with open(place / "errors.txt", "wb") as errors:
            child = subprocess.Popen(
                [sys.executable, "-P", str(Path(__file__).with_name("_probe.py")), str(place / "question.json")],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, env=environment, cwd=place,
                start_new_session=True,
            )  # fmt: skip
            try:
                child.wait(timeout)
            except subprocess.TimeoutExpired as error:
                raise OperationError(f"{archive.path}: expected {what} within {timeout:g} s, got no end. "
                                     "The FMU may loop for ever; or give it more time.") from error  # fmt: skip
            finally:
                # Whatever the FMU may have started goes with it; an own session makes it a group.
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(child.pid, signal.SIGKILL)
                child.wait()
        if child.returncode < 0:
            name = signal.Signals(-child.returncode).name
            raise OperationError(f"{archive.path}: expected {what} to end, got a crash ({name}) inside the FMU. "
                                 "Ask its maker.")  # fmt: skip
        if child.returncode or not (place / "answer.json").exists():
            raise OperationError(f"{archive.path}: expected {what} to end, got {last_line(place / 'errors.txt')}. "
                                 "Ask the FMU's maker.")  # fmt: skip
        answer: dict[str, Any] = json.loads((place / "answer.json").read_text())
    if "problem" in answer:
        raise OperationError(f"{archive.path}: expected {what} to succeed, got {answer['problem']}. Check the FMU.")
    return answer


def last_line(path: Path) -> str:
    lines = path.read_text(errors="replace").strip().splitlines()
    return lines[-1][:300].rstrip(".") if lines else "an exit without a word"
