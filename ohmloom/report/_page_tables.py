"""Rows of the report's tables: figures, success, the spec and its device cards."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from ohmloom._files import StrictModel
from ohmloom.mapping import Hardware, Quantity
from ohmloom.mapping.hardware import UNITS
from ohmloom.mapping.quantity import ASSUMED
from ohmloom.report import _page_words as words
from ohmloom.sim import Feasibility, Figure
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from ohmloom.devices import Device

Row = dict[str, str]
WORST_FIRST: Final = ("FAIL", "MARGINAL", "ASSUMED", "NOT_RUN", "PASS")


def figure_row(figure: Figure) -> dict[str, Any]:
    """A figure in words; value, limit and margin each with the number that they are sorted by."""

    def amount(value: float | None) -> tuple[str, float | str]:
        return ("–", "") if value is None else (format_quantity(value, figure.unit), float(value))

    rank = WORST_FIRST.index(figure.status) if figure.status in WORST_FIRST else len(WORST_FIRST)
    return {
        "name": figure.name, "title": words.FIGURES.get(figure.name, ""), "value": amount(figure.value),
        "limit": amount(figure.limit), "status": figure.status, "detail": figure.detail, "source": figure.source,
        "margin": (words.margin(figure.margin), "" if figure.margin is None else float(figure.margin)), "rank": rank,
    }  # fmt: skip


def success_rows(study: Feasibility) -> list[tuple[str, str, str, str]]:
    """Controller, count, rate and interval."""
    if (s := study.success) is None:
        return []
    return [
        (name, f"{round(rate * s.n)} of {s.n}", words.percent(rate), f"{words.percent(low)} to {words.percent(high)}")
        for name, rate, (low, high) in (
            ("ideal network", s.ideal, s.ideal_interval),
            ("hardware", s.hardware, s.hardware_interval),
        )
    ] + [(
        "hardware less ideal", "", f"{words.points(s.hardware - s.ideal)} points",
        f"{words.points(s.interval[0])} to {words.points(s.interval[1])} points",
    )]  # fmt: skip


def spec_rows(hardware: Hardware) -> list[Row]:
    """Every setting of the spec, with its source."""
    rows = []
    for section in type(hardware).model_fields:
        table = getattr(hardware, section)
        if isinstance(table, StrictModel):
            for name in type(table).model_fields:
                value = getattr(table, name)
                if value is not None and name != "source":
                    rows.append(_spec_row(f"{section}.{name}", value, getattr(table, "source", "")))
    return rows


def _spec_row(name: str, value: Any, source: str) -> Row:
    if not isinstance(value, Quantity):
        return {"name": name, "value": str(value), "range": "", "source": source}
    unit = UNITS[name]
    return {"name": name, "value": format_quantity(value.value, unit), "range": _range(value.range, unit),
            "source": value.source}  # fmt: skip


def _range(ends: tuple[float, float] | None, unit: str) -> str:
    return "" if ends is None else " to ".join(format_quantity(end, unit) for end in ends)


def assumed_rows(hardware: Hardware, devices: dict[str, Device]) -> list[Row]:
    """What nobody but the spec or the card of a device that is used stands behind."""
    cards = [
        {**row, "name": f"{device.name}: {row['name']}"} for device in devices.values() for row in _card_rows(device)
    ]
    return [row for row in (*spec_rows(hardware), *cards) if row["source"].strip().lower().startswith(ASSUMED)]


def card(kind: str, device: Device) -> dict[str, Any]:
    return {"kind": kind, "name": device.name, "law": device.law, "source": device.source, "sha256": device.sha256,
            "rows": _card_rows(device)}  # fmt: skip


def _card_rows(device: Device) -> list[Row]:
    from ohmloom.devices.laws import LAWS

    return [
        {"name": parameter.name, "value": format_quantity(entry.value, parameter.unit),
         "range": _range(entry.interval, parameter.unit), "source": entry.source}
        for parameter, entry in zip(LAWS[device.law].parameters, device.values, strict=True)
    ]  # fmt: skip
