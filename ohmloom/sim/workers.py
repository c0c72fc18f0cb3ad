"""Units of work on one machine: in this process or in a pool, stopped by Ctrl-C between two pieces, without orphans."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any, Protocol

from ohmloom.errors import OperationError

Stopped = Callable[[], bool]
Report = Callable[[int, dict[str, float]], None]


class Unit(Protocol):
    """Works on item `item`, asks now and then whether to stop, reports rows; whether it finished. Can be pickled."""

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool: ...


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[Stopped]:
    """Turn the first Ctrl-C into a flag, so that a piece of work is saved; a second one acts as usual."""
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag.is_set
        return
    previous = signal.getsignal(signal.SIGINT)

    def note(*_: Any) -> None:
        flag.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, note)
    try:
        yield flag.is_set
    finally:
        signal.signal(signal.SIGINT, previous)


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while processes start: they inherit this, and ours arrives afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_units(unit: Unit, items: Sequence[int], *, workers: int, stopped: Stopped, report: Report) -> None:
    """Run `unit` on every item, in a pool if there are several workers and items.

    Raises
    ------
    OperationError
        If a worker process dies.
    """
    if workers == 1 or len(items) == 1:
        for item in items:
            if stopped() or not unit(item, stopped, report):
                break
    else:
        _run_pool(unit, items, workers, stopped, report)


_worker_stop: Any = None
_worker_reports: Any = None
_worker_parent = 0
_worker_busy = threading.Lock()


def _start_worker(stop: Any, reports: Any, parent: int) -> None:
    global _worker_stop, _worker_reports, _worker_parent
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker_stop, _worker_reports, _worker_parent = stop, reports, parent
    threading.Thread(target=_end_with_driver, daemon=True).start()


def _end_with_driver() -> None:
    """A worker whose driver was killed would wait for its next task for ever; what it is doing is saved first."""
    driver = multiprocessing.parent_process()
    if driver is not None:
        multiprocessing.connection.wait([driver.sentinel])
        with _worker_busy:
            os._exit(1)


def end_when_told(told: Connection) -> None:
    """In a worker: leave Ctrl-C to the driver, and end at once when that is killed or closes its end of `told`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    driver = multiprocessing.parent_process()

    def end() -> None:
        multiprocessing.connection.wait([told] if driver is None else [told, driver.sentinel])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _work(unit: Unit, item: int) -> bool:
    def stopped() -> bool:
        # A worker whose driver was killed must not live on.
        return bool(_worker_stop.is_set()) or os.getppid() != _worker_parent

    with _worker_busy:
        return unit(item, stopped, lambda k, row: _worker_reports.put((k, row)))


def _run_pool(unit: Unit, items: Sequence[int], workers: int, stopped: Stopped, report: Report) -> None:
    context = multiprocessing.get_context("spawn")
    stop, reports = context.Event(), context.Queue()

    def pass_on() -> None:
        while not reports.empty():
            report(*reports.get())

    with ProcessPoolExecutor(
        min(workers, len(items)), context, initializer=_start_worker, initargs=(stop, reports, os.getpid())
    ) as pool:
        with interrupts_held():
            futures = {pool.submit(_work, unit, item) for item in items}
        try:
            while futures:
                done, futures = wait(futures, timeout=0.2, return_when=FIRST_COMPLETED)
                pass_on()
                for future in done:
                    future.result()
                if stopped():
                    stop.set()
                    for future in futures:
                        future.cancel()
                    futures = {future for future in futures if not future.cancelled()}
        except BrokenProcessPool as error:
            if stopped():
                return  # The user gave up this run; where it resumes, it does not matter who died.
            raise OperationError("workers: expected all to live, got one that died. Run the same command again to "
                                 "resume.") from error  # fmt: skip
        finally:
            stop.set()
    # A worker sends its last rows before it ends, which may be after its result was seen.
    pass_on()
