"""Units: how a quantity in SI is written for a person, and what a person's unit is in SI."""

from __future__ import annotations

import math
import re

from ohmloom.errors import ParameterError, UnknownNameError, expect_type, shown

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
UNSCALED = frozenset({"", "1", "events", "pulses", "dies", "trials", "%"})
BASES = ("s", "V", "A", "Ohm", "S", "C", "Hz", "F", "W", "J")
_TIMES = {"min": 60.0, "h": 3600.0}
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
# Both signs that print as micro and as ohm, and the lower-case ohm.
_SPELLINGS = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u03a9": "Ohm", "\u2126": "Ohm"})


def format_quantity(value: float, unit: str, digits: int = 3) -> str:
    """Write `value`, in SI, with a metric prefix.

    >>> format_quantity(0.00152, "s")
    '1.52 ms'
    >>> format_quantity(90.9, "events"), format_quantity(24777, "pulses")
    ('90.9 events', '24,777 pulses')
    >>> format_quantity(0.0094, "1/s"), format_quantity(4e-12, "m2")
    ('0.0094 1/s', '4e-12 m2')
    """
    if not math.isfinite(value):
        return f"{value} {unit}".strip()
    # A prefix belongs to one unit, not to a quotient or a power of units.
    if unit in UNSCALED or "/" in unit or unit[-1].isdigit() or value == 0:
        text = f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.{digits}g}"
        return f"{text} {'' if unit == '1' else unit}".strip()
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = min(max(3 * math.floor(math.log10(abs(rounded)) / 3), -15), 9)
    scaled = rounded / 10.0**exponent
    return f"{scaled:.{digits}g} {_PREFIXES[exponent]}{unit}"


def axis_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor from SI to the unit in which `largest` reads as a number from 0.2 to 200, and that unit.

    >>> axis_unit(0.00015, "A"), axis_unit(0.8, "V"), axis_unit(3.0, "1/V")
    ((1000000.0, 'uA'), (1.0, 'V'), (1.0, '1/V'))
    """
    if unit not in BASES or not math.isfinite(largest) or largest == 0.0:
        return 1.0, unit
    most = 0 if unit == "s" else 9  # nobody counts in kiloseconds
    exponent = min(max(3 * math.floor((math.log10(abs(largest)) - math.log10(0.2)) / 3), -15), most)
    return float(f"1e{-exponent}"), f"{_PREFIXES[exponent]}{unit}"


def parse_quantity(text: str, base: str, *, where: str = "quantity") -> float:
    """A number with or without its unit, in the SI unit `base`; a prefix may stand alone.

    >>> parse_quantity("5k", "Ohm"), parse_quantity("5 kOhm", "Ohm"), parse_quantity("2min", "s")
    (5000.0, 5000.0, 120.0)
    >>> parse_quantity("5 kV", "Ohm")
    Traceback (most recent call last):
    ohmloom.errors.UnknownNameError: quantity: expected a unit of Ohm, such as mOhm, got 'kV', a unit of V. Check that \
this is the right quantity.

    Raises
    ------
    ParameterError
        If `text` does not begin with a number, or is not finite.
    UnknownNameError
        If what follows the number is no unit of `base`.
    """
    found = _NUMBER.fullmatch(text)
    number = float(found[1]) if found else math.nan
    if found is None or not math.isfinite(number):
        example = f", such as 5 or 5k{base}" if base in BASES else ""
        rule = f"a number in {base}{example}" if base not in UNSCALED else "a number"
        raise ParameterError(f"{where}: expected {rule}, got {shown(text)}. Correct it.")
    unit = found[2]
    if unit in ("", base):
        return number
    if base not in BASES:
        rule = f"a number in {base}" if base not in UNSCALED else "a number without a unit"
        raise ParameterError(f"{where}: expected {rule}, got {shown(text)}. Leave {shown(unit)} out.")
    if find_unit(unit, base) is None and unit in _PREFIXES.values():
        unit += base
    # Both as decimal text, so that 5k is the float that 5000 is.
    factor = parse_unit(unit, base, where=where)
    return number / round(1.0 / factor) if factor < 1.0 else number * factor


def parse_unit(text: str, base: str, *, where: str = "unit") -> float:
    """Factor from the unit `text` to the SI unit `base`.

    Prefixes are f, p, n, u (or the Greek mu), m, k, M, G or none; times may also be in min and h. Upper and lower
    case differ (mV, MV).

    Parameters
    ----------
    text
        The unit, as "uA" or "kOhm".
    base
        An SI unit without a prefix, as "s", "V", "A" or "Ohm".
    where
        What the unit belongs to, for the error.

    Raises
    ------
    UnknownNameError
        If `text` is no unit, or a unit of something else.

    Examples
    --------
    >>> parse_unit("uA", "A"), parse_unit("min", "s")
    (1e-06, 60.0)
    >>> parse_unit("mV", "A")
    Traceback (most recent call last):
    ohmloom.errors.UnknownNameError: unit: expected a unit of A, such as mA, got 'mV', a unit of V. Check that this is \
the right quantity.
    """
    expect_type(where, text, str)
    known = known_units(base)
    unit = find_unit(text, base)
    if unit is not None:
        return known[unit]
    for other in BASES:
        if other != base and find_unit(text, other):
            raise UnknownNameError(
                f"{where}: expected a unit of {base}, such as m{base}, got {shown(text)}, a unit of {other}. "
                "Check that this is the right quantity."
            )
    near = find_unit(text, base, any_case=True)
    if near:  # UA is nearer to uA than to A, whatever the letters say
        wanted = ", ".join(sorted(known))
        raise UnknownNameError(f"{where}: expected one of {wanted}, got {shown(text)}. Did you mean {near!r}?")
    raise UnknownNameError.of(where, text, known)


def known_units(base: str) -> dict[str, float]:
    """Factor to SI by unit, for all units of `base`, from the smallest on."""
    units = {f"{prefix}{base}": float(f"1e{exponent}") for exponent, prefix in _PREFIXES.items()}
    return units | _TIMES if base == "s" else units


def find_unit(text: str, base: str, *, any_case: bool = False) -> str | None:
    """The unit of `base` that `text` spells, or None; with `any_case`, the smallest that it spells but for its case.

    >>> find_unit("\u00b5A", "A"), find_unit("kohm", "Ohm"), find_unit("mV", "A")
    ('uA', 'kOhm', None)
    """
    name = text.strip().translate(_SPELLINGS)
    name = f"{name[:-3]}Ohm" if name.endswith("ohm") else name
    if any_case:
        return next((unit for unit in known_units(base) if unit.lower() == name.lower()), None)
    return name if name in known_units(base) else None
