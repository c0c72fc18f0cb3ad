"""Checks of what a caller passes to a fit, made before any of it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.laws import LAWS, Law
from ohmloom.devices.laws._law import ORDERED
from ohmloom.devices.measurement import Measurement
from ohmloom.errors import ParameterError, UnknownNameError, expect_integer, expect_number, expect_type, shown

Weights = Literal["relative", "absolute"] | tuple[float, float]


def check_inputs(measurements: Any, holdout: Any, screen: Any, starts: Any,
                 rng: Any) -> tuple[tuple[Measurement, ...], tuple[Measurement, ...]]:  # fmt: skip
    """Sweeps and hold-out sweeps as tuples."""
    sweeps = (measurements,) if isinstance(measurements, Measurement) else _list("fit.measurements", measurements)
    held_out = (holdout,) if isinstance(holdout, Measurement) else _list("fit.holdout", holdout)
    if not sweeps:
        raise ParameterError("fit.measurements: expected at least one Measurement, got none. Read one with read_csv.")
    names = [sweep.name for sweep in (*sweeps, *held_out)]
    for name in names:
        check_text("fit.measurements: name", name)
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"fit.measurements: expected sweeps of different names, got {name!r} twice. "
                                 "Pass name= to read_csv.")  # fmt: skip
    expect_integer("fit.screen", screen, 1, 1_000_000)
    expect_integer("fit.starts", starts, 1, 10_000)
    expect_type("fit.rng", rng, np.random.Generator)
    return sweeps, held_out


def check_text(where: str, text: Any) -> None:
    """Refuse what a card could not hold, or a picture not show."""
    expect_type(where, text, str)
    if not text or not text.isprintable():
        raise ParameterError(f"{where}: expected printable text, got {shown(text)}. Use another name.")


def check_names(law: Any, fixed: Mapping[str, float], free: Sequence[str]) -> Law:
    """The law, with the names and values of `fixed` and `free` checked against it."""
    expect_type("fit.law", law, str)
    if law not in LAWS:
        raise UnknownNameError.of("fit.law", law, LAWS)
    chosen = LAWS[law]
    if not chosen.is_fittable:
        raise ParameterError(f"fit.law: expected a law to fit, got {law}, a generator of reference data whose "
                             "derivatives are too long. Fit tio2_threshold to such data.")  # fmt: skip
    by_name = {p.name: p for p in chosen.parameters}
    expect_type("fit.fixed", fixed, Mapping)
    if isinstance(free, str) or not isinstance(free, Sequence):
        raise ParameterError(f"fit.free: expected names in a list, got {shown(free)}. Put them in brackets.")
    for name in (*fixed, *free):
        expect_type("fit.fixed" if name not in free else "fit.free", name, str)
        if name not in by_name:
            raise UnknownNameError.of("fit.fixed" if name in fixed else "fit.free", name, by_name)
        if free.count(name) > 1:
            raise ParameterError(f"fit.free: expected each name once, got {name!r} twice. Remove one.")
    for name, value in fixed.items():
        parameter = by_name[name]
        number = expect_number(f"fit.fixed: {name}", value, "a finite number in SI units")
        if not parameter.lower <= number <= parameter.upper:
            raise ParameterError(
                f"fit.fixed: {name}: expected {parameter.lower:.6g} to {parameter.upper:.6g} {parameter.unit}, "
                f"got {number:.6g} {parameter.unit}. Check its unit."
            )
        if name in free:
            raise ParameterError(f"fit.free: expected no name that is fixed too, got {name!r}. Drop one of the two.")
    for low, high in ORDERED:
        if {low, high} <= set(fixed) and fixed[low] >= fixed[high]:
            unit = by_name[low].unit
            raise ParameterError(f"fit.fixed: {low}: expected less than {high} = {fixed[high]:.6g} {unit}, got "
                                 f"{fixed[low]:.6g} {unit}. Lower {low} or raise {high}.")  # fmt: skip
    if all(p.name in fixed or not (p.fitted or p.name in free) for p in chosen.parameters):
        raise ParameterError(f"fit.fixed: expected at least one parameter of {law} to fit, got all of them fixed. "
                             "Free one.")  # fmt: skip
    return chosen


def sizes(sweeps: Sequence[Measurement], weights: Weights) -> tuple[FloatArray, ...]:
    """What each sample's residual is divided by, so that its squares sum to a squared relative RMS."""
    if isinstance(weights, str):
        if weights not in ("relative", "absolute"):
            raise UnknownNameError.of("fit.weights", weights, ("relative", "absolute"))
        common = np.sqrt(np.mean(np.concatenate([sweep.i for sweep in sweeps]) ** 2))
        own = [np.sqrt(np.mean(sweep.i**2)) for sweep in sweeps]
        used = own if weights == "relative" else [common] * len(sweeps)
        if min(used) <= 0.0:
            raise ParameterError("fit.measurements: expected currents above 1e-150 A in size, got smaller ones. "
                                 "Check the unit.")  # fmt: skip
        return tuple(np.full(len(sweep.t), rms * np.sqrt(len(sweep.t) * len(sweeps)))
                     for sweep, rms in zip(sweeps, used, strict=True))  # fmt: skip
    if not isinstance(weights, Sequence) or len(weights) != 2:
        raise ParameterError(f"fit.weights: expected 'relative', 'absolute' or (a, b) for a + b |i|, got "
                             f"{shown(weights)}. Give two numbers.")  # fmt: skip
    a, b = (expect_number(f"fit.weights: {name}", value, rule) for name, value, rule in zip(
        ("a", "b"), weights, ("a number in A", "a number"), strict=True))  # fmt: skip
    if a <= 0.0 or b < 0.0:
        raise ParameterError(f"fit.weights: expected a > 0 A and b >= 0 in a + b |i|, got a = {a:.6g} A, b = {b:.6g}. "
                             "Give the current's absolute and relative uncertainty.")  # fmt: skip
    deviations = [a + b * np.abs(sweep.i) for sweep in sweeps]
    with np.errstate(over="ignore"):
        total = sum(float(np.sum((sweep.i / d) ** 2)) for sweep, d in zip(sweeps, deviations, strict=True))
    if not 0.0 < total < np.inf:
        raise ParameterError(f"fit.weights: expected a + b |i| near the current's uncertainty, got a = {a:.6g} A, "
                             f"b = {b:.6g}. Check the unit of a.")  # fmt: skip
    return tuple(d * np.sqrt(total) for d in deviations)


def _list(where: str, values: Any) -> tuple[Measurement, ...]:
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise ParameterError(f"{where}: expected Measurements in a list, got {shown(values)}. Read them with read_csv.")
    for value in values:
        expect_type(where, value, Measurement)
    return tuple(values)
