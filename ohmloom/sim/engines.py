"""Engines that work on units: this process, processes on this machine, or a dask cluster.

All give the same bytes. An engine has `slots`, takes a unit and an item by `submit`, and tells by `wait` what became of
them; who tries again, and what is kept, is not its business.
"""

from __future__ import annotations

import functools
import importlib
import json
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

from ohmloom import __version__
from ohmloom._files import sha256
from ohmloom.errors import OperationError, ParameterError, UnknownNameError, expect_integer
from ohmloom.sim.workers import Unit, end_when_told, interrupts_held

ENGINES = ("processes", "dask")
ROOMS = ("devices", "circuits", "neurocontroller", "mapping", "sim")  # that a unit's result follows from
PAUSE = 0.2  # s, after which a driver looks whether it was interrupted
PATIENCE = 30  # s, in which a cluster must answer
Result = tuple[int, "bytes | BaseException"]


class Engine(Protocol):
    """Works on units."""

    @property
    def slots(self) -> int:
        """How many units it takes at once."""
        ...

    def submit(self, unit: Unit, item: int) -> None:
        """Begin with an item."""
        ...

    def wait(self) -> list[Result]:
        """What has ended since the last call, as bytes or as the error; waits a little if nothing has."""
        ...

    def close(self) -> None:
        """End at once, with every process that it started."""
        ...


def open_engine(name: str, *, workers: int = 1, address: str | None = None) -> Engine:
    """The engine of this name; see `ohmloom.sim.work.open_work`."""
    if name not in ENGINES:
        raise UnknownNameError.of("--engine", name, ENGINES)
    expect_integer("--workers", workers, 1)
    if name == "dask":
        return DaskState(workers, address)
    if address is not None:
        raise ParameterError(f"--address: expected --engine dask with it, got {address!r} alone. Add it.")
    return HereState() if workers == 1 else ProcessesState(workers)


@functools.cache
def code_version() -> str:
    """Version, and digest of the sources from which a result follows: results of other code are not taken over."""
    package = Path(__file__).parents[1]
    files = sorted(path for room in ROOMS for path in (package / room).rglob("*.py"))
    text = "".join(f"{path.relative_to(package).as_posix()} {sha256(path.read_bytes())}\n" for path in files)
    return f"{__version__} {sha256(text.encode())[:16]}"


def work_on(unit: Unit, item: int, code: str) -> bytes:
    """Everything that a unit reports of an item, as the bytes of its file."""
    if code != code_version():
        raise OperationError(f"worker: expected ohmloom {code}, got {code_version()}. Install the same one on every "
                             "machine.")  # fmt: skip
    rows: list[tuple[int, dict[str, Any]]] = []
    unit(item, lambda: False, lambda k, row: rows.append((k, row)))
    # numpy's scalars count as the numbers they are.
    return (json.dumps(rows, default=lambda value: value.item()) + "\n").encode()


class HereState:
    """In this process, one after the other."""

    slots = 1

    def __init__(self) -> None:
        self._next: tuple[Unit, int] | None = None

    def submit(self, unit: Unit, item: int) -> None:
        self._next = unit, item

    def wait(self) -> list[Result]:
        assert self._next is not None
        unit, item = self._next
        try:
            return [(item, work_on(unit, item, code_version()))]
        except Exception as error:  # noqa: BLE001 - whatever it is, it counts as a failed try of this unit
            return [(item, error)]

    def close(self) -> None:
        pass


class ProcessesState:
    """Processes of this machine, a pool of one for each, so that one that dies takes no other's unit with it."""

    def __init__(self, workers: int) -> None:
        self.slots = workers
        self._idle: list[_Pool] = []
        self._running: dict[Future[bytes], tuple[int, _Pool]] = {}

    def submit(self, unit: Unit, item: int) -> None:
        while True:
            pool = self._idle.pop() if self._idle else _Pool()
            try:
                with interrupts_held():
                    future = pool.processes.submit(work_on, unit, item, code_version())
            except BrokenProcessPool:  # its process died while it had nothing to do
                pool.close()
            else:
                self._running[future] = item, pool
                return

    def wait(self) -> list[Result]:
        done, _ = wait(self._running, timeout=PAUSE, return_when=FIRST_COMPLETED)
        return [self._take(future) for future in done]

    def _take(self, future: Future[bytes]) -> Result:
        item, pool = self._running.pop(future)
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            pool.close()
            return item, OperationError("worker: expected it to live, got one that died. Look for what killed it.")
        self._idle.append(pool)
        return item, future.result() if error is None else error

    def close(self) -> None:
        for _, pool in self._running.values():
            pool.kill()
        for pool in [*self._idle, *(pool for _, pool in self._running.values())]:
            pool.close()


class _Pool:
    """A process that works on one unit at a time, and a pipe whose closing ends it."""

    def __init__(self) -> None:
        context = get_context("spawn")
        told, self._tell = context.Pipe(duplex=False)
        self.processes = ProcessPoolExecutor(1, context, initializer=end_when_told, initargs=(told,))

    def kill(self) -> None:
        self._tell.close()

    def close(self) -> None:
        self.processes.shutdown(wait=True, cancel_futures=True)
        self._tell.close()


class DaskState:
    """A dask cluster: the one at an address, or one of this machine that ends with the driver."""

    def __init__(self, workers: int, address: str | None) -> None:
        try:
            # By name: dask is an extra, and says nothing about its types.
            dask: Any = importlib.import_module("dask")
            self._distributed: Any = importlib.import_module("distributed")
        except ImportError as error:
            raise ParameterError("--engine: expected dask's distributed to be installed, got none. "
                                 "Install ohmloom[cluster].") from error  # fmt: skip
        self._cluster: Any = None
        # A worker that dies is a failed try of its unit, and tries are counted elsewhere.
        own = dask.config.set({"distributed.scheduler.allowed-failures": 0})
        try:
            if address is None:
                with own, interrupts_held():
                    self._cluster = self._distributed.LocalCluster(
                        n_workers=workers, threads_per_worker=1, dashboard_address=None
                    )  # fmt: skip
            self._client: Any = self._distributed.Client(self._cluster or address, timeout=PATIENCE)
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, TimeoutError, ValueError) as error:
            raise OperationError(f"--address: expected a dask cluster with workers, got {error}. "
                                 "Start one, or leave the address out.") from error  # fmt: skip
        self._running: dict[Any, int] = {}

    @property
    def slots(self) -> int:
        return max(int(sum(self._client.nthreads().values())), 1)

    def submit(self, unit: Unit, item: int) -> None:
        self._running[self._client.submit(work_on, unit, item, code_version(), pure=False)] = item

    def wait(self) -> list[Result]:
        try:
            self._distributed.wait(list(self._running), timeout=PAUSE, return_when="FIRST_COMPLETED")
        except TimeoutError:
            return []
        done = [future for future in self._running if future.done()]
        return [(self._running.pop(future), future.exception() or future.result()) for future in done]

    def close(self) -> None:
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
