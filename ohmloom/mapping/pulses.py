"""The pulse that writes one event: how long, how much flux, and what its edges and its slot leave of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ohmloom.devices.laws import LAWS
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.spec import DriveSpec
from ohmloom.neurocontroller.device_levels import state_of_weight
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, MEM_LIFETIME, PLASTIC_KINDS


@dataclass(frozen=True, kw_only=True)
class PulseOf:
    """One event's pulse on one kind: flux [Wb] and duration [s]; 0 where they vary from event to event."""

    flux: float
    duration: float


def pulse_of(hardware: Hardware, kind: str, *, has_reference: bool) -> PulseOf:
    """The pulse that writes one event on a kind: as the spec says, else right at W = 0.5."""
    drive, device = hardware.drive, hardware.devices[kind]
    if drive.mode in ("charge_metered", "exact_width") or kind not in PLASTIC_KINDS:
        return PulseOf(flux=0.0, duration=0.0)
    if drive.pulse_duration is not None:
        return PulseOf(flux=drive.pulse_voltage.value * drive.pulse_duration.value, duration=drive.pulse_duration.value)
    s, v = state_of_weight(device, INITIAL_WEIGHT, has_reference=has_reference), drive.pulse_voltage.value
    g = float(device.conductance(s, v))
    if LAWS[device.law].flux is not None:
        event = device.charge_scale / MEM_LIFETIME / float(device.conductance(s))
        return PulseOf(flux=event, duration=event / v)
    rate = float(LAWS[device.law].charge_rate(s, v, g * v, list(device.parameters.values())))
    duration = device.charge_scale / MEM_LIFETIME / rate
    return PulseOf(flux=v * duration, duration=duration)


def pulse_area(drive: DriveSpec) -> float:
    """Area of a pulse with its edges inside its slot, as a fraction of the rectangular one's.

    Edges keep the area as long as the pulse is not cut: what the rise lacks, the tail has.
    """
    if drive.slot is None or drive.edge is None or drive.pulse_duration is None:
        return 1.0
    t, edge, slot = drive.pulse_duration.value, drive.edge.value, drive.slot.value
    if drive.pulse_shape == "rc":
        held = edge * (1.0 - math.exp(-min(t, slot) / edge))
        if slot < t:
            return (slot - held) / t
        return 1.0 - held * math.exp(-(slot - t) / edge) / t
    # Rise over one edge from the start, fall over one edge after the duration.
    return (_ramp(slot, edge) - _ramp(slot - t, edge)) / t


def _ramp(t: float, edge: float) -> float:
    """Integral of a ramp from 0 at 0 to 1 at `edge` and on."""
    return 0.0 if t <= 0.0 else 0.5 * t * t / edge if t < edge else t - 0.5 * edge
