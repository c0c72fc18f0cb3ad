"""Entries of the exact box about one device: what a pulse does to its state, and its weights on the lattice."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices import LAWS, Device
from ohmloom.mapping.pulses import pulse_of
from ohmloom.neurocontroller import LATTICES
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, charge_levels, reads_with_reference
from ohmloom.sim.exact_case import NO_PLASTIC, Case, exact_variant, not_claimed

PULSE_TOLERANCE = 1e-9  # of an event
WIDTH_TOLERANCE = 1e-8  # of an event
LATTICE_TOLERANCE = 1e-12
STATES = (0.0, 1e-4, 0.0097, 0.25, 0.5, 0.75, 0.98, 0.9899, 0.9996, 1.0)


def current_pulse(case: Case) -> bool | str:
    """A current pulse, integrated, moves the charge by one event, to the walls and no further."""
    return _pulses(case, _after_current, PULSE_TOLERANCE)


def voltage_pulse(case: Case) -> bool | str:
    """A pulse of fixed voltage, integrated, ends where the closed form of the flux says."""
    return _pulses(case, _after_voltage, PULSE_TOLERANCE)


def exact_width_pulse(case: Case) -> bool | str:
    """A voltage pulse of width (phi(q + dq) - phi(q))/V, integrated, moves the charge by one event."""
    return _pulses(case, _after_width, WIDTH_TOLERANCE)


def lattice(case: Case) -> bool | str:
    """Weights of the cards are those of the paper's integer lattice."""
    if not case.plastic:
        return NO_PLASTIC
    other = [kind for kind, device in case.plastic.items() if not _is_paper_law(kind, device)]
    if other:
        return f"the cards of {', '.join(other)} have not the paper's law and ratio 100, so their weights are others"
    return all(_lattice_error(kind, device) <= LATTICE_TOLERANCE for kind, device in case.plastic.items())


def _pulses(case: Case, after: Callable[..., tuple[float, float]], tolerance: float) -> bool | str:
    if not case.plastic:
        return NO_PLASTIC
    reason = not_claimed(case)
    if reason is not None:
        return reason
    variant = exact_variant(case.hardware, "voltage")
    for kind, device in case.plastic.items():
        pulse = pulse_of(variant, kind, has_reference=reads_with_reference(kind))
        for s, sign in itertools.product(STATES, (1, -1)):
            got, wanted = after(device, s, sign, pulse.flux, case)
            if abs(got - wanted) > tolerance / MEM_LIFETIME:
                return False
    return True


def _event(s: float, sign: int) -> float:
    return min(max(s + sign / MEM_LIFETIME, 0.0), 1.0)


def _after_current(device: Device, s: float, sign: int, flux: float, case: Case) -> tuple[float, float]:
    duration = 1e-4
    current = sign * (1.0 + case.perturb) * device.charge_scale / MEM_LIFETIME / duration
    return _integrated(device, s, duration, current=current), _event(s, sign)


def _after_voltage(device: Device, s: float, sign: int, flux: float, case: Case) -> tuple[float, float]:
    from ohmloom.devices._event_kernels import FLUX, event_state
    from ohmloom.devices._kernels import LAW_INDEX
    from ohmloom.devices._kernels import flux as flux_of

    law, p = LAW_INDEX[device.law], np.array(list(device.parameters.values()))
    walls = float(flux_of(law, 0.0, p)), float(flux_of(law, 1.0, p))
    wanted, _, _ = event_state(law, FLUX, float(flux_of(law, s, p)), float(sign), flux, p, *walls)
    v = case.hardware.drive.pulse_voltage.value
    return _integrated(device, s, (1.0 + case.perturb) * flux / v, voltage=sign * v), float(wanted)


def _after_width(device: Device, s: float, sign: int, flux: float, case: Case) -> tuple[float, float]:
    from ohmloom.devices._kernels import LAW_INDEX
    from ohmloom.devices._kernels import flux as flux_of

    law, p = LAW_INDEX[device.law], np.array(list(device.parameters.values()))
    wanted, v = _event(s, sign), case.hardware.drive.pulse_voltage.value
    width = abs(float(flux_of(law, wanted, p)) - float(flux_of(law, s, p))) / v
    return _integrated(device, s, (1.0 + case.perturb) * width, voltage=sign * v), wanted


def _integrated(
    device: Device, s: float, duration: float, *, voltage: float | None = None, current: float | None = None
) -> float:
    """State after a pulse, by SciPy on the law's own functions, stopped at the walls."""
    from scipy.integrate import solve_ivp

    if duration == 0.0:
        return s
    law, p = LAWS[device.law], [device.parameters[one.name] for one in LAWS[device.law].parameters]

    def rate(_: float, y: FloatArray) -> list[float]:
        g = float(law.conductance(y[0], 0.0 if voltage is None else voltage, p))
        i = g * voltage if voltage is not None else current
        v = voltage if voltage is not None else float(current or 0.0) / g
        return [float(law.charge_rate(y[0], v, i, p)) * duration / device.charge_scale]

    up = (voltage if voltage is not None else float(current or 0.0)) > 0.0
    if s == (1.0 if up else 0.0):
        return s

    def wall(_: float, y: FloatArray) -> float:
        return float(y[0]) - (1.0 if up else 0.0)

    # SciPy looks for this on the function itself; functions have no such attribute for a type checker.
    wall.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rate, (0.0, 1.0), [s], "DOP853", rtol=1e-12, atol=1e-15, events=wall, first_step=1e-3)
    return float(min(max(found.y[0, -1], 0.0), 1.0))


def _is_paper_law(kind: str, device: Device) -> bool:
    ratio = float(device.conductance(1.0) / device.conductance(0.0))
    laws = {"hp": "hp_linear", "peo_pani": "peo_pani_mirror", "linear": "linear"}
    return device.law == laws[kind] and (reads_with_reference(kind) or abs(ratio - 100.0) < 1e-6)


def _lattice_error(kind: str, device: Device) -> float:
    """Largest difference between a card's weight and the integer lattice's, over all its levels."""
    one = LATTICES[kind]
    levels = charge_levels(one)
    w = np.asarray(device.weight(np.array(levels) / one.top), dtype=np.float64)
    if reads_with_reference(kind):
        w_off, w_on = float(device.weight(0.0)), float(device.weight(1.0))
        w = (w - w_off) / (w_on - w_off)
    return float(np.abs(w - [one.weight(q) for q in levels]).max())
