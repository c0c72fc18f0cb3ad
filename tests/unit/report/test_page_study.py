"""What a full study adds to the report: yield, corners, sensitivity, requirements, lifetime, and pictures as files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ohmloom.report import report_page
from ohmloom.report._page_run import die_run, ideal_run
from ohmloom.report.output import save_study
from ohmloom.report.study_figures import save_figures
from ohmloom.report.study_plot import (
    FARTHEST,
    plot_margins,
    plot_sensitivity,
    plot_yield,
    running_success,
    share_of_limit,
)
from ohmloom.sim import Feasibility
from ohmloom.sim.sampling import DieOutcome

COMMAND = "ohmloom evaluate net.json --hardware het_mixed --dies 3 --seed 1 --study full"
ADDED = ("requirements", "yield", "corners", "sensitivity", "lifetime")


def section(page: str, name: str) -> str:
    """Text of a section, tags taken out; each tag counts as a space."""
    found = re.search(rf'<section id="{name}">(.*?)</section>', page, re.DOTALL)
    assert found is not None
    return " ".join(re.sub(r"<[^>]*>", " ", found[1]).split())


@pytest.fixture(scope="module")
def full_page(full_study: Feasibility) -> str:
    return report_page(full_study, command=COMMAND, runs=(None, None))


def test_sections_of_a_full_study_are_there_and_linked(full_page: str, het_study: Feasibility) -> None:
    plain = report_page(replace(het_study, yield_=()), command=COMMAND, runs=(None, None))
    for name in ADDED:
        assert f'<section id="{name}">' in full_page
        assert f'<a href="#{name}">' in full_page
        assert f'id="{name}"' not in plain
        assert f'href="#{name}"' not in plain


def test_every_link_of_the_page_leads_somewhere(full_page: str) -> None:
    wanted = set(re.findall(r'<a href="#([^"]+)"', full_page))
    assert len(wanted) > 10
    assert wanted <= set(re.findall(r'<section id="([^"]+)"', full_page))


def test_yields_corners_requirements_and_lifetimes_stand_with_their_numbers(
    full_page: str, full_study: Feasibility
) -> None:
    yields = section(full_page, "yield")
    assert "5 % lines permuted 2 + 2 92.5 % 86.5 % to 97.5 % 120" in yields
    assert "10 % none 0 + 0 10 %" in yields
    corners = section(full_page, "corners")
    assert "typical every value as the spec has it MARGINAL" in corners
    assert "cannot be built: no card FAIL – – –" in corners
    broken, near = (
        " ".join(figure.name for figure in full_study.figures if figure.status == status) or "none"
        for status in ("FAIL", "MARGINAL")
    )
    assert "time_per_step" in broken
    assert f" {broken} {near} " in corners
    requirements = section(full_page, "requirements")
    assert "time_per_step drive.pulse_voltage 1 V 3.21 V time_per_step passes with" in requirements
    assert "1 V – no value helps" in requirements
    assert "100 2 2,411,800 0.002412 0.1" in section(full_page, "lifetime")


def test_ranges_and_sources_stand_beside_the_ranking(full_page: str) -> None:
    shown = section(full_page, "sensitivity")
    assert "wires.r_row 0.012 0.0084 to 0.0168 0.006 0 Ohm to 5 Ohm assumed: a guess" in shown
    assert "40 Morris trajectories" in shown
    assert "Of 256 base samples" in shown
    assert "wires.r_row 0.5, 0.4 to 0.6 0.62, 0.5 to 0.75" in shown
    # In the order of the ranking.
    assert shown.index("event_charge 0.031") < shown.index("wires.r_row 0.012")


def test_names_from_elsewhere_are_text_and_no_formula(full_page: str) -> None:
    assert "<b>x</b>" not in full_page
    assert full_page.count("&lt;b&gt;x&lt;/b&gt; $\\frac$") >= 4


def test_sensitivity_bars_are_as_long_as_mu_star_and_carry_their_range(full_study: Feasibility) -> None:
    assert full_study.sensitivity is not None
    ax = plot_sensitivity(full_study.sensitivity)
    widths = [patch.get_width() for patch in ax.patches]
    assert widths == [factor["mu_star"] for factor in full_study.sensitivity["factors"]]
    assert ax.get_yticklabels()[1].get_text() == "wires.r_row\n0 Ohm to 5 Ohm"


def test_yield_curves_are_one_per_repair_and_spares(full_study: Feasibility) -> None:
    ax = plot_yield(full_study.yield_)
    curves = {str(line.get_label()): list(np.asarray(line.get_ydata())) for line in ax.lines}
    assert list(curves) == ["no repair, 0 + 0 spare lines", "lines permuted, 0 + 0 spare lines",
                            "lines permuted, 2 + 2 spare lines"]  # fmt: skip
    assert curves["lines permuted, 2 + 2 spare lines"] == pytest.approx([1.0, 0.985, 0.925, 0.85])


def test_margins_show_each_share_of_a_limit(het_study: Feasibility) -> None:
    drawn = {
        str(line.get_gid())[6:]: line.get_xdata()[0] for line in plot_margins(het_study.figures).lines if line.get_gid()
    }
    for figure in het_study.figures:
        share = share_of_limit(figure)
        assert (figure.name in drawn) == (share is not None)
        if share is not None:
            assert drawn[figure.name] == pytest.approx(min(max(share, 1 / FARTHEST), FARTHEST))
            assert figure.margin is not None
            assert (share <= 1.0) == (figure.margin >= 0.0)


def test_running_comparison_ends_at_the_studys_own(het_study: Feasibility) -> None:
    running = running_success(het_study)
    assert [one.n for one in running] == [1, 2, 3]
    assert running[-1] == het_study.success


def test_several_starts_per_die_are_counted_by_die(het_study: Feasibility) -> None:
    first = het_study.dies[0]
    dies = tuple(
        replace(first, die=die, start=start, ideal=True, hardware=(die + start) % 3 > 0)
        for die in range(4)
        for start in range(5)
    )
    assert isinstance(first, DieOutcome)
    running = running_success(replace(het_study, dies=dies))
    assert [(one.dies, one.n) for one in running] == [(1, 5), (2, 10), (3, 15), (4, 20)]


def test_pictures_are_files_that_repeat_byte_for_byte(full_study: Feasibility, tmp_path: Path) -> None:
    ideal, die = ideal_run(full_study), die_run(full_study)
    made = [save_figures(full_study, tmp_path / name, ideal=ideal, die=die) for name in ("a", "b")]
    names = {path.stem for path in made[0]}
    assert {"margins", "success", "difference", "yield", "sensitivity", "sobol", "convergence", "path_ideal",
            "path_hardware", "weights", "events", "tile_0_programmed", "tile_0_after", "tile_0_drop",
            "tile_0_pulses"} <= names  # fmt: skip
    assert {path.suffix for path in made[0]} == {".svg", ".pdf"}
    for one, other in zip(*made, strict=True):
        assert one.read_bytes() == other.read_bytes()
        assert one.read_bytes()[:4] == (b"%PDF" if one.suffix == ".pdf" else b"<?xm")


def test_study_without_dies_is_saved_with_the_pictures_it_has(ga_study: Feasibility, tmp_path: Path) -> None:
    paths = save_study(ga_study, tmp_path, command=COMMAND)
    assert all(path.stat().st_size > 0 for path in paths)
    names = {path.name for path in paths}
    assert {"report.html", "report.json", "plan.json", "margins.pdf", "weights.svg"} <= names
    assert "success.svg" not in names
