"""An FMU that runs in a process of its own, kept for as many runs as one likes."""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from ohmloom.errors import OperationError, ParameterError, UnknownNameError, expect_number
from ohmloom.fmu._archive import open_archive
from ohmloom.fmu._process import MEMORY, TIMEOUT, last_line
from ohmloom.fmu.run import check_value

Values = dict[str, Any]


class Host:
    """An FMU for co-simulation, stepped by hand; close it, or use it in a ``with``.

    The file is unpacked once, into a temporary folder, and its library loaded in a process of its own; `reset` begins
    another run. The caller survives whatever the FMU does, and nothing is left on disk once it is closed. The file's
    native code runs with your rights: host only what you trust.

    Parameters
    ----------
    file
        The FMU, of version 2.0 or 3.0.
    start_values
        By name of parameter or input, for every run; `reset` may give others.
    timeout
        Of each call, in s.
    memory
        Of the process, in bytes of address space.

    Raises
    ------
    MissingFileError, FileFormatError
        If the file is no FMU for co-simulation that can run here.
    ParameterError, UnknownNameError
        If a start value is none of those that the FMU has, or out of its range.
    OperationError
        If the FMU fails, crashes, takes too long or wants too much memory.
    """

    def __init__(
        self,
        file: Path | str,
        *,
        start_values: Mapping[str, float] | None = None,
        timeout: float = TIMEOUT,
        memory: int = MEMORY,
    ) -> None:
        archive = open_archive(file)
        archive.library("CoSimulation")
        if not expect_number("Host: timeout", timeout) > 0.0:
            raise ParameterError(f"Host: timeout: expected a time above 0 s, got {timeout:g}. Correct it.")
        self.path, self.timeout = archive.path, float(timeout)
        self._place = Path(tempfile.mkdtemp(prefix="ohmloom-host-"))
        self._processes: list[subprocess.Popen[bytes]] = []
        self._end = weakref.finalize(self, _clean, self._processes, self._place)
        try:
            archive.extract(self._place / "fmu")
            self._child = _spawn(self._place, memory)
            self._processes.append(self._child)
            answer = self._ask({"describe": True})
            self.variables: dict[str, Values] = {v["name"]: v for v in answer["variables"]}
            self.dependencies: dict[str, list[str] | None] = answer["dependencies"]
            self.step_size: float | None = answer["step_size"]
            self.stop_time: float | None = answer["stop_time"]
            self.time = 0.0
            self._start_values = dict(start_values or {})
            self.reset()
        except BaseException:
            self.close()
            raise

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(name for name, v in self.variables.items() if v["causality"] == "input")

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(name for name, v in self.variables.items() if v["causality"] == "output")

    def reset(self, start_values: Mapping[str, float] | None = None, *, time: float = 0.0) -> None:
        """Begin another run at `time` in s, with the start values given here over those of the constructor."""
        values = self._checked({**self._start_values, **(start_values or {})})
        self._ask({"start": values, "time": time})
        self.time = time

    def set(self, values: Mapping[str, float]) -> None:
        """Set inputs, and parameters that are tunable; of an array all elements, or one number for each."""
        self._ask({"set": self._checked(values)})

    def get(self, names: Iterable[str]) -> Values:
        """Values of variables by name."""
        return self._values({"get": self._known(names)})

    def step(self, length: float, values: Mapping[str, float] | None = None, get: Iterable[str] = ()) -> Values:
        """Set `values`, go on by `length` in s, and read the variables `get`, in one round."""
        given = self._checked(values or {})
        found = self._values({"set": given, "step": [self.time, length], "get": self._known(get)})
        self.time += length
        return found

    def close(self) -> None:
        """End the process and remove its folder; a second time does nothing."""
        self._end()

    def __enter__(self) -> Host:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _checked(self, values: Mapping[str, float]) -> Values:
        return {name: check_value(f"{self.path}", self.variables, name, value) for name, value in values.items()}

    def _known(self, names: Iterable[str]) -> list[str]:
        listed = list(names)
        for name in listed:
            if name not in self.variables:
                raise UnknownNameError.of(f"{self.path}: variable", name, self.variables)
        return listed

    def _values(self, request: Values) -> Values:
        values: Values = self._ask(request)["values"]
        for name, x in values.items():
            if any(isinstance(each, float) and not math.isfinite(each) for each in (x if isinstance(x, list) else [x])):
                raise OperationError(f"{self.path}: {name}: expected a finite value, got {x} at t = {self.time:g} s. "
                                     "Check the FMU and its inputs.")  # fmt: skip
        return values

    def _ask(self, request: Values) -> Values:
        if not self._end.alive:
            raise OperationError(f"{self.path}: expected a host that is open, got a closed one. Make a new one.")
        child = self._child
        assert child.stdin is not None
        try:
            child.stdin.write(json.dumps(request).encode() + b"\n")
            child.stdin.flush()
            line = self._read_line()
        except BrokenPipeError:
            line = b""
        if not line.endswith(b"\n"):
            cause = self._cause_of_death()
            self.close()
            raise OperationError(f"{self.path}: expected an answer, got {cause} inside the FMU. Ask its maker.")
        answer: Values = json.loads(line)
        if "problem" in answer:
            raise OperationError(f"{self.path}: expected it to go on at t = {getattr(self, 'time', 0.0):g} s, "
                                 f"got {answer['problem']}. Check the FMU and its inputs.")  # fmt: skip
        return answer

    def _read_line(self) -> bytes:
        assert self._child.stdout is not None
        # One answer to one request: nothing is left in the reader's buffer when it is asked again.
        ready, _, _ = select.select([self._child.stdout], [], [], self.timeout)
        if not ready:
            self.close()
            raise OperationError(f"{self.path}: expected an answer within {self.timeout:g} s, got none. "
                                 "The FMU may loop for ever; or give it more time.")  # fmt: skip
        return bytes(self._child.stdout.readline())

    def _cause_of_death(self) -> str:
        try:
            code = self._child.wait(5.0)
        except subprocess.TimeoutExpired:
            return "a closed connection"
        if code < 0:
            return f"a crash ({signal.Signals(-code).name})"
        return f"an exit with status {code} ({last_line(self._place / 'errors.txt')})"


def _spawn(place: Path, memory: int) -> subprocess.Popen[bytes]:
    (place / "tmp").mkdir()
    environment = {**os.environ, "TMPDIR": str(place / "tmp"), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    task = json.dumps({"folder": str(place / "fmu"), "memory": memory})
    with open(place / "errors.txt", "wb") as errors:
        return subprocess.Popen(
            [sys.executable, "-P", str(Path(__file__).with_name("_host_worker.py")), task], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=errors, env=environment, cwd=place, start_new_session=True,
        )  # fmt: skip


def _clean(processes: list[subprocess.Popen[bytes]], place: Path) -> None:
    for child in processes:
        # Whatever the FMU may have started goes with it: its own session makes it a group.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        for pipe in (child.stdin, child.stdout):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
    shutil.rmtree(place, ignore_errors=True)
