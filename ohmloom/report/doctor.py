"""What works on this machine and what does not."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

LIBRARIES = ("numpy", "scipy", "numba", "matplotlib", "pillow", "pydantic", "typer", "rich", "jinja2")
PROBE_SENSORS = (0.0, 0.0, 0.0, 0.2, 0.8, 1.0)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was tried: its name, whether it works, whether ohmloom needs it, and what was seen."""

    name: str
    works: bool
    is_core: bool
    detail: str


def examine() -> list[Finding]:
    """Try everything; takes some seconds the first time, while kernels are compiled."""
    from ohmloom import __version__

    here = f"{__version__} on Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    found = [Finding(name="ohmloom", works=sys.version_info >= (3, 11), is_core=True, detail=here)]
    found += [_library(name) for name in LIBRARIES]
    found += [
        _try("shipped files", _shipped),
        _try("compiled kernels", _kernels),
        _try("kernel cache", _cache, is_core=False),
        _tool("C compiler", (os.environ.get("CC", ""), "cc", "gcc", "clang"), "builds FMUs; without one ziglang does"),
        _tool("ngspice", ("ngspice",), "runs netlists with circuit run --engine ngspice"),
    ]
    return found


def _library(name: str) -> Finding:
    try:
        return Finding(name=name, works=True, is_core=True, detail=importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return Finding(name=name, works=False, is_core=True, detail="not installed: install ohmloom again")


def _try(name: str, test: Callable[[], str], *, is_core: bool = True) -> Finding:
    try:
        return Finding(name=name, works=True, is_core=is_core, detail=test())
    except Exception as error:  # noqa: BLE001 - whatever is wrong is the finding
        return Finding(name=name, works=False, is_core=is_core, detail=f"{type(error).__name__}: {error}")


def _shipped() -> str:
    from ohmloom.devices import Device
    from ohmloom.mapping import Hardware
    from ohmloom.neurocontroller import SYSTEMS, champion

    cards = [Device.load(name) for name in Device.names()]
    specs = [Hardware.load(name) for name in Hardware.names()]
    networks = [champion(system) for system in SYSTEMS]
    return f"{len(cards)} device cards, {len(specs)} hardware specs, {len(networks)} champions"


def _kernels() -> str:
    from ohmloom.neurocontroller import SpikingController, champion

    fast, plain = (SpikingController(champion("HET"), implementation=i) for i in ("compiled", "plain"))
    for _ in range(3):
        if fast.step(PROBE_SENSORS) != plain.step(PROBE_SENSORS) or (fast.weights != plain.weights).any():
            raise RuntimeError("the compiled controller differs from the plain one")
    return "equal to the plain controller over 63 steps of the HET champion"


def _cache() -> str:
    from ohmloom._jit import cache_directory

    folder = Path(os.environ.get("NUMBA_CACHE_DIR", cache_directory()))
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        return str(folder)


def _tool(name: str, commands: tuple[str, ...], use: str) -> Finding:
    path = next((found for command in commands if command and (found := shutil.which(command))), None)
    return Finding(name=name, works=path is not None, is_core=False, detail=path or f"not found; {use}")
