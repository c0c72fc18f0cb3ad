"""Tables of measured numbers: delimiter, header and comments found, errors that name line, column and value."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._files import read_bytes, sha256
from ohmloom.errors import FileFormatError, shown

FILE_LIMIT = 200_000_000  # bytes; a day of samples at 10 ms is about 200 MB
NAME_LIMIT = 100  # characters; a longer name comes from a file that is no table
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_BLANKS = re.compile(r'"([^"]*)"|(\S+)')


@dataclass(frozen=True, kw_only=True)
class Table:
    """A file split into names and lines; its numbers are read when columns are asked for.

    Attributes
    ----------
    where, sha256
        The path as errors show it, and the digest of the file's bytes.
    names
        Column names; a file without a header, and a column without a name, count from "1".
    delimiter
        A character, or "" for blanks.
    body
        Line number (from 1) and text of each data row.
    """

    where: str
    sha256: str
    names: tuple[str, ...]
    delimiter: str
    body: tuple[tuple[int, str], ...]

    def columns(self, names: Sequence[str], start: int, stop: int) -> FloatArray:
        """Numbers of the data rows [start, stop), axes (column, time); the other columns may hold anything.

        Raises
        ------
        FileFormatError
            If a row has too few or too many fields, or a field is no finite number.
        """
        places = [self.names.index(name) for name in names]
        values = np.empty((stop - start, len(places)))
        for k, (line, text) in enumerate(self.body[start:stop]):
            cells = self.cells(line, text)
            try:
                values[k] = [_number(cells[place]) for place in places]
            except ValueError:
                bad = next(place for place in places if not _is_number(cells[place]))
                raise self._bad_cell(line, bad, cells[bad]) from None
        if not np.isfinite(values).all():
            k, j = np.argwhere(~np.isfinite(values))[0]
            line, text = self.body[start + int(k)]
            raise self._bad_cell(line, places[j], self.cells(line, text)[places[j]])
        return values.T

    def cells(self, line: int, text: str) -> list[str]:
        """The fields of a data row, one per name."""
        cells = _split(text, self.delimiter)
        if len(cells) != len(self.names):
            wanted = f"{len(self.names)} field{'s'[: len(self.names) - 1]} ({', '.join(self.names)})"
            raise FileFormatError(
                f"{self.where}, line {line}: expected {wanted}, got {len(cells)}: {shown(text.strip())}. "
                f"{self._count_advice(cells)}"
            )
        return cells

    def _count_advice(self, cells: list[str]) -> str:
        if self.delimiter == "," and len(cells) == 2 * len(self.names):
            return "Write decimal points, not decimal commas."
        return "Correct the line, or put '#' before it if it is no data."

    def _bad_cell(self, line: int, place: int, cell: str) -> FileFormatError:
        rule, advice = "a finite number", "Correct it, or read rows=(start, stop) without this line."
        if _DECIMAL_COMMA.fullmatch(cell):
            rule, advice = "a number with a decimal point", f"Write {cell.replace(',', '.')}, here and in all lines."
        name = shown(self.names[place])
        return FileFormatError(
            f"{self.where}, line {line}, column {name}: expected {rule}, got {shown(cell)}. {advice}"
        )


def read_table(path: Path | str) -> Table:
    """Find delimiter, header and data rows of a text file.

    Fields are separated by semicolons, tabs, commas or blanks. Empty lines and lines that start with '#' are skipped;
    a byte order mark and any line ends are accepted, and names and values may stand in double quotes. If every field
    of the first row is a number, the file has no header.

    Raises
    ------
    MissingFileError
        If the file does not exist.
    FileFormatError
        If it is no text, is empty, has only a header, or has a name twice.
    """
    data = read_bytes(path, "measurement", limit=FILE_LIMIT)
    where = str(path) if str(path).isprintable() else shown(str(path))
    lines = _text(data, where).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    kept = [(k, line) for k, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise FileFormatError(f"{where}: expected rows of numbers, got an empty file. Check the path.")
    delimiter = _find_delimiter(kept[min(1, len(kept) - 1)][1])
    first = _split(kept[0][1], delimiter)
    if all(_is_number(cell) or _DECIMAL_COMMA.fullmatch(cell) for cell in first):
        names, body = tuple(str(k) for k in range(1, len(first) + 1)), kept
    else:
        names, body = _names(first, where, kept[0][0]), kept[1:]
    if not body:
        raise FileFormatError(f"{where}: expected rows of numbers below the names, got none. It may be truncated.")
    table = Table(where=where, sha256=sha256(data), names=names, delimiter=delimiter, body=tuple(body))
    table.cells(*body[0])  # before anyone looks for names in what is no header
    return table


def _text(data: bytes, where: str) -> str:
    if b"\0" in data:
        raise FileFormatError(f"{where}: expected UTF-8 text, got other bytes. Export the table as CSV in UTF-8.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Instruments write the micro sign in Latin-1; the numbers are the same in both.
        return data.decode("latin-1")


def _find_delimiter(row: str) -> str:
    blanks = _split(row, "")
    if len(blanks) > 1 and all(_DECIMAL_COMMA.fullmatch(cell) for cell in blanks) and "\t" not in row:
        return ""
    return next((mark for mark in ";\t," if mark in row), "")


def _split(text: str, delimiter: str) -> list[str]:
    if '"' not in text:
        return [cell.strip() for cell in text.split(delimiter)] if delimiter else text.split()
    if not delimiter:
        return [quoted or plain for quoted, plain in _BLANKS.findall(text)]
    try:
        return [
            cell.strip() for cell in next(csv.reader([text.strip(" ")], delimiter=delimiter, skipinitialspace=True))
        ]
    except csv.Error:  # a field of more than 131072 characters
        return [text]


def _names(cells: list[str], where: str, line: int) -> tuple[str, ...]:
    names = tuple(cell or str(k) for k, cell in enumerate(cells, start=1))
    for k, name in enumerate(names):
        if not name.isprintable() or len(name) > NAME_LIMIT:
            raise FileFormatError(f"{where}, line {line}: expected names of columns, got {shown(name)}. "
                                  "Check that this is the right file.")  # fmt: skip
        if name in names[:k]:
            raise FileFormatError(f"{where}, line {line}: expected each column name once, got {shown(name)} twice. "
                                  "Rename one.")  # fmt: skip
    return names


def _number(cell: str) -> float:
    # float() would also read 1_000 and the digits of other scripts.
    if "_" in cell or not cell.isascii():
        raise ValueError
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True
