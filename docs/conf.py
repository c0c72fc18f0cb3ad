"""Sphinx settings; also writes what the pages include from the package itself: help texts, the champions' table."""

from __future__ import annotations

import csv
from pathlib import Path

from typer.models import CommandInfo
from typer.testing import CliRunner

from ohmloom import __version__
from ohmloom.cli import app

HERE = Path(__file__).parent
GENERATED = HERE / "_generated"
CHAMPIONS = HERE.parent / "examples" / "champions" / "champions.csv"

project = "ohmloom"
author = "the ohmloom authors"
version = release = __version__
copyright = "the ohmloom authors, Apache-2.0"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "_generated", "images/README.md"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_default_options = {"exclude-members": "model_config"}
napoleon_google_docstring = False
# A list of names, not of cross-references: fields of several classes share names.
napoleon_custom_sections = [("Attributes", "params_style")]
html_theme = "furo"
html_title = f"ohmloom {version}"


def verb_name(command: CommandInfo) -> str:
    """What the user types."""
    return command.name or command.callback.__name__  # type: ignore[union-attr]


def write_help() -> None:
    """One file per verb; a verb that the command line's page leaves out stops the build."""
    verbs: list[list[str]] = [[]]
    verbs += [[verb_name(command)] for command in app.registered_commands]
    for group in app.registered_groups:
        verbs += [[group.name, verb_name(command)] for command in group.typer_instance.registered_commands]
    page = (HERE / "cli.md").read_text(encoding="utf-8")
    folder = GENERATED / "help"
    folder.mkdir(parents=True, exist_ok=True)
    for words in verbs:
        name = "-".join(["ohmloom", *words])
        if f"_generated/help/{name}.txt" not in page:
            raise RuntimeError(f"docs/cli.md: expected a section on '{' '.join(words)}'. Include its help text.")
        # The first word of the usage line is the program's name, which is not known here.
        result = CliRunner().invoke(app, [*words, "--help"], prog_name="ohmloom", terminal_width=88)
        (folder / f"{name}.txt").write_text(result.output.strip() + "\n", encoding="utf-8")


def write_champions() -> None:
    """The committed table with a column per system, and the commands of the runs as a list."""
    with CHAMPIONS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with (GENERATED / "champions.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["", *(row["system"] for row in rows)])
        for key in rows[0]:
            if key not in ("system", "runs"):
                writer.writerow([key, *(row[key] for row in rows)])
    commands = [command for row in rows for command in row["runs"].split(" ; ")]
    (GENERATED / "champions.sh").write_text("\n".join(commands) + "\n", encoding="utf-8")


write_help()
write_champions()
