"""Everything ohmloom raises on purpose.

Each error is also the built-in that it specialises, so that callers may catch either. Messages have the form
``<Class.field or file:path>: expected <rule>, got <value>. <One thing to do next.>``
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


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
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
        hint = f"Did you mean {near[0]!r}?" if near else "Use one of these."
        return cls(f"{where}: expected one of {', '.join(names)}, got {name!r}. {hint}")


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
