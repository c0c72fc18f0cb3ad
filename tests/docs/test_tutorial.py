"""The documentation against the package: the tutorial's code runs, tables and examples say what the code says."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import math
import os
import re
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from ohmloom.cli import app
from ohmloom.devices import LAWS, Device
from ohmloom.mapping import WAVEFORMS, Hardware
from ohmloom.mapping.hardware import UNITS
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.mapping.waveform import separability
from ohmloom.neurocontroller import Network, Readings
from ohmloom.sim import Arena, EvolutionSettings
from ohmloom.sim.exactness import EXACT

DOCS = Path(__file__).parents[2] / "docs"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def page(name: str) -> str:
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and content of the plain fenced blocks, in order."""
    return [(match[1], match[2]) for match in FENCE.finditer(text)]


def table(name: str, header: str) -> dict[str, list[str]]:
    """Rows of the first table of a page whose header starts so: first cell, without backticks -> other cells."""
    lines = iter(page(name).splitlines())
    for line in lines:
        if line.startswith(f"| {header} |"):
            break
    else:
        raise AssertionError(f"docs/{name}.md has no table that starts with {header!r}")
    next(lines)
    rows = {}
    for line in lines:
        if not line.startswith("|"):
            break
        first, *rest = (cell.strip() for cell in line.strip("|").split("|"))
        for key in re.findall(r"`([^`]+)`", first) or [first]:
            rows[key] = rest
    return rows


def literal(cell: str) -> Any:
    return ast.literal_eval(cell.strip("`"))


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], list[tuple[str, str]], Path]:
    """The namespace after all blocks, pairs of (shown, printed) output, and the folder they wrote to."""
    folder = tmp_path_factory.mktemp("tutorial")
    namespace: dict[str, Any] = {"__name__": "tutorial"}
    outputs: list[tuple[str, str]] = []
    printed = ""
    with contextlib.chdir(folder):
        for language, content in blocks(page("tutorial")):
            if language == "python":
                stream = io.StringIO()
                with contextlib.redirect_stdout(stream):
                    exec(compile(content, "docs/tutorial.md", "exec"), namespace)
                printed = stream.getvalue()
            elif language == "text":
                outputs.append((content, printed))
    return namespace, outputs, folder


def test_the_tutorial_prints_what_it_shows(tutorial: Any) -> None:
    _, outputs, _ = tutorial
    assert len(outputs) == page("tutorial").count("\n```text\n") > 5
    for shown, printed in outputs:
        if shown.endswith("...\n"):
            assert printed.startswith(shown.removesuffix("...\n"))
            assert len(printed) > len(shown)
        else:
            assert printed == shown


def test_the_tutorial_repeats_the_stored_trial(tutorial: Any) -> None:
    namespace, _, _ = tutorial
    assert namespace["trial"].fitness == namespace["network"].provenance["fitness"]


def test_the_tutorial_writes_the_files_it_names(tutorial: Any) -> None:
    _, _, folder = tutorial
    for name in ("plan.json", "report.json", "report.html", "replay.html", "run/run.json", "run/tables/summary.csv"):
        assert (folder / name).stat().st_size > 0


def test_every_figure_and_key_of_a_study_is_explained(tutorial: Any) -> None:
    study = tutorial[0]["study"]
    shown = table("sim", "figure")
    assert list(shown) == [figure.name for figure in study.figures]
    limits = {figure.name: figure.limit for figure in study.figures}
    assert limits["event_fidelity"] == float(shown["event_fidelity"][1].removeprefix("<= "))
    assert limits["closed_loop_success"] == float(shown["closed_loop_success"][1].removeprefix(">= "))
    assert "1.524 ms" in shown["time_per_step"][1]
    assert round(1e3 * limits["time_per_step"], 3) == 1.524
    assert list(table("sim", "exactness")) == list(EXACT) == [*study.exactness]
    assert set(table("cli", "key")) == set(study.to_dict())
    for line in study.not_modelled:
        assert f"\n- {line}\n" in page("sim")


def test_the_json_of_map_is_explained(tutorial: Any, tmp_path: Path) -> None:
    tutorial[0]["network"].save(tmp_path / "HET.net.json")
    words = ["map", str(tmp_path / "HET.net.json"), "--hardware", "het_mixed", "--out", str(tmp_path), "--json"]
    found = json.loads(CliRunner().invoke(app, words, catch_exceptions=False).output)
    text = page("cli").split("## map")[1].split("`--json` gives")[1].split("## evaluate")[0]
    top = ["plan", "files", "seed", "tiles", "synapses", "utilisation", "reset", "cost", "late_steps", "assumed"]
    assert re.findall(r"`(\w+)`", text) == [*top[:4], *found["tiles"][0], *top[4:]]
    assert list(found) == top


def test_every_column_of_a_plan_is_named(tutorial: Any) -> None:
    sentence = page("mapping").split("`plan.table()` has a row per synapse:")[1].split(". `ohmloom map`")[0]
    assert re.findall(r"`(\w+)`", sentence) == list(tutorial[0]["plan"].table()[0])


def test_the_readings_table_has_the_defaults() -> None:
    rows = table("neurocontroller", "setting")
    assert {name: literal(cells[0]) for name, cells in rows.items()} == Readings().model_dump()


def test_the_evolution_table_has_the_defaults() -> None:
    text = page("sim").split("## Evolution")[1]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", text, re.MULTILINE))
    for name, field in EvolutionSettings.model_fields.items():
        shown = rows[name]
        if field.is_required():
            assert shown == "required"
        elif name == "readings":
            assert shown == "[the controller's](neurocontroller.md#readings)"
        else:
            assert literal(shown) == field.default


def test_the_arena_table_has_the_defaults() -> None:
    rows, arena = table("sim", "setting"), Arena()
    assert set(rows) == {field.name for field in fields(Arena)}
    bearings = [float(number) for number in re.findall(r"[-+]?\d+\.?\d*", rows.pop("sensor_bearings")[0])]
    np.testing.assert_allclose(arena.sensor_bearings, [math.radians(angle) for angle in bearings], rtol=1e-12)
    for name, cells in rows.items():
        assert np.array_equal(literal(cells[0]), getattr(arena, name)), name


def test_the_devices_page_has_the_laws_and_the_cards() -> None:
    laws = table("devices", "law")
    assert set(laws) == set(LAWS)
    for name, cells in laws.items():
        assert tuple(re.findall(r"`(\w+)`", cells[1])) == LAWS[name].parameter_names
    cards = table("devices", "card")
    assert set(cards) == set(Device.names())
    for name, cells in cards.items():
        assert cells[0] in ("", f"`{Device.load(name).law}`")


def test_the_mapping_page_has_the_specs_units_and_waveforms() -> None:
    assert set(table("mapping", "spec")) == set(Hardware.names())
    rows = table("mapping", "key")
    effects = {f"nonidealities.{name}": cells[1:] for name, cells in table("mapping", "effect").items()}
    for name, unit in UNITS.items():
        assert (rows | effects)[name][0] == unit, name
    for section, field in Hardware.model_fields.items():
        models = [one for one in (field.annotation, *get_args(field.annotation)) if hasattr(one, "model_fields")]
        for name in [f"{section}.{key}" for one in models for key in one.model_fields] or [section]:
            assert name in rows | effects
    shown = table("mapping", "waveform")
    assert set(shown) == set(WAVEFORMS)
    for name, cells in shown.items():
        waveform = WAVEFORMS[name]
        for cell, side in zip(cells, ("row", "column"), strict=False):
            phases = [[int(number) for number in re.findall(r"[-+]?\d+", part)] for part in cell.split(" then ")]
            assert phases == [list(getattr(phase, side))[::-1] for phase in waveform.phases], (name, side)
        window = separability(waveform)
        assert fractions(cells[2]) == window.least_event / waveform.event == 1
        assert fractions(cells[3]) == window.largest_other / waveform.event


def fractions(cell: str) -> float:
    """V, V/2, 4 V/5 in units of V."""
    found = re.fullmatch(r"(\d*) ?V(?:/(\d+))?", cell)
    assert found is not None
    return int(found[1] or 1) / int(found[2] or 1)


def test_the_mapping_page_has_every_effect_with_its_meaning() -> None:
    shown = table("mapping", "effect")
    assert shown == {e.name: [e.moment, e.unit, e.meaning] for e in EFFECTS.values()}


def test_the_network_in_the_docs_loads() -> None:
    (example,) = [content for language, content in blocks(page("neurocontroller")) if language == "json"]
    network = Network.from_json(example.encode(), "docs/neurocontroller.md")
    keys = set(table("neurocontroller", "key"))
    assert keys == set(json.loads(network.to_json()))


def test_the_device_example_runs(tmp_path: Path) -> None:
    (example,) = [content for language, content in blocks(page("devices")) if language == "python"]
    with contextlib.chdir(tmp_path):
        exec(compile(example, "docs/devices.md", "exec"), {})
    assert os.path.getsize(tmp_path / "loop.png") > 0


def test_every_verb_has_a_section() -> None:
    headings = set(re.findall(r"^## (.+)$", page("cli"), re.MULTILINE))
    verbs = {command.name or command.callback.__name__ for command in app.registered_commands}
    for group in app.registered_groups:
        verbs |= {f"{group.name} {command.name}" for command in group.typer_instance.registered_commands}
    assert headings == verbs


def test_the_error_in_the_docs_is_the_error() -> None:
    shown = next(content for language, content in blocks(page("errors")) if content.startswith("ohmloom: "))
    with pytest.raises(FileNotFoundError) as caught:
        Device.load("hp_tio3")
    assert shown.strip() == f"ohmloom: {caught.value}"


def test_the_readme_has_the_two_commands_and_code_that_runs(tmp_path: Path) -> None:
    text = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    shell = next(content for language, content in blocks(text) if language == "sh")
    assert shell.splitlines() == [
        "python3 -m venv .venv && .venv/bin/pip install -q -c constraints.txt . && .venv/bin/ohmloom demo",
        "python3 -m venv .venv && .venv/bin/pip install -q -c constraints.txt '.[test]' && .venv/bin/pytest",
    ]
    (example,) = [content for language, content in blocks(text) if language == "python"]
    namespace: dict[str, Any] = {}
    with contextlib.chdir(tmp_path), contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(example, "README.md", "exec"), namespace)
    assert printed.getvalue().startswith(namespace["study"].verdict)
