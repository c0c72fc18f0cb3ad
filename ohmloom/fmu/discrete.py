"""Controllers, arenas and their closed loop as discrete FMUs, for co-simulation with a step of 32 ms."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ohmloom.errors import ParameterError, UnknownNameError, expect_integer, expect_number, expect_type, shown
from ohmloom.fmu import _discrete_code as code
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import FmiVersion
from ohmloom.neurocontroller import Network
from ohmloom.sim import Arena

TIMESTEP = 0.032  # s, Section VIII
LICENCE = "Licence: Apache-2.0, see licenses/license.txt."


def export_controller(
    network: Network,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
    timestep: float = TIMESTEP,
    arrays: bool = False,
) -> Export:
    """Write the discrete controller of `network` as an FMU for co-simulation; spike for spike the compiled one.

    In: `ir_0`, `ir_2`, `ir_5`, `light_0`, `light_2`, `light_5`, each in [0, 1]. Out: `action` (0 forward, 1 left, 2
    right), `spikes_left`, `spikes_right`, all of the last timestep. Parameters, fixed: the readings that are numbers.

    Parameters
    ----------
    network
        With its own readings.
    out
        The file, ``*.fmu``.
    fmi, platforms
        As `export_device` has them.
    timestep
        In s; a communication step is a whole number of these.
    arrays
        By FMI 3.0: the sensors as the array ``sensors[6]``, in the order above. Several tools do not read arrays.

    Raises
    ------
    ParameterError
        If an option is none of these.
    OperationError
        If the compiler fails, or the file cannot be written.

    Examples
    --------
    >>> from ohmloom.neurocontroller import champion
    >>> export_controller(champion("HET"), "het.so")
    Traceback (most recent call last):
    ohmloom.errors.ParameterError: export_controller: out: expected a file that ends in .fmu, got 'het.so'. Rename it.
    """
    where = "export_controller"
    expect_type(f"{where}: network", network, Network)
    path = check_options(where, out, fmi, platforms, arrays=arrays)
    if not 1e-6 <= expect_number(f"{where}: timestep", timestep, "a time in s") <= 1e6:
        raise ParameterError(f"{where}: timestep: expected 1e-06 to 1e+06 s, got {timestep:g}. Correct it.")
    description = code.controller_description(network, float(timestep))
    description = code.with_arrays(description) if arrays else description
    model = {
        "model.c": code.model_code(code.CONTROLLER, description),
        "network.c": code.network_table(network),
        "controller.c": runtime_file("controller.c"),
    }
    return build(path, description, model, [about(network), LICENCE], fmi=fmi, platforms=platforms)


def export_arena(
    task: str | Arena,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
    trial_key: int = 0,
    arrays: bool = False,
) -> Export:
    """Write an arena with its robot as an FMU for co-simulation: the path of `run_trial`, noise and slip included.

    In: `action`. Out: the six sensors, `x`, `y`, `heading`, `fitness`, `st`, `bumps`, `solved`, `done`. Parameters,
    fixed: `trial_key_low` and `trial_key_high`, the key of the random numbers as two signed 32-bit integers;
    `max_timesteps`; in the dynamic task `ir_noise`, `light_noise` and `slip`. After the end nothing moves.

    Parameters
    ----------
    task
        ``"static"``, ``"dynamic"``, or an arena.
    out, fmi, platforms
        As `export_device` has them.
    trial_key
        The key at the start, 0 to 2^64 - 1.
    arrays
        As `export_controller` has it.

    Raises
    ------
    UnknownNameError, ParameterError
        If an option is none of these.
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    where = "export_arena"
    arena = as_arena(where, task)
    path = check_options(where, out, fmi, platforms, arrays=arrays)
    key = expect_integer(f"{where}: trial_key", trial_key, 0, 2**64 - 1)
    description = code.arena_description(arena, key)
    description = code.with_arrays(description) if arrays else description
    model = {
        "model.c": code.model_code(code.ARENA, description),
        "world.c": code.world_table(arena),
        "arena.c": runtime_file("arena.c"),
        "random.c": runtime_file("random.c"),
    }
    return build(path, description, model, [about_arena(arena), LICENCE], fmi=fmi, platforms=platforms)


def as_arena(where: str, task: str | Arena) -> Arena:
    """An arena, or that of the paper for a task."""
    if isinstance(task, Arena):
        return task
    if not isinstance(task, str):
        raise ParameterError(f"{where}: task: expected a task or an Arena, got {shown(task)}. Pass one of these.")
    if task == "static":
        return Arena.paper(task="static")
    if task == "dynamic":
        return Arena.paper(task="dynamic")
    raise UnknownNameError.of(f"{where}: task", task, ("static", "dynamic"))


def runtime_file(name: str) -> str:
    """One of the C files that are the same for every model."""
    return (files("ohmloom.fmu") / "runtime" / name).read_text(encoding="utf-8")


def about(network: Network) -> str:
    return (
        f"Network {network.name} ({network.system}, sha256 {network.sha256}): 21 steps of the spiking network in a "
        "timestep, eqs. 3 to 6 and 10 to 12 of Howard et al. (2012); see sources/fmu.c."
    )


def about_arena(arena: Arena) -> str:
    return (
        f"Arena of the {arena.task} task, after Howard et al. (2012), Section VIII; see sources/fmu.c, parts arena.c "
        "and world.c. Sensors are those at the end of the last timestep, or at the start."
    )
