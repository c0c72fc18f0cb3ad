"""The parts of a hardware spec: array, wires, drive, read, neurons, converters, periphery, environment, limits."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from ohmloom._files import StrictModel
from ohmloom.mapping.quantity import Count, NotNegative, Positive
from ohmloom.mapping.waveform import WAVEFORMS, Phase, Waveform, check_rule
from ohmloom.neurocontroller import Readings


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
    yield_: Positive | None = None
