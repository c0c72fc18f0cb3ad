"""Conduction that is not ohmic: current of a device as a function of its conductance at low field and its voltage.

A further one is a class here and a line in `CONDUCTIONS`. Current must rise with voltage, and vanish without.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import ParameterError, expect_number

# exp of more than this overflows; a device at 700 times its scale has no physics left.
LARGEST_EXPONENT = 700.0


class Conduction(ABC):
    """How a device conducts; conductances `g` [S] and voltages `v` [V] of one shape in, from row to column positive."""

    @abstractmethod
    def current(self, g: FloatArray, v: FloatArray) -> FloatArray:
        """Current [A]."""

    @abstractmethod
    def slope(self, g: FloatArray, v: FloatArray) -> FloatArray:
        """Its derivative by the voltage [S]."""

    @property
    @abstractmethod
    def largest_voltage(self) -> float:
        """Voltage [V] beyond which the formula overflows."""


@dataclass(frozen=True, kw_only=True)
class SinhConduction(Conduction):
    """Hopping or field-driven conduction, ``i = g scale sinh(v/scale)``; `scale` in V, > 0.

    Equation: Yang et al., Nature Nanotechnology 3 (2008) 429, the off state; valid while `v` is a few times `scale`.

    >>> import numpy as np
    >>> float(SinhConduction(scale=0.5).current(np.array(1e-3), np.array(0.5)).round(9))
    0.000587601
    """

    scale: float

    def __post_init__(self) -> None:
        _positive(self, "scale")

    def current(self, g: FloatArray, v: FloatArray) -> FloatArray:
        return g * self.scale * np.sinh(v / self.scale)

    def slope(self, g: FloatArray, v: FloatArray) -> FloatArray:
        return g * np.cosh(v / self.scale)

    @property
    def largest_voltage(self) -> float:
        return LARGEST_EXPONENT * self.scale


@dataclass(frozen=True, kw_only=True)
class SelectorConduction(Conduction):
    """A device behind a threshold selector, ``i = g v (leak + (1 - leak)/(1 + exp((threshold - |v|)/width)))``.

    `threshold` and `width` in V, > 0; `leak` in (0, 1] is the share that conducts below the threshold. A smooth form of
    our own for a switch; the current rises with the voltage at every voltage.

    >>> import numpy as np
    >>> selector = SelectorConduction(threshold=0.5, width=0.02, leak=1e-3)
    >>> g = np.full(2, 1e-3)
    >>> (selector.current(g, np.array([0.25, 1.0])) / (g * [0.25, 1.0])).round(4).tolist()
    [0.001, 1.0]
    """

    threshold: float
    width: float
    leak: float

    def __post_init__(self) -> None:
        _positive(self, "threshold", "width")
        leak = expect_number("SelectorConduction.leak", self.leak, "a share in (0, 1]")
        if not 0.0 < leak <= 1.0:
            raise ParameterError(f"SelectorConduction.leak: expected a share in (0, 1], got {leak:g}. An ideal switch "
                                 "would leave nodes floating.")  # fmt: skip

    def current(self, g: FloatArray, v: FloatArray) -> FloatArray:
        return g * v * (self.leak + (1.0 - self.leak) * self._open(v))

    def slope(self, g: FloatArray, v: FloatArray) -> FloatArray:
        is_open = self._open(v)
        rise = is_open * (1.0 - is_open) * np.abs(v) / self.width
        return g * (self.leak + (1.0 - self.leak) * (is_open + rise))

    @property
    def largest_voltage(self) -> float:
        return np.inf

    def _open(self, v: FloatArray) -> FloatArray:
        # Both tails without overflow: 1/(1 + exp(-x)) = (1 + tanh(x/2))/2.
        return 0.5 * (1.0 + np.tanh(0.5 * (np.abs(v) - self.threshold) / self.width))


CONDUCTIONS: dict[str, type[Conduction]] = {"sinh": SinhConduction, "selector": SelectorConduction}


def _positive(conduction: Conduction, *names: str) -> None:
    for name in names:
        where = f"{type(conduction).__name__}.{name}"
        value = expect_number(where, getattr(conduction, name), "a voltage in V")
        if value <= 0.0:
            raise ParameterError(f"{where}: expected more than 0 V, got {value:g} V. Leave the conduction out for an "
                                 "ohmic device.")  # fmt: skip
        object.__setattr__(conduction, name, value)
