"""Does an FMU work? Looked at, loaded and run by every client that is installed, in processes of their own."""

from __future__ import annotations

import html
import importlib.util
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ohmloom.errors import OhmloomError, ParameterError, expect_number
from ohmloom.fmu._archive import Archive, open_archive
from ohmloom.fmu._probe import SHORT
from ohmloom.fmu._process import MEMORY, TIMEOUT, run_probe

Status = Literal["passed", "failed", "skipped"]
# Clients integrate model exchange by themselves, each with its own error; what they hold and step agrees to rounding.
STEPPED, INTEGRATED = 1e-9, 1e-6
CLIENTS = {"fmuloader": "fmuloader", "libcosimpy": "libcosimpy", "pathsim": "pathsim_fmi"}


@dataclass(frozen=True, kw_only=True)
class CheckRow:
    """One thing that was tried: what, by which client, and what came of it."""

    what: str
    client: str
    status: Status
    detail: str


@dataclass(frozen=True, kw_only=True)
class Check:
    """What passed in which client."""

    path: Path
    fmi: int
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

    The file's native code runs with your rights, in processes of its own: check only what you trust to run.

    Parameters
    ----------
    file
        The FMU, of version 2.0 or 3.0.
    start_values
        Parameters and inputs by name, as `run` has them; all clients then agree on more than a model at rest.
    timeout, memory
        Limits of each process, in s and in bytes of address space.

    Raises
    ------
    MissingFileError, FileFormatError
        If the file is no FMU that can be looked at: see `open_archive`.
    ParameterError
        If a start value is no number.
    """
    archive = open_archive(file)
    given: dict[str, Any] = {}
    for name, x in (start_values or {}).items():
        is_many = not isinstance(x, str) and np.ndim(x) > 0
        given[name] = (
            [expect_number(f"check: {name}", each) for each in np.ravel(x).tolist()]
            if is_many
            else expect_number(f"check: {name}", x)
        )
    if not expect_number("check: timeout", timeout) > 0.0:
        raise ParameterError(f"check: timeout: expected a time above 0 s, got {timeout:g}. Correct it.")
    limits = {"timeout": timeout, "memory": memory}
    rows = [_row("validation", "FMPy", lambda: _validation(archive, limits))]
    for interface in archive.interfaces:
        rows.append(_row(f"functions of {interface}", "loader", lambda i=interface: _symbols(archive, i, limits)))
    if all(row.status != "failed" for row in rows[1:]):
        rows += _runs(archive, given, limits)
    return Check(path=archive.path, fmi=archive.fmi, rows=tuple(rows))


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


def _validation(archive: Archive, limits: dict[str, Any]) -> tuple[Status, str]:
    problems = run_probe(archive, "validation", {}, **limits)["problems"]
    return ("failed", "; ".join(" ".join(p.split()) for p in problems)) if problems else ("passed", "no problems")


def _symbols(archive: Archive, interface: str, limits: dict[str, Any]) -> tuple[Status, str]:
    names = function_names(archive.fmi, interface)
    library = archive.library(interface)
    missing = run_probe(archive, "symbols", {"names": names, "library": f"fmu/{library}"}, **limits)["missing"]
    if missing:
        more = f" and {len(missing) - 3} more" if len(missing) > 3 else ""
        return "failed", f"{archive.path}:{library}: expected {len(names)} functions, got none named " + (
            f"{', '.join(missing[:3])}{more}. Ask its maker.")  # fmt: skip
    return "passed", f"all {len(names)}"


def _runs(archive: Archive, given: dict[str, Any], limits: dict[str, Any]) -> list[CheckRow]:
    rows: list[CheckRow] = []
    answer = run_probe(archive, "description", {}, **limits)
    h = answer["step_size"] or (answer["stop_time"] or 1.0) / 500
    # One number is that of all elements of an array.
    sizes = {v["name"]: math.prod(v["shape"]) for v in answer["variables"] if v["shape"]}
    given = {name: [x] * sizes[name] if name in sizes and isinstance(x, float) else x for name, x in given.items()}
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


def _state(archive: Archive, common: dict[str, Any], limits: dict[str, Any]) -> tuple[Status, str]:
    answer = run_probe(archive, "state round trip", common, **limits)
    if answer["is_equal"]:
        return "passed", f"{answer['bytes']} bytes, the same bits in a second instance"
    return "failed", f"{archive.path}: expected the same outputs after its state went to a second instance, got others"
