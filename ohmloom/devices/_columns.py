"""Which columns and rows of a table hold a sweep, and in which units."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices._read_csv import Table
from ohmloom.errors import (
    FileFormatError,
    ParameterError,
    UnknownNameError,
    expect_integer,
    expect_type,
    shown,
)
from ohmloom.units import BASES, find_unit, known_units, parse_unit

QUANTITIES = {"time": "s", "voltage": "V", "current": "A"}
# A unit at the end of a name: "I [mA]", "t(ms)", "i_uA", "I / mA", "I mA".
_NAMED_UNIT = re.compile(r".*?(?:[\[(]\s*(?P<bracketed>[^\[\]()]+?)\s*[\])]|[_/ ]\s*(?P<bare>[^\W\d_]+))\s*")


def choose_columns(
    table: Table, time: str | None, voltage: str, current: str, frequency: float | None, sample_interval: float | None
) -> dict[str, str]:
    """Column names by quantity; without "time" where the times are made."""
    where = "Measurement.read_csv"
    given = {"frequency": frequency, "sample_interval": sample_interval}
    made = [key for key, value in given.items() if value is not None]
    if len(made) == 2:
        raise ParameterError(f"{where}: expected one of frequency and sample_interval, got both. Leave one out.")
    chosen = {}
    if time is not None:
        expect_type(f"{where}: time", time, str, name="a column name or None")
        if time in table.names:
            if made:
                raise ParameterError(
                    f"{table.where}: expected the times from one source, got a column {shown(time)} and {made[0]}. "
                    f"Leave {made[0]} out, or pass time=None to ignore the column."
                )
            chosen["time"] = time
        # The default is no claim that the file has a time column; any other name is.
        elif time != "t" or (not made and _near_columns(table, time)):
            _find_column(table, "time", time)
    if not made and not chosen:
        raise ParameterError(
            f"{table.where}: expected a time for each row, got no column 't' among {', '.join(table.names)}. Name the "
            "column (time=...), or give frequency= in Hz if the file is one period, or sample_interval= in s."
        )
    for quantity, name in (("voltage", voltage), ("current", current)):
        expect_type(f"{where}: {quantity}", name, str, name="a column name")
        chosen[quantity] = _find_column(table, quantity, name)
    if len(set(chosen.values())) < len(chosen):
        pairs = ", ".join(f"{quantity}={name!r}" for quantity, name in chosen.items())
        raise ParameterError(
            f"{table.where}: expected a column of its own for each quantity, got {pairs}. Correct one."
        )
    return chosen


def _find_column(table: Table, quantity: str, name: str) -> str:
    """`name` if the table has such a column.

    Raises
    ------
    UnknownNameError
        If it has not; offers the nearest name.
    """
    if name in table.names:
        return name
    near = _near_columns(table, name)
    if len(near) == 1:
        raise UnknownNameError(
            f"{table.where}: {quantity} column: expected one of {', '.join(table.names)}, got {shown(name)}. "
            f"Did you mean {quantity}={near[0]!r}?"
        )
    raise UnknownNameError.of(f"{table.where}: {quantity} column", name, table.names)


def _near_columns(table: Table, name: str) -> list[str]:
    """Columns whose name begins with the word `name`, in any case: "i" finds "i_uA" and "I [mA]"."""
    start = re.compile(rf"{re.escape(name)}(?![^\W_])", re.IGNORECASE)
    return [known for known in table.names if start.match(known)]


def column_factors(table: Table, chosen: Mapping[str, str], units: Mapping[str, str] | None) -> dict[str, float]:
    """Factor to SI by quantity, for the column names `chosen` by quantity.

    Raises
    ------
    UnknownNameError
        If a unit is unknown, one of something else, or given for a column that is not used.
    ParameterError
        If a name ends in a unit that is not SI, and none is given.
    """
    given = {} if units is None else units
    expect_type("Measurement.read_csv: units", given, Mapping, name="a table from column name to unit")
    for column in given:
        if column not in chosen.values():
            raise UnknownNameError.of(f"{table.where}: units", column, chosen.values())
    factors = {}
    for quantity, column in chosen.items():
        where = f"{table.where}: unit of column {shown(column)}"
        if column in given:
            factors[quantity] = parse_unit(given[column], QUANTITIES[quantity], where=where)
        else:
            _check_named_unit(where, column, QUANTITIES[quantity])
            factors[quantity] = 1.0
    return factors


def _check_named_unit(where: str, column: str, base: str) -> None:
    """Refuse a name that ends in a unit that is not `base`."""
    found = _NAMED_UNIT.fullmatch(column)
    if not found:
        return
    text, known = found["bracketed"] or found["bare"], known_units(base)
    unit = find_unit(text, base) or find_unit(text, base, any_case=True)
    if unit is not None:
        if known[unit] != 1.0:
            raise ParameterError(
                f"{where}: expected it in units, got nothing, though the name ends in {shown(text)}. "
                f"Pass units={{{column!r}: {unit!r}}} (--unit {column}={unit})."
            )
        return
    # A bare ending may be a label (V_GS, v_A), so only a prefixed V or A tells another quantity.
    others = [name for name in (BASES if found["bracketed"] else ("V", "A")) if found["bracketed"] or text != name]
    other = next((name for name in others if find_unit(text, name)), None)
    if other is not None:
        raise UnknownNameError(f"{where}: expected a unit of {base}, got a name that ends in {shown(text)}, a unit of "
                               f"{other}. Choose another column.")  # fmt: skip


def choose_rows(table: Table, rows: tuple[int, int] | None, every: int) -> tuple[int, int]:
    """The data rows that are used, [start, stop), a whole number of blocks."""
    size, where = len(table.body), "Measurement.read_csv"
    start, stop = 0, size
    if rows is not None:
        if not isinstance(rows, tuple | list) or len(rows) != 2:
            raise ParameterError(f"{where}: rows: expected (start, stop), got {shown(rows)}. Give two integers.")
        start, stop = (expect_integer(f"{where}: rows", row) for row in rows)
        if not start < stop <= size:
            raise ParameterError(f"{where}: rows: expected 0 <= start < stop <= {size}, the rows of {table.where}, "
                                 f"got ({start}, {stop}). The first row has number 0.")  # fmt: skip
    every = expect_integer(f"{where}: every", every, low=1)
    if stop - start < 2:
        raise FileFormatError(f"{table.where}: expected at least 2 rows of numbers, got 1. Give a whole sweep.")
    if (stop - start) // every < 2:
        raise ParameterError(f"{where}: every: expected at least 2 blocks in {stop - start} rows, got {every} rows "
                             "per block. Lower it.")  # fmt: skip
    return start, stop - (stop - start) % every


def check_times(table: Table, column: str, t: FloatArray, start: int) -> None:
    if (np.diff(t) > 0).all():
        return
    k = int(np.argmin(np.diff(t) > 0))
    raise FileFormatError(
        f"{table.where}, line {table.body[start + k + 1][0]}, column {shown(column)}: expected a time above "
        f"{t[k]:.9g}, that of the row before, got {t[k + 1]:.9g}. "
        "Remove repeats, or read one sweep with rows=(start, stop)."
    )
