"""Reads the raw files that ngspice writes, binary or ASCII: real vectors over one scale."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import FileFormatError, shown

ADVICE = "The file may be truncated."
_COUNT = re.compile(r"\d{1,9}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Plot:
    """One analysis: `plotname` as "Transient Analysis", vectors by name in lower case, axes (point,)."""

    plotname: str
    vectors: dict[str, FloatArray]


def parse_raw(data: bytes, where: str) -> list[Plot]:
    """All plots of a raw file; `where` names it in errors.

    Raises
    ------
    FileFormatError
        Names the line of a header or of a value, or the byte at which binary values end too early.
    """
    reader = _Reader(data, where)
    plots = []
    while not reader.is_at_end():
        plots.append(_read_plot(reader))
    if not plots:
        raise FileFormatError(f"{where}: line 1: expected 'Title:', got nothing. {ADVICE}")
    return plots


class _Reader:
    """A place in the file: lines are counted, binary values are not lines."""

    def __init__(self, data: bytes, where: str) -> None:
        self.data, self.where = data, where
        self.byte, self.line = 0, 0

    def is_at_end(self) -> bool:
        return not self.data[self.byte :].strip()

    def next_line(self, expected: str) -> str:
        if self.byte >= len(self.data):
            raise self.failure(expected, "the end of the file", 1)
        end = self.data.find(b"\n", self.byte)
        end = len(self.data) if end < 0 else end
        text = self.data[self.byte : end].decode("utf-8", "replace").rstrip("\r")
        self.byte, self.line = end + 1, self.line + 1
        return text

    def failure(self, expected: str, got: str, ahead: int = 0) -> FileFormatError:
        return FileFormatError(f"{self.where}: line {self.line + ahead}: expected {expected}, got {got}. {ADVICE}")


def _read_plot(reader: _Reader) -> Plot:
    fields: dict[str, str] = {}
    while True:
        text = reader.next_line("a header line, as 'No. Points: 10'")
        key, colon, value = text.partition(":")
        if not colon:
            if not text.strip():
                continue
            raise reader.failure("a header line, as 'No. Points: 10'", shown(text))
        fields[key.strip().lower()] = value.strip()
        if key.strip().lower() == "variables":
            break
    flags = fields.get("flags", "real").lower().split()
    if "complex" in flags:
        raise reader.failure("real values", "complex ones")
    sizes = []
    for key in ("No. Variables", "No. Points"):
        text = fields.get(key.lower(), "")
        if not _COUNT.fullmatch(text):
            raise reader.failure(f"'{key}:' with a whole number before the variables", shown(text) if text else "none")
        sizes.append(int(text))
    variables, points = sizes
    names = []
    for k in range(variables):
        words = reader.next_line(f"variable {k}").split()
        if len(words) < 3 or words[0] != str(k):
            raise reader.failure(f"number, name and type of variable {k}", shown(" ".join(words)))
        names.append(words[1].lower())
    kind = reader.next_line("'Binary:' or 'Values:'").strip().lower()
    if kind not in ("binary:", "values:"):
        raise reader.failure("'Binary:' or 'Values:'", shown(kind))
    table = (_binary if kind == "binary:" else _ascii)(reader, points, variables)
    return Plot(plotname=fields.get("plotname", ""), vectors={name: table[:, k] for k, name in enumerate(names)})


def _binary(reader: _Reader, points: int, variables: int) -> FloatArray:
    wanted = 8 * points * variables
    left = len(reader.data) - reader.byte
    if left < wanted:
        raise FileFormatError(f"{reader.where}: byte {reader.byte}: expected {points} points of {variables} values, "
                              f"{wanted} bytes, got {left}. {ADVICE}")  # fmt: skip
    values = np.frombuffer(reader.data, "<f8", points * variables, reader.byte)
    reader.byte += wanted
    return values.reshape(points, variables).astype(np.float64)


def _ascii(reader: _Reader, points: int, variables: int) -> FloatArray:
    table = []
    for point in range(points):
        row: list[float] = []
        while len(row) < variables:
            what = f"value {len(row)} of point {point}"
            words = reader.next_line(what).split()
            if not words:
                continue
            if not row and (len(words) != 2 or words[0] != str(point)):
                raise reader.failure(f"the number {point} and a value", shown(" ".join(words)))
            if row and len(words) != 1:
                raise reader.failure(what, shown(" ".join(words)))
            try:
                row.append(float(words[-1]))
            except ValueError:
                raise reader.failure(what, shown(words[-1])) from None
        table.append(row)
    return np.array(table, dtype=np.float64).reshape(points, variables)
