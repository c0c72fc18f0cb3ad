"""Checks of what callers pass to a device, made once at the public edge."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array, refuse_counts
from ohmloom.errors import ParameterError, expect_number, shown

LARGEST_TIME = 1e12  # s
LARGEST_VOLTAGE = 1e6  # V


def finite(where: str, values: Any, unit: str) -> FloatArray:
    """`values` as a float64 array of any shape; text and booleans are no numbers."""
    refuse_counts(where, values)
    rule = f"numbers in {unit}" if unit else "numbers"
    try:
        if np.asarray(values).dtype.kind in "bSU":
            raise TypeError
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{where}: expected {rule}, got {shown(values)}. Pass floats.") from error
    if not np.isfinite(array).all():
        raise ParameterError(f"{where}: expected finite numbers, got NaN or infinity. Check the input.")
    return array


def series(where: str, values: Any, unit: str) -> FloatArray:
    """`values` as a read-only float64 array with axes (time,)."""
    array: FloatArray = frozen_array(where, finite(where, values, unit), ("time",))
    return array


def check_size(where: str, values: FloatArray, limit: float, unit: str) -> None:
    """Refuse what would overflow in the integrator."""
    size = float(np.abs(values).max(initial=0.0))
    if size > limit:
        raise ParameterError(f"{where}: expected at most {limit:g} {unit} in size, got {size:g} {unit}. "
                             "Check the unit.")  # fmt: skip


def check_number(where: str, value: Any) -> float:
    return expect_number(where, value, "a finite number in SI units")


def checked_function(where: str, voltage: Callable[[float], Any], t: FloatArray) -> Callable[[float], float]:
    def drive(time: float) -> float:
        try:
            v = float(voltage(time))
        except (TypeError, ValueError, OverflowError) as error:
            raise ParameterError(
                f"{where}: expected a function from a time in s to one voltage in V, got {error}. "
                "Return a float for a float."
            ) from error
        if not math.isfinite(v):
            raise ParameterError(f"{where}: expected finite volts, got {v} at t = {time:.6g} s. Check the function.")
        check_size(where, np.array(v), LARGEST_VOLTAGE, "V")
        return v

    drive(float(t[0]))
    return drive


def rising_times(where: str, t: Any) -> FloatArray:
    """`t` as times in s that strictly increase, at least two."""
    times = series(f"{where}: t", t, "s")
    if times.size < 2 or not (np.diff(times) > 0).all():
        raise ParameterError(
            f"{where}: t: expected at least two times in s, strictly increasing, "
            f"got {times.size} with smallest step {np.diff(times).min(initial=math.inf):.6g} s. "
            "Sort them and drop repeats."
        )
    check_size(f"{where}: t", times, LARGEST_TIME, "s")
    return times


def drive_over(where: str, voltage: Any, t: FloatArray) -> Callable[[float], float]:
    """The voltage as a function of time: the caller's own, checked at each call, or linear between samples."""
    if callable(voltage):
        return checked_function(f"{where}: voltage", voltage, t)
    v = series(f"{where}: voltage", voltage, "V")
    check_size(f"{where}: voltage", v, LARGEST_VOLTAGE, "V")
    if v.shape != t.shape:
        raise ParameterError(
            f"{where}: voltage: expected axes (time,) as long as t, {t.size}, got {v.size}. "
            "Give one value in V per time, or a function of the time."
        )
    return lambda time: float(np.interp(time, t, v))


def like_input(array: Any) -> Any:
    """A float for what came from floats, else the array."""
    return float(array) if np.ndim(array) == 0 else array
