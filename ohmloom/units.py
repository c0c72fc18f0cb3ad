"""Units: how a quantity in SI is written for a person."""

from __future__ import annotations

import math

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
UNSCALED = frozenset({"", "1", "events", "pulses", "dies", "trials", "%"})


def format_quantity(value: float, unit: str, digits: int = 3) -> str:
    """Write `value`, in SI, with a metric prefix.

    >>> format_quantity(0.00152, "s")
    '1.52 ms'
    >>> format_quantity(90.9, "events"), format_quantity(24777, "pulses")
    ('90.9 events', '24,777 pulses')
    """
    if not math.isfinite(value):
        return f"{value} {unit}".strip()
    if unit in UNSCALED or value == 0:
        text = f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.{digits}g}"
        return f"{text} {'' if unit == '1' else unit}".strip()
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = min(max(3 * math.floor(math.log10(abs(rounded)) / 3), -15), 9)
    scaled = rounded / 10.0**exponent
    return f"{scaled:.{digits}g} {_PREFIXES[exponent]}{unit}"
