"""A device as C, as a SPICE subcircuit, or as a Verilog-A module, out of the one definition of its law."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from importlib.metadata import version
from typing import TYPE_CHECKING

from ohmloom.devices._emit_c import emit_c
from ohmloom.devices._emit_spice import emit_spice
from ohmloom.devices._emit_verilog_a import emit_verilog_a
from ohmloom.devices._reserved import RESERVED
from ohmloom.devices._symbolic import WIDTH
from ohmloom.devices.laws import LAWS, Law
from ohmloom.errors import ParameterError, UnknownNameError, expect_type

if TYPE_CHECKING:
    from ohmloom.devices.device import Device

DIALECTS: dict[str, Callable[[str, list[str], Law, tuple[float, ...]], str]] = {
    "c": emit_c,
    "spice": emit_spice,
    "verilog-a": emit_verilog_a,
}


def emit(device: Device, to: str) -> str:
    """`device` in the language `to`, a key of `DIALECTS`; see `Device.emit`."""
    expect_type("Device.emit", to, str, name="a name of a language")
    if to not in DIALECTS:
        raise UnknownNameError.of("Device.emit", to, DIALECTS)
    law = LAWS[device.law]
    check_names(law)
    return DIALECTS[to](identifier(device.name), _header(device, law), law, tuple(device.parameters.values()))


def check_names(law: Law) -> None:
    """Refuse a parameter whose name means something else in emitted text, or to a simulator that reads it.

    Raises
    ------
    ParameterError
        If a name is a port, a state or a temporary of the emitted model, a keyword or function of C, SPICE or
        Verilog-A, no identifier, or equal to another but for the case of its letters.
    """
    found = []
    lowered = [name.lower() for name in law.parameter_names]
    for name in law.parameter_names:
        rule = ""
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
            rule = "letters, digits and _, a letter first"
        elif name.lower() in RESERVED or re.fullmatch(r"t\d+", name.lower()):
            rule = "a name that is free in C, SPICE and Verilog-A, and not one of the emitted model's own"
        elif lowered.count(name.lower()) > 1:
            rule = "names that differ by more than the case of letters, which SPICE ignores"
        if rule:
            found.append(f"{law.name}.{name}: expected {rule}, got {name!r}. Rename the parameter.")
    if found:
        raise ParameterError(*found)


def identifier(name: str) -> str:
    """A card's name as an identifier of all three languages.

    >>> identifier("hp_tio2"), identifier("5k, 100 Hz"), identifier("module")
    ('hp_tio2', 'device_5k_100_Hz', 'device_module')
    """
    text = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    is_usable = text[:1].isalpha() and text.lower() not in RESERVED and not re.fullmatch(r"[tT]\d+", text)
    return text if is_usable else f"device_{text}".rstrip("_")


def _header(device: Device, law: Law) -> list[str]:
    """What every language says in its opening comment, wrapped, in characters that no comment can end with."""
    lines = [
        f"{device.name}: {law.name}, {law.doc}",
        f"Card: {device.source}",
        f"Written by ohmloom {version('ohmloom')} from the card with sha256 {device.sha256}",
        "",
        "Current i counts positive into the first terminal, p; v is the voltage of p above the second terminal, n.",
        "State s = q/q_d in [0, 1]; i = G(s, v) v; ds/dt = charge rate/q_d, 0 where it points outward at a wall.",
        "",
        "Parameters, SI:",
    ]
    for parameter in law.parameters:
        value, source = device.parameters[parameter.name], device.sources[parameter.name]
        lines.append(f"  {parameter.name} = {value!r} {parameter.unit}: {parameter.doc}; {source}")
    return [piece for line in lines for piece in _wrap(line)]


def _wrap(line: str) -> list[str]:
    indent = "  " if line.startswith("  ") else ""
    text = " ".join(line.split()).encode("ascii", "replace").decode()
    # Neither the end of a C comment, nor a trigraph, nor a line that goes on.
    text = text.replace("\\", "/").replace("*", "x").replace("??", "?")
    text = "".join(c for c in text if c.isprintable())
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent + "    ") or [""]
