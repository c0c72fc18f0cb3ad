"""What the report shows of a study beyond its figures: yield, corners, sensitivity, requirements, lifetime."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from ohmloom.report import study_plot as plots
from ohmloom.report._page_svg import figure_of, page_svg
from ohmloom.report._page_words import percent, points
from ohmloom.sim import Feasibility
from ohmloom.units import format_quantity

Cell = tuple[str, float | str]  # text, and what the page's script sorts by


def study_context(study: Feasibility, table: Mapping[str, Any]) -> dict[str, Any]:
    """What the template needs; `table` is the study's object for JSON, whose numbers these are."""
    sensitivity = table["sensitivity"]
    return {
        "margins": _svg(plots.plot_margins, study.figures, key="margins", label="How much of its limit a figure uses")
        if any(plots.share_of_limit(figure) is not None for figure in study.figures) else None,
        "success_pictures": _success_pictures(study),
        "yield_rows": [_yield_row(row) for row in table["yield_"]],
        "yield_picture": _svg(plots.plot_yield, table["yield_"], key="yield", label="Yield over the fault rate")
        if table["yield_"] else None,
        "corners": [_corner_row(row) for row in table["corners"]],
        "requirements": [_requirement_row(row) for row in table["requirements"]],
        "sensitivity": _sensitivity(sensitivity) if sensitivity else None,
        "lifetime": _lifetime(table["lifetime"]),
    }  # fmt: skip


def _svg(plot: Any, *data: Any, key: str, label: str) -> Markup:
    return page_svg(lambda: figure_of(plot(*data)), key, label)


def _success_pictures(study: Feasibility) -> list[Markup]:
    if len(study.dies) < 2:
        return []
    running = plots.running_success(study)
    return [
        _svg(plots.plot_success, running, key="success", label="Fractions that reached the goal, over the dies"),
        _svg(plots.plot_difference, running, key="difference", label="Paired difference, over the dies"),
    ]


def _amount(value: float | None, unit: str) -> Cell:
    return ("–", "") if value is None else (format_quantity(value, unit), float(value))


def _yield_row(row: Mapping[str, Any]) -> list[Cell]:
    low, high = row["interval"]
    repair = "none" if row["repair"] == "none" else "lines permuted"
    return [
        (percent(row["fault_rate"]), row["fault_rate"]), (repair, repair),
        (f"{row['spare_rows']} + {row['spare_columns']}", row["spare_rows"] + row["spare_columns"]),
        (percent(row["value"]), row["value"]), (f"{percent(low)} to {percent(high)}", low), (f"{row['n']:,}", row["n"]),
    ]  # fmt: skip


def _corner_row(row: Mapping[str, Any]) -> dict[str, Any]:
    success, figures = row["success"], row["figures"]
    broken, near = (
        [one["name"] for one in figures if one["status"] == status] if figures else None
        for status in ("FAIL", "MARGINAL")
    )
    words = "–"
    if success is not None:
        low, high = success["interval"]
        words = (f"{percent(success['hardware'])} of {success['n']} starts, ideal {percent(success['ideal'])}; "
                 f"difference {points(low)} to {points(high)} points")  # fmt: skip
    return {"name": row["name"], "description": row["description"], "verdict": row["verdict"], "success": words,
            "broken": broken, "near": near}  # fmt: skip


def _requirement_row(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "figure": row["figure"], "parameter": row["parameter"], "now": _amount(row["now"], row["unit"]),
        "needed": _amount(row["needed"], row["unit"]), "sentence": row["sentence"],
    }  # fmt: skip


def _sensitivity(found: Mapping[str, Any]) -> dict[str, Any]:
    factors = sorted(found["factors"], key=lambda factor: -factor["mu_star"])
    rows = [
        {
            "name": one["name"], "range": plots.factor_range(one), "source": one["source"],
            "mu_star": (f"{one['mu_star']:.3g}", one["mu_star"]),
            "interval": f"{one['interval'][0]:.3g} to {one['interval'][1]:.3g}",
            "sigma": (f"{one['sigma']:.3g}", one["sigma"]),
        }
        for one in factors
    ]  # fmt: skip
    sobol: Sequence[Mapping[str, Any]] = found["sobol"] or ()
    convergence = found["convergence"]
    return {
        "output": found["output"], "trajectories": found["trajectories"], "table": rows,
        "picture": _svg(plots.plot_sensitivity, found, key="morris", label="Sensitivity: mu* of each factor")
        if factors else None,
        "sobol": [
            {"name": one["name"],
             "first": f"{one['first']:.2g}, {one['first_interval'][0]:.2g} to {one['first_interval'][1]:.2g}",
             "total": f"{one['total']:.2g}, {one['total_interval'][0]:.2g} to {one['total_interval'][1]:.2g}"}
            for one in sobol
        ],
        "n_sobol": found["n_sobol"],
        "sobol_picture": _svg(plots.plot_sobol, sobol, key="sobol", label="Sobol indices") if sobol else None,
        "convergence": _svg(plots.plot_convergence, convergence, key="convergence", label="mu* over trajectories")
        if len(convergence) > 1 else None,
    }  # fmt: skip


def _lifetime(rows: Sequence[Mapping[str, Any]] | None) -> dict[str, Any] | None:
    """The study names the columns."""
    if not rows:
        return None
    columns = list(rows[0])

    def cell(value: Any) -> Cell:
        if value is None:
            return "–", ""
        return (f"{value:,}" if isinstance(value, int) else f"{value:.4g}"), float(value)

    return {"columns": [name.replace("_", " ") for name in columns],
            "rows": [[cell(row[name]) for name in columns] for row in rows]}  # fmt: skip
