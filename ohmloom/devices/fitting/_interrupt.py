"""Ctrl-C while CasADi runs: its wrapper would swallow a KeyboardInterrupt, or turn it into an error of another kind."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_pending: list[int] = []


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Within it, Ctrl-C waits for the next `raise_pending`; a second one acts at once. In the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: Any) -> None:
        _pending.append(number)
        if len(_pending) > 1:
            raise KeyboardInterrupt

    _pending.clear()
    before = signal.signal(signal.SIGINT, note)
    try:
        yield
        raise_pending()
    finally:
        signal.signal(signal.SIGINT, before)
        _pending.clear()


def raise_pending() -> None:
    """Raise the KeyboardInterrupt that came since the last call."""
    if _pending:
        raise KeyboardInterrupt
