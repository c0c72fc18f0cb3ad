"""The hardware spec: one TOML file with a source for every value."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, model_validator

from ohmloom._files import StrictModel, check_format, parse_toml, read_bytes, sha256, validate
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, UnknownNameError
from ohmloom.mapping.nonidealities import EFFECTS, NonIdealitySpec, check_shown
from ohmloom.mapping.quantity import Quantity
from ohmloom.mapping.spec import (
    ArraySpec,
    ConverterSpec,
    DriveSpec,
    EnduranceSpec,
    EnvironmentSpec,
    LimitSpec,
    NeuronSpec,
    PeripherySpec,
    ReadSpec,
    WireSpec,
)
from ohmloom.neurocontroller import KINDS

FORMAT, VERSION = "ohmloom.hardware", 1


@cache
def _shipped_card(name: str) -> Device:
    return Device.load(name)


@cache
def _shipped_cards() -> frozenset[str]:
    return frozenset(Device.names())


def _known_kinds(cards: dict[str, str]) -> dict[str, str]:
    unknown = [kind for kind in cards if kind not in KINDS]
    if unknown:
        raise ValueError(f"only {', '.join(KINDS)} as keys, not {unknown[0]!r}")
    return cards


class _HardwareFile(StrictModel):
    name: str = Field(min_length=1)
    description: str
    cards: Annotated[dict[str, str], AfterValidator(_known_kinds)] = Field(min_length=1)
    array: ArraySpec
    wires: WireSpec
    drive: DriveSpec
    read: ReadSpec
    neuron: NeuronSpec
    nonidealities: NonIdealitySpec = NonIdealitySpec()
    endurance: EnduranceSpec
    converter: ConverterSpec | None = None
    periphery: PeripherySpec | None = None
    environment: EnvironmentSpec | None = None
    limits: LimitSpec = LimitSpec()

    @model_validator(mode="after")
    def _check(self) -> Self:
        drive, array = self.drive, self.array
        if max(self.read.voltage.extremes) >= drive.threshold.value:
            highest, threshold = max(self.read.voltage.extremes), drive.threshold.value
            raise ValueError(f"read.voltage: expected less than drive.threshold = {threshold:g} V over its range, "
                             f"got {highest:g} V. A read must not write; lower it.")  # fmt: skip
        if array.access == "passive":
            if drive.mode != "voltage":
                raise ValueError(f"drive.mode: expected 'voltage' on a passive array, got {drive.mode!r}. Current "
                                 "and meters "
                                 "need one selected cell: through sneak paths most of the charge goes elsewhere. "
                                 "Use array.access = '1T1R'.")  # fmt: skip
            if drive.parallelism != "array":
                raise ValueError(f"drive.parallelism: expected 'array' on a passive array, got {drive.parallelism!r}. "
                                 "Without transistors all lines are driven at once.")  # fmt: skip
        if drive.mode == "current" and drive.parallelism == "array" and not self.wires.is_ideal:
            raise ValueError("drive.parallelism: expected 'cell' or 'column' for current pulses through wires, got "
                             "'array'. "
                             "Cells that share a line cannot each have their own current.")  # fmt: skip
        environment = self.environment
        if environment is not None:
            if environment.retention_activation is not None and self.nonidealities.retention is None:
                raise ValueError("environment.retention_activation: expected nonidealities.retention beside it, got "
                                 "none. "
                                 "Add it.")  # fmt: skip
            if environment.drift_activation is not None and drive.mode not in ("voltage", "exact_width"):
                raise ValueError("environment.drift_activation: expected drive.mode 'voltage' or 'exact_width' "
                                 "beside it, got "
                                 f"{drive.mode!r}: where the charge is given, drift changes nothing. Leave it "
                                 "out.")  # fmt: skip
        check_shown(self)
        return self


class Hardware(_HardwareFile):
    """A hardware spec, read by `Hardware.load` from a shipped name or a path.

    Examples
    --------
    >>> Hardware.load("hp_1t1r").cards
    {'hp': 'hp_tio2_10k', 'constant': 'constant'}
    """

    @classmethod
    def names(cls) -> list[str]:
        """The shipped specs."""
        folder = resources.files("ohmloom.mapping") / "specs"
        return sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml"))

    @classmethod
    def load(cls, name: Path | str) -> Hardware:
        """Read a shipped spec by name, or a TOML file by path.

        Raises
        ------
        UnknownNameError
            If it is neither.
        MissingFileError, FileFormatError
            If the file cannot be read, or breaks a rule; names every field that does.
        """
        text = str(name)
        if text in cls.names():
            data = (resources.files("ohmloom.mapping") / "specs" / f"{text}.toml").read_bytes()
            return cls.from_toml(data, f"{text}.toml")
        if not text.endswith(".toml") and not os.path.exists(text):
            raise UnknownNameError.of("--hardware", text, cls.names())
        return cls.from_toml(read_bytes(text, "hardware spec"), text)

    @classmethod
    def from_toml(cls, data: bytes, where: str) -> Hardware:
        """Parse the text of a spec; `where` names it in errors. Relative card paths start at its folder."""
        table = check_format(parse_toml(data, where), where, FORMAT, VERSION)
        return cls._from_table(table, where)

    @classmethod
    def _from_table(cls, table: dict[str, Any], where: str) -> Hardware:
        hardware = validate(cls, table, where)
        folder = Path(where).parent
        for kind, card in hardware.cards.items():
            beside = folder / card
            if card.endswith(".toml") and beside.exists():
                hardware.cards[kind] = str(beside)
        for kind, device in hardware.devices.items():
            if kind != "constant" and device.law == "linear" and kind != "linear":
                raise FileFormatError(f"{where}: cards.{kind}: expected a memristive card, got {device.name!r} of the "
                                      "law 'linear'. Use an hp or peo_pani card.")  # fmt: skip
        return hardware

    @property
    def devices(self) -> dict[str, Device]:
        """Device card of each kind that this hardware can build, in the order of the kinds."""
        shipped = _shipped_cards()
        return {
            kind: _shipped_card(card) if card in shipped else Device.load(card)
            for kind in KINDS
            if (card := self.cards.get(kind)) is not None
        }

    def with_values(self, values: Mapping[str, float]) -> Hardware:
        """The same spec with other values, by dotted names such as ``wires.r_row``; for studies that vary it.

        What a file of these values would be refused for is not checked again. Bits are rounded.

        >>> Hardware.load("hp_1t1r").with_values({"wires.r_row": 2.0}).wires.r_row.value
        2.0
        """
        changed: dict[str, dict[str, Quantity]] = {}
        for name, value in values.items():
            section, key = name.split(".", 1)
            now = float(round(value)) if UNITS[name] == "bit" else value
            changed.setdefault(section, {})[key] = Quantity(value=now, source="varied by a study")
        return self.model_copy(
            update={section: getattr(self, section).model_copy(update=keys) for section, keys in changed.items()}
        )

    @property
    def sha256(self) -> str:
        """Digest of the spec and of its device cards."""
        parts = [self.model_dump_json(exclude={"description"})]
        parts += [f"{kind} {device.sha256}" for kind, device in self.devices.items()]
        return sha256("\n".join(parts).encode())

    def quantities(self) -> dict[str, Quantity]:
        """All quantities by dotted name, for reports and for what is assumed."""
        found: dict[str, Quantity] = {}
        for section in type(self).model_fields:
            table = getattr(self, section)
            if isinstance(table, StrictModel):
                for name in type(table).model_fields:
                    value = getattr(table, name)
                    if isinstance(value, Quantity):
                        found[f"{section}.{name}"] = value
        return found

    def assumptions(self) -> list[str]:
        """What nobody but the spec's author stands behind, a line each."""
        from ohmloom.units import format_quantity

        return [
            f"{name} = {format_quantity(q.value, UNITS[name])}, {q.source.removeprefix('assumed').lstrip(': ')}"
            for name, q in self.quantities().items()
            if q.is_assumed
        ]

    def _repr_html_(self) -> str:
        from html import escape

        rows = "".join(
            f"<tr><th>{name}</th><td>{q.value:g}</td><td>{escape(q.source)}</td></tr>"
            for name, q in self.quantities().items()
        )
        return f"<table><caption>{escape(self.name)}</caption>{rows}</table>"


UNITS = {
    "array.unformed_conductance": "S", "wires.r_row": "Ohm", "wires.r_column": "Ohm", "wires.r_driver": "Ohm",
    "wires.r_sense": "Ohm", "wires.c_segment": "F", "drive.pulse_voltage": "V", "drive.threshold": "V",
    "drive.pulse_duration": "s", "drive.edge": "s", "drive.slot": "s", "drive.compliance_current": "A",
    "drive.compliance_voltage": "V", "read.voltage": "V", "read.duration": "s", "neuron.energy_per_spike": "J",
    "neuron.area": "m2", "converter.bits": "bit", "converter.energy": "J", "converter.duration": "s",
    "converter.area": "m2", "periphery.feature": "m", "periphery.cell_area": "F2", "periphery.driver_area": "m2",
    "periphery.driver_energy": "J", "periphery.sense_area": "m2", "periphery.sense_energy": "J",
    "periphery.meter_area": "m2", "periphery.meter_energy": "J", "periphery.register_area": "m2",
    "periphery.register_energy": "J", "environment.temperature": "K", "environment.card_temperature": "K",
    "environment.retention_activation": "eV", "environment.drift_activation": "eV", "endurance.pulses": "1",
    "limits.read_error": "1", "limits.wake_up": "1", "limits.programming_power": "W",
    "limits.useful_event_range": "events", "limits.endurance": "trials", "limits.yield_": "1",
    **{f"nonidealities.{effect.name}": effect.unit for effect in EFFECTS.values()},
}  # fmt: skip
