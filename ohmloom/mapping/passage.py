"""From one state of a device to another: how long a drive takes, what it costs, and how many pulses that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from ohmloom.devices import LAWS, Device
from ohmloom.mapping.hardware import Hardware
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


def pulse_duration(device: Device, hardware: Hardware) -> float | None:
    """Length of a programming pulse [s]; None where it depends on the state (charge-metered, exact width).

    Where the spec of a fixed voltage names none, it is what moves a device up by one event at W = 0.5.
    """
    drive = hardware.drive
    if drive.pulse_duration is not None:
        return drive.pulse_duration.value
    if drive.mode != "voltage":
        return None
    middle = float(device.state_at_weight(INITIAL_WEIGHT))
    return passage(device, middle, min(middle + 1.0 / MEM_LIFETIME, 1.0), hardware).duration


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """What one programming pulse does: the state after it, its length [s], and the energy in the device [J]."""

    state: float
    duration: float
    energy: float


def pulse(device: Device, state: float, sign: int, hardware: Hardware, share: float = 1.0) -> Pulse:
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
    """
    fixed = pulse_duration(device, hardware)
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
    h = duration / STAGES
    for _ in range(STAGES):
        middle = min(max(after + 0.5 * h * float(_rate(device, after, volts)), 0.0), 1.0)
        after = min(max(after + h * float(_rate(device, middle, volts)), 0.0), 1.0)
        energy += h * volts**2 * float(device.conductance(middle, volts))
    return Pulse(state=after, duration=duration, energy=energy)


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


def _rate(device: Device, s: float, v: float) -> Any:
    i = device.conductance(s, v) * v
    return LAWS[device.law].charge_rate(s, v, i, device._p) / device.charge_scale
