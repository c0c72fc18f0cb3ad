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
from ohmloom.mapping.nonidealities import EFFECTS, NonIdealitySpec, check_shown
from ohmloom.mapping.quantity import Count, NotNegative, Positive, Quantity
from ohmloom.mapping.waveform import WAVEFORMS, Phase, Waveform, check_rule
from ohmloom.neurocontroller import KINDS, Readings

FORMAT, VERSION = "ohmloom.hardware", 1


class ArraySpec(StrictModel):
    """The array: how a crosspoint is selected, how large a tile may be, what an unused crosspoint is.

    ``access``: a transistor per cell (``1T1R``) or none (``passive``). ``disabled``: what stands where no synapse is:
    never formed (``unformed``, with a rest of ``unformed_conductance`` [S]), behind a closed transistor (``masked``),
    or a device like any other (``present``). ``signs``: the sender's sign is its row's read polarity, or a receiver has
    two bit lines (``column_pair``), or a synapse has two devices (``differential_pair``). ``delays``: columns are read
    one after the other through taps of the rows' shift registers, or neurons run at skewed clocks (``retimed``).
    """

    access: Literal["1T1R", "passive"]
    disabled: Literal["unformed", "masked", "present"]
    max_rows: int = Field(ge=1)
    max_columns: int = Field(ge=1)
    spare_rows: int = Field(default=0, ge=0)
    spare_columns: int = Field(default=0, ge=0)
    signs: Literal["row_polarity", "column_pair", "differential_pair"] = "row_polarity"
    delays: Literal["column_serial", "retimed"] = "column_serial"
    unformed_conductance: NotNegative | None = None
    source: str = Field(min_length=1)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.access == "passive" and self.disabled == "masked":
            raise ValueError(
                "disabled 'unformed' or 'present' with access = 'passive': only a transistor can mask a cell"
            )
        if self.unformed_conductance is not None and self.disabled != "unformed":
            raise ValueError("unformed_conductance with disabled = 'unformed', and only with it")
        return self


class WireSpec(StrictModel):
    """Resistance per segment between two crosspoints, of a driver and of a sense [ohm]; capacitance per segment [F].

    The capacitance delays a read: the largest tile's lines settle with the sum of their Elmore delays. ``node``: the
    technology node that the numbers are of, for readers.
    """

    r_row: NotNegative
    r_column: NotNegative
    r_driver: NotNegative | None = None
    r_sense: NotNegative | None = None
    c_segment: NotNegative | None = None
    node: str | None = None

    @property
    def resistances(self) -> dict[str, float]:
        """By the names of `Crossbar`'s parameters [ohm]."""
        names = ("r_row", "r_column", "r_driver", "r_sense")
        return {name: 0.0 if (q := getattr(self, name)) is None else q.value for name in names}

    @property
    def is_ideal(self) -> bool:
        """Whether nothing drops any voltage."""
        return not any(self.resistances.values())


class PhaseSpec(StrictModel):
    """One phase of a user's waveform: levels for ls = 0, 1, ... on rows and columns, length in pulses."""

    row: tuple[float, ...] = Field(strict=False)
    column: tuple[float, ...] = Field(strict=False)
    duration: float = Field(default=1.0, gt=0.0)


class DriveSpec(StrictModel):
    """How an STDP event is written.

    ``mode``: ``charge_metered`` (a voltage pulse that ends when its charge has passed), ``current`` (a current pulse),
    ``voltage`` (fixed voltage and duration), ``exact_width`` (fixed voltage; the duration that a device of its last
    known state needs). ``waveform``: a name of `WAVEFORMS`, or ``user`` with ``levels`` (the same on rows and
    columns) or ``phases``. ``parallelism``: one ``cell`` at a time, one cell per ``column`` at a time, or the whole
    ``array``. ``pulse_duration`` [s]: for current pulses; for fixed voltages, without it, each kind gets the duration
    that is right at W = 0.5. ``pulse_shape`` with ``edge`` [s]: the time of an edge, or the time constant of an
    RC-limited one; ``slot`` [s]: when the next pulse begins, so that a tail is cut. ``pulse_voltage``: what an event
    puts on a device [V]. ``compliance_current`` [A], ``compliance_voltage`` [V]: what driver and cell stand; a plan
    that exceeds them is refused.
    """

    mode: Literal["charge_metered", "current", "voltage", "exact_width"]
    waveform: Literal["half", "two_part", "two_slot", "pwm", "user"]
    parallelism: Literal["cell", "column", "array"]
    source: str = Field(min_length=1)
    pulse_voltage: Positive
    threshold: Positive
    levels: tuple[float, ...] | None = Field(default=None, strict=False)
    phases: tuple[PhaseSpec, ...] | None = Field(default=None, strict=False)
    pulse_duration: Positive | None = None
    pulse_shape: Literal["rectangular", "trapezoid", "rc"] = "rectangular"
    edge: Positive | None = None
    slot: Positive | None = None
    compliance_current: Positive | None = None
    compliance_voltage: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.mode == "current" and self.pulse_duration is None:
            raise ValueError("pulse_duration with mode = 'current'")
        if self.mode in ("charge_metered", "exact_width"):
            if self.pulse_duration is not None:
                raise ValueError(f"no pulse_duration with mode = {self.mode!r}: a pulse is as long as its charge takes")
            if self.parallelism == "array":
                raise ValueError(f"parallelism 'cell' or 'column' with mode = {self.mode!r}: one pulse width a column")
        if (self.levels is not None) + (self.phases is not None) != (self.waveform == "user"):
            raise ValueError("either levels or phases with waveform = 'user', and only with it")
        if (self.pulse_shape != "rectangular") != (self.edge is not None):
            raise ValueError("edge with pulse_shape = 'trapezoid' or 'rc', and only with these")
        if self.pulse_shape != "rectangular" and self.mode == "charge_metered":
            raise ValueError(
                "pulse_shape 'rectangular' with mode = 'charge_metered': a meter counts the edges' charge too"
            )
        if self.slot is not None and (self.pulse_duration is None or self.pulse_shape == "rectangular"):
            raise ValueError("slot with pulse_duration and a pulse_shape that has edges")
        for voltage in self.pulse_voltage.extremes:
            # Unlike the check against a network's own readings, this one holds for the paper's rule.
            check_rule(self.waveform_at(voltage), self.threshold.value, Readings())
        return self

    @property
    def shape(self) -> Waveform:
        """The waveform in its own unit."""
        if self.levels is not None:
            return Waveform.of_levels(self.levels)
        if self.phases is not None:
            return Waveform(phases=tuple(Phase(row=p.row, column=p.column, duration=p.duration) for p in self.phases))
        return WAVEFORMS[self.waveform]

    @property
    def volts(self) -> Waveform:
        """The waveform in V."""
        return self.waveform_at(self.pulse_voltage.value)

    def waveform_at(self, pulse_voltage: float) -> Waveform:
        """The same for another pulse voltage [V]."""
        shape = self.shape
        return shape.scaled(pulse_voltage / shape.event)


class ReadSpec(StrictModel):
    """Row voltage [V] and time [s] of reading one column."""

    voltage: Positive
    duration: Positive


class NeuronSpec(StrictModel):
    """Energy of one spike [J], area of one neuron [m2]."""

    energy_per_spike: NotNegative
    area: NotNegative | None = None


class ConverterSpec(StrictModel):
    """A converter behind each column: bits, energy [J] and duration [s] of a conversion, area [m2]."""

    bits: Count | None = None
    energy: NotNegative | None = None
    duration: NotNegative | None = None
    area: NotNegative | None = None


class PeripherySpec(StrictModel):
    """What stands around the cells, each optional: what is left out is named as not counted.

    ``feature`` [m] and ``cell_area`` [feature squares]; area [m2] of a row or column driver, of a sense, of a charge
    meter, of one bit of shift register; energy [J] of driving one line for one pulse or read, of one sense for one
    read, of one metered pulse, of shifting one bit.
    """

    feature: Positive | None = None
    cell_area: Positive | None = None
    driver_area: NotNegative | None = None
    driver_energy: NotNegative | None = None
    sense_area: NotNegative | None = None
    sense_energy: NotNegative | None = None
    meter_area: NotNegative | None = None
    meter_energy: NotNegative | None = None
    register_area: NotNegative | None = None
    register_energy: NotNegative | None = None


class EnvironmentSpec(StrictModel):
    """Temperature of the array and of the device cards [K]; activation energies [eV] (Arrhenius).

    ``retention_activation`` scales the time constant of ``nonidealities.retention``; ``drift_activation`` scales what a
    pulse of fixed voltage moves.
    """

    temperature: Positive
    card_temperature: Positive
    retention_activation: NotNegative | None = None
    drift_activation: NotNegative | None = None


class EnduranceSpec(StrictModel):
    """Pulses that a device survives."""

    pulses: Positive


class LimitSpec(StrictModel):
    """Limits of the figures, each with its source; a figure without a limit here is ASSUMED at best."""

    read_error: Positive | None = None
    wake_up: Positive | None = None
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
    "limits.useful_event_range": "events", "limits.endurance": "trials",
    **{f"nonidealities.{effect.name}": effect.unit for effect in EFFECTS.values()},
}  # fmt: skip
