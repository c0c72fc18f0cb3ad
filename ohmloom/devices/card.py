"""Device cards: TOML files in SI units, every value with its source."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

import pydantic

from ohmloom._files import StrictModel, check_format, parse_toml, read_bytes, validate
from ohmloom.devices.laws import LAWS, Law
from ohmloom.devices.laws._law import problems
from ohmloom.errors import FileFormatError, MissingFileError, UnknownNameError, expect_type

FORMAT = "ohmloom.device"
VERSION = 1


@dataclass(frozen=True, kw_only=True)
class CardValue:
    """One parameter as a card states it: SI value, where it comes from, and the interval if one is known."""

    value: float
    source: str
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class DataFile:
    """A measured file that a card was fitted to: its name and the digest of its bytes."""

    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Card:
    """A checked card; `values` are in the order in which the law declares its parameters."""

    name: str
    law: str
    source: str
    values: tuple[CardValue, ...]
    data: tuple[DataFile, ...] = ()


def shipped_names() -> list[str]:
    """Names of the cards that come with ohmloom, sorted."""
    return sorted(item.name.removesuffix(".toml") for item in _folder().iterdir() if item.name.endswith(".toml"))


def read_card(name_or_path: str | Path) -> Card:
    """Read a shipped card by name, or a card file by path.

    Raises
    ------
    MissingFileError
        If it is neither a shipped name nor a file.
    FileFormatError
        If the file breaks a rule; every problem is named with file, field and value.
    """
    expect_type("Device.load", name_or_path, str, os.PathLike, name="a card's name or path")
    text = str(name_or_path)
    if text in shipped_names():
        return parse_card(_folder().joinpath(f"{text}.toml").read_bytes(), f"{text}.toml")
    path = Path(name_or_path)
    if isinstance(name_or_path, str) and path.name == text and path.suffix != ".toml" and not os.path.exists(path):
        unknown = UnknownNameError.of("Device.load", text, shipped_names())
        raise MissingFileError(f"{unknown} A card file is given by its path, ending in .toml.")
    return parse_card(read_bytes(path, "device card"), str(path))


def parse_card(data: bytes, where: str) -> Card:
    """Check the text of a card; `where` names it in errors."""
    table = check_format(parse_toml(data, where), where, FORMAT, VERSION)
    law_name = table.get("law")
    if isinstance(law_name, str) and law_name not in LAWS:
        raise FileFormatError(str(UnknownNameError.of(f"{where}: law", law_name, LAWS)))
    # A card without a usable law still gets its other fields checked, against any law's.
    law = LAWS[law_name] if isinstance(law_name, str) else next(iter(LAWS.values()))
    checked: Any = validate(_model(law.name), table, where)
    values = tuple(
        CardValue(value=entry.value, source=entry.source, interval=tuple(entry.interval) if entry.interval else None)
        for entry in (getattr(checked.parameters, name) for name in law.parameter_names)
    )
    if found := _value_problems(law, values, where):
        raise FileFormatError(*found)
    files = tuple(DataFile(file=entry.file, sha256=entry.sha256) for entry in checked.data)
    return Card(name=checked.name, law=law.name, source=checked.source, values=values, data=files)


def write_card(card: Card) -> str:
    """The text of a card: the same card always gives the same bytes."""
    lines = [f'format = "{FORMAT}"', f"version = {VERSION}"]
    lines += [f"{key} = {_quoted(getattr(card, key))}" for key in ("name", "law", "source")]
    for name, entry in zip(LAWS[card.law].parameter_names, card.values, strict=True):
        lines += ["", f"[parameters.{name}]", f"value = {entry.value!r}", f"source = {_quoted(entry.source)}"]
        if entry.interval is not None:
            lines.append(f"interval = [{entry.interval[0]!r}, {entry.interval[1]!r}]")
    for used in card.data:
        lines += ["", "[[data]]", f"file = {_quoted(used.file)}", f"sha256 = {_quoted(used.sha256)}"]
    return "\n".join(lines) + "\n"


def _folder() -> Traversable:
    return resources.files("ohmloom.devices") / "cards"


def _quoted(text: str) -> str:
    """A TOML basic string; JSON escapes all that TOML forbids, but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value_problems(law: Law, values: Sequence[CardValue], where: str) -> list[str]:
    found = [
        f"{where}: parameters.{name}.value: {text}" for name, text in problems(law, [entry.value for entry in values])
    ]
    for name, entry in zip(law.parameter_names, values, strict=True):
        if entry.interval is not None and not entry.interval[0] <= entry.value <= entry.interval[1]:
            low, high = entry.interval
            found.append(
                f"{where}: parameters.{name}.interval: expected low <= value <= high with value = "
                f"{entry.value:.15g}, got [{low:.15g}, {high:.15g}]. Correct the interval or the value."
            )
    return found


_Text = Annotated[str, pydantic.Field(min_length=1)]


class _Entry(StrictModel):
    value: float
    source: _Text
    interval: Annotated[list[float], pydantic.Field(min_length=2, max_length=2)] | None = None


class _Data(StrictModel):
    file: _Text
    sha256: Annotated[str, pydantic.Field(pattern="^[0-9a-f]{64}$")]


@cache
def _model(law_name: str) -> type[pydantic.BaseModel]:
    """The card's model for one law, so that parameter names are checked and hinted at like any other key."""
    fields: dict[str, Any] = dict.fromkeys(LAWS[law_name].parameter_names, (_Entry, ...))
    parameters = pydantic.create_model("Parameters", __base__=StrictModel, **fields)
    top: dict[str, Any] = dict.fromkeys(("name", "law", "source"), (_Text, ...))
    return pydantic.create_model("Card", __base__=StrictModel, **top, parameters=(parameters, ...),
                                 data=(list[_Data], []))  # fmt: skip
