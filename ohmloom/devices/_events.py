"""Events for SciPy's integrators, which read an event's settings from attributes of what they call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TerminalEvent:
    """Ends the integration where ``function(t, y)`` crosses 0: rising for a `direction` of 1, falling for -1."""

    function: Callable[[float, Any], float]
    direction: float
    terminal: bool = True

    def __call__(self, t: float, y: Any) -> float:
        """The function's value."""
        return self.function(t, y)
