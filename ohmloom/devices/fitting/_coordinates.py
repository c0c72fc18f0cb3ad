"""What a fit varies: each parameter's logarithm or itself, within bounds, and the state at each sweep's start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.fitting._features import Features
from ohmloom.devices.laws import Law, Parameter
from ohmloom.devices.laws._functions import smaller
from ohmloom.devices.laws._law import ORDERED

# A fit looks this many decades to either side of what the data suggest.
DECADES = 4.0
# Random starts lie in two decades about it.
START_DECADES = 1.0
SMALLEST_RATIO, LARGEST_RATIO = 1.001, 1e7
SMALLEST_RANGE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Coordinates:
    """The fitted parameters of a law as coordinates z, and back.

    z is the natural logarithm where the parameter varies on a log scale, else the value. Where r_on and r_off are
    both fitted, r_off's coordinate is ``ln(r_off/r_on)``, so that a box keeps r_on below r_off. The coordinates of
    the states at the start of each sweep, themselves in [0, 1], follow those of the parameters.

    Attributes
    ----------
    free
        The fitted parameters, in declared order.
    held
        Values of the others, by name, SI.
    """

    law: Law
    free: tuple[Parameter, ...]
    held: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return tuple(parameter.name for parameter in self.free)

    @property
    def has_ratio(self) -> bool:
        """Whether r_off is written as a ratio to r_on."""
        return {"r_on", "r_off"} <= set(self.names)

    def values(self, z: Any, exp: Any = math.exp) -> dict[str, Any]:
        """Value of each parameter of the law by name, from coordinates (numbers, or symbols with their own `exp`)."""
        found: dict[str, Any] = {}
        for k, parameter in enumerate(self.free):
            coordinate = z[k]
            if self.has_ratio and parameter.name == "r_off":
                coordinate = coordinate + z[self.names.index("r_on")]
            found[parameter.name] = exp(coordinate) if parameter.scale == "log" else coordinate
            if self.has_ratio and parameter.name == "r_off":
                # A box for r_on and the ratio has a corner beyond the law's own limit.
                found[parameter.name] = smaller(found[parameter.name], parameter.upper)
        return {name: found.get(name, self.held.get(name)) for name in self.law.parameter_names}

    def of_values(self, values: Mapping[str, float]) -> FloatArray:
        """Coordinates of the fitted parameters; the inverse of `values`."""
        z = [math.log(values[p.name]) if p.scale == "log" else values[p.name] for p in self.free]
        if self.has_ratio:
            z[self.names.index("r_off")] -= z[self.names.index("r_on")]
        return np.array(z)

    def transform(self) -> FloatArray:
        """Matrix from coordinates to each parameter's own logarithm or value, axes (parameter, coordinate)."""
        matrix = np.eye(len(self.free))
        if self.has_ratio:
            matrix[self.names.index("r_off"), self.names.index("r_on")] = 1.0
        return matrix

    def nominal(self, features: Features) -> dict[str, float]:
        """Values that the data suggest, within the law's bounds."""
        return {p.name: min(max(features.suggest(p, self.law), p.lower), p.upper) for p in self.free}

    def bounds(self, features: Features) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters' coordinates."""
        low, high = [], []
        for parameter, z in zip(self.free, self.of_values(self.nominal(features)), strict=True):
            if self.has_ratio and parameter.name == "r_off":
                a, b = math.log(SMALLEST_RATIO), math.log(LARGEST_RATIO)
            elif parameter.scale == "log":
                reach = DECADES * math.log(10.0)
                smallest, largest = (math.log(end) for end in self._limits(parameter))
                a = min(max(z - reach, smallest), largest - SMALLEST_RANGE)
                b = max(min(z + reach, largest), smallest + SMALLEST_RANGE)
            else:
                reach = 3.0 * max(features.voltage, parameter.lower) if parameter.unit == "V" else math.inf
                a, b = max(parameter.lower, -reach), min(parameter.upper, reach)
            low.append(a)
            high.append(b)
        return np.array(low), np.array(high)

    def _limits(self, parameter: Parameter) -> tuple[float, float]:
        """The law's bounds of a parameter, narrowed where one that must be smaller or larger is held."""
        low, high = parameter.lower, parameter.upper
        for smaller_name, larger_name in ORDERED:
            if parameter.name == smaller_name:
                high = min(high, self.held.get(larger_name, parameter.upper) / SMALLEST_RATIO)
            elif parameter.name == larger_name:
                low = max(low, self.held.get(smaller_name, 0.0) * SMALLEST_RATIO)
        return low, high

    def random(self, features: Features, rng: np.random.Generator) -> FloatArray:
        """Coordinates of one random start: two decades about the nominal value, or anywhere between linear bounds."""
        values = self.nominal(features)
        for parameter in self.free:
            spread = rng.uniform(-1.0, 1.0)
            if parameter.scale == "linear" and parameter.unit == "V" and parameter.lower >= 0.0:
                spread = abs(spread)
            if parameter.scale == "log":
                values[parameter.name] *= 10.0 ** (START_DECADES * spread)
            elif parameter.unit == "V":
                values[parameter.name] = max(features.voltage * spread, parameter.lower)
            else:
                middle = 0.5 * (parameter.lower + parameter.upper)
                values[parameter.name] = middle + 0.5 * (parameter.upper - parameter.lower) * spread
        if self.has_ratio and values["r_on"] > values["r_off"]:
            values["r_on"], values["r_off"] = values["r_off"], values["r_on"]
        return self.of_values(values)


def choose(law: Law, fixed: Mapping[str, float], freed: Sequence[str]) -> Coordinates:
    """The law's own choice of what is fitted, with `fixed` held and `freed` fitted too; the names are known."""
    free = tuple(p for p in law.parameters if (p.fitted or p.name in freed) and p.name not in fixed)
    held = {p.name: float(fixed.get(p.name, p.default)) for p in law.parameters if p not in free}
    return Coordinates(law=law, free=free, held=held)
