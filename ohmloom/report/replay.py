"""Pictures of one trial: a still figure, an animation, or a page that plays it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ohmloom.errors import ParameterError
from ohmloom.report._replay_data import ArenaView, Recording, TrialView
from ohmloom.report._replay_gif import replay_gif
from ohmloom.report._replay_page import replay_html
from ohmloom.report._replay_png import replay_png

__all__ = [
    "FORMATS",
    "ArenaView",
    "Recording",
    "TrialView",
    "replay",
    "replay_gif",
    "replay_html",
    "replay_png",
]

FORMATS: dict[str, Callable[[Recording, ArenaView, Path | str], None]] = {
    ".gif": replay_gif,
    ".html": replay_html,
    ".png": replay_png,
}


def replay(recording: Recording, arena: ArenaView, path: Path | str) -> None:
    """Write the replay in the format that the suffix of `path` names: .gif, .html or .png.

    Raises
    ------
    ParameterError
        If the suffix is none of these.
    OperationError
        If the file cannot be written.

    Examples
    --------
    >>> sorted(FORMATS)
    ['.gif', '.html', '.png']
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        got = repr(suffix) if suffix else "none"
        raise ParameterError(
            f"replay.path: expected a suffix among {', '.join(sorted(FORMATS))}, got {got}. "
            f"Name the file like {Path(path).stem or 'replay'}.html."
        )
    FORMATS[suffix](recording, arena, path)
