"""The one gate through which arrays enter frozen objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ohmloom.errors import ParameterError

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
        If the number of axes or a fixed length disagrees, or if a value is NaN or infinite.
    """
    array = np.array(values, dtype=dtype)
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
