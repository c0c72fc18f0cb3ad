"""Reads and writes ``*.netlist.json``: elements, waveforms as tables, device cards by name or path, subcircuits."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import pydantic
from pydantic import Field

from ohmloom._files import StrictModel, check_format, parse_json, read_bytes, validate, write_atomic
from ohmloom.circuits.elements import ELEMENTS, Element, Memristor, Subcircuit
from ohmloom.circuits.netlist import Netlist
from ohmloom.circuits.waveforms import WAVEFORMS, Constant, Waveform
from ohmloom.devices import Device
from ohmloom.devices.emit import identifier
from ohmloom.errors import FileFormatError, OhmloomError, OperationError, ParameterError, UnknownNameError, shown

FORMAT, VERSION = "ohmloom.netlist", 1
KINDS = {kind: name for name, kind in ELEMENTS.items()}
SHAPES = {kind: name for name, kind in WAVEFORMS.items()}


def load(path: str | Path) -> Netlist:
    """See `Netlist.load`."""
    where = str(path)
    table = check_format(parse_json(read_bytes(path, "netlist"), where), where, FORMAT, VERSION)
    checked = validate(_File, table, where)
    folder = Path(path).parent
    parts: dict[str, Netlist] = {}
    for name, entry in checked.subcircuits.items():
        parts[name] = _make(
            entry, parts, folder, where, f"subcircuits.{name}", name=name, ports=tuple(entry.ports), t_end=None
        )
    return _make(checked, parts, folder, where, "", name=checked.name, ports=(), t_end=checked.t_end)


def save(netlist: Netlist, path: Path) -> None:
    """See `Netlist.save`; an inner netlist is written once, under its name.

    Raises
    ------
    ParameterError
        If two subcircuits that differ have one name, or the netlist has ports of its own.
    OperationError
        If a file cannot be written, or a card would replace another.
    """
    if netlist.ports:
        raise ParameterError(f"Netlist.save: expected a netlist without ports, got {', '.join(netlist.ports)}. "
                             "Save the netlist whose subcircuit it is.")  # fmt: skip
    cards = _cards(netlist)
    inner: dict[str, Netlist] = {}
    _gather(netlist, inner)
    table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "name": netlist.name}
    if netlist.t_end is not None:
        table["t_end"] = netlist.t_end
    if inner:
        table["subcircuits"] = {
            name: {"ports": list(part.ports), "elements": [_table(element, cards) for element in part.elements]}
            for name, part in inner.items()
        }
    table["elements"] = [_table(element, cards) for element in netlist.elements]
    for device, name in cards.items():
        if name.endswith(".toml"):
            _write_card(device, path.parent / name)
    write_atomic(path, json.dumps(table, indent=1) + "\n")


def _write_card(device: Device, path: Path) -> None:
    if path.exists():
        try:
            is_same = Device.load(path) == device
        except OhmloomError:
            is_same = False
        if is_same:
            return
        raise OperationError(f"{path}: expected no file or the card of {device.name}, got another one. Rename either.")
    device.save(path)


def _cards(netlist: Netlist) -> dict[Device, str]:
    """How the file names each device: by its shipped name, or as a card beside it."""
    shipped, found = Device.names(), {}
    for element in netlist.flat:
        if not isinstance(element, Memristor) or element.device in found:
            continue
        device = element.device
        if device.name in shipped and Device.load(device.name) == device:
            found[device] = device.name
            continue
        base = name = identifier(device.name)
        count = 1
        while f"{name}.toml" in found.values():
            count += 1
            name = f"{base}_{count}"
        found[device] = f"{name}.toml"
    return found


def _gather(netlist: Netlist, inner: dict[str, Netlist]) -> None:
    """Inner netlists by name, each after those that it uses."""
    for element in netlist.elements:
        if not isinstance(element, Subcircuit):
            continue
        part = element.netlist
        if part.name in inner:
            if inner[part.name] != part:
                raise ParameterError(f"Netlist.save: expected another name for each subcircuit, got {part.name} for "
                                     "two that differ. Rename one.")  # fmt: skip
            continue
        _gather(part, inner)
        inner[part.name] = part


def _table(element: Element, cards: Mapping[Device, str]) -> dict[str, Any]:
    table: dict[str, Any] = {"element": KINDS[type(element)]}
    for field in fields(element):
        value = getattr(element, field.name)
        if isinstance(value, Waveform):
            value = value.level if isinstance(value, Constant) else _waveform_table(value)
        elif isinstance(value, Device):
            value = cards[value]
        elif isinstance(value, Netlist):
            table["subcircuit"] = value.name
            continue
        elif isinstance(value, Mapping):
            value = dict(value)
        table[field.name] = value
    return table


def _waveform_table(waveform: Any) -> dict[str, Any]:
    values = {field.name: getattr(waveform, field.name) for field in fields(waveform)}
    return {"waveform": SHAPES[type(waveform)], **{name: value for name, value in values.items() if value is not None}}


def _make(
    entry: _File | _Part, parts: Mapping[str, Netlist], folder: Path, where: str, at: str,
    *, name: str, ports: tuple[str, ...], t_end: float | None,
) -> Netlist:  # fmt: skip
    elements: list[Element] = []
    problems: list[str] = []
    for k, item in enumerate(entry.elements):
        place = f"{where}: {at}{'.' if at else ''}elements[{k}]"
        try:
            elements.append(_element(item, parts, folder, place))
        except FileFormatError as error:
            problems += error.problems
        except ParameterError as error:
            problems += [f"{place}: {problem}" for problem in error.problems]
    if problems:
        raise FileFormatError(*problems)
    try:
        return Netlist(name=name, elements=tuple(elements), ports=ports, t_end=t_end)
    except ParameterError as error:
        raise FileFormatError(*(f"{where}: {problem}" for problem in error.problems)) from error


def _element(item: dict[str, Any], parts: Mapping[str, Netlist], folder: Path, place: str) -> Element:
    kind = _tag(item, "element", ELEMENTS, place)
    checked = validate(_ELEMENT_MODELS[kind], item, place)
    values = {name: getattr(checked, name) for name in type(checked).model_fields if name != "element"}
    for name in ("voltage", "current"):
        if isinstance(values.get(name), dict):
            values[name] = _waveform(values[name], f"{place}.{name}")
    if "device" in values:
        card = values["device"]
        values["device"] = Device.load(card if card in Device.names() else _card_path(folder, card))
    if "subcircuit" in values:
        used = values.pop("subcircuit")
        if used not in parts:
            raise UnknownNameError(f"subcircuit: expected one that stands above, {', '.join(parts) or 'none does'}, "
                                   f"got {used!r}. Define it first.")  # fmt: skip
        values["netlist"] = parts[used]
    return ELEMENTS[kind](**values)


def _tag(item: dict[str, Any], key: str, known: Mapping[str, Any], place: str) -> str:
    name = item.get(key)
    if not isinstance(name, str) or name not in known:
        raise FileFormatError(str(UnknownNameError.of(f"{place}: {key}", shown(name).strip("'"), known)))
    return name


def _card_path(folder: Path, card: str) -> str | Path:
    """A path relative to the netlist; what is no path goes to `Device.load` as a name, for its error."""
    return folder / card if card.endswith(".toml") else card


def _waveform(item: dict[str, Any], place: str) -> Waveform:
    kind = _tag(item, "waveform", WAVEFORMS, place)
    checked = validate(_WAVEFORM_MODELS[kind], item, place)
    values = {name: getattr(checked, name) for name in type(checked).model_fields if name != "waveform"}
    return WAVEFORMS[kind](**{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})


def _model(tag: str, kind: type[Any]) -> type[StrictModel]:
    """The model of a dataclass's fields, beside their `tag`; the dataclass itself checks ranges."""
    made: dict[str, Any] = {tag: (str, ...)}
    for field in fields(kind):
        has_default = isinstance(field.default, float | int | type(None))
        key = "subcircuit" if field.type == "Netlist" else field.name
        made[key] = (_TYPES[str(field.type)], field.default if has_default else ...)
    return pydantic.create_model(f"{kind.__name__}Table", __base__=StrictModel, **made)


_TYPES: dict[str, Any] = {
    "str": str,
    "float": float,
    "float | None": float | None,
    "float | Waveform": Any,  # a number or a table, told apart by hand for the sake of the errors
    "tuple[float, ...]": list[float],
    "Mapping[str, str]": dict[str, str],
    "Device": str,
    "Netlist": str,
}
_WAVEFORM_MODELS = {name: _model("waveform", kind) for name, kind in WAVEFORMS.items()}
_ELEMENT_MODELS = {name: _model("element", kind) for name, kind in ELEMENTS.items()}


class _Part(StrictModel):
    ports: list[str]
    elements: list[dict[str, Any]]


class _File(StrictModel):
    name: str = "netlist"
    t_end: float | None = None
    subcircuits: dict[str, _Part] = Field(default_factory=dict)
    elements: list[dict[str, Any]]
