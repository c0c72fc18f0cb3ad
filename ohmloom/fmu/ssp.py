"""An own small runner of SSP 1.0 systems: FMUs in processes of their own, ordered by what depends on what."""

from __future__ import annotations

import contextlib
import math
import re
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ohmloom._arrays import frozen_array
from ohmloom._files import DAMAGED_ZIP
from ohmloom.errors import (
    FileFormatError,
    MissingFileError,
    OhmloomError,
    ParameterError,
    UnknownNameError,
    expect_number,
    shown,
)
from ohmloom.fmu._archive import check_entries, parse_xml
from ohmloom.fmu._process import MEMORY, TIMEOUT
from ohmloom.fmu.host import Host
from ohmloom.fmu.run import FmuTrace

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
MOST_STEPS = 10_000_000
PREFIX = "ohmloom-ssp-"  # of folders that systems are unpacked into

Port = tuple[str, str]  # component and variable


@dataclass(frozen=True, kw_only=True)
class Structure:
    """What a system's file says.

    Attributes
    ----------
    sources
        Path inside the archive by component.
    parameters
        By component: values by name.
    wires
        For each connected input, the output that feeds it.
    stop_time
        In s, if the file suggests one.
    """

    sources: dict[str, str]
    parameters: dict[str, dict[str, float]]
    wires: dict[Port, Port]
    stop_time: float | None


def run_ssp(
    file: Path | str,
    *,
    stop_time: float | None = None,
    step_size: float | None = None,
    steps: int | None = None,
    start_values: Mapping[str, float] | None = None,
    timeout: float = TIMEOUT,
    memory: int = MEMORY,
) -> FmuTrace:
    """Run a system of FMUs with a fixed step.

    At each communication point values go from outputs to inputs in the order of the FMUs' declared dependencies: an
    output that depends on the state alone is known at once; a continuous one follows from its inputs; a discrete one
    that depends on inputs is that of the coming step, so its FMU steps before those that it feeds. A ring in which
    every output depends on the input before it has no order, and is refused.

    Parameters
    ----------
    file
        The system, ``*.ssp``, flat, of FMUs for co-simulation of either version.
    stop_time, step_size
        In s; None for what the file and its FMUs suggest.
    steps
        How many; None for those until `stop_time`.
    start_values
        By ``component.variable``, over those of the file.
    timeout, memory
        Of each call of an FMU, in s, and of each FMU's process, in bytes.

    Returns
    -------
    FmuTrace
        Outputs by ``component.variable``, those of steps as of the last one.

    Raises
    ------
    MissingFileError, FileFormatError
        If the file is no system that can run here.
    ParameterError, UnknownNameError
        If an option is out of its range, or a name is none of the system's.
    OperationError
        If an FMU fails.
    """
    path = Path(file)
    for name, x in (("stop_time", stop_time), ("step_size", step_size)):
        if x is not None and not (expect_number(f"run_ssp: {name}", x) > 0.0 and math.isfinite(x)):
            raise ParameterError(f"run_ssp: {name}: expected a time above 0 s, got {x:g}. Give one.")
    with named_within(path), contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=PREFIX)))
        structure = unpack(path, folder)
        given = by_component(path, structure, start_values or {})
        hosts = {
            name: stack.enter_context(Host(folder / source, start_values=given[name], timeout=timeout, memory=memory))
            for name, source in structure.sources.items()
        }
        order = plan(path, structure.wires, hosts)
        h = step_size or max((host.step_size or 0.0 for host in hosts.values()), default=0.0)
        if h == 0.0:
            raise ParameterError("run_ssp: step_size: expected a time above 0 s, got none, and its FMUs suggest none. "
                                 "Give one.")  # fmt: skip
        end = stop_time or (steps or 0) * h or structure.stop_time or 1.0
        if end / h > MOST_STEPS:
            raise ParameterError(f"run_ssp: expected at most {MOST_STEPS} steps, got {end / h:.3g}. Take longer ones.")
        count = max(1, round(end / h))
        return _run(path, hosts, structure.wires, order, count, h)


@dataclass(frozen=True, kw_only=True)
class Order:
    """How a communication point goes: `tasks` in order, a port to be fed or read, or a component to be stepped."""

    tasks: tuple[Any, ...]
    early: frozenset[str]  # components that step inside it


def plan(where: Path, wires: Mapping[Port, Port], hosts: Mapping[str, Host]) -> Order:
    """The order of a communication point.

    Raises
    ------
    UnknownNameError
        If a wire ends at a variable that its FMU has not.
    FileFormatError
        If there is a ring of direct feedthrough; names it.
    """
    for into, out in wires.items():
        for (name, variable), kind in ((into, "input"), (out, "output")):
            known = hosts[name].inputs if kind == "input" else hosts[name].outputs
            if variable not in known:
                raise UnknownNameError.of(f"{where}: {name}: {kind}", variable, known)
    graph: dict[Any, set[Any]] = {}
    early = set()
    for name, host in hosts.items():
        fed = {port[1] for port in wires if port[0] == name}
        for output in host.outputs:
            needs = host.dependencies.get(output)
            # Without a declaration, an output depends on every input.
            through = fed & set(host.inputs if needs is None else needs)
            graph[(name, output)] = {(name, need) for need in through}
            if through and host.variables[output]["variability"] == "discrete":
                early.add(name)
                graph[(name, output)] = {name}
                graph.setdefault(name, set()).update((name, need) for need in fed)
    for into, out in wires.items():
        graph.setdefault(into, set()).add(out)
    try:
        return Order(tasks=tuple(TopologicalSorter(graph).static_order()), early=frozenset(early))
    except CycleError as error:
        ring = [".".join(port) for port in error.args[1] if isinstance(port, tuple)]
        raise FileFormatError(f"{where}: expected no ring of direct feedthrough, got {' -> '.join(ring)}. "
                              "Export its models as one flattened FMU.") from error  # fmt: skip


def _run(
    path: Path, hosts: Mapping[str, Host], wires: Mapping[Port, Port], order: Order, count: int, h: float
) -> FmuTrace:
    values: dict[Port, Any] = {}
    columns: dict[str, list[float]] = {f"{name}.{out}": [] for name, host in hosts.items() for out in host.outputs}

    def read(name: str, outputs: tuple[str, ...] | list[str]) -> None:
        values.update({(name, out): x for out, x in hosts[name].get(outputs).items()})

    def step(name: str, inputs: dict[str, Any]) -> None:
        values.update({(name, out): x for out, x in hosts[name].step(h, inputs, hosts[name].outputs).items()})

    for name, host in hosts.items():
        read(name, host.outputs)
    for k in range(count + 1):
        is_last = k == count
        given: dict[str, dict[str, Any]] = {name: {} for name in hosts}
        row = dict(values)
        for task in order.tasks:
            if isinstance(task, str):
                if not is_last:
                    step(task, given.pop(task))
            elif task in wires:
                x = values[wires[task]]
                given.get(task[0], {})[task[1]] = int(x) if isinstance(x, bool) else x
            elif task[0] not in order.early and given[task[0]]:
                hosts[task[0]].set(given[task[0]])
                read(task[0], [task[1]])
                row[task] = values[task]
        for (name, out), x in row.items():
            columns[f"{name}.{out}"].append(float(x))
        if not is_last:
            for name in hosts.keys() - order.early:
                step(name, given[name])
    t = frozen_array("FmuTrace.t", [k * h for k in range(count + 1)], ("time",))
    frozen = {name: frozen_array(f"FmuTrace.{name}", x, ("time",)) for name, x in columns.items()}
    return FmuTrace(name=path.name, t=t, values=frozen)


@contextlib.contextmanager
def named_within(path: Path) -> Iterator[None]:
    """Errors name an FMU of a system by the system's file, not by the folder that it was unpacked into."""
    try:
        yield
    except OhmloomError as error:
        raise type(error)(*(named(path, problem) for problem in error.problems)) from error


def named(path: Path, text: str) -> str:
    """The same for one text."""
    return re.sub(rf"{re.escape(tempfile.gettempdir())}[/\\]{PREFIX}[^/\\ :]*[/\\]", lambda _: f"{path}:", text)


def is_system(file: Path | str) -> bool:
    """Whether a file is an SSP archive, by its name or by what is inside."""
    try:
        if Path(file).suffix == ".ssp":
            return True
        with zipfile.ZipFile(file) as archive:
            return "SystemStructure.ssd" in archive.namelist()
    except (OSError, TypeError, *DAMAGED_ZIP):
        return False  # whoever opens it says why


@dataclass(frozen=True)
class System:
    """A system's file, for a process of its own."""

    path: Path

    def extract(self, folder: Path) -> None:
        """Unpack what is safe to unpack."""
        unpack(self.path, folder)


def unpack(path: Path, folder: Path) -> Structure:
    """A system's structure; its FMUs are written into `folder`.

    Raises
    ------
    FileFormatError
        If it is no archive that is safe to unpack, or no flat SSP 1.0 system.
    MissingFileError
        If there is no such file.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: expected an SSP file, got none. Check the path.")
    try:
        with zipfile.ZipFile(path) as file:
            check_entries(path, file.infolist())
            if "SystemStructure.ssd" not in file.namelist():
                raise FileFormatError(f"{path}: expected SystemStructure.ssd inside, got no such entry. "
                                      "Check that this is an SSP file.")  # fmt: skip
            structure = _parse(path, file.read("SystemStructure.ssd"))
            for name, source in structure.sources.items():
                if source not in file.namelist():
                    raise FileFormatError(f"{path}: {name}: expected its source inside, got no {shown(source)}. "
                                          "Pack it again.")  # fmt: skip
            file.extractall(folder)
    except DAMAGED_ZIP as error:
        raise FileFormatError(f"{path}: expected a zip file, got {error}. Check that this is an SSP file.") from error
    return structure


def _parse(path: Path, text: bytes) -> Structure:
    where = f"{path}:SystemStructure.ssd"
    root = parse_xml(where, text)
    system = root.find(f"{SSD}System")
    if root.tag != f"{SSD}SystemStructureDescription" or system is None:
        raise FileFormatError(f"{where}: expected a system of SSP 1.0, got <{root.tag}>. Check the file.")
    for tag in ("System", "SignalDictionaryReference"):
        if system.find(f"{SSD}Elements/{SSD}{tag}") is not None:
            raise FileFormatError(f"{where}: expected a flat system, got a {tag} inside. Flatten it.")
    for tag in ("LinearTransformation", "BooleanMappingTransformation", "IntegerMappingTransformation",
                "EnumerationMappingTransformation"):  # fmt: skip
        if any(element.tag.endswith(f"}}{tag}") for element in root.iter()):
            raise FileFormatError(f"{where}: expected plain connections, got a {tag}. Put it into an FMU.")
    if (
        root.find(f".//{SSD}ParameterMapping") is not None
        or root.find(f".//{SSD}ParameterBinding[@source]") is not None
    ):
        raise FileFormatError(f"{where}: expected parameter values inline, got a file or a mapping. Write them inline.")
    components = system.findall(f"{SSD}Elements/{SSD}Component")
    sources = {c.get("name", ""): c.get("source", "") for c in components}
    if not sources or len(sources) < len(components):
        raise FileFormatError(
            f"{where}: expected components with names of their own, got {len(components)}. Name them."
        )
    parameters = {c.get("name", ""): _parameters(where, c) for c in components}
    wires: dict[Port, Port] = {}
    for connection in system.iterfind(f"{SSD}Connections/{SSD}Connection"):
        a, b = connection.get("startElement"), connection.get("endElement")
        if a is None or b is None:
            continue  # to or from the system's own connectors
        into, out = (b, connection.get("endConnector", "")), (a, connection.get("startConnector", ""))
        for name in (a, b):
            if name not in sources:
                raise FileFormatError(f"{where}: Connection: expected a component, got {shown(name)}. Correct it.")
        if into in wires:
            raise FileFormatError(f"{where}: {'.'.join(into)}: expected one connection, got two. Remove one.")
        wires[into] = out
    experiment = root.find(f"{SSD}DefaultExperiment")
    found = None if experiment is None else experiment.get("stopTime")
    stop = None if found is None else _time(f"{where}: stopTime", found)
    return Structure(sources=sources, parameters=parameters, wires=wires, stop_time=stop)


def _time(where: str, text: str) -> float:
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not 0.0 < time < math.inf:
        raise FileFormatError(f"{where}: expected a time above 0 s, got {shown(text)}. Correct it.")
    return time


def _parameters(where: str, component: ElementTree.Element) -> dict[str, float]:
    values = {}
    for parameter in component.iterfind(f".//{SSV}Parameter"):
        name = parameter.get("name", "")
        text = next((child.get("value", "") for child in parameter), "")
        try:
            values[name] = {"true": 1.0, "false": 0.0}[text] if text in ("true", "false") else float(text)
        except ValueError as error:
            raise FileFormatError(f"{where}: {component.get('name')}.{name}: expected a number, got {shown(text)}. "
                                  "Correct it.") from error  # fmt: skip
    return values


def by_component(path: Path, structure: Structure, given: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The file's parameters with `given`, which has ``component.variable``, over them."""
    values = {name: dict(structure.parameters[name]) for name in structure.sources}
    for name, x in given.items():
        component, _, variable = name.partition(".")
        if component not in values:
            raise UnknownNameError.of(f"{path}: start values: component", component, values)
        values[component][variable] = x
    return values
