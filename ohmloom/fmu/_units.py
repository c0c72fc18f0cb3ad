"""Units as FMI wants them: exponents of the SI base units."""

from __future__ import annotations

import re

from ohmloom.errors import UnknownNameError

_BASES: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "rad": {"rad": 1},
    "C": {"s": 1, "A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "S": {"kg": -1, "m": -2, "s": 3, "A": 2},
}


def base_exponents(unit: str) -> dict[str, int]:
    """Exponents of the SI base units in `unit`, a product or quotient, without those that are 0.

    >>> base_exponents("1/(V s)")
    {'kg': -1, 'm': -2, 's': 2, 'A': 1}

    Raises
    ------
    UnknownNameError
        If a part of it is no unit that ohmloom uses.
    """
    above, _, below = unit.partition("/")
    found = dict.fromkeys(("kg", "m", "s", "A", "rad"), 0)
    for text, sign in ((above, 1), (below, -1)):
        for part in re.findall(r"[^\s()]+", text):
            match = re.fullmatch(r"(\D+?|1)\^?(\d*)", part)
            name, power = match.groups() if match else (part, "")
            if name not in _BASES:
                raise UnknownNameError.of(f"unit {unit}", part, _BASES)
            for base, exponent in _BASES[name].items():
                found[base] += sign * exponent * int(power or 1)
    return {base: exponent for base, exponent in found.items() if exponent}
