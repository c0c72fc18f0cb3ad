"""The report of a feasibility study: one HTML file that opens by double click and asks nothing of the network."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ohmloom._files import StrictModel, write_atomic
from ohmloom.mapping import Hardware, Quantity
from ohmloom.mapping.hardware import UNITS
from ohmloom.mapping.quantity import ASSUMED
from ohmloom.report import _page_pictures as pictures
from ohmloom.report import _page_words as words
from ohmloom.sim import Feasibility, Figure
from ohmloom.units import format_quantity

if TYPE_CHECKING:
    from ohmloom.devices import Device

Row = dict[str, str]


def write_report(study: Feasibility, path: Path | str, *, command: str) -> None:
    """Write the report: verdict and reasons, figures, success, exactness, pictures, assumptions, sources.

    Style and pictures are inside the file, scripts there are none. The same study and command give the same bytes
    with the same matplotlib.

    Parameters
    ----------
    study
        From `feasibility`; one that was loaded from a file has no pictures and no spec, and the report says so.
    path
        Where to; replaced as a whole.
    command
        The command line that makes the study again, shown as text.

    Raises
    ------
    OperationError
        If the file cannot be written.
    """
    write_atomic(path, report_page(study, command=command))


def report_page(study: Feasibility, *, command: str) -> str:
    """Compose the page that `write_report` writes."""
    import jinja2
    from markupsafe import Markup

    folder = resources.files("ohmloom.report") / "templates"
    template, style = ((folder / name).read_text(encoding="utf-8") for name in ("report.html", "report.css"))
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(template).render(style=Markup(style), **_context(study, command))
    # A name that came from a file's may hold bytes that no text file can.
    return page.encode(errors="replace").decode()


def _context(study: Feasibility, command: str) -> dict[str, Any]:
    given = study.provenance
    names = [figure.name for figure in study.figures]
    hardware = study.plan.hardware if study.plan is not None else None
    used = {tile.kind for tile in study.plan.tiles} if study.plan is not None else set()
    devices = {kind: device for kind, device in hardware.devices.items() if kind in used} if hardware else {}
    return {
        "network": given.get("network", "network"), "hardware": given.get("hardware", "hardware"),
        "task": given.get("task", "unknown"), "dies": given.get("dies", 0), "given": given, "command": command,
        "verdict": study.verdict, "verdict_line": words.verdict_line(study),
        "reasons": [_split(reason, names) for reason in study.reasons],
        "count_line": words.count_line([figure.status for figure in study.figures]),
        "figures": [_figure_row(figure) for figure in study.figures], "statuses": words.STATUSES,
        "success": study.success, "success_rows": _success_rows(study),
        "success_line": words.success_line(study.success) if study.success else "",
        "p_line": words.p_line(study.success) if study.success else "",
        "exactness": [(name, words.EXACTNESS.get(name, ""), holds) for name, holds in study.exactness.items()],
        "not_applicable": dict(study.not_applicable),
        "agreement_line": words.agreement_line(study.agreement) if study.agreement else "",
        "paths": pictures.paths(study), "tiles": pictures.tiles(study), "weights": pictures.weights(study),
        "plan": study.plan, "spec": _spec_rows(hardware) if hardware else [],
        "description": hardware.description if hardware else "",
        "assumed": _assumed_rows(hardware, devices) if hardware else [],
        "cards": [_card(kind, device) for kind, device in devices.items()],
        "unused": [device.name for kind, device in hardware.devices.items() if kind not in used] if hardware else [],
        "not_modelled": study.not_modelled,
    }  # fmt: skip


def _split(reason: str, names: list[str]) -> tuple[str, str]:
    """The figure's name at the start of a reason, if there is one, and the rest."""
    name = next((name for name in names if reason.startswith(name)), "")
    return name, reason.removeprefix(name)


def _figure_row(figure: Figure) -> Row:
    def amount(value: float | None) -> str:
        return "–" if value is None else format_quantity(value, figure.unit)

    return {
        "name": figure.name, "title": words.FIGURES.get(figure.name, ""), "value": amount(figure.value),
        "limit": amount(figure.limit), "status": figure.status, "detail": figure.detail, "source": figure.source,
        "margin": words.margin(figure.margin),
    }  # fmt: skip


def _success_rows(study: Feasibility) -> list[tuple[str, str, str, str]]:
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


def _spec_rows(hardware: Hardware) -> list[Row]:
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


def _assumed_rows(hardware: Hardware, devices: dict[str, Device]) -> list[Row]:
    """What nobody but the spec or the card of a device that is used stands behind."""
    cards = [
        {**row, "name": f"{device.name}: {row['name']}"} for device in devices.values() for row in _card_rows(device)
    ]
    return [row for row in (*_spec_rows(hardware), *cards) if row["source"].strip().lower().startswith(ASSUMED)]


def _card(kind: str, device: Device) -> dict[str, Any]:
    return {"kind": kind, "name": device.name, "law": device.law, "source": device.source, "sha256": device.sha256,
            "rows": _card_rows(device)}  # fmt: skip


def _card_rows(device: Device) -> list[Row]:
    from ohmloom.devices.laws import LAWS

    return [
        {"name": parameter.name, "value": format_quantity(entry.value, parameter.unit),
         "range": _range(entry.interval, parameter.unit), "source": entry.source}
        for parameter, entry in zip(LAWS[device.law].parameters, device.values, strict=True)
    ]  # fmt: skip
