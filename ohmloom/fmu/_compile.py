"""From the C sources of an FMU to shared libraries: for this machine, or for five targets."""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ohmloom.errors import OperationError

Platforms = Literal["host", "all"]
# No contraction to fused operations: every platform rounds alike.
FLAGS = ("-std=c99", "-g0", "-fvisibility=hidden", "-ffp-contract=off", "-shared", "-fno-asynchronous-unwind-tables",
         "-ffunction-sections", "-falign-functions=1", "-falign-loops=1")  # fmt: skip
TIMEOUT = 600.0  # s; the first use of a target builds its C library


@dataclass(frozen=True, kw_only=True)
class Target:
    """A platform: its folders in an FMU, the ending of its libraries, and what ziglang calls it."""

    folder2: str
    folder3: str
    ending: str
    zig: str

    def folder(self, fmi: int) -> str:
        """Its folder under ``binaries/``; FMI 2.0 names three, the others are named as in FMI 3.0."""
        return self.folder2 if fmi == 2 else self.folder3


TARGETS = {
    "x86_64-linux": Target(folder2="linux64", folder3="x86_64-linux", ending=".so", zig="x86_64-linux-gnu.2.17"),
    "aarch64-linux": Target(
        folder2="aarch64-linux", folder3="aarch64-linux", ending=".so", zig="aarch64-linux-gnu.2.17"
    ),
    "x86_64-windows": Target(folder2="win64", folder3="x86_64-windows", ending=".dll", zig="x86_64-windows-gnu"),
    "x86_64-darwin": Target(folder2="darwin64", folder3="x86_64-darwin", ending=".dylib", zig="x86_64-macos"),
    "aarch64-darwin": Target(folder2="aarch64-darwin", folder3="aarch64-darwin", ending=".dylib", zig="aarch64-macos"),
}


def host() -> str:
    """This machine's key of `TARGETS`, or another name if FMUs for it are not built here."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{platform.system().lower()}"


def find_compiler() -> tuple[str, ...] | None:
    """``$CC``, gcc or clang; else ziglang's, else None."""
    given = os.environ.get("CC", "").strip()
    if given:
        words = tuple(shlex.split(given))
        if shutil.which(words[0]) is None:
            raise OperationError(f"CC: expected a C compiler, got {given!r}, which is not there. Correct or unset it.")
        return words
    for name in ("gcc", "clang"):
        if shutil.which(name):
            return (name,)
    return _zig()


def _zig() -> tuple[str, ...] | None:
    return (sys.executable, "-m", "ziglang", "cc") if importlib.util.find_spec("ziglang") else None


def compile_library(
    sources: dict[str, bytes], target: str = "", *, flags: tuple[str, ...] = (*FLAGS, "-O2")
) -> bytes | None:
    """The shared library of `sources`, whose ``fmu.c`` includes the rest; for `target`, by default for this machine.

    Returns None if there is no compiler for it.

    Raises
    ------
    OperationError
        If the compiler fails.
    """
    compiler = _zig() if target else find_compiler() if host() in TARGETS else None
    if compiler is None:
        return None
    place = TARGETS[target or host()]
    is_zig = "ziglang" in compiler
    words = [*compiler, *flags]
    if is_zig:
        # Zig checks for undefined behaviour unless it is told not to.
        words += ["-fno-sanitize=all", "-target", place.zig]
    if place.ending != ".dll":
        words += ["-fPIC"]
    if place.ending == ".so":
        words += [
            "-fno-unwind-tables",
            "-Wl,--build-id=none",
            "-Wl,-z,noexecstack",
            "-Wl,--gc-sections",
            "-Wl,--hash-style=gnu",
        ]
        # Nothing runs at loading, so start files are of no use; unpadded segments make a library a third smaller.
        words += [] if is_zig else ["-nostartfiles", "-Wl,-z,noseparate-code", "-Wl,-z,now", "-fno-plt"]
    words += ["-s", "fmu.c", "-o", f"fmu{place.ending}"]
    words += [] if place.ending == ".dll" else ["-lm"]
    with tempfile.TemporaryDirectory(prefix="ohmloom-") as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_bytes(text)
        try:
            done = subprocess.run(words, cwd=folder, capture_output=True, timeout=TIMEOUT, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OperationError(f"{compiler[0]}: expected a C compiler that runs, got {error}. Check it.") from error
        library = Path(folder) / f"fmu{place.ending}"
        if done.returncode or not library.exists():
            first = next(
                (line for line in done.stderr.decode(errors="replace").splitlines() if "error" in line), "no word"
            )
            raise OperationError(f"{' '.join(compiler)}: expected it to compile an FMU, got: {first}. "
                                 "Try another compiler in $CC.")  # fmt: skip
        return library.read_bytes()
