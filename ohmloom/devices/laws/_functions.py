"""Functions that laws use beside `+ - * / **` and comparisons: for floats, arrays and CasADi symbols alike.

A comparison times a value, ``(x > 0.0) * y``, stands for a choice in all of them, where `y` is finite. The elementary
functions have a numeric form apart, which is what the compiled kernels use; floats take the short way through `math`,
where an overflow or a domain error raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

# Above it e^x is held: nothing that a device does needs more, and no overflow reaches a solver as NaN.
LARGEST_EXPONENT = 200.0


def exp(x: Any) -> Any:
    """e^x."""
    if type(x) is float:
        return math.exp(x)
    return x.exp() if hasattr(x, "is_symbolic") else _exp(x)


def sinh(x: Any) -> Any:
    """Hyperbolic sine."""
    if type(x) is float:
        return math.sinh(x)
    return x.sinh() if hasattr(x, "is_symbolic") else _sinh(x)


def log(x: Any) -> Any:
    """Natural logarithm."""
    if type(x) is float:
        return math.log(x)
    return x.log() if hasattr(x, "is_symbolic") else _log(x)


def sqrt(x: Any) -> Any:
    """Square root."""
    if type(x) is float:
        return math.sqrt(x)
    return x.sqrt() if hasattr(x, "is_symbolic") else _sqrt(x)


def smaller(x: Any, limit: Any) -> Any:
    """The smaller of a value, which may be a symbol, and a limit."""
    if type(x) is float and type(limit) is float:
        return x if x < limit else limit
    if hasattr(limit, "is_symbolic"):
        return limit.fmin(x)
    return x.fmin(limit) if hasattr(x, "is_symbolic") else _smaller(x, limit)


def larger(x: Any, limit: Any) -> Any:
    """The larger of a value, which may be a symbol, and a limit."""
    if type(x) is float and type(limit) is float:
        return x if x > limit else limit
    if hasattr(limit, "is_symbolic"):
        return limit.fmax(x)
    return x.fmax(limit) if hasattr(x, "is_symbolic") else _larger(x, limit)


def bounded_exp(x: Any) -> Any:
    """e^x, held where x is beyond +-LARGEST_EXPONENT."""
    return exp(larger(smaller(x, LARGEST_EXPONENT), -LARGEST_EXPONENT))


def bounded_sinh(x: Any) -> Any:
    """sinh x, held in the same way."""
    return sinh(larger(smaller(x, LARGEST_EXPONENT), -LARGEST_EXPONENT))


def sinhc(x: Any) -> Any:
    """sinh(x)/x, 1 at 0, held in the same way."""
    near = abs(x) < 1e-3
    far = smaller(x + near * 1.0, LARGEST_EXPONENT)
    safe = larger(far, -LARGEST_EXPONENT)
    return near * (1.0 + x * x / 6.0) + (1.0 - near) * sinh(safe) / safe


def logistic(x: Any) -> Any:
    """1/(1 + e^-x): a step that is smooth over a few units of x."""
    return 1.0 / (1.0 + bounded_exp(-x))


def _exp(x: Any) -> Any:
    return np.exp(x)


def _sinh(x: Any) -> Any:
    return np.sinh(x)


def _log(x: Any) -> Any:
    return np.log(x)


def _sqrt(x: Any) -> Any:
    return np.sqrt(x)


def _smaller(x: Any, limit: Any) -> Any:
    return np.minimum(x, limit)


def _larger(x: Any, limit: Any) -> Any:
    return np.maximum(x, limit)


ELEMENTARY: dict[Callable[..., Any], Callable[..., Any]] = {
    exp: _exp, sinh: _sinh, log: _log, sqrt: _sqrt, smaller: _smaller, larger: _larger,
}  # fmt: skip
COMPOSED: tuple[Callable[..., Any], ...] = (bounded_exp, bounded_sinh, sinhc, logistic)
