"""Files: written whole or not at all, read with errors that name the file, the field and the value."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from ohmloom.errors import (
    FileFormatError,
    MissingFileError,
    OhmloomError,
    OperationError,
    ParameterError,
    expect_type,
    shown,
)

M = TypeVar("M", bound=pydantic.BaseModel)
TEXT_LIMIT = 16_000_000  # bytes; ours are far smaller
DEPTH_LIMIT = 64  # levels of nesting; ours have five
WRITES = 5  # of a file whose temporary others remove
# What zipfile raises for an archive that it cannot read: no archive, damaged data, cut short; and, for an encrypted
# entry or a compression that it does not know, a bare RuntimeError or its child NotImplementedError.
DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError)
# tomllib takes a time that grows with the cube of a dotted key's length, so long ones are refused unread.
_LONG_KEY = re.compile(r"""(?m)(?:^|[\[{,])[ \t]*(?:(?:[\w-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*')[ \t]*\.[ \t]*){64}""")


class StrictModel(pydantic.BaseModel):
    """A table read from a file or made in Python: strict types, no unknown keys, frozen."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except pydantic.ValidationError as error:
            raise ParameterError(*_problems(type(self).__name__, error, type(self), ".")) from error

    # Parsing a table must go around this constructor, or the errors of inner tables would lose their place. The mark
    # is pydantic's own way to say so; functions have no such attribute for a type checker.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


def write_atomic(path: Path | str, data: bytes | str) -> None:
    """Write `data` under a temporary name, flush it to disk, then rename it to `path`.

    Raises
    ------
    OperationError
        If the file cannot be written (no such folder, no permission, disk full); nothing is left behind.
    """
    path = Path(path)
    payload = data.encode() if isinstance(data, str) else data
    for _ in range(WRITES):
        temporary = ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            with os.fdopen(descriptor, "wb") as file:
                file.write(payload)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
            return
        except (OSError, ValueError) as error:  # a NUL in a path is a ValueError
            if temporary and os.path.exists(temporary):
                os.unlink(temporary)
            elif temporary and isinstance(error, FileNotFoundError):
                continue  # taken for a leftover by another process that resumes in the same folder
            raise OperationError(
                f"{_path_text(path)}: expected a file that can be written, got {_why(error)}. Check the folder."
            ) from error
    raise OperationError(f"{_path_text(path)}: expected its temporary file to stay, got it removed {WRITES} times. "
                         "Check what else works in the folder.")  # fmt: skip


def remove_temporaries(folder: Path, is_ours: Callable[[str], bool]) -> None:
    """Remove what a killed `write_atomic` left in `folder`, for the files whose name `is_ours`."""
    for leftover in folder.glob(".*"):
        name = re.fullmatch(r"\.(.+)\.[a-z0-9_]{8}", leftover.name)
        if name and is_ours(name[1]):
            leftover.unlink(missing_ok=True)


def read_bytes(path: Path | str, what: str, *, limit: int | None = TEXT_LIMIT) -> bytes:
    """Read a whole file of at most `limit` bytes; `what` names it in the error ("network", "hardware spec").

    Raises
    ------
    MissingFileError
        If it does not exist or cannot be read.
    FileFormatError
        If it is larger than `limit`.
    ParameterError
        If `path` is no path.
    """
    expect_type(f"{what} file", path, str, os.PathLike, name="a path")
    try:
        with open(path, "rb") as file:
            data = file.read(-1 if limit is None else limit + 1)
    except (OSError, ValueError) as error:
        raise MissingFileError(
            f"{_path_text(path)}: expected a {what} file, got {_why(error)}. Check the path."
        ) from error
    if limit is not None and len(data) > limit:
        raise FileFormatError(f"{_path_text(path)}: expected a {what} file of at most {limit // 10**6} MB, "
                              "got a larger one. Check that this is the right file.")  # fmt: skip
    return data


def parse_json(data: bytes, where: str) -> Any:
    """Parse JSON; NaN, Infinity and duplicate keys are refused."""

    def refuse(constant: str) -> None:
        raise FileFormatError(f"{where}: expected finite numbers, got {constant}. Replace it with a number.")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table: dict[str, Any] = {}
        for key, value in pairs:
            if key in table:
                raise FileFormatError(f"{where}: expected each key once, got {shown(key)} twice. Remove one.")
            table[key] = value
        return table

    return _parse(
        lambda text: json.loads(text, parse_constant=refuse, object_pairs_hook=unique), data, where, "JSON object"
    )


def parse_toml(data: bytes, where: str) -> dict[str, Any]:
    """Parse TOML."""

    def loads(text: str) -> Any:
        if _LONG_KEY.search(text):
            raise RecursionError
        return tomllib.loads(text)

    table: dict[str, Any] = _parse(loads, data, where, "TOML table")
    return table


def _parse(loads: Callable[[str], Any], data: bytes, where: str, what: str) -> Any:
    try:
        table = loads(data.decode("utf-8"))
        _check_depth(table)
        return table
    except OhmloomError:
        raise
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{where}: expected UTF-8 text, got byte {error.start} that is not. "
                              "Save the file as UTF-8.") from error  # fmt: skip
    except RecursionError as error:
        raise FileFormatError(f"{where}: expected a shallow {what}, got one nested too deeply. "
                              "Check that this is the right file.") from error  # fmt: skip
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{where}: expected JSON, got {error.msg} at line {error.lineno}, column {error.colno}. "
            "The file may be truncated."
        ) from error
    except tomllib.TOMLDecodeError as error:
        got = shown(str(error), 200)[1:-1]
        raise FileFormatError(f"{where}: expected TOML, got {got}. The file may be truncated.") from error
    except ValueError as error:  # Python reads no integer of more than 4300 digits
        raise FileFormatError(f"{where}: expected numbers that fit 64 bits, got an integer of thousands of digits. "
                              "Shorten it.") from error  # fmt: skip


def _check_depth(table: Any) -> None:
    """Later code may walk a table recursively, so it must be shallow; this walk is not recursive."""
    level = [table]
    for _ in range(DEPTH_LIMIT):
        level = [
            item
            for part in level
            if isinstance(part, dict | list)
            for item in (part.values() if isinstance(part, dict) else part)
        ]
        if not level:
            return
    raise RecursionError


def check_format(table: Any, where: str, name: str, version: int) -> dict[str, Any]:
    """Check the two fields that every ohmloom file has, before anything else is read.

    Returns the table without them.
    """
    if not isinstance(table, dict):
        raise FileFormatError(f"{where}: expected an object with the key 'format', got {shown(table)}. "
                              "Check that this is the right file.")  # fmt: skip
    rest = dict(table)
    for key, wanted in (("format", name), ("version", version)):
        value = rest.pop(key, None)
        if value != wanted or type(value) is not type(wanted):
            got = "nothing" if value is None else shown(value)
            advice = "Check that this is the right file." if key == "format" else "This ohmloom reads only that one."
            raise FileFormatError(f"{where}: {key}: expected {wanted!r}, got {got}. {advice}")
    return rest


def validate(model: type[M], table: Any, where: str) -> M:
    """Turn a parsed table into `model`, gathering every problem into one error."""
    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        raise FileFormatError(*_problems(where, error, model, ": ")) from error


def advise(problems: Iterable[str], advice: str) -> list[str]:
    """The same problems with another last sentence: what to do with a file that nobody writes by hand."""
    return [f"{problem.rpartition('. ')[0]}. {advice}" for problem in problems]


def sha256(data: bytes) -> str:
    """Hexadecimal digest of `data`."""
    return hashlib.sha256(data).hexdigest()


def _why(error: OSError | ValueError) -> str:
    return getattr(error, "strerror", None) or str(error)


def _path_text(path: Any) -> str:
    """A path as an error shows it: as it is, unless that would break the line."""
    text = os.fsdecode(path)
    return text if text.isprintable() and len(text) < 1000 else shown(text)


def _problems(where: str, error: pydantic.ValidationError, model: type[pydantic.BaseModel], joint: str) -> list[str]:
    return [_problem(where, item, model, joint) for item in error.errors(include_url=False)]


def _problem(where: str, item: Any, model: type[pydantic.BaseModel], joint: str) -> str:
    field = ""
    for part in item["loc"]:
        name = str(part) if str(part).isprintable() and len(str(part)) <= 60 else shown(part)
        field += f"[{part}]" if isinstance(part, int) else (f".{name}" if field else name)
    head = f"{where}{joint}{field}" if field else where
    if item["type"] == "extra_forbidden":
        import difflib

        known = _fields_at(model, item["loc"][:-1])
        near = difflib.get_close_matches(str(item["loc"][-1]), known, n=1, cutoff=0.5)
        advice = f"Did you mean {near[0]!r}?" if near else "Remove it."
        return f"{head}: expected no such key, got {shown(item['input'])}. {advice}"
    if item["type"] == "missing":
        return f"{head}: expected a value, got nothing. Add it."
    message = item["msg"].removeprefix("Value error, ")
    if item["type"] == "value_error" and ": expected" in message:
        return f"{where}{joint}{message}"
    rule = "a table" if item["type"] == "model_type" else message.removeprefix("Input should be ")
    return f"{head}: expected {rule}, got {shown(item['input'])}. Correct it."


def _fields_at(model: type[pydantic.BaseModel], location: tuple[Any, ...]) -> list[str]:
    """Names of the fields of the model that `location` leads to, as far as it can be followed."""
    current: Any = model
    for part in location:
        if isinstance(part, int):
            continue
        info = getattr(current, "model_fields", {}).get(part)
        if info is None:
            return []
        current = info.annotation
        for argument in getattr(current, "__args__", ()):
            if isinstance(argument, type) and issubclass(argument, pydantic.BaseModel):
                current = argument
    return sorted(getattr(current, "model_fields", {}))
