"""From one state of a device to another: how long a drive takes, what it costs, and how many pulses that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from ohmloom.devices import LAWS, Device
from ohmloom.mapping.hardware import Hardware
from ohmloom.neurocontroller.device_levels import state_of_weight
from ohmloom.neurocontroller.kinds import INITIAL_WEIGHT, MEM_LIFETIME

STATES: Final = 129  # at which a law is asked whether a voltage moves it that way at all
STAGES: Final = 64  # steps of a pulse of fixed voltage on a law without a flux


@dataclass(frozen=True, kw_only=True)
class Passage:
    """What moving a state takes.

    Attributes
    ----------
    duration
        Time under the drive [s]; infinite if this drive does not get there.
    energy
        In the device [J].
    events
        Distance in STDP events, each a thousandth of the range.
    """

    duration: float
    energy: float
    events: float


def passage(device: Device, start: float, end: float, hardware: Hardware) -> Passage:
    """Drive a device from one state to another by the pulse voltage or the pulse current of the spec.

    ``T = integral of q_d ds / (dq/dt)`` between the states, ``E = integral of v i dt``; for an ideal memristor
    ``T = |phi(s1) - phi(s0)|/V`` and ``E = V |q1 - q0|``.

    Parameters
    ----------
    device
        Card of the device.
    start, end
        States s in [0, 1].
    hardware
        Gives mode, voltage and duration of its pulses.
    """
    drive = hardware.drive
    if drive.mode == "current":
        assert drive.pulse_duration is not None
        current = device.charge_scale / MEM_LIFETIME / drive.pulse_duration.value
        return _passage(device, start, end, None, current)
    return _passage(device, start, end, drive.pulse_voltage.value, None)


def pulse_duration(device: Device, hardware: Hardware, *, has_reference: bool = False) -> float | None:
    """Length of a programming pulse [s]; None where it depends on the state (charge-metered, exact width).

    Where the spec of a fixed voltage names none, it is what one event takes at the rate of W = 0.5; infinite where that
    voltage does not move the device up.

    Parameters
    ----------
    device, hardware
        The device and what drives it.
    has_reference
        Whether the tile subtracts G_off, which says where W = 0.5 is.
    """
    drive = hardware.drive
    if drive.pulse_duration is not None:
        return drive.pulse_duration.value
    return _duration_at_half(device, drive.pulse_voltage.value, has_reference) if drive.mode == "voltage" else None


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """What one programming pulse does: the state after it, its length [s], and the energy in the device [J]."""

    state: float
    duration: float
    energy: float


def pulse(
    device: Device, state: float, sign: int, hardware: Hardware, *, share: float = 1.0, has_reference: bool = False
) -> Pulse:
    """One programming pulse on a device.

    Parameters
    ----------
    device, state
        The device and its state before.
    sign
        1 or -1.
    hardware
        Gives the drive.
    share
        Part of a whole pulse, as in a waveform with phases.
    has_reference
        As for `pulse_duration`.
    """
    fixed = pulse_duration(device, hardware, has_reference=has_reference)
    if hardware.drive.mode != "voltage":
        after = min(max(state + sign * share / MEM_LIFETIME, 0.0), 1.0)
        way = passage(device, state, after, hardware)
        return Pulse(state=after, duration=way.duration if fixed is None else share * fixed, energy=way.energy)
    assert fixed is not None
    volts, duration = sign * hardware.drive.pulse_voltage.value, share * fixed
    after, energy = state, 0.0
    if LAWS[device.law].is_ideal:
        phi = float(device.flux(state)) + volts * duration
        after = float(device.state_at_flux(min(max(phi, 0.0), float(device.flux(1.0)))))
        energy = abs(volts * (after - state)) * device.charge_scale
        return Pulse(state=after, duration=duration, energy=energy)
    law, p, q_d = LAWS[device.law], device._p, device.charge_scale

    def slopes(s: float) -> tuple[float, float]:
        """ds/dt and power: plain numbers, since a schedule asks for thousands."""
        s = min(max(s, 0.0), 1.0)
        i = float(law.conductance(s, volts, p)) * volts
        return float(law.charge_rate(s, volts, i, p)) / q_d, volts * i

    h = duration / STAGES
    for _ in range(STAGES):
        middle = after + 0.5 * h * slopes(after)[0]
        rate, power = slopes(middle)
        after = min(max(after + h * rate, 0.0), 1.0)
        energy += h * power
    return Pulse(state=after, duration=duration, energy=energy)


@lru_cache(maxsize=64)
def _duration_at_half(device: Device, volts: float, has_reference: bool) -> float:
    s, law = state_of_weight(device, INITIAL_WEIGHT, has_reference=has_reference), LAWS[device.law]
    i = float(device.conductance(s, volts)) * volts
    rate = float(law.charge_rate(s, volts, i, device._p))
    return device.charge_scale / MEM_LIFETIME / rate if rate > 0.0 else math.inf


@lru_cache(maxsize=4096)
def _passage(device: Device, start: float, end: float, volts: float | None, current: float | None) -> Passage:
    events = abs(end - start) * MEM_LIFETIME
    if start == end:
        return Passage(duration=0.0, energy=0.0, events=0.0)
    sign = 1.0 if end > start else -1.0
    charge = abs(end - start) * device.charge_scale
    if LAWS[device.law].is_ideal:
        flux = abs(float(device.flux(end)) - float(device.flux(start)))
        if volts is None:
            assert current is not None
            return Passage(duration=charge / current, energy=current * flux, events=events)
        return Passage(duration=flux / volts, energy=volts * charge, events=events)
    return _integrated(device, (start, end), sign * volts if volts else None, sign * current if current else None)


def _integrated(device: Device, ends: tuple[float, float], volts: float | None, current: float | None) -> Passage:
    from scipy.integrate import quad

    start, end = ends

    def port(s: Any) -> tuple[Any, Any]:
        if volts is not None:
            return volts, device.conductance(s, volts) * volts
        assert current is not None
        return current / device.conductance(s), current

    def rate(s: Any) -> Any:
        v, i = port(s)
        return LAWS[device.law].charge_rate(s, v, i, device._p) / device.charge_scale

    events = abs(end - start) * MEM_LIFETIME
    rates = [float(rate(s)) for s in np.linspace(start, end, STATES)]
    if min((end - start) * r for r in rates) <= 0.0:
        return Passage(duration=math.inf, energy=math.inf, events=events)
    duration = quad(lambda s: 1.0 / float(rate(s)), start, end, limit=200)[0]
    energy = quad(lambda s: float(port(s)[0] * port(s)[1]) / float(rate(s)), start, end, limit=200)[0]
    return Passage(duration=float(duration), energy=float(energy), events=events)
