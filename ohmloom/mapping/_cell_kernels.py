"""One event at one cell: the closed forms of ideal laws, and integration for all others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ohmloom._jit import choose_by_type, inlined_kernel, inner_kernel
from ohmloom._philox_kernels import normal
from ohmloom.devices._event_kernels import CHARGE, FLUX, MEM_LIFETIME, event_state, read_weight
from ohmloom.devices._kernels import (
    conductance,
    current_pulse,
    flux,
    ideal_conductance,
    metered_pulse,
    voltage_pulse,
)
from ohmloom.mapping._fabric import (
    CHARGE_METERED,
    CURRENT,
    EXACT_WIDTH,
    VOLTAGE,
    AnyPulses,
    ClosedPulses,
)

INTEGRATED = 2  # beside CHARGE and FLUX: a law without a closed form, or one that is checked against it
NEWTON_ROUNDS = 60
SMOOTH = 0.05  # relative change of G in an event up to which Simpson's rule errs by less than 1e-6
SIXTH = 1.0 / 6.0
STILL = 1e-16  # a change of s that is none


def law_conductance(pulses: Any, law: int, s: float, p: Any) -> float:
    """Low-field G(s) of a fabric's laws [S]."""
    return _CONDUCTANCES[type(pulses)](pulses, law, s, p)


def _conductance_of_ideal(pulses: Any, law: int, s: float, p: Any) -> float:
    return ideal_conductance(law, s, p)


def _conductance_of_any(pulses: Any, law: int, s: float, p: Any) -> float:
    return conductance(law, s, 0.0, p)


_CONDUCTANCES: dict[type, Callable[..., float]] = {
    ClosedPulses: _conductance_of_ideal,
    AnyPulses: _conductance_of_any,
}
choose_by_type(law_conductance, _CONDUCTANCES)


@inlined_kernel
def show(cell: Any, now: Any, tile: Any, g: float) -> None:
    """What a cell of this conductance looks like to a read."""
    now["g"], now["load"] = g, g + tile["reference"]
    now["weight"] = cell["polarity"] * tile["gain"] * read_weight(g, tile["reference"], tile["g_on"])


@inlined_kernel
def refresh(pulses: Any, cell: Any, now: Any, tile: Any) -> None:
    """Conductance and weight of a live cell from its state."""
    show(cell, now, tile, law_conductance(pulses, tile["law"], now["s"], tile["parameters"]))


@inner_kernel
def place_at(pulses: Any, cell: Any, now: Any, tile: Any, state: float) -> None:
    """Put a live cell into a state that no count of events reaches."""
    now["s"] = min(max(state, 0.0), 1.0)
    now["count"] = 0.0
    now["origin"] = flux(tile["law"], now["s"], tile["parameters"]) if tile["family"] == FLUX else now["s"]
    refresh(pulses, cell, now, tile)


@inlined_kernel
def event_size(cell: Any, now: Any, constants: Any, sign: int) -> float:
    """Size of the next event of a cell, 1 nominally."""
    size: float = cell["factor"] * (1.0 + sign * constants["asymmetry"])
    if constants["cycle_to_cycle"] > 0.0:
        noise = normal(constants["cycle_key"], cell["number"], now["pulses"])
        size *= max(1.0 + constants["cycle_to_cycle"] * noise, 0.0)
    return size


@inlined_kernel
def count_events(now: Any, tile: Any, events: float) -> None:
    """Move a cell by a number of events in its tile's coordinate."""
    family = CHARGE if tile["family"] == INTEGRATED else tile["family"]
    now["s"], now["origin"], now["count"] = event_state(
        tile["law"], family, now["origin"], now["count"] + events, tile["event_flux"], tile["parameters"],
        tile["bottom"], tile["top"],
    )  # fmt: skip


@inlined_kernel
def _count_charge(now: Any, tile: Any, events: float) -> None:
    """The same where the coordinate is a charge: no flux is compiled for it."""
    now["s"], now["origin"], now["count"] = event_state(
        tile["law"], CHARGE, now["origin"], now["count"] + events, 0.0, tile["parameters"], 0.0, 1.0
    )


@inner_kernel
def state_behind(law: int, p: Any, q_d: float, s: float, series: float, phi: float) -> float:
    """State after a flux `phi` over a cell and a resistance in series: phi(s') - phi(s) + R q_d (s' - s) = phi."""
    start = flux(law, s, p)
    low, high = (s, 1.0) if phi > 0.0 else (0.0, s)
    end = high if phi > 0.0 else low
    if abs(flux(law, end, p) - start + series * q_d * (end - s)) <= abs(phi):
        return end
    x = s
    for _ in range(NEWTON_ROUNDS):
        miss = flux(law, x, p) - start + series * q_d * (x - s) - phi
        if miss > 0.0:
            high = x
        else:
            low = x
        after = x - miss / (q_d / ideal_conductance(law, x, p) + series * q_d)
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - x) <= STILL:
            return after
        x = after
    return x


@inlined_kernel
def closed_pulse(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """One pulse on a selected cell of an ideal law, and what it leaves; (duration in s, charge in C, energy in J),
    sizes."""
    p, series = tile["parameters"], cell["series"]
    law, q_d, mode = tile["law"], tile["charge_scale"], constants["mode"]
    before, voltage = now["s"], strength * constants["pulse_voltage"]
    size = event_size(cell, now, constants, sign) * width
    if mode == EXACT_WIDTH:
        return exact_width(pulses, cell, now, tile, sign, size, voltage)
    if mode == VOLTAGE:
        start, applied = flux(law, before, p), size * strength * tile["event_flux"]
        if series == 0.0:
            count_events(now, tile, sign * size * strength)
        else:
            place_at(pulses, cell, now, tile, state_behind(law, p, q_d, before, series, sign * applied))
        charge = abs(now["s"] - before) * q_d
        g = ideal_conductance(law, now["s"], p)
        rest = applied - abs(flux(law, now["s"], p) - start) - series * charge
        if rest > 0.0 and (now["s"] == 0.0 or now["s"] == 1.0):
            # The state stands at its wall, and the current goes on.
            charge += rest * g / (1.0 + series * g)
        show(cell, now, tile, g)
        return tile["duration"] * width, charge, voltage * charge
    charge = size * tile["event_charge"]
    _count_charge(now, tile, sign * size)
    after, g_before = now["s"], now["g"]
    inside = abs(after - before) * q_d
    g = ideal_conductance(law, after, p)
    # Flux: the integral of M over the charge; by Simpson's rule, which is faster, where M hardly changes.
    if abs(g - g_before) > SMOOTH * g:
        passed = abs(flux(law, after, p) - flux(law, before, p))
    else:
        middle = ideal_conductance(law, 0.5 * (before + after), p)
        # 1/G at the start, four times in the middle, at the end: over one denominator.
        edges = g_before * g
        passed = ((g_before + g) * middle + 4.0 * edges) / (edges * middle) * SIXTH * inside
    show(cell, now, tile, g)
    passed += series * charge
    if after == 0.0 or after == 1.0:
        # The state stands at its wall, and the current goes on.
        passed += max(charge - inside, 0.0) / g
    if mode == CURRENT:
        duration = tile["duration"] * width
        return duration, charge, passed * charge / duration
    duration = passed / voltage
    if constants["metering_delay"] > 0.0:
        more = constants["metering_delay"] * duration * voltage * g / (1.0 + series * g)
        _count_charge(now, tile, sign * more / tile["event_charge"])
        refresh(pulses, cell, now, tile)
        charge += more
        duration *= 1.0 + constants["metering_delay"]
    return duration, charge, voltage * charge


@inner_kernel
def exact_width(
    pulses: Any, cell: Any, now: Any, tile: Any, sign: int, size: float, voltage: float
) -> tuple[float, float, float]:
    """The driver applies the flux that takes the state it believes in to the next; the cell takes that flux."""
    p, series, before = tile["parameters"], cell["series"], now["s"]
    law, q_d = tile["law"], tile["charge_scale"]
    knows = now["belief_origin"] == now["origin"] and now["belief_count"] == now["count"] and size == 1.0
    taken, wanted = believe(now, tile, sign)
    applied = abs(flux(law, wanted, p) - flux(law, taken, p)) + series * q_d * abs(wanted - taken)
    if knows:
        now["s"], now["origin"], now["count"] = wanted, now["belief_origin"], now["belief_count"]
    else:
        place_at(pulses, cell, now, tile, state_behind(law, p, q_d, before, series, sign * size * applied))
    refresh(pulses, cell, now, tile)
    charge = abs(now["s"] - before) * q_d
    return applied / voltage, charge, voltage * charge


@inner_kernel
def believe(now: Any, tile: Any, sign: int) -> tuple[float, float]:
    """States that an exact-width driver takes for true before and after an event; the latter becomes its belief."""
    law, p = tile["law"], tile["parameters"]
    taken, _, _ = event_state(law, CHARGE, now["belief_origin"], now["belief_count"], 0.0, p, 0.0, 1.0)
    wanted, now["belief_origin"], now["belief_count"] = event_state(
        law, CHARGE, now["belief_origin"], now["belief_count"] + sign, 0.0, p, 0.0, 1.0
    )
    return taken, wanted


@inner_kernel
def integrated_pulse(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """The same by integrating the law's own state equation, for any law; wires enter by the voltage they leave at
    first."""
    p, before = tile["parameters"], now["s"]
    law, q_d, mode = tile["law"], tile["charge_scale"], constants["mode"]
    size = event_size(cell, now, constants, sign) * width
    left = strength * constants["pulse_voltage"] / (1.0 + cell["series"] * now["g"])
    if mode == CHARGE_METERED:
        charge = size * q_d / MEM_LIFETIME
        after, duration, _ = metered_pulse(law, before, p, q_d, sign * left, sign * charge)
        if constants["metering_delay"] > 0.0:
            more = constants["metering_delay"] * duration
            after, extra = voltage_pulse(law, after, p, q_d, sign * left, more)
            charge += abs(extra)
            duration += more
        energy = left * charge
    elif mode == CURRENT:
        charge, duration = size * q_d / MEM_LIFETIME, tile["duration"] * width
        after, energy, _ = current_pulse(law, before, p, q_d, sign * charge / duration, duration)
    else:
        duration = tile["duration"] * size
        if mode == EXACT_WIDTH:
            taken, wanted = believe(now, tile, sign)
            duration = abs(flux(law, wanted, p) - flux(law, taken, p)) / left * size
        after, charge = voltage_pulse(law, before, p, q_d, sign * left, duration)
        charge = abs(charge)
        energy = left * charge
        if mode == VOLTAGE:
            duration = tile["duration"] * width
    now["s"] = min(max(after, 0.0), 1.0)
    now["origin"], now["count"] = now["s"], 0.0
    refresh(pulses, cell, now, tile)
    return duration, charge, energy


def write_pulse(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """The pulse of a fabric in which all laws have closed forms, or of any."""
    return _PULSES[type(pulses)](pulses, cell, now, tile, constants, sign, strength, width)


def _write_closed(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    return closed_pulse(pulses, cell, now, tile, constants, sign, strength, width)


def _write_any(
    pulses: Any, cell: Any, now: Any, tile: Any, constants: Any, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    if tile["family"] == INTEGRATED:
        return integrated_pulse(pulses, cell, now, tile, constants, sign, strength, width)
    return closed_pulse(pulses, cell, now, tile, constants, sign, strength, width)


_PULSES: dict[type, Callable[..., tuple[float, float, float]]] = {ClosedPulses: _write_closed, AnyPulses: _write_any}
choose_by_type(write_pulse, _PULSES)


def move(pulses: Any, now: Any, tile: Any, constants: Any, v: float, size: float) -> float:
    """Hold `v` [V] over a cell for `size` pulses; the charge that passes [C]."""
    return _MOVES[type(pulses)](pulses, now, tile, constants, v, size)


@inner_kernel
def move_closed(now: Any, tile: Any, constants: Any, v: float, size: float) -> float:
    """In the flux family."""
    before = ideal_conductance(tile["law"], now["s"], tile["parameters"])
    count_events(now, tile, v / constants["pulse_voltage"] * size)
    after = ideal_conductance(tile["law"], now["s"], tile["parameters"])
    charge: float = 0.5 * (before + after) * abs(v) * tile["duration"] * abs(size)
    return charge


def _move_closed(pulses: Any, now: Any, tile: Any, constants: Any, v: float, size: float) -> float:
    return move_closed(now, tile, constants, v, size)


def _move_any(pulses: Any, now: Any, tile: Any, constants: Any, v: float, size: float) -> float:
    if tile["family"] != INTEGRATED:
        return move_closed(now, tile, constants, v, size)
    after, charge = voltage_pulse(
        tile["law"], now["s"], tile["parameters"], tile["charge_scale"], v, tile["duration"] * size
    )
    now["s"] = min(max(after, 0.0), 1.0)
    now["origin"], now["count"] = now["s"], 0.0
    return abs(charge)


_MOVES: dict[type, Callable[..., float]] = {ClosedPulses: _move_closed, AnyPulses: _move_any}
choose_by_type(move, _MOVES)
