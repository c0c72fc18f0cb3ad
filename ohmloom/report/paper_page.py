"""The paper's experiments as pages: one HTML file, the same as Markdown, tables as CSV, figures as SVG."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Final

from markupsafe import Markup

from ohmloom import __version__
from ohmloom._files import write_atomic
from ohmloom.report._page_svg import figure_files, page_svg
from ohmloom.report._replay_page import render, template
from ohmloom.report.paper_plot import figures
from ohmloom.sim.paper.claim_tests import NO, UNTESTED, YES, Finding
from ohmloom.sim.paper.claims import QUESTIONS
from ohmloom.sim.paper.results import Results
from ohmloom.sim.paper.tables import Table, claims_table, tables

SOURCE: Final = (
    "G. Howard, E. Gale, L. Bull, B. de Lacy Costello, A. Adamatzky: Evolution of Plastic Learning in Spiking Networks "
    "via Memristive Connections. IEEE Trans. Evol. Comput. 16 (2012) 711-729."
)


def save_paper(results: Results, findings: Sequence[Finding], out: Path, *, command: str) -> list[Path]:
    """Write ``paper.html``, ``index.md``, ``tables.md``, ``figures.md``, ``tables/*.csv`` and ``figures/*.svg``.

    Parameters
    ----------
    results, findings
        Of a finished run, and what `examine` says of them.
    out
        Folder, which may be the run's own.
    command
        The command that makes them again, shown as text.

    Raises
    ------
    OperationError
        If a file cannot be written.
    """
    found = [claims_table(findings), *tables(results)]
    # Each is drawn once, for its file and for the page.
    pictures = [(name, caption, cache(draw)) for name, caption, draw in figures(results)]
    made = _made(results, command)
    written: dict[Path, str | bytes] = {out / "tables" / f"{table.name}.csv": table.to_csv() for table in found}
    for name, _, draw in pictures:
        written |= {out / "figures" / f"{name}.{form}": data for form, data in figure_files(draw, ["svg"])}
    written[out / "index.md"] = _index(findings, found, made)
    written[out / "tables.md"] = "# Tables\n\n" + "\n".join(_section(table) for table in found[1:])
    written[out / "figures.md"] = "# Figures\n\n" + "\n".join(
        f"## {name.replace('_', ' ').capitalize()}\n\n![{caption}](figures/{name}.svg)\n\n{caption}\n"
        for name, caption, _ in pictures
    )
    written[out / "paper.html"] = render(
        "paper.html", style=Markup(template("report.css")), source=SOURCE, made=made, summary=_summary(findings),
        questions=_answers(findings), claims=found[0], tables=[_with_short(table) for table in found[1:]],
        figures=[(name, caption, page_svg(draw, name, caption)) for name, caption, draw in pictures],
    )  # fmt: skip
    for path, text in written.items():
        write_atomic(path, text)
    return list(written)


def _with_short(table: Table) -> dict[str, object]:
    return {name: getattr(table, name) for name in ("name", "title", "head", "rows", "note")} | {
        "short": table.title.partition(":")[0] if table.title.startswith("Table ") else table.name.replace("_", " ")
    }


def _made(results: Results, command: str) -> str:
    settings = results.experiment.settings
    return (f"{settings.repeats} repeats of {settings.generations} generations, {settings.random_networks} random "
            f"networks per system and reading, seed {settings.seed}, ohmloom {__version__}: {command}")  # fmt: skip


def _summary(findings: Sequence[Finding]) -> str:
    counts = Counter(finding.verdict for finding in findings if finding.section != "ours")
    return (
        f"Of {counts.total()} claims {counts[YES]} reproduce, {counts[NO]} do not, and {counts[UNTESTED]} cannot be "
        "tested here. A claim of a difference reproduces if it has the paper's sign and a corrected p below 0.05, one "
        "of no difference if its p is not below that; with fewer than five runs neither is tested."
    )


def _answers(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    by_claim = {finding.claim: finding.verdict for finding in findings}
    rows = []
    for question, claims in QUESTIONS.items():
        verdicts = [by_claim[claim] for claim in claims]
        counts = f"{verdicts.count(YES)} of {len(claims)}"
        untested = verdicts.count(UNTESTED)
        rows.append((question, counts + (f" ({untested} cannot be tested here)" if untested else "")))
    return rows


def _index(findings: Sequence[Finding], tables: Sequence[Table], made: str) -> str:
    questions = Table(name="questions", title="", head=("question", "claims that reproduce"),
                      rows=tuple(_answers(findings)))  # fmt: skip
    command = made.partition(": ")
    # As repositories and Sphinx make anchors of headings.
    links = [
        f"- [{t.title}](tables.md#{re.sub(r'[^a-z0-9 -]', '', t.title.lower()).replace(' ', '-')})" for t in tables[1:]
    ]
    return (
        f"# What of the paper reproduces\n\n{SOURCE}\n\n{command[0]}:\n\n```text\n{command[2]}\n```\n\n"
        f"{_summary(findings)}\n\n{questions.to_markdown()}\nAll on one page: [paper.html](paper.html). "
        "[Figures](figures.md). Tables:\n\n" + "\n".join(links) + f"\n\n## Claims\n\n{tables[0].to_markdown()}"
    )


def _section(table: Table) -> str:
    note = f"\n{table.note}\n" if table.note else ""
    return f"## {table.title}\n\n{table.to_markdown()}{note}"
