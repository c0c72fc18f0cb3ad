"""Run an FMU of any tool, in a process of its own."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom._files import write_atomic
from ohmloom.errors import OperationError, ParameterError, UnknownNameError, expect_number
from ohmloom.fmu._archive import open_archive
from ohmloom.fmu._process import MEMORY, TIMEOUT, run_probe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Interface = Literal["CoSimulation", "ModelExchange"]
REALS = ("Real", "Float64", "Float32")
INTERFACES: tuple[Interface, ...] = ("CoSimulation", "ModelExchange")


@dataclass(frozen=True, kw_only=True, eq=False)
class FmuTrace:
    """What an FMU's variables did.

    Attributes
    ----------
    name
        The file's.
    t
        Times, axes (time,), in s.
    values
        By variable, axes (time,), in the variable's own unit.
    """

    name: str
    t: FloatArray
    values: dict[str, FloatArray]

    def write_csv(self, path: Path | str) -> None:
        """Write the columns ``time`` and one per variable, as FMPy does."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(["time", *self.values])
        writer.writerows(zip(self.t.tolist(), *(x.tolist() for x in self.values.values()), strict=True))
        write_atomic(path, buffer.getvalue())

    def plot(self, names: list[str] | None = None, ax: Axes | None = None) -> Axes:
        """Draw variables over the time, by default all.

        Raises
        ------
        UnknownNameError
            If one of `names` was not recorded.
        """
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").add_subplot()
        for name in self.values if names is None else names:
            if name not in self.values:
                raise UnknownNameError.of("FmuTrace.plot", name, self.values)
            ax.plot(self.t, self.values[name], label=name)
        ax.set_xlabel("t [s]")
        ax.legend()
        return ax


def run(
    file: Path | str,
    *,
    stop_time: float | None = None,
    start_values: Mapping[str, Any] | None = None,
    inputs: Mapping[str, Any] | None = None,
    interface: Interface | None = None,
    step_size: float | None = None,
    output_interval: float | None = None,
    tolerance: float | None = None,
    outputs: list[str] | None = None,
    timeout: float = TIMEOUT,
    memory: int = MEMORY,
) -> FmuTrace:
    """Run an FMU by FMPy in a process of its own, from time 0 on.

    The file's native code runs with your rights: run only what you trust.

    Parameters
    ----------
    file
        The FMU, of version 2.0 or 3.0.
    stop_time, step_size, output_interval, tolerance
        As FMPy's; None for what the FMU suggests. The step is that of co-simulation, which is also its interval of
        output.
    start_values
        By name of parameter or input; of an array all its elements, or one number for each.
    inputs
        ``"time"`` and inputs by name, each with axes (time,); linear between the times, held where FMPy holds them.
    interface
        ``"CoSimulation"`` or ``"ModelExchange"`` (by CVode); default: the first that the FMU has.
    outputs
        Names of variables to record; default: its outputs. Elements of an array are named ``q[0,1]``.
    timeout, memory
        Limits of the process, in s and in bytes of address space.

    Raises
    ------
    MissingFileError, FileFormatError
        If the file is no FMU that can run here.
    ParameterError
        If an option, a name or a start value is none of those that the FMU has, or out of its declared range.
    OperationError
        If the FMU fails, crashes, takes too long, wants too much memory, or puts out values that are not finite.
    """
    archive = open_archive(file)
    if interface is not None and interface not in INTERFACES:
        raise UnknownNameError.of("run: interface", interface, INTERFACES)
    chosen: str = interface or next(name for name in INTERFACES if name in archive.interfaces)
    archive.library(chosen)
    for name, value in (("stop_time", stop_time), ("step_size", step_size), ("output_interval", output_interval),
                        ("tolerance", tolerance), ("timeout", timeout)):  # fmt: skip
        if value is not None and not expect_number(f"run: {name}", value) > 0.0:
            raise ParameterError(f"run: {name}: expected a number above 0, got {value:g}. Correct it.")
    if chosen == "CoSimulation" and output_interval is None:
        output_interval = step_size
    given = {} if start_values is None else dict(start_values)
    variables = {
        v["name"]: v for v in run_probe(archive, "description", {}, timeout=timeout, memory=memory)["variables"]
    }
    given = {name: check_value(f"{archive.path}", variables, name, value) for name, value in given.items()}
    signals = None if inputs is None else _signals(f"{archive.path}", variables, inputs)
    for name in outputs or ():
        if name not in variables:
            raise UnknownNameError.of(f"{archive.path}: outputs", name, variables)
    options = {
        "interface": chosen, "stop_time": stop_time, "start_values": given, "step_size": step_size,
        "output_interval": output_interval, "tolerance": tolerance, "inputs": signals, "outputs": outputs,
    }  # fmt: skip
    values = run_probe(archive, "simulation", options, timeout=timeout, memory=memory)["values"]
    columns = {name: np.asarray(x, dtype=float) for name, x in values.items()}
    for name, x in columns.items():
        if not np.isfinite(x).all():
            when = columns["time"][int(np.argmax(~np.isfinite(x)))]
            raise OperationError(f"{archive.path}: {name}: expected finite values, got {x[~np.isfinite(x)][0]} "
                                 f"at t = {when:g} s. Check the FMU and its inputs.")  # fmt: skip
    t = frozen_array("FmuTrace.t", columns.pop("time"), ("time",))
    frozen = {name: frozen_array(f"FmuTrace.{name}", x, ("time",)) for name, x in columns.items()}
    return FmuTrace(name=archive.path.name, t=t, values=frozen)


def check_value(where: str, variables: dict[str, Any], name: str, value: Any) -> Any:
    """A start value as a number, of an array as a list, if the FMU has a variable of this name that takes it.

    One number is that of all elements of an array.

    Raises
    ------
    UnknownNameError, ParameterError
        If it has not, or the value is out of the declared range.
    """
    if name not in variables:
        raise UnknownNameError.of(f"{where}: start values", name, variables)
    variable = variables[name]
    if variable.get("shape"):
        scalar, size = {name: {**variable, "shape": []}}, math.prod(variable["shape"])
        if isinstance(value, int | float):
            return [check_value(where, scalar, name, value)] * size
        elements = np.ravel(value).tolist()
        if len(elements) != size:
            raise ParameterError(f"{where}: {name}: expected {size} numbers, got {len(elements)}. Correct it.")
        return [check_value(where, scalar, name, x) for x in elements]
    if variable["causality"] not in ("parameter", "input", "structuralParameter") and variable["initial"] != "exact":
        raise ParameterError(f"{where}: {name}: expected a parameter or an input, got one that is "
                             f"{variable['causality']}. Set another one.")  # fmt: skip
    if isinstance(value, bool | int | np.integer | np.bool_):
        value = int(value)
    number = expect_number(f"{where}: {name}", value)
    if variable["type"] not in REALS and number != int(number):
        raise ParameterError(f"{where}: {name}: expected a whole number, got {number:.15g}. Correct it.")
    low, high = (float(variable[key]) if variable[key] is not None else default
                 for key, default in (("min", -math.inf), ("max", math.inf)))  # fmt: skip
    if not low <= number <= high:
        raise ParameterError(
            f"{where}: {name}: expected a value from {low:g} to {high:g}, got {number:.15g}. Correct it."
        )
    # As an integer it keeps all of its 64 bits.
    return value if isinstance(value, int) else number


def _signals(where: str, variables: dict[str, Any], inputs: Mapping[str, Any]) -> dict[str, list[float]]:
    known = {name for name, v in variables.items() if v["causality"] == "input"} | {"time"}
    for name in inputs:
        if name not in known:
            raise UnknownNameError.of(f"{where}: inputs", name, known)
    if "time" not in inputs:
        raise ParameterError(f"{where}: inputs: expected times under 'time', got none. Add them.")
    # FMPy takes the first column for the time.
    columns = {
        name: frozen_array(f"{where}: {name}", inputs[name], ("time",))
        for name in sorted(inputs, key=lambda n: n != "time")
    }
    t = columns["time"]
    if any(x.shape != t.shape for x in columns.values()) or t.size < 2 or not (np.diff(t) >= 0).all():
        raise ParameterError(f"{where}: inputs: expected columns of one length, at least 2, with rising times, "
                             f"got lengths {sorted(x.size for x in columns.values())}. Correct them.")  # fmt: skip
    return {name: x.tolist() for name, x in columns.items()}
