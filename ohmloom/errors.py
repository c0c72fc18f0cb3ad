"""Everything ohmloom raises on purpose.

Each error is also the built-in that it specialises, so that callers may catch either. Messages have the form
``<Class.field or file:path>: expected <rule>, got <value>. <One thing to do next.>``
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any


class OhmloomError(Exception):
    """Base of all errors that ohmloom raises on purpose."""

    def __init__(self, *problems: str) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        return "\n".join(self.problems)


class ParameterError(OhmloomError, ValueError):
    """A value passed by a caller is out of range, of a wrong shape or of a wrong kind."""


class UnknownNameError(ParameterError, KeyError):
    """A name that no table holds; the message offers the nearest known one."""

    @classmethod
    def of(cls, where: str, name: str, known: Iterable[str]) -> UnknownNameError:
        """Make the error for `name`, which is not among `known`."""
        names = sorted(known)
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.4) if isinstance(name, str) else []
        hint = f"Did you mean {near[0]!r}?" if near else "Use one of these."
        return cls(f"{where}: expected one of {', '.join(names)}, got {shown(name)}. {hint}")


class FileFormatError(OhmloomError, ValueError):
    """A file is truncated, of another format or version, or has a field that breaks a rule."""


class MissingFileError(OhmloomError, FileNotFoundError):
    """A file or a shipped item of that name does not exist."""

    # FileNotFoundError formats its own arguments; ours are sentences.
    __str__ = OhmloomError.__str__


class SettingsConflictError(OhmloomError, ValueError):
    """A run folder exists and was made with other settings."""


class MappingError(OhmloomError, ValueError):
    """A network cannot be placed on a hardware spec; names the synapse or the kind that does not fit."""


class OperationError(OhmloomError, RuntimeError):
    """Something outside ohmloom failed: a full disk, a worker that died, a tool that crashed."""


class Interrupted(OhmloomError):  # noqa: N818 - an event, not a fault
    """The user stopped a run, and everything finished was kept. Raised after a KeyboardInterrupt was dealt with."""


def shown(value: object, limit: int = 60) -> str:
    """`value` as an error shows it: its repr on one line, cut short."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, a list inside itself
        return f"one {type(value).__name__} too large to show"
    text = text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def expect_type(where: str, value: object, *types: type, name: str = "") -> None:
    """Refuse what is of none of the `types`; `name` says what they are, if not their own names.

    >>> expect_type("place.network", None, int)
    Traceback (most recent call last):
    ohmloom.errors.ParameterError: place.network: expected int, got None. Pass a value of this type.
    """
    if not isinstance(value, types):
        wanted = name or " or ".join(t.__name__ for t in types)
        raise ParameterError(f"{where}: expected {wanted}, got {shown(value)}. Pass a value of this type.")


def expect_integer(where: str, value: Any, low: int = 0, high: int | None = None) -> int:
    """`value` as an int in [low, high]; booleans and floats are no integers.

    >>> expect_integer("sample.seed", 7)
    7
    >>> expect_integer("sample.seed", -1)
    Traceback (most recent call last):
    ohmloom.errors.ParameterError: sample.seed: expected an integer >= 0, got -1. Correct it.
    """
    # Integral and Real hold numpy's scalars too.
    if isinstance(value, bool) or not isinstance(value, Integral) or not _is_between(int(value), low, high):
        rule = f">= {low}" if high is None else f"from {low} to {high}"
        raise ParameterError(f"{where}: expected an integer {rule}, got {shown(value)}. Correct it.")
    return int(value)


def expect_number(where: str, value: Any, rule: str = "a finite number") -> float:
    """`value` as a finite float; `rule` is what the error says, with the unit."""
    number = math.nan
    if not isinstance(value, bool) and isinstance(value, Real):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise ParameterError(f"{where}: expected {rule}, got {shown(value)}. Correct it.")
    return number


def _is_between(value: int, low: int, high: int | None) -> bool:
    return low <= value and (high is None or value <= high)
