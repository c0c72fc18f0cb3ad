"""A figure of a feasibility study: value, unit, limit, margin, source, status, and the rules that give a status.

The figures themselves stand in `figures_cost` (time, energy, wear), `figures_array` (wires, thresholds, disturb, yield)
and `figures_behaviour` (events, weights, success).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ohmloom.mapping import Hardware, Plan, Quantity
from ohmloom.mapping.quantity import ASSUMED as ASSUMED_SOURCE
from ohmloom.units import format_quantity

PASS, MARGINAL, FAIL, ASSUMED, NOT_RUN = "PASS", "MARGINAL", "FAIL", "ASSUMED", "NOT_RUN"
MARGINAL_BELOW = 0.2
NON_INFERIORITY = -0.05
DESIGN_SOURCE = "ohmloom's criterion"


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of a study.

    Attributes
    ----------
    name, value, unit
        What was found, in SI; value None where it was not run.
    limit, margin
        The limit, and (limit - value) / abs(limit) with the sign of the good direction; None without a limit.
    source
        Where the limit comes from.
    status
        PASS, MARGINAL (margin under 20 %), FAIL, ASSUMED (an assumed input decides), or NOT_RUN.
    detail
        How the value comes about, in a sentence.
    """

    name: str
    value: float | None
    unit: str
    limit: float | None
    margin: float | None
    source: str
    status: str
    detail: str

    @property
    def sentence(self) -> str:
        """Why this figure binds, in one sentence that names it."""
        if self.value is None or self.limit is None:
            return f"{self.name}: {self.detail}"
        value, limit = format_quantity(self.value, self.unit), format_quantity(self.limit, self.unit)
        return f"{self.name} is {value} against a limit of {limit} ({self.status}): {self.detail}"


def margin_of(value: float, limit: float, *, low_is_good: bool) -> float:
    """(limit - value) / abs(limit), positive on the good side.

    >>> margin_of(1.0, 2.0, low_is_good=True), margin_of(1.0, 2.0, low_is_good=False)
    (0.5, -0.5)
    """
    return (limit - value if low_is_good else value - limit) / abs(limit)


def status_of(margin: float) -> str:
    """PASS, MARGINAL or FAIL.

    >>> status_of(0.5), status_of(0.1), status_of(-0.1)
    ('PASS', 'MARGINAL', 'FAIL')
    """
    return FAIL if margin < 0.0 else MARGINAL if margin < MARGINAL_BELOW else PASS


def formula_figure(
    name: str,
    value: Callable[[Mapping[str, float]], float],
    unit: str,
    limit: Quantity | None,
    inputs: Mapping[str, Quantity],
    detail: str,
    *,
    low_is_good: bool,
) -> Figure:
    """A figure that is a formula of spec quantities; it is tried at both ends of every assumed one."""
    nominal = value({key: quantity.value for key, quantity in inputs.items()})
    if limit is None:
        return Figure(name=name, value=nominal, unit=unit, limit=None, margin=None, source="no limit in the spec",
                      status=ASSUMED, detail=detail)  # fmt: skip
    margin = margin_of(nominal, limit.value, low_is_good=low_is_good)
    statuses = set()
    for corner in itertools.product(limit.extremes, *(quantity.extremes for quantity in inputs.values())):
        at_corner = value(dict(zip(inputs, corner[1:], strict=True)))
        statuses.add(status_of(margin_of(at_corner, corner[0], low_is_good=low_is_good)))
    status = status_of(margin) if statuses <= {status_of(margin)} else ASSUMED
    if status == ASSUMED:
        names = [key for key, quantity in inputs.items() if quantity.is_assumed]
        names += ["its limit"] if limit.is_assumed else []
        detail += f" The status rests on what is assumed of {' and '.join(names)}."
    return Figure(name=name, value=nominal, unit=unit, limit=limit.value, margin=margin, source=limit.source,
                  status=status, detail=detail)  # fmt: skip


def capped_by_cards(figure: Figure, plan: Plan) -> Figure:
    """A figure that follows from device cards cannot pass on assumed values of theirs."""
    assumed = [
        f"{tile.card}.{name}"
        for tile in plan.tiles
        for name, source in plan.hardware.devices[tile.kind].sources.items()
        if source.strip().lower().startswith(ASSUMED_SOURCE)
    ]
    if not assumed or figure.status not in (PASS, MARGINAL):
        return figure
    detail = f"{figure.detail} It rests on what the device cards assume: {', '.join(assumed)}."
    return replace(figure, status=ASSUMED, detail=detail)


def sampled_status(margin: float, hardware: Hardware) -> str:
    """A figure from sampled dies cannot pass on assumed non-idealities."""
    status = status_of(margin)
    effects = hardware.quantities().items()
    is_assumed = any(q.is_assumed and q.value > 0.0 for name, q in effects if name.startswith("nonidealities."))
    return ASSUMED if status == PASS and is_assumed else status
