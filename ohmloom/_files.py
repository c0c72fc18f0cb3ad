"""Files: written whole or not at all, read with errors that name the file, the field and the value."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from ohmloom.errors import FileFormatError, MissingFileError, OperationError

M = TypeVar("M", bound=pydantic.BaseModel)


class StrictModel(pydantic.BaseModel):
    """A table read from a file: strict types, no unknown keys, frozen."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def write_atomic(path: Path | str, data: bytes | str) -> None:
    """Write `data` under a temporary name, flush it to disk, then rename it to `path`.

    Raises
    ------
    OperationError
        If the file cannot be written (no such folder, no permission, disk full); nothing is left behind.
    """
    path = Path(path)
    payload = data.encode() if isinstance(data, str) else data
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
    except OSError as error:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)
        raise OperationError(
            f"{path}: expected a file that can be written, got {error.strerror or error}. Check the folder."
        ) from error


def read_bytes(path: Path | str, what: str) -> bytes:
    """Read a whole file; `what` names it in the error ("network", "hardware spec").

    Raises
    ------
    MissingFileError
        If it does not exist or cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise MissingFileError(
            f"{path}: expected a {what} file, got {error.strerror or error}. Check the path."
        ) from error


def parse_json(data: bytes, where: str) -> Any:
    """Parse JSON; NaN, Infinity and duplicate keys are refused."""

    def refuse(constant: str) -> None:
        raise FileFormatError(f"{where}: expected finite numbers, got {constant}. Replace it with a number.")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        for key in keys:
            if keys.count(key) > 1:
                raise FileFormatError(f"{where}: expected each key once, got {key!r} twice. Remove one.")
        return dict(pairs)

    try:
        return json.loads(data.decode("utf-8"), parse_constant=refuse, object_pairs_hook=unique)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{where}: expected UTF-8 text, got byte {error.start} that is not. "
                              "Save the file as UTF-8.") from error  # fmt: skip
    except RecursionError as error:
        raise FileFormatError(f"{where}: expected a shallow JSON object, got one nested too deeply. "
                              "Check that this is the right file.") from error  # fmt: skip
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{where}: expected JSON, got {error.msg} at line {error.lineno}, column {error.colno}. "
            "The file may be truncated."
        ) from error


def parse_toml(data: bytes, where: str) -> dict[str, Any]:
    """Parse TOML."""
    try:
        return tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{where}: expected TOML, got {error}. The file may be truncated.") from error


def check_format(table: Any, where: str, name: str, version: int) -> dict[str, Any]:
    """Check the two fields that every ohmloom file has, before anything else is read.

    Returns the table without them.
    """
    if not isinstance(table, dict):
        raise FileFormatError(f"{where}: expected an object with the key 'format', got {_short(table)}. "
                              "Check that this is the right file.")  # fmt: skip
    rest = dict(table)
    for key, wanted in (("format", name), ("version", version)):
        value = rest.pop(key, None)
        if value != wanted or type(value) is not type(wanted):
            got = "nothing" if value is None else _short(value)
            advice = "Check that this is the right file." if key == "format" else "This ohmloom reads only that one."
            raise FileFormatError(f"{where}: {key}: expected {wanted!r}, got {got}. {advice}")
    return rest


def validate(model: type[M], table: Any, where: str) -> M:
    """Turn a parsed table into `model`, gathering every problem into one error."""
    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        raise FileFormatError(*(_problem(where, item, model) for item in error.errors(include_url=False))) from error


def sha256(data: bytes) -> str:
    """Hexadecimal digest of `data`."""
    return hashlib.sha256(data).hexdigest()


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _problem(where: str, item: Any, model: type[pydantic.BaseModel]) -> str:
    field = ""
    for part in item["loc"]:
        field += f"[{part}]" if isinstance(part, int) else (f".{part}" if field else str(part))
    head = f"{where}: {field}" if field else where
    if item["type"] == "extra_forbidden":
        import difflib

        known = _fields_at(model, item["loc"][:-1])
        near = difflib.get_close_matches(str(item["loc"][-1]), known, n=1, cutoff=0.5)
        advice = f"Did you mean {near[0]!r}?" if near else "Remove it."
        return f"{head}: expected no such key, got {_short(item['input'])}. {advice}"
    if item["type"] == "missing":
        return f"{head}: expected a value, got nothing. Add it."
    message = item["msg"].removeprefix("Value error, ")
    if item["type"] == "value_error" and ": expected" in message:
        return f"{where}: {message}"
    rule = message.removeprefix("Input should be ")
    return f"{head}: expected {rule}, got {_short(item['input'])}. Correct it."


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
