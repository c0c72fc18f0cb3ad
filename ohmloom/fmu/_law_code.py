"""The C text of laws: their functions, and their partial derivatives."""

from __future__ import annotations

from collections.abc import Iterable

from ohmloom.devices import LAWS
from ohmloom.devices._emit_c import emit_function, emit_together
from ohmloom.devices.laws import Law

FUNCTIONS = {"conductance": "sv", "charge_rate": "svi", "charge_scale": ""}
PARTIALS = {
    "conductance_by_s": "sv",
    "conductance_by_v": "sv",
    "charge_rate_by_s": "svi",
    "charge_rate_by_v": "svi",
    "charge_rate_by_i": "svi",
}


def law_text(laws: Iterable[str], functions: Iterable[str] = (*FUNCTIONS, *PARTIALS)) -> str:
    """``law.c``: these functions of every law that is named, once."""
    lines = ["/* Laws: conductance [S] of s and v, charge rate [A] of s, v and i, charge scale [C], derivatives. */"]
    arguments = {**FUNCTIONS, **PARTIALS}
    for name in dict.fromkeys(laws):
        for function in functions:
            lines += ["", *emit_function(LAWS[name], f"static double {name}_", function, tuple(arguments[function]))]
    return "\n".join([*lines, ""])


def partials_text(law: Law) -> str:
    """One function for all of `PARTIALS`, in this order: what they have in common is computed once."""
    head = f"SELDOM static void {law.name}_partials(double s, double v, double i, const double *p, double *by)"
    return "\n".join(emit_together(law, head, tuple(PARTIALS), ("s", "v", "i")))
