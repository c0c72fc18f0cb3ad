"""Does an FMU, or a system of them, work? Run by every client that is installed, in processes of their own."""

from __future__ import annotations

import html
import importlib.util
import math
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np

from ohmloom.errors import OhmloomError, ParameterError, expect_number
from ohmloom.fmu._archive import Archive, open_archive
from ohmloom.fmu._probe import SHORT
from ohmloom.fmu._process import MEMORY, TIMEOUT, run_probe
from ohmloom.fmu.run import check_value
from ohmloom.fmu.ssp import PREFIX, System, by_component, is_system, named, named_within, run_ssp, unpack

Status = Literal["passed", "failed", "skipped"]
# Clients integrate model exchange by themselves, each with its own error; what they hold and step agrees to rounding.
STEPPED, INTEGRATED = 1e-9, 1e-6
CLIENTS = {"fmuloader": "fmuloader", "libcosimpy": "libcosimpy", "pathsim": "pathsim_fmi"}


class Limits(TypedDict):
    """Of a process: time in s, address space in bytes."""

    timeout: float
    memory: int


@dataclass(frozen=True, kw_only=True)
class CheckRow:
    """One thing that was tried: what, by which client, and what came of it."""

    what: str
    client: str
    status: Status
    detail: str


@dataclass(frozen=True, kw_only=True)
class Check:
    """What passed in which client; `fmi` is None of a system."""

    path: Path
    fmi: int | None
    rows: tuple[CheckRow, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return all(row.status != "failed" for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data."""
        return {
            "file": str(self.path),
            "fmi": self.fmi,
            "passed": self.passed,
            "rows": [vars(row) for row in self.rows],
        }

    def _repr_html_(self) -> str:
        cells = "".join(
            f"<tr>{''.join(f'<td>{html.escape(x)}</td>' for x in (r.what, r.client, r.status, r.detail))}</tr>"
            for r in self.rows
        )
        return f"<table>{cells}</table>"


def check(
    file: Path | str,
    *,
    start_values: Mapping[str, Any] | None = None,
    timeout: float = TIMEOUT,
    memory: int = MEMORY,
) -> Check:
    """Validate an FMU, look for its functions, run 20 steps in each client, and take its state to a second instance.

    Of a system (SSP) each FMU is checked, then 20 steps of the whole are run here and by FMPy. The file's native code
    runs with your rights, in processes of its own: check only what you trust to run.

    Parameters
    ----------
    file
        The FMU, of version 2.0 or 3.0, or a flat SSP 1.0 system.
    start_values
        Parameters and inputs by name, as `run` has them; all clients then agree on more than a model at rest. Of a
        system ``component.name``.
    timeout, memory
        Limits of each process, in s and in bytes of address space.

    Raises
    ------
    MissingFileError, FileFormatError
        If the file is no FMU or system that can be looked at: see `open_archive` and `run_ssp`.
    UnknownNameError, ParameterError
        If a start value is none that the FMU takes.
    OperationError
        If the description cannot be read.
    """
    if not expect_number("check: timeout", timeout) > 0.0:
        raise ParameterError(f"check: timeout: expected a time above 0 s, got {timeout:g}. Correct it.")
    if is_system(file):
        return _check_system(Path(file), start_values or {}, timeout, memory)
    archive = open_archive(file)
    limits: Limits = {"timeout": timeout, "memory": memory}
    description = run_probe(archive, "description", {}, **limits)
    variables = {v["name"]: v for v in description["variables"]}
    given = {name: check_value(str(archive.path), variables, name, x) for name, x in (start_values or {}).items()}
    rows = [_row("validation", "FMPy", lambda: _validation(archive, limits))]
    for interface in archive.interfaces:
        rows.append(_row(f"functions of {interface}", "loader", lambda i=interface: _symbols(archive, i, limits)))
    if all(row.status != "failed" for row in rows[1:]):
        rows += _runs(archive, description, given, limits)
    return Check(path=archive.path, fmi=archive.fmi, rows=tuple(rows))


def _check_system(path: Path, start_values: Mapping[str, Any], timeout: float, memory: int) -> Check:
    rows: list[CheckRow] = []
    limits: Limits = {"timeout": timeout, "memory": memory}
    with tempfile.TemporaryDirectory(prefix=PREFIX) as folder:
        structure = unpack(path, Path(folder))
        given = by_component(path, structure, start_values)
        versions = set()
        for name, source in structure.sources.items():
            with named_within(path):
                found = check(Path(folder) / source, start_values=given[name], **limits)
            versions.add(found.fmi)
            rows += [replace(row, what=f"{name}: {row.what}", detail=named(path, row.detail)) for row in found.rows]

    steps: list[float] = []

    def here() -> tuple[Status, str]:
        trace = run_ssp(path, start_values=start_values, steps=SHORT, **limits)
        steps.append(float(trace.t[1]))
        return told([name for name, x in trace.values.items() if not np.isfinite(x).all()])

    def by_fmpy() -> tuple[Status, str]:
        if versions != {2}:
            return "skipped", "knows FMI 2.0 alone"
        return told(run_probe(System(path), "system", {"step_size": steps[0]}, **limits)["wrong"])

    def told(wrong: list[str]) -> tuple[Status, str]:
        if wrong:
            return "failed", f"{path}: {wrong[0]}: expected finite values, got NaN or infinity. Check its FMU."
        return "passed", f"{SHORT} steps of {steps[0]:g} s"

    if all(row.status != "failed" for row in rows):
        rows.append(_row("system", "ohmloom", here))
    if steps:
        rows.append(_row("system", "FMPy", by_fmpy))
    return Check(path=path, fmi=None, rows=tuple(rows))


def function_names(fmi: int, interface: str) -> list[str]:
    """The functions that a library of this version and interface must have, out of the standard's header."""
    text = (files("fmpy") / "c-code" / f"fmi{fmi}Functions.h").read_text()
    names = re.findall(rf"FMI{fmi}_Export\s+\w+TYPE\s+(\w+);", text)
    # Both interfaces of FMI 3.0 have event mode, of FMI 2.0 model exchange alone.
    others = {"EnterEventMode"} if (fmi, interface) == (2, "CoSimulation") else set()
    return [name for name in names if _of(name.removeprefix(f"fmi{fmi}"), interface, others)]


_MODEL_EXCHANGE = {
    "InstantiateModelExchange", "NewDiscreteStates", "EnterContinuousTimeMode", "CompletedIntegratorStep", "SetTime",
    "SetContinuousStates", "GetDerivatives", "GetContinuousStateDerivatives", "GetEventIndicators",
    "GetContinuousStates", "GetNominalsOfContinuousStates", "GetNumberOfEventIndicators", "GetNumberOfContinuousStates",
}  # fmt: skip
_CO_SIMULATION = {
    "InstantiateCoSimulation", "SetRealInputDerivatives", "GetRealOutputDerivatives", "GetOutputDerivatives", "DoStep",
    "CancelStep", "GetStatus", "GetRealStatus", "GetIntegerStatus", "GetBooleanStatus", "GetStringStatus",
    "EnterStepMode",
}  # fmt: skip
_SCHEDULED = {"InstantiateScheduledExecution", "ActivateModelPartition"}


def _of(name: str, interface: str, others: set[str]) -> bool:
    others = others | (_CO_SIMULATION if interface == "ModelExchange" else _MODEL_EXCHANGE)
    return name not in others | _SCHEDULED


def _row(what: str, client: str, ask: Any) -> CheckRow:
    try:
        status, detail = ask()
    except OhmloomError as error:
        status, detail = "failed", error.problems[0]
    return CheckRow(what=what, client=client, status=status, detail=detail)


def _validation(archive: Archive, limits: Limits) -> tuple[Status, str]:
    problems = run_probe(archive, "validation", {}, **limits)["problems"]
    return ("failed", "; ".join(" ".join(p.split()) for p in problems)) if problems else ("passed", "no problems")


def _symbols(archive: Archive, interface: str, limits: Limits) -> tuple[Status, str]:
    names = function_names(archive.fmi, interface)
    library = archive.library(interface)
    missing = run_probe(archive, "symbols", {"names": names, "library": f"fmu/{library}"}, **limits)["missing"]
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        return "failed", f"{archive.path}:{library}: expected {len(names)} functions, got none named " + (
            f"{', '.join(missing[:3])}{more}. Ask its maker.")  # fmt: skip
    return "passed", f"all {len(names)}"


def _runs(archive: Archive, answer: dict[str, Any], given: dict[str, Any], limits: Limits) -> list[CheckRow]:
    rows: list[CheckRow] = []
    h = answer["step_size"] or (answer["stop_time"] or 1.0) / 500
    common = {"start_values": given, "step_size": h}
    ends: dict[str, dict[str, float]] = {}
    largest: dict[str, dict[str, float]] = {}  # the largest of each in the run: what comes to rest at 0 has no other

    def by_fmpy(interface: str) -> tuple[Status, str]:
        # Others step with the FMU's own tolerance.
        tolerance = 1e-9 if interface == "ModelExchange" else None
        options = {**common, "interface": interface, "stop_time": SHORT * h, "output_interval": h,
                   "tolerance": tolerance}  # fmt: skip
        values = run_probe(archive, "simulation", options, **limits)["values"]
        ends[interface] = {name: float(x[-1]) for name, x in values.items() if name != "time"}
        largest[interface] = {name: max(map(abs, x)) for name, x in values.items()}
        wrong = [name for name, x in values.items() if not all(map(math.isfinite, x))]
        if wrong:
            return "failed", f"{archive.path}: {wrong[0]}: expected finite values, got NaN or infinity. Check the FMU."
        return "passed", f"{SHORT} steps of {h:g} s"

    def by_client(client: str, interface: str, tolerance: float) -> tuple[Status, str]:
        values = run_probe(archive, client, common, **limits)["values"]
        wanted = ends.get(interface, {})
        apart = [
            (abs(x - wanted[n]) / max(largest[interface][n], 1e-300), n)
            for n, x in values.items()
            if n in wanted and x != wanted[n]
        ]
        worst, name = max(apart, default=(0.0, ""))
        if not worst <= tolerance:
            return "failed", f"{name}: expected {wanted[name]!r} as in FMPy, got {values[name]!r}"
        return "passed", f"as in FMPy to {worst:.1e}" if worst else "as in FMPy, to the last bit"

    for interface in archive.interfaces:
        rows.append(_row(interface, "FMPy", lambda i=interface: by_fmpy(i)))
    if "CoSimulation" in archive.interfaces:
        if answer["has_state"]:
            rows.append(_row("state round trip", "FMPy", lambda: _state(archive, common, limits)))
        else:
            rows.append(
                CheckRow(what="state round trip", client="FMPy", status="skipped", detail="the FMU offers none")
            )
    for client, module in CLIENTS.items():
        interface, tolerance = ("ModelExchange", INTEGRATED) if client == "pathsim" else ("CoSimulation", STEPPED)
        reason = ""
        if importlib.util.find_spec(module) is None:
            reason = "not installed"
        elif interface not in archive.interfaces:
            reason = f"needs {interface}"
        elif client == "pathsim" and any(v["shape"] for v in answer["variables"]):
            reason = "knows no arrays"
        elif client == "libcosimpy" and archive.fmi == 3:
            reason = "knows FMI 2.0 alone"
        if reason:
            rows.append(CheckRow(what=interface, client=client, status="skipped", detail=reason))
        else:
            rows.append(_row(interface, client, lambda c=client, i=interface, t=tolerance: by_client(c, i, t)))
    return rows


def _state(archive: Archive, common: dict[str, Any], limits: Limits) -> tuple[Status, str]:
    answer = run_probe(archive, "state round trip", common, **limits)
    if answer["is_equal"]:
        return "passed", f"{answer['bytes']} bytes, the same bits in a second instance"
    return "failed", f"{archive.path}: expected the same outputs after its state went to a second instance, got others"
