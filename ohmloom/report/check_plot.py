"""The picture of a check: the exact box, and what each way of writing events does to the weights."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.sim import Check

GREEN, RED, GREY = "#1a7f37", "#b42318", "#6b7280"


def plot_check(check: Check) -> Any:
    """A Figure: names that hold in green, that do not in red, that are not claimed in grey; below, rms over the
    trial."""
    from matplotlib.figure import Figure

    kinds = sorted({kind for scheme in check.schemes.values() for kind in scheme.worst_rms})
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    box, *panels = figure.subplots(1, 1 + max(len(kinds), 1), width_ratios=[1.0, *[1.2] * max(len(kinds), 1)])
    _draw_box(box, check)
    for axes, kind in zip(panels, kinds or [""], strict=True):
        _draw_rms(axes, check, kind)
    return figure


def _draw_box(axes: Any, check: Check) -> None:
    axes.set_axis_off()
    axes.set_title("Exact: the simulator is right" if check.passes else "NOT EXACT: no figure below means anything",
                   color=GREEN if check.passes else RED, fontsize=10, loc="left")  # fmt: skip
    lines = [
        (name, GREEN if holds else RED, "holds" if holds else "DOES NOT HOLD") for name, holds in check.exact.items()
    ]
    lines += [(name, GREY, "not claimed") for name in check.not_applicable]
    for k, (name, colour, words) in enumerate(lines):
        y = 1.0 - (k + 0.7) / max(len(lines), 1)
        axes.text(0.0, y, name.replace("_", " "), transform=axes.transAxes, fontsize=9)
        axes.text(1.0, y, words, transform=axes.transAxes, fontsize=9, color=colour, ha="right")


def _draw_rms(axes: Any, check: Check, kind: str) -> None:
    for name, one in check.agreements.items():
        of_kind = np.array([k == kind for k in one.kinds])
        if one.weights.size and of_kind.any():
            difference = one.emulated_weights[:, of_kind] - one.weights[:, of_kind]
            axes.plot(np.sqrt((difference**2).mean(axis=1)), label=name.replace("_", " "), lw=1.2)
    title = f"{kind.replace('_', '-')}: emulated W beside the paper's rule" if kind else "no synapse"
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("timestep")
    axes.set_ylabel("rms difference of W")
    axes.set_ylim(bottom=0.0)
    if axes.lines:
        axes.legend(fontsize=8)


def save_check_picture(check: Check, path: Path) -> None:
    """Write the picture as PNG, whole or not at all."""
    picture = io.BytesIO()
    plot_check(check).savefig(picture, format="png", dpi=130, metadata={"Software": None})
    write_atomic(path, picture.getvalue())
