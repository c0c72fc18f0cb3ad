"""The one gate through which arrays enter frozen objects, and the one file format that keeps them."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom._files import DAMAGED_ZIP, check_format, parse_json, read_bytes, write_atomic
from ohmloom.errors import FileFormatError, ParameterError, shown

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def frozen_array(where: str, values: Any, axes: Sequence[str], *, dtype: npt.DTypeLike = np.float64) -> Any:
    """Copy `values` to a read-only array with exactly the named `axes`.

    Parameters
    ----------
    where
        ``Class.field``, for the error text.
    axes
        One name per axis, in order; a trailing ``name=3`` fixes its length.

    Raises
    ------
    ParameterError
        If the number of axes or a fixed length disagrees, if a value is NaN, infinite or masked, or if values are
        dates or durations, which numpy would count in whatever unit they have.
    """
    refuse_counts(where, values)
    try:
        array = np.array(values, dtype=dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{where}: expected numbers, axes ({', '.join(axes)}), got {shown(values)}. "
                             "Give an array of numbers.") from error  # fmt: skip
    shape = ", ".join(axes)
    if array.ndim != len(axes):
        raise ParameterError(f"{where}: expected axes ({shape}), got shape {array.shape}. Give one axis per name.")
    for name, length in zip(axes, array.shape, strict=True):
        if "=" in name and int(name.split("=")[1]) != length:
            raise ParameterError(f"{where}: expected axes ({shape}), got shape {array.shape}. Check {name}.")
    if np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
        raise ParameterError(f"{where}: expected finite numbers, got NaN or infinity. Check the input.")
    array.flags.writeable = False
    return array


def refuse_counts(where: str, values: Any) -> None:
    """Refuse what numpy would turn into wrong numbers without a word: durations, dates, and what a mask hides.

    Raises
    ------
    ParameterError
        If `values` is or holds any of these.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.getmaskarray(values).any():
        raise ParameterError(f"{where}: expected a value everywhere, got a masked array with "
                             f"{np.ma.getmaskarray(values).sum()} masked. Drop or fill them.")  # fmt: skip
    dtype = getattr(values, "dtype", None)
    if dtype is None and isinstance(values, list | tuple) and values:
        dtype = getattr(values[0], "dtype", None)
    if getattr(dtype, "kind", "") in ("m", "M"):
        raise ParameterError(f"{where}: expected numbers, got {dtype}, whose unit would be lost. Divide a duration by "
                             "np.timedelta64(1, 's') for seconds.")  # fmt: skip


def write_arrays(
    path: Path | str, what: str, version: int, header: Mapping[str, Any], arrays: Mapping[str, Any]
) -> None:
    """Write named arrays and a JSON header as compressed npz, whole; the same contents give the same bytes."""
    table = {"format": f"ohmloom.{what}", "version": version, **header}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, header=np.array(json.dumps(table, sort_keys=True)), **arrays)
    write_atomic(path, buffer.getvalue())


def read_arrays(
    path: Path | str, what: str, version: int, names: Sequence[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read what `write_arrays` wrote: header, and the arrays of these names.

    Raises
    ------
    MissingFileError
        If the file does not exist.
    FileFormatError
        If it is damaged, of another format or version, or lacks an array of numbers.
    """
    where = str(path)
    data = read_bytes(path, what, limit=None)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, AttributeError, TypeError, KeyError, *DAMAGED_ZIP) as error:
        raise FileFormatError(
            f"{where}: expected an npz file of a {what}, got {error}. It may be truncated."
        ) from error
    if "header" not in found or found["header"].dtype.kind != "U":
        raise FileFormatError(f"{where}: header: expected text, got nothing. Check that this is a {what} file.")
    header = check_format(parse_json(str(found["header"]).encode(), where), where, f"ohmloom.{what}", version)
    for name in names:
        if name not in found:
            raise FileFormatError(f"{where}: {name}: expected an array, got nothing. Make the {what} again.")
        if found[name].dtype.kind not in "fiub":
            raise FileFormatError(f"{where}: {name}: expected numbers, got {found[name].dtype}. Make the {what} again.")
    return header, {name: found[name] for name in names}
