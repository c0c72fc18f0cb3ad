"""One event at one cell: the closed forms of ideal laws, and integration for all others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ohmloom._jit import choose_by_type, inner_kernel, inlined_kernel
from ohmloom._philox_kernels import normal
from ohmloom.devices._event_kernels import CHARGE, FLUX, MEM_LIFETIME, event_state, read_weight
from ohmloom.devices._kernels import conductance, current_pulse, flux, metered_pulse, voltage_pulse
from ohmloom.mapping._fabric import (
    CHARGE_METERED,
    CURRENT,
    EXACT_WIDTH,
    VOLTAGE,
    AnyPulses,
    ClosedPulses,
    Fabric,
    FabricState,
)

INTEGRATED = 2  # beside CHARGE and FLUX: a law without a closed form, or one that is checked against it
NEWTON_ROUNDS = 60
STILL = 1e-16  # a change of s that is none


@inlined_kernel
def refresh(f: Fabric, s: FabricState, k: int) -> None:
    """Conductance and weight of a live cell from its state."""
    cell, now = f.cells[k], s.cells[k]
    t = cell["tile"]
    tile = f.tiles[t]
    g = conductance(tile["law"], now["s"], 0.0, f.parameters[t])
    now["g"] = g
    now["weight"] = cell["polarity"] * tile["gain"] * read_weight(g, tile["reference"], tile["g_on"])
    s.is_stale[t] = True


@inner_kernel
def place_at(f: Fabric, s: FabricState, k: int, state: float) -> None:
    """Put a live cell into a state that no count of events reaches."""
    now, t = s.cells[k], f.cells[k]["tile"]
    tile = f.tiles[t]
    now["s"] = min(max(state, 0.0), 1.0)
    now["count"] = 0.0
    now["origin"] = flux(tile["law"], now["s"], f.parameters[t]) if tile["family"] == FLUX else now["s"]
    refresh(f, s, k)


@inlined_kernel
def event_size(f: Fabric, s: FabricState, k: int, sign: int) -> float:
    """Size of the next event of a cell, 1 nominally."""
    constants = f.constants[0]
    size = f.cells[k]["factor"] * (1.0 + sign * constants["asymmetry"])
    if constants["cycle_to_cycle"] > 0.0:
        noise = normal(constants["cycle_key"], f.cells[k]["number"], s.cells[k]["pulses"])
        size *= max(1.0 + constants["cycle_to_cycle"] * noise, 0.0)
    return size


@inlined_kernel
def count_events(f: Fabric, s: FabricState, k: int, events: float) -> None:
    """Move a cell by a number of events in its tile's coordinate."""
    now, t = s.cells[k], f.cells[k]["tile"]
    tile = f.tiles[t]
    family = CHARGE if tile["family"] == INTEGRATED else tile["family"]
    now["s"], now["origin"], now["count"] = event_state(
        tile["law"], family, now["origin"], now["count"] + events, tile["event_flux"], f.parameters[t], tile["bottom"],
        tile["top"],
    )  # fmt: skip


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
        after = x - miss / (q_d / conductance(law, x, 0.0, p) + series * q_d)
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - x) <= STILL:
            return after
        x = after
    return x


@inlined_kernel
def closed_pulse(
    f: Fabric, s: FabricState, k: int, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """One pulse on a selected cell of an ideal law; (duration in s, charge in C, energy in J), sizes."""
    now, constants, t = s.cells[k], f.constants[0], f.cells[k]["tile"]
    tile, p, series = f.tiles[t], f.parameters[t], f.cells[k]["series"]
    law, q_d, mode = tile["law"], tile["charge_scale"], constants["mode"]
    before, voltage = now["s"], strength * constants["pulse_voltage"]
    size = event_size(f, s, k, sign) * width
    if mode == EXACT_WIDTH:
        return exact_width(f, s, k, sign, size, voltage)
    start = flux(law, before, p)
    if mode == VOLTAGE:
        applied = size * strength * tile["event_flux"]
        if series == 0.0:
            count_events(f, s, k, sign * size * strength)
        else:
            place_at(f, s, k, state_behind(law, p, q_d, before, series, sign * applied))
        charge = abs(now["s"] - before) * q_d
        g = conductance(law, now["s"], 0.0, p)
        rest = applied - abs(flux(law, now["s"], p) - start) - series * charge
        if rest > 0.0 and (now["s"] == 0.0 or now["s"] == 1.0):
            # The state stands at its wall, and the current goes on.
            charge += rest * g / (1.0 + series * g)
        return tile["duration"] * width, charge, voltage * charge
    charge = size * q_d / MEM_LIFETIME
    count_events(f, s, k, sign * size)
    inside = abs(now["s"] - before) * q_d
    g = conductance(law, now["s"], 0.0, p)
    passed = abs(flux(law, now["s"], p) - start) + max(charge - inside, 0.0) / g + series * charge
    if mode == CURRENT:
        duration = tile["duration"] * width
        return duration, charge, passed * charge / duration
    duration = passed / voltage
    if constants["metering_delay"] > 0.0:
        more = constants["metering_delay"] * duration * voltage * g / (1.0 + series * g)
        count_events(f, s, k, sign * more * MEM_LIFETIME / q_d)
        charge += more
        duration *= 1.0 + constants["metering_delay"]
    return duration, charge, voltage * charge


@inner_kernel
def exact_width(
    f: Fabric, s: FabricState, k: int, sign: int, size: float, voltage: float
) -> tuple[float, float, float]:
    """The driver applies the flux that takes the state it believes in to the next; the cell takes that flux."""
    now, t = s.cells[k], f.cells[k]["tile"]
    tile, p, series, before = f.tiles[t], f.parameters[t], f.cells[k]["series"], now["s"]
    law, q_d = tile["law"], tile["charge_scale"]
    knows = now["belief_origin"] == now["origin"] and now["belief_count"] == now["count"] and size == 1.0
    taken, wanted = believe(f, s, k, sign)
    applied = abs(flux(law, wanted, p) - flux(law, taken, p)) + series * q_d * abs(wanted - taken)
    if knows:
        now["s"], now["origin"], now["count"] = wanted, now["belief_origin"], now["belief_count"]
    else:
        place_at(f, s, k, state_behind(law, p, q_d, before, series, sign * size * applied))
    charge = abs(now["s"] - before) * q_d
    return applied / voltage, charge, voltage * charge


@inner_kernel
def believe(f: Fabric, s: FabricState, k: int, sign: int) -> tuple[float, float]:
    """States that an exact-width driver takes for true before and after an event; the latter becomes its belief."""
    now, t = s.cells[k], f.cells[k]["tile"]
    law, p = f.tiles[t]["law"], f.parameters[t]
    taken, _, _ = event_state(law, CHARGE, now["belief_origin"], now["belief_count"], 0.0, p, 0.0, 1.0)
    wanted, now["belief_origin"], now["belief_count"] = event_state(
        law, CHARGE, now["belief_origin"], now["belief_count"] + sign, 0.0, p, 0.0, 1.0
    )
    return taken, wanted


@inner_kernel
def integrated_pulse(
    f: Fabric, s: FabricState, k: int, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """The same by integrating the law's own state equation, for any law; wires enter by the voltage they leave at first."""
    now, constants, t = s.cells[k], f.constants[0], f.cells[k]["tile"]
    tile, p, before = f.tiles[t], f.parameters[t], now["s"]
    law, q_d, mode = tile["law"], tile["charge_scale"], constants["mode"]
    size = event_size(f, s, k, sign) * width
    left = strength * constants["pulse_voltage"] / (1.0 + f.cells[k]["series"] * now["g"])
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
            taken, wanted = believe(f, s, k, sign)
            duration = abs(flux(law, wanted, p) - flux(law, taken, p)) / left * size
        after, charge = voltage_pulse(law, before, p, q_d, sign * left, duration)
        charge = abs(charge)
        energy = left * charge
        if mode == VOLTAGE:
            duration = tile["duration"] * width
    now["s"] = min(max(after, 0.0), 1.0)
    now["origin"], now["count"] = now["s"], 0.0
    return duration, charge, energy


def write_pulse(
    pulses: Any, f: Fabric, s: FabricState, k: int, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    """The pulse of a fabric in which all laws have closed forms, or of any."""
    return _PULSES[type(pulses)](pulses, f, s, k, sign, strength, width)


def _write_closed(
    pulses: Any, f: Fabric, s: FabricState, k: int, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    return closed_pulse(f, s, k, sign, strength, width)


def _write_any(
    pulses: Any, f: Fabric, s: FabricState, k: int, sign: int, strength: float, width: float
) -> tuple[float, float, float]:
    if f.tiles[f.cells[k]["tile"]]["family"] == INTEGRATED:
        return integrated_pulse(f, s, k, sign, strength, width)
    return closed_pulse(f, s, k, sign, strength, width)


_PULSES: dict[type, Callable[..., tuple[float, float, float]]] = {ClosedPulses: _write_closed, AnyPulses: _write_any}
choose_by_type(write_pulse, _PULSES)
