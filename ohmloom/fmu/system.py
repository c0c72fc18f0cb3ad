"""A controller and its arena as one closed loop: an FMU, or an SSP system of two."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ohmloom._files import write_atomic
from ohmloom.errors import expect_integer, expect_type
from ohmloom.fmu import _discrete_code as code
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu.build import Export, archive, build, check_options
from ohmloom.fmu.description import Description, FmiVersion
from ohmloom.fmu.discrete import (
    LICENCE,
    about,
    about_arena,
    as_arena,
    export_arena,
    export_controller,
    runtime_file,
)
from ohmloom.fmu.hardware import die_parameters, die_parts, export_hardware_controller
from ohmloom.mapping.die import Die
from ohmloom.neurocontroller import Network
from ohmloom.sim import Arena

SSC = {"real": "Real", "integer": "Integer", "boolean": "Boolean"}


def export_system(
    controller: Network | Die,
    out: Path | str,
    *,
    task: str | Arena = "static",
    trial_key: int = 0,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
) -> Export:
    """Write a controller in its arena: ``x.fmu`` is one FMU for any master, ``x.ssp`` a system of SSP 1.0.

    The one FMU follows the path of `run_trial`, whatever the master. The system holds the controller's and the arena's
    FMU; a master that runs the controller before the arena follows the same path, one that hands on values after both
    have stepped that of ``run_trial(action_delay=1)``. Settings are start values of the FMUs, which every tool reads.

    Parameters
    ----------
    controller
        A network, or the die that it runs on.
    out
        The file, ``*.fmu`` or ``*.ssp``.
    task
        ``"static"``, ``"dynamic"``, or an arena.
    trial_key
        Key of the trial's random numbers, 0 to 2^64 - 1.
    fmi, platforms
        As `export_device` has them.

    Returns
    -------
    Export
        Of a system, the token is empty.

    Raises
    ------
    UnknownNameError, ParameterError
        If an option is none of these.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_system"
    expect_type(f"{where}: controller", controller, Network, Die, name="a Network or a Die")
    arena = as_arena(where, task)
    path = check_options(where, out, fmi, platforms, suffixes=(".fmu", ".ssp"))
    key = expect_integer(f"{where}: trial_key", trial_key, 0, 2**64 - 1)
    if path.suffix == ".fmu":
        return _export_loop(path, controller, arena, key, fmi=fmi, platforms=platforms)
    network = controller if isinstance(controller, Network) else controller.plan.network
    with tempfile.TemporaryDirectory(prefix="ohmloom-") as folder:
        parts = {
            "controller": _export_part(controller, Path(folder) / "controller.fmu", fmi, platforms, arena.timestep),
            "arena": export_arena(arena, Path(folder) / "arena.fmu", fmi=fmi, platforms=platforms, trial_key=key),
        }  # fmt: skip
        content = {f"resources/{name}.fmu": part.path.read_bytes() for name, part in parts.items()}
    descriptions = {
        "controller": code.controller_description(network, arena.timestep),
        "arena": code.arena_description(arena, key),
    }
    content["SystemStructure.ssd"] = _structure(descriptions, arena).encode()
    data = archive(content)
    write_atomic(path, data)
    return Export(path=path, platforms=parts["arena"].platforms, token="", size=len(data))


def _export_part(
    controller: Network | Die, path: Path, fmi: FmiVersion, platforms: Platforms, timestep: float
) -> Export:
    if isinstance(controller, Die):
        return export_hardware_controller(controller, path, fmi=fmi, platforms=platforms, timestep=timestep)
    return export_controller(controller, path, fmi=fmi, platforms=platforms, timestep=timestep)


def _export_loop(
    path: Path, controller: Network | Die, arena: Arena, trial_key: int, *, fmi: FmiVersion, platforms: Platforms
) -> Export:
    """The closed loop as one FMU."""
    template = code.SYSTEM
    if isinstance(controller, Die):
        network = controller.plan.network
        name, parameters = f"{network.name}_{controller.plan.hardware.name}", die_parameters(controller)
        model = die_parts(controller)
        template = template.replace("controller.c", "hardware.c").replace("network.c", "die.c")
    else:
        network = controller
        name, parameters = network.name, code.controller_parameters(network)
        model = {"network.c": code.network_table(network), "controller.c": runtime_file("controller.c")}
    description = code.system_description(name, parameters, arena, trial_key)
    model |= {
        "model.c": code.model_code(template, description, len(code.arena_parameters(arena, trial_key))),
        "world.c": code.world_table(arena),
        "arena.c": runtime_file("arena.c"),
        "random.c": runtime_file("random.c"),
    }
    paragraphs = [about(network), about_arena(arena), LICENCE]
    return build(path, description, model, paragraphs, fmi=fmi, platforms=platforms)


def _structure(parts: dict[str, Description], arena: Arena) -> str:
    """`SystemStructure.ssd`: what feeds what; every output that is not a sensor is one of the system too."""
    wires = [("arena", name, "controller", name) for name in code.SENSORS]
    wires.append(("controller", "action", "arena", "action"))
    shown = [(part, v) for part, d in parts.items() for v in d.of("output") if v.name not in code.SENSORS]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<ssd:SystemStructureDescription version="1.0" name="loop"',
        '    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"',
        '    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">',
        '  <ssd:System name="loop">',
        "    <ssd:Connectors>",
        *(f"    {_connector(v.name, 'output', v.type)}" for _, v in shown),
        "    </ssd:Connectors>",
        "    <ssd:Elements>",
    ]
    for name, description in parts.items():
        lines += [f'      <ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" '
                  f'source="resources/{name}.fmu">', "        <ssd:Connectors>"]  # fmt: skip
        lines += [f"        {_connector(v.name, v.kind, v.type)}" for v in description.of("input", "output")]
        lines += ["        </ssd:Connectors>", "      </ssd:Component>"]
    lines += ["    </ssd:Elements>", "    <ssd:Connections>"]
    lines += [
        f'      <ssd:Connection startElement="{a}" startConnector="{out}" endElement="{b}" endConnector="{into}"/>'
        for a, out, b, into in wires
    ]
    lines += [
        f'      <ssd:Connection startElement="{a}" startConnector="{v.name}" endConnector="{v.name}"/>'
        for a, v in shown
    ]
    stop = arena.max_timesteps * arena.timestep
    lines += [
        "    </ssd:Connections>",
        "  </ssd:System>",
        f'  <ssd:DefaultExperiment startTime="0" stopTime="{stop!r}"/>',
        "</ssd:SystemStructureDescription>",
        "",
    ]
    return "\n".join(lines)


def _connector(name: str, kind: str, type_: str) -> str:
    return f'  <ssd:Connector name="{name}" kind="{kind}"><ssc:{SSC[type_]}/></ssd:Connector>'
