"""Tables that a laboratory can use: which device stands where, at which conductance, and the pulses of every line."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.errors import ParameterError

if TYPE_CHECKING:
    from ohmloom.circuits.crossbar import Crossbar
    from ohmloom.circuits.memristor_crossbar import MemristorCrossbar


def write_placement(crossbar: Crossbar, path: str | Path) -> None:
    """``word_line,bit_line,conductance_S`` of one crossbar, counted from 0; refused for a batch."""
    if crossbar.conductance.ndim != 2:
        raise ParameterError(f"Crossbar.write_csv: expected one crossbar, axes (word_line, bit_line), got shape "
                             f"{crossbar.conductance.shape}. Take one of the batch.")  # fmt: skip
    rows = [[i, j, repr(float(g))] for (i, j), g in np.ndenumerate(crossbar.conductance)]
    write_rows(path, ["word_line", "bit_line", "conductance_S"], rows)


def write_devices(array: MemristorCrossbar, path: str | Path) -> None:
    """``word_line,bit_line,card,s,conductance_S`` of memristors, counted from 0; an open crosspoint has no card."""
    assert array.kind is not None
    assert isinstance(array.devices, tuple)
    g = array.crossbar().conductance
    rows = []
    for (i, j), kind in np.ndenumerate(array.kind):
        card = "" if kind < 0 else array.devices[kind].name
        rows.append([i, j, card, "" if kind < 0 else repr(float(array.s[i, j])), repr(float(g[i, j]))])
    write_rows(path, ["word_line", "bit_line", "card", "s", "conductance_S"], rows)


def write_rows(path: str | Path, header: list[str], rows: list[list[Any]]) -> None:
    """A CSV file, whole or not at all."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_atomic(path, text.getvalue())
