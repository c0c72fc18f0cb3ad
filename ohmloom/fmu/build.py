"""An FMU's archive: description, sources, libraries, documentation; the same model always gives the same bytes."""

from __future__ import annotations

import hashlib
import io
import logging
import zipfile
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import get_args

from ohmloom._files import write_atomic
from ohmloom.errors import OperationError, ParameterError, UnknownNameError, expect_type, shown
from ohmloom.fmu._compile import FLAGS, TARGETS, Platforms, compile_library, host
from ohmloom.fmu.description import Description, FmiVersion, build_description, index_page

logger = logging.getLogger(__name__)

HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip file knows
LICENCE = """The model and its C sources: Apache-2.0, by ohmloom,
see https://www.apache.org/licenses/LICENSE-2.0
"""


@dataclass(frozen=True, kw_only=True)
class Export:
    """What an export has written.

    Attributes
    ----------
    path
        The file.
    platforms
        Keys like ``"x86_64-linux"`` of the libraries inside; empty if there was no compiler, and the FMU holds sources
        alone.
    token
        The FMU's GUID (FMI 2.0) or instantiation token (FMI 3.0), a digest of what it computes.
    size
        In bytes.
    """

    path: Path
    platforms: tuple[str, ...]
    token: str
    size: int


def check_options(
    where: str,
    out: Path | str,
    fmi: int,
    platforms: str,
    *,
    suffixes: tuple[str, ...] = (".fmu",),
    arrays: bool = False,
) -> Path:
    """Refuse a bad place, version or choice of platforms before any work is done.

    Raises
    ------
    ParameterError
        If one of them is none of those that there are.
    OperationError
        If all platforms are asked for, and no compiler for them is installed.
    """
    import importlib.util

    expect_type(f"{where}: out", out, str, Path, name="a path")
    path = Path(out)
    if path.suffix not in suffixes:
        raise ParameterError(f"{where}: out: expected a file that ends in {' or '.join(suffixes)}, "
                             f"got {shown(str(path))}. Rename it.")  # fmt: skip
    if path.is_dir():
        raise ParameterError(f"{where}: out: expected a file, got the folder {path}. Use another path.")
    if isinstance(fmi, bool) or fmi not in (2, 3):
        raise ParameterError(f"{where}: fmi: expected 2 or 3, got {shown(fmi)}. Choose one.")
    if arrays is True and fmi == 2:
        raise ParameterError(f"{where}: arrays: expected FMI 3.0, since FMI 2.0 has no arrays, got fmi=2. Set fmi=3.")
    expect_type(f"{where}: arrays", arrays, bool, name="True or False")
    expect_type(f"{where}: platforms", platforms, str, name="a name")
    if platforms not in get_args(Platforms):
        raise UnknownNameError.of(f"{where}: platforms", platforms, get_args(Platforms))
    if platforms == "all" and importlib.util.find_spec("ziglang") is None:
        raise OperationError(f"{where}: platforms: expected ziglang, which compiles for other platforms, got none. "
                             "Install ohmloom's extra 'fmu'.")  # fmt: skip
    return path


def build(
    path: Path,
    description: Description,
    model: dict[str, str],
    paragraphs: list[str],
    *,
    fmi: FmiVersion,
    platforms: Platforms,
    notes: dict[str, str] | None = None,
    has_flow: bool = False,
) -> Export:
    """Compile `model` (name -> C text, ``model.c`` among them) with the runtime, and write the archive to `path`.

    The documentation gets the paragraphs, and to variables that are named in `notes` these. `has_flow` says that the
    model has a closed form of its state after a step, so that co-simulation needs no integration.

    Raises
    ------
    OperationError
        If the compiler fails, or the file cannot be written.
    """
    sources = {name: text.encode() for name, text in model.items()}
    sources["runtime.c"] = runtime_text(
        fmi, is_discrete=description.timestep is not None, has_arrays=bool(description.blocks), has_flow=has_flow
    ).encode()
    token = _token(description.to_xml(fmi, ""), sources)
    # Circuits and dies spend their time in long loops, devices in few instructions.
    flags = (*FLAGS, "-Os" if len(description.of("state")) == 1 else "-O2")
    text = (
        f"/* Compile it with FMI's headers on the include path: cc {' '.join(flags)} -fPIC fmu.c -lm */\n"
        f'#define FMI_VERSION {fmi}\n#define MODEL_TOKEN "{token}"\n'
        f"#define LONGEST_NAME {max(len(v.name) for v in description.variables)}\n{_joined(sources, 'runtime.c')}"
    ).encode()
    content = {"sources/fmu.c": text}
    content["modelDescription.xml"] = description.to_xml(fmi, token).encode()
    content["documentation/index.html"] = index_page(description.name, paragraphs, description, notes or {}).encode()
    content["documentation/licenses/license.txt"] = LICENCE.encode()
    if fmi == 3:
        content["sources/buildDescription.xml"] = build_description(description.identifier).encode()
    # By the standard an importer has these; they are needed here alone.
    headers = {name: (files("fmpy") / "c-code" / name).read_bytes() for name in HEADERS[fmi]}
    built = []
    for key in TARGETS if platforms == "all" else ("",):
        library = compile_library({"fmu.c": text, **headers}, key, flags=flags)
        if library is None:
            logger.warning("%s: no C compiler was found: the FMU holds sources alone", path)
            continue
        target = TARGETS[key or host()]
        content[f"binaries/{target.folder(fmi)}/{description.identifier}{target.ending}"] = library
        built.append(key or host())
    data = archive(content)
    write_atomic(path, data)
    return Export(path=path, platforms=tuple(built), token=token, size=len(data))


def archive(content: dict[str, bytes]) -> bytes:
    """A zip file of `content`, always the same: sorted, without dates; the description comes first."""
    first = ("modelDescription.xml", "SystemStructure.ssd")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        for name in sorted(content, key=lambda name: (name not in first, name)):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o644 << 16
            file.writestr(entry, content[name])
    return buffer.getvalue()


def runtime_text(fmi: FmiVersion, *, is_discrete: bool, has_arrays: bool = False, has_flow: bool = False) -> str:
    """The part of the runtime that a version and a kind of model need: its ``#if`` on these are decided here."""
    text = (files("ohmloom.fmu") / "runtime" / "runtime.c").read_text(encoding="utf-8")
    answers = {f"FMI_VERSION == {version}": version == fmi for version in get_args(FmiVersion)}
    answers |= {"MODEL_IS_DISCRETE": is_discrete, "!MODEL_IS_DISCRETE": not is_discrete, "MODEL_HAS_ARRAYS": has_arrays,
                "MODEL_HAS_FLOW": has_flow}  # fmt: skip
    # For each open #if: whether its branch is kept, or None if it is the compiler's to decide.
    kept: list[str] = []
    stack: list[bool | None] = []
    for line in text.splitlines(keepends=True):
        word, _, condition = line.strip().partition(" ")
        if word in ("#if", "#ifdef", "#ifndef"):
            stack.append(answers.get(condition))
        elif word == "#else" and stack[-1] is not None:
            stack[-1] = not stack[-1]
            continue
        is_ours = bool(stack) and stack[-1] is not None and word in ("#if", "#endif")
        if word == "#endif":
            stack.pop()
        if not is_ours and False not in stack:
            kept.append(line)
    return "".join(kept)


def _joined(sources: dict[str, bytes], name: str) -> str:
    """A file with those that it includes put in: one file is smaller in an archive than its parts are."""
    lines = [f"/* {f' {name} ':=^114} */\n"]
    for line in sources[name].decode().splitlines(keepends=True):
        included = line.removeprefix('#include "').removesuffix('"\n')
        lines.append(_joined(sources, included) if included in sources else line)
    return "".join([*lines, f"/* {f' end of {name} ':=^114} */\n"])


def _token(xml: str, sources: dict[str, bytes]) -> str:
    digest = hashlib.sha256(xml.encode())
    for name in sorted(sources):
        digest.update(name.encode() + b"\0" + sources[name] + b"\0")
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
