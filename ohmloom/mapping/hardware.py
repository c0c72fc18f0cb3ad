"""The hardware spec: one TOML file with a source for every value."""

from __future__ import annotations

import os
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ohmloom._files import StrictModel, check_format, parse_toml, read_bytes, sha256, validate
from ohmloom.devices import Device
from ohmloom.errors import FileFormatError, UnknownNameError
from ohmloom.mapping.quantity import NotNegative, Positive, Quantity, Zero
from ohmloom.mapping.waveform import WAVEFORMS, check_rule
from ohmloom.neurocontroller import KINDS, Readings

FORMAT, VERSION = "ohmloom.hardware", 1


class ArraySpec(StrictModel):
    """The array: how a crosspoint is selected, how large a tile may be, what an unused crosspoint is."""

    access: Literal["1T1R"]
    disabled: Literal["unformed", "masked"]
    max_rows: int = Field(ge=1)
    max_columns: int = Field(ge=1)
    source: str = Field(min_length=1)


class WireSpec(StrictModel):
    """Resistance per segment [ohm]; this version emulates wires without resistance and refuses others."""

    r_row: Zero
    r_column: Zero


class DriveSpec(StrictModel):
    """How an STDP event is written: charge-metered voltage pulses, or current pulses of a fixed width.

    ``parallelism``: one ``cell`` at a time, one cell per ``column`` at a time, or the whole ``array`` (all positive
    events, then all negative ones).
    """

    mode: Literal["charge_metered", "current"]
    waveform: Literal["half", "two_part"]
    parallelism: Literal["cell", "column", "array"]
    source: str = Field(min_length=1)
    pulse_voltage: Positive
    threshold: Positive
    pulse_duration: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.mode == "current") != (self.pulse_duration is not None):
            raise ValueError("pulse_duration with mode = 'current', and only with it")
        if self.mode == "charge_metered" and self.parallelism == "array":
            raise ValueError("parallelism 'cell' or 'column' with mode = 'charge_metered': one meter a column")
        for voltage in self.pulse_voltage.extremes:
            # Unlike the check against a network's own readings, this one holds for the paper's rule.
            check_rule(self.levels_at(voltage), self.threshold.value, Readings())
        return self

    @property
    def levels(self) -> tuple[float, ...]:
        """Voltage of a line for ls = 0, 1, 2, 3 [V]."""
        return self.levels_at(self.pulse_voltage.value)

    def levels_at(self, pulse_voltage: float) -> tuple[float, ...]:
        """The same for another pulse voltage [V]."""
        waveform = WAVEFORMS[self.waveform]
        return tuple(level * pulse_voltage / waveform.event for level in waveform.levels)


class ReadSpec(StrictModel):
    """Row voltage [V] and time [s] of reading one column."""

    voltage: Positive
    duration: Positive


class NeuronSpec(StrictModel):
    """Energy of one spike [J]."""

    energy_per_spike: NotNegative


class SpreadSpec(StrictModel):
    """Standard deviations, each relative.

    write_verify: of the initial conductance, as a fraction of G_on; event_charge: of a device's charge per event;
    threshold: of a device's threshold voltage.
    """

    write_verify: NotNegative
    event_charge: NotNegative
    threshold: NotNegative


class EnduranceSpec(StrictModel):
    """Pulses that a device survives."""

    pulses: Positive


class LimitSpec(StrictModel):
    """Limits of the figures, each with its source; a figure without a limit here is ASSUMED at best."""

    programming_power: Positive | None = None
    useful_event_range: Positive | None = None
    endurance: Positive | None = None


@cache
def _shipped_card(name: str) -> Device:
    return Device.load(name)


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
    spread: SpreadSpec
    endurance: EnduranceSpec
    limits: LimitSpec = LimitSpec()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if max(self.read.voltage.extremes) >= self.drive.threshold.value:
            highest, threshold = max(self.read.voltage.extremes), self.drive.threshold.value
            raise ValueError(f"read.voltage: expected less than drive.threshold = {threshold:g} V over its range, "
                             f"got {highest:g} V. A read must not write; lower it.")  # fmt: skip
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
        shipped = Device.names()
        return {
            kind: _shipped_card(card) if card in shipped else Device.load(card)
            for kind in KINDS
            if (card := self.cards.get(kind)) is not None
        }

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

    def _repr_html_(self) -> str:
        from html import escape

        rows = "".join(
            f"<tr><th>{name}</th><td>{q.value:g}</td><td>{escape(q.source)}</td></tr>"
            for name, q in self.quantities().items()
        )
        return f"<table><caption>{escape(self.name)}</caption>{rows}</table>"


UNITS = {
    "wires.r_row": "Ohm", "wires.r_column": "Ohm", "drive.pulse_voltage": "V", "drive.threshold": "V",
    "drive.pulse_duration": "s", "read.voltage": "V", "read.duration": "s", "neuron.energy_per_spike": "J",
    "spread.write_verify": "1", "spread.event_charge": "1", "spread.threshold": "1", "endurance.pulses": "1",
    "limits.programming_power": "W", "limits.useful_event_range": "events", "limits.endurance": "trials",
}  # fmt: skip
