"""Work cut into units whose results are files: it may stop anywhere, goes on anywhere, and ends in the same bytes.

A batch of units has a folder named by a digest of all that its results follow from. A unit is done if and only if its
file exists there, and a file appears whole or not at all. Nothing else is written down: who works on what is known to
nobody but the process that does it, so that any number of drivers can share a folder, and any of them can be killed.
"""

from __future__ import annotations

import contextlib
import json
import re
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ohmloom._files import parse_json, read_bytes, remove_temporaries, sha256, write_atomic
from ohmloom.errors import Interrupted, OhmloomError, OperationError, ParameterError, expect_integer
from ohmloom.sim.engines import Engine, HereState, code_version, open_engine
from ohmloom.sim.workers import Unit, stop_on_interrupt

FORMAT = 1  # of a unit's file, and of what its key is made of
TRIES = 5
UNITS, FAILED = "units", "failed"
Row = tuple[int, dict[str, Any]]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Units of one kind.

    Attributes
    ----------
    name
        For people.
    unit
        Works on an item; can be pickled.
    items
        What there is to do.
    inputs
        All that the results follow from but the item, as plain values.
    """

    name: str
    unit: Unit
    items: Sequence[int]
    inputs: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Name of its folder: the same inputs, code and format give the same key."""
        text = json.dumps({"format": FORMAT, "code": code_version(), "inputs": self.inputs}, sort_keys=True)
        return f"{self.name}_{sha256(text.encode())[:16]}"


@dataclass(frozen=True, kw_only=True)
class Shard:
    """Part `index` of `count`, from 1: what it does first. When that is done it helps the others, from their end."""

    index: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        expect_integer("--shard", self.count, 1)
        expect_integer("--shard", self.index, 1, self.count)

    @classmethod
    def parse(cls, text: str) -> Shard:
        """From ``I/N``."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if not found:
            raise ParameterError(f"--shard: expected I/N, such as 1/4, got {text!r}. Correct it.")
        return cls(index=int(found[1]), count=int(found[2]))

    def order(self, items: Sequence[int]) -> list[int]:
        """All items, its own first."""
        own = [item for k, item in enumerate(items) if k % self.count == self.index - 1]
        others = [item for k, item in enumerate(items) if k % self.count != self.index - 1]
        return own + others[::-1]


@dataclass(frozen=True, kw_only=True)
class Work:
    """Where units are worked on, and where their results are kept.

    Attributes
    ----------
    engine
        Works on units.
    folder
        Where results are kept; None keeps them in memory only.
    shard
        What is done first.
    """

    engine: Engine
    folder: Path | None = None
    shard: Shard = Shard()

    def run(self, batch: Batch, progress: Progress | None = None) -> dict[int, list[Row]]:
        """Rows that each item reported, in the order of the items, from files where there are any.

        Raises
        ------
        OperationError
            If a unit failed in five tries, after all others are done, or a file cannot be written.
        Interrupted, KeyboardInterrupt
            After Ctrl-C, once the units under way are done; the first if they are kept.
        """
        if not batch.items:
            return {}
        store = _Store(folder=None if self.folder is None else self.folder / UNITS / batch.key)
        store.open(batch)
        found, tries, failures = dict(store.load(batch.items)), Counter[int](), dict[int, BaseException]()

        def tell() -> None:
            if progress is not None:
                progress(len(found), len(batch.items))

        waiting = deque(item for item in self.shard.order(batch.items) if item not in found)
        running: set[int] = set()
        if found:
            tell()
        with stop_on_interrupt() as stopped:
            while (waiting and not stopped()) or running:
                while waiting and len(running) < self.engine.slots and not stopped():
                    item = waiting.popleft()
                    there = store.read(item) if self.shard.count > 1 else None  # another driver may have been here
                    if there is None:
                        running.add(item)
                        self.engine.submit(batch.unit, item)
                    else:
                        found[item] = there
                        tell()
                for item, result in self.engine.wait() if running else ():
                    running.discard(item)
                    if isinstance(result, bytes):
                        store.write(item, result)
                        found[item] = _rows(result)
                        tell()
                        continue
                    tries[item] += 1
                    if tries[item] < TRIES:
                        waiting.append(item)
                    else:
                        failures[item] = result
                        store.report(batch, item, result)
        if failures:
            raise _poisoned(batch, failures, store) from next(iter(failures.values()))
        if len(found) < len(batch.items):
            if self.folder is None:
                raise KeyboardInterrupt
            raise Interrupted(f"{self.folder}: interrupted; all finished work is kept.")
        return {item: found[item] for item in batch.items}


@contextlib.contextmanager
def open_work(
    *,
    workers: int = 1,
    engine: str = "processes",
    address: str | None = None,
    folder: Path | None = None,
    shard: Shard | None = None,
) -> Iterator[Work]:
    """Work on an engine that is closed at the end, whatever happens.

    Raises
    ------
    ParameterError, UnknownNameError
        If there is no such engine, or it cannot have an address.
    OperationError
        If no cluster answers at `address`.
    """
    with contextlib.closing(open_engine(engine, workers=workers, address=address)) as opened:
        yield Work(engine=opened, folder=folder, shard=shard or Shard())


def work_here() -> Work:
    """In this process, in memory."""
    return Work(engine=HereState())


@dataclass(frozen=True, kw_only=True)
class _Store:
    """The folder of a batch: a file a unit, and ``batch.json`` with the inputs."""

    folder: Path | None

    def open(self, batch: Batch) -> None:
        if self.folder is None:
            return
        if self.folder.exists():
            remove_temporaries(self.folder, lambda name: re.fullmatch(r"(batch|\d+)\.json", name) is not None)
        path = self.folder / "batch.json"
        table = {"name": batch.name, "items": list(batch.items), "inputs": batch.inputs}
        text = json.dumps(table, indent=1, sort_keys=True) + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            write_atomic(path, text)

    def path(self, item: int) -> Path | None:
        return None if self.folder is None else self.folder / f"{item:06}.json"

    def read(self, item: int) -> list[Row] | None:
        path = self.path(item)
        if path is None or not path.exists():
            return None
        return _rows(read_bytes(path, "unit", limit=None))

    def load(self, items: Sequence[int]) -> Iterator[tuple[int, list[Row]]]:
        for item in items:
            rows = self.read(item)
            if rows is not None:
                yield item, rows

    def write(self, item: int, data: bytes) -> None:
        path = self.path(item)
        if path is not None:
            write_atomic(path, data)
            self._failed(item).unlink(missing_ok=True)

    def _failed(self, item: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{item:06}.{FAILED}"

    def report(self, batch: Batch, item: int, error: BaseException) -> None:
        """Keep what a unit was given and how it failed."""
        if self.folder is not None:
            table = {"name": batch.name, "item": item, "tries": TRIES, "error": f"{type(error).__name__}: {error}",
                     "traceback": traceback.format_exception(error), "inputs": batch.inputs}  # fmt: skip
            write_atomic(self._failed(item), json.dumps(table, indent=1, sort_keys=True) + "\n")

    def kept(self, item: int) -> str:
        return "" if self.folder is None else f" Its input is kept in {self._failed(item)}."


def _rows(data: bytes) -> list[Row]:
    return [(int(item), row) for item, row in parse_json(data, "unit")]


def _poisoned(batch: Batch, failures: Mapping[int, BaseException], store: _Store) -> OperationError:
    def problem(item: int, error: BaseException) -> str:
        why = str(error) if isinstance(error, OhmloomError) else f"{type(error).__name__}: {error}"
        return (f"{batch.name} {item}: expected a unit that can be worked on, got {TRIES} failures, the last: "
                f"{why.rstrip('.')}.{store.kept(item)} All others are kept; run the same command again to "
                "resume.")  # fmt: skip

    return OperationError(*(problem(item, error) for item, error in sorted(failures.items())))
