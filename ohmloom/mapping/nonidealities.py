"""What a real array does otherwise: one table, each effect with the moment at which it is sampled.

A new effect is a line here, a draw in `ohmloom.mapping.die`, and a line of the kernel where it acts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pydantic import create_model

from ohmloom._files import StrictModel
from ohmloom.mapping.quantity import Count, Fraction, NotNegative, Positive

if TYPE_CHECKING:
    from ohmloom.mapping.hardware import _HardwareFile

BUILD, PROGRAM, READ, OVER_TIME = "build", "program", "read", "over time"
MOMENTS = (BUILD, PROGRAM, READ, OVER_TIME)


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One non-ideality.

    Attributes
    ----------
    name
        Key under ``[nonidealities]`` of a hardware spec.
    moment
        When it is sampled: ``build``, ``program``, ``read`` or ``over time``.
    stream
        Number of its stream of random numbers; never used twice, so that an effect leaves the draws of others alone.
    unit, meaning
        Of its value.
    rule
        What its value may be.
    refusal
        Why a spec cannot show it, or None: asking for an effect that would do nothing is an error.
    """

    name: str
    moment: str
    stream: int
    unit: str
    meaning: str
    rule: Any
    refusal: Callable[[_HardwareFile], str | None]


def _always(_: _HardwareFile) -> str | None:
    return None


def _has_wires(spec: _HardwareFile) -> str | None:
    return "the wires have no resistance" if spec.wires.is_ideal else None


def _meters(spec: _HardwareFile) -> str | None:
    return None if spec.drive.mode == "charge_metered" else f"drive.mode is {spec.drive.mode!r}, which has no meter"


def _half_selects(spec: _HardwareFile) -> str | None:
    if spec.drive.parallelism != "array":
        return "only selected cells see a programming voltage; half-selects need drive.parallelism = 'array'"
    if spec.drive.mode != "voltage":
        return f"drive.mode is {spec.drive.mode!r}, which puts no voltage on lines; half-selects need 'voltage'"
    return None


def _reads_charge(spec: _HardwareFile) -> str | None:
    return None if spec.converter is None or spec.converter.bits is None else "converter.bits says it already"


_LIST = (
    Effect(name="write_verify", moment=PROGRAM, stream=0, unit="1", rule=NotNegative, refusal=_always,
           meaning="standard deviation of the initial conductance after write-verify, as a fraction of G_on"),
    Effect(name="event_charge", moment=BUILD, stream=1, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from device to device, of the charge (or flux) of one event"),
    Effect(name="threshold", moment=BUILD, stream=2, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from device to device, of the threshold voltage"),
    Effect(name="stuck_on", moment=BUILD, stream=3, unit="1", rule=Fraction, refusal=_always,
           meaning="probability that a cell is stuck at G_on"),
    Effect(name="stuck_off", moment=BUILD, stream=4, unit="1", rule=Fraction, refusal=_always,
           meaning="probability that a cell is stuck at G_off"),
    Effect(name="forming", moment=BUILD, stream=5, unit="1", rule=Fraction, refusal=_always,
           meaning="probability that a cell does not form and hardly conducts"),
    Effect(name="neuron_threshold", moment=BUILD, stream=6, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from neuron to neuron, of y_thresh"),
    Effect(name="neuron_leak", moment=BUILD, stream=7, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from neuron to neuron, of the leak b"),
    Effect(name="neuron_bias", moment=BUILD, stream=8, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from neuron to neuron, of the constant input a"),
    Effect(name="sense_offset", moment=BUILD, stream=9, unit="1", rule=NotNegative, refusal=_always,
           meaning="standard deviation, from column to column, of a sense's offset, in units of one synapse of W = 1"),
    Effect(name="tile_gain", moment=BUILD, stream=10, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from tile to tile, of the gain from current to membrane"),
    Effect(name="wire_resistance", moment=BUILD, stream=11, unit="1", rule=NotNegative, refusal=_has_wires,
           meaning="relative standard deviation, from die to die, of the resistance per wire segment"),
    Effect(name="cycle_to_cycle", moment=PROGRAM, stream=12, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from event to event, of its charge (or flux)"),
    Effect(name="asymmetry", moment=PROGRAM, stream=13, unit="1", rule=Fraction, refusal=_always,
           meaning="events up move 1 + this, events down 1 - this"),
    Effect(name="metering_delay", moment=PROGRAM, stream=14, unit="1", rule=NotNegative, refusal=_meters,
           meaning="delay of the meter's comparator as a fraction of a pulse's duration"),
    Effect(name="read_noise", moment=READ, stream=15, unit="1", rule=NotNegative, refusal=_always,
           meaning="relative standard deviation, from read to read, of each device's current"),
    Effect(name="quantisation", moment=READ, stream=16, unit="bit", rule=Count, refusal=_reads_charge,
           meaning="bits of a converter behind each column, over plus and minus all rows of its tile at W = 1"),
    Effect(name="settling", moment=READ, stream=17, unit="s", rule=Positive, refusal=_always,
           meaning="time constant with which a column's output settles during the read"),
    Effect(name="retention", moment=OVER_TIME, stream=18, unit="s", rule=Positive, refusal=_always,
           meaning="time constant with which the state charge decays"),
    Effect(name="half_select", moment=OVER_TIME, stream=19, unit="1", rule=Fraction, refusal=_half_selects,
           meaning="part of an event that a device moves when it sees a voltage below its threshold"),
    Effect(name="read_disturb", moment=OVER_TIME, stream=20, unit="1", rule=Fraction, refusal=_always,
           meaning="part of an event that a device moves when its row is read"),
)  # fmt: skip
EFFECTS: dict[str, Effect] = {effect.name: effect for effect in _LIST}

_FIELDS: dict[str, Any] = {effect.name: (effect.rule | None, None) for effect in _LIST}
NonIdealitySpec: Any = create_model(
    "NonIdealitySpec",
    __base__=StrictModel,
    __doc__="Values of the effects of `EFFECTS`; one that is left out does not act.",
    **_FIELDS,
)


def check_shown(spec: _HardwareFile) -> None:
    """Refuse effects that the chosen drive, wires or converters cannot show.

    Raises
    ------
    ValueError
        Names the first one, and why.
    """
    for effect in _LIST:
        quantity = getattr(spec.nonidealities, effect.name)
        if quantity is not None and any(x != 0.0 for x in quantity.extremes):
            reason = effect.refusal(spec)
            if reason is not None:
                raise ValueError(f"nonidealities.{effect.name}: expected none, since {reason}, got {quantity.value:g}. "
                                 "Leave it out.")  # fmt: skip
