"""What the command line writes of a fit, of a comparison and of a simulated loop."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ohmloom._files import write_atomic
from ohmloom.devices import Comparison, Fit, Trace
from ohmloom.report.fit_plot import plot_comparison, plot_fit, plot_profiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIT_FILES: Final = ("device.toml", "fit.json", "fit.png", "fit.pdf", "profiles.png")
COMPARISON_FILES: Final = ("comparison.json", "comparison.png", "comparison.pdf")
DPI: Final = 200
# What would make two runs differ: dates, and the version of the library that draws.
NAMELESS: Final = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def save_fit(fit: Fit, out: Path) -> list[Path]:
    """Write the card, the fit, and its pictures to a folder; their paths. Without profiles, none of an older fit stays.

    Raises
    ------
    OperationError
        If a file cannot be written.
    """
    card, table, png, pdf, profiles = (out / name for name in FIT_FILES)
    pictures = {png: _draw(lambda: plot_fit(fit), "png"), pdf: _draw(lambda: plot_fit(fit), "pdf")}
    if fit.profiles:
        pictures[profiles] = _draw(lambda: plot_profiles(fit), "png")
    fit.device.save(card)
    fit.save(table)
    for path, data in pictures.items():
        write_atomic(path, data)
    if not fit.profiles:
        profiles.unlink(missing_ok=True)
    return [card, table, *pictures]


def comparison_files(laws: Sequence[str]) -> list[str]:
    """Names of the files of a comparison: a card for each law, the table, pictures."""
    return [*(f"{law}.toml" for law in laws), *COMPARISON_FILES]


def save_comparison(comparison: Comparison, out: Path) -> list[Path]:
    """Write the card of each law, the comparison, and its picture to a folder; their paths, best law first.

    Raises
    ------
    OperationError
        If a file cannot be written.
    """
    laws = [row.law for row in comparison.ranking]
    paths = [out / name for name in comparison_files(laws)]
    pictures = [_draw(lambda: plot_comparison(comparison), kind) for kind in ("png", "pdf")]
    for law, path in zip(laws, paths, strict=False):
        comparison.fits[law].device.save(path)
    comparison.save(paths[-3])
    for path, data in zip(paths[-2:], pictures, strict=True):
        write_atomic(path, data)
    return paths


def save_trace(trace: Trace, path: Path) -> None:
    """Write a trace by the file's ending: ``.csv`` (columns t, v, i, q, s in SI), ``.npz`` (`Trace.save`), ``.png``.

    `Measurement.read_csv` reads the CSV, and gives the same numbers to the last bit.

    Raises
    ------
    OperationError
        If the file cannot be written.
    """
    if path.suffix == ".npz":
        trace.save(path)
    elif path.suffix == ".png":
        write_atomic(path, _draw(lambda: _loop(trace), "png"))
    else:
        rows = zip(*(getattr(trace, name).tolist() for name in "tviqs"), strict=True)
        head = ["# t in s, v in V, i in A, q in C, s in [0, 1]", "t,v,i,q,s"]
        write_atomic(path, "\n".join([*head, *(",".join(map(repr, row)) for row in rows), ""]))


def _loop(trace: Trace) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 3.6), layout="constrained")
    trace.plot(figure.add_subplot())
    return figure


def _draw(figure: Callable[[], Figure], kind: str) -> bytes:
    """A figure as bytes, the same each time: without dates, and whatever style the user has set for matplotlib."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context(), warnings.catch_warnings():
        # A letter of a name that the font lacks becomes a box.
        warnings.filterwarnings("ignore", message="Glyph")
        matplotlib.rcdefaults()
        matplotlib.rcParams["pdf.fonttype"] = 42  # journals refuse fonts of type 3
        figure().savefig(buffer, format=kind, dpi=DPI, metadata=NAMELESS[kind])
    return buffer.getvalue()
