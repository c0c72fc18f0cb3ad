"""Figures as SVG text that stands inside a page: no ids in common, colours of the page, the same bytes each time."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import numpy as np
from markupsafe import Markup, escape

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HASH_SALT: Final = "ohmloom"
MOST_VERTICES: Final = 2500  # a collection with more becomes a bitmap inside the SVG, or the page gets too large
BITMAP_DPI: Final = 200
# Drawn colours that follow the page's scheme, light or dark.
PAGE_COLOURS: Final = {
    "#000000": "currentColor", "#222222": "currentColor", "#ffffff": "var(--paper)", "#d9efdf": "var(--goal)",
    "#e4e7ee": "var(--start)", "#d6d6d6": "var(--wall)", "#555555": "var(--soft)", "#c03a2b": "var(--bad)",
    "#2a76c6": "var(--blue)", "#8a9099": "var(--wire)", "#17703b": "var(--good)", "#8a5a00": "var(--warn)",
}  # fmt: skip


def page_svg(draw: Callable[[], Figure], key: str, label: str, *, map_index: int | None = None) -> Markup:
    """Draw a figure and give its SVG element; `key` keeps its ids apart, `label` is read out to the blind.

    With `map_index`, the page's script shows the values under the pointer: the element says where its first axes have
    (0, 0) and how far it is to (1, 1), in its own units.
    """
    with _same_style():
        figure = draw()
        for axes in figure.axes:
            for artist in axes.get_children():
                if _vertices(artist) > MOST_VERTICES:
                    artist.set_rasterized(True)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", dpi=BITMAP_DPI, transparent=True, metadata={"Date": None})
    return _inside_page(buffer.getvalue(), key, label, "" if map_index is None else _frame(figure, map_index))


@contextmanager
def _same_style() -> Iterator[None]:
    """Whatever the user's own settings are, the same picture."""
    import matplotlib

    with matplotlib.rc_context(), warnings.catch_warnings():
        # A letter of a name that the font lacks is left to the browser, or out.
        warnings.filterwarnings("ignore", message="Glyph")
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"svg.hashsalt": HASH_SALT, "svg.fonttype": "none", "pdf.fonttype": 42})
        yield


FORMATS: Final = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "Creator": None, "Producer": None}}


def figure_files(draw: Callable[[], Figure], forms: Sequence[str] = tuple(FORMATS)) -> Iterator[tuple[str, bytes]]:
    """Draw a figure and give the contents of its files, each with its ending; the same bytes each time."""
    with _same_style():
        figure = draw()
        for form in forms:
            picture = io.BytesIO()
            figure.savefig(picture, format=form, metadata=FORMATS[form])
            yield form, picture.getvalue()


def figure_of(axes: Axes) -> Figure:
    """The figure that a plot was drawn on."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure


def _frame(figure: Figure, map_index: int) -> str:
    to_figure = figure.axes[0].transData + figure.transFigure.inverted()
    (x0, y0), (x1, y1) = to_figure.transform([(0.0, 0.0), (1.0, 1.0)])
    width, height = 72.0 * figure.get_size_inches()  # an SVG's unit is the point
    place = f"{x0 * width:.2f} {(1 - y0) * height:.2f} {(x1 - x0) * width:.4f} {(y0 - y1) * height:.4f}"
    return f' data-map="{map_index}" data-frame="{place}" tabindex="0"'


def _vertices(artist: Artist) -> int:
    from matplotlib.collections import Collection

    if not isinstance(artist, Collection):
        return 0
    return sum(np.shape(path.vertices)[0] for path in artist.get_paths())


def _inside_page(text: str, key: str, label: str, more: str) -> Markup:
    head = re.search(r'<svg[^>]*viewBox="0 0 ([\d.]+) ([\d.]+)"[^>]*>', text)
    assert head is not None
    width, height = float(head[1]), float(head[2])
    body = text[head.end() :]
    body = re.sub(r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>", "", body, flags=re.DOTALL)
    # A hundredth of a point is enough; matplotlib's six decimals are a third of the bytes.
    body = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(?<![\d.])([1-9]\d*\.\d\d)\d+", r"\1", tag[0]), body)
    # The page's style sheet has the fonts, and many groups are empty.
    body = re.sub(r"font-family: [^;\"]*;? ?|<g id=\"[^\"]*\"/>|(?<=\") transform=\"rotate\(-?0 [^\"]*\"", "", body)
    body = re.sub(r'(\sid="|url\(#|href="#)', rf"\g<1>{key}-", body)
    for drawn, shown in PAGE_COLOURS.items():
        body = body.replace(drawn, shown)
    # Wide figures scroll on a phone rather than shrink until their text cannot be read.
    least = 1.05 if more else 0.82
    size = f"min-width: {least * width:.0f}px; max-width: {1.5 * width:.0f}px"
    start = f'<svg role="img" aria-label="{escape(label)}"{more} viewBox="0 0 {width:g} {height:g}" style="{size}">'
    return Markup(start + "".join(line.strip() + "\n" for line in body.splitlines()))
