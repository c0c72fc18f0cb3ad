"""The operating point and the transient of a netlist: a linear or Newton solve inside, an integrator outside.

Capacitor voltages and memristor states are integrated from corner to corner of the sources; everything else follows
from them by one resistive solve per right-hand side. A memristor at a wall rests while its rate points outward; arrival
and release are events.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable
from importlib.metadata import version
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray
from ohmloom._files import sha256
from ohmloom.circuits._stamps import System
from ohmloom.circuits.netlist_trace import ByName, NetlistTrace, OperatingPoint
from ohmloom.devices._events import TerminalEvent
from ohmloom.errors import OhmloomError, OperationError, ParameterError

if TYPE_CHECKING:
    from ohmloom.circuits.netlist import Netlist

# On volts and on states; the first method follows the second where it is stiff or not alike.
METHODS = (("LSODA", 1e-10, 1e-13), ("Radau", 1e-9, 1e-11))
FIRST_STEP = 1e-3  # of a piece between corners: nothing may yet move at its start
MOST_EVALUATIONS = 1_000_000
MOST_EVENTS = 10_000
# A state this close to a wall with its rate outward is there.
AT_WALL = 1e-12
AGREE = 1e-9  # relatively: capacitors in a loop, at their initial voltages
# How far inside a piece the slope of a source is taken, of its length: at the corner itself it is its neighbour's.
INSIDE = 1e-6
JUST_BEFORE = 1e-12
# A stiff state that rests nearer to a wall than the tolerance must find its rate smooth a little past it.
BEYOND = 1e-9


def solve_dc(netlist: Netlist, t: float) -> OperatingPoint:
    """See `Netlist.dc`."""
    system = System(netlist.flat, netlist.nodes, is_dc=True)
    s = np.array([m.s0 for m in system.memristors])
    system.check_solvable(s)
    x = system.solve(system.right_side(t, np.zeros(0)), s)
    i = system.currents(x, t, s)
    return OperatingPoint(
        v=ByName("OperatingPoint.v", dict(zip(system.nodes, x.tolist(), strict=False))),
        i=ByName("OperatingPoint.i", dict(zip([e.name for e in system.elements], i.tolist(), strict=True))),
        residual=_relative(system.unbalanced(i), float(np.abs(i).max(initial=0.0))),
    )


def simulate(netlist: Netlist, t: FloatArray, max_step: float | None) -> NetlistTrace:
    """See `Netlist.simulate`."""
    run = _Run(System(netlist.flat, netlist.nodes, is_dc=False), max_step)
    states = run.follow(t)
    system, k = run.system, len(run.system.capacitors)
    xs, currents, unbalanced = [], [], 0.0
    guess = None
    for time, y in zip(t.tolist(), states, strict=True):
        # At a corner a capacitor across a source has two currents; take the one before.
        guess = system.solve(system.right_side(time, y[:k], time * (1.0 - JUST_BEFORE)), y[k:], guess)
        xs.append(guess)
        currents.append(system.currents(guess, time, y[k:]))
        unbalanced = max(unbalanced, system.unbalanced(currents[-1]))
    x, i = np.array(xs), np.array(currents)
    s = {m.name: states[:, k + j] for j, m in enumerate(system.memristors)}
    made = {"ohmloom": version("ohmloom"), "engine": "ohmloom", "netlist": netlist.name,
            "netlist_sha256": sha256(repr(netlist).encode()), "max_step": max_step}  # fmt: skip
    return NetlistTrace(
        t=t,
        v={node: x[:, j] for j, node in enumerate(system.nodes)},
        i={element.name: i[:, j] for j, element in enumerate(system.elements)},
        s=s,
        q={m.name: s[m.name] * m.device.charge_scale for m in system.memristors},
        residual=_relative(unbalanced, float(np.abs(i).max(initial=0.0))),
        provenance=json.dumps(made, sort_keys=True),
    )


class _Run:
    """One transient: what the integrator asks for, with the last answer kept."""

    def __init__(self, system: System, max_step: float | None) -> None:
        self.system = system
        self._max_step = max_step
        self._k = len(system.capacitors)
        self._last: tuple[float, bytes, FloatArray] | None = None
        self._guess: FloatArray | None = None
        self._evaluations = 0
        self._piece = (0.0, 0.0)
        start = [c.initial for c in system.capacitors] + [m.s0 for m in system.memristors]
        self._start = np.array(start)
        _check_initial(system)
        system.check_solvable(self._start[self._k :])

    def follow(self, t: FloatArray) -> FloatArray:
        """Capacitor voltages and memristor states at the times `t`, axes (time, state)."""
        end = float(t[-1])
        corners = {c for source in self.system.sources for c in source.breakpoints(end)}
        states = np.empty((t.size, self._start.size))
        y, is_first = self._start.copy(), bool(t[0] == 0.0)
        if is_first:
            states[0] = y
        for begin, stop in pairwise(sorted({0.0, end, *corners})):
            inside = (t > begin) & (t <= stop)
            y, found = self._follow_piece(begin, stop, y, t[inside])
            states[inside] = found
        return states

    def _follow_piece(self, begin: float, stop: float, y: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The state at `stop`, and at the times `t` in (begin, stop]."""
        if y.size == 0:
            return y, np.empty((t.size, 0))
        self._piece = (begin, stop)
        self._evaluations = 0
        samples: list[FloatArray] = []
        time, released = begin, None
        times = t if t.size and t[-1] == stop else np.append(t, stop)
        for _ in range(MOST_EVENTS):
            held, y = self._settle(time, y, released)
            reached, found, y, released = self._integrate(time, stop, y, held, times[times > time])
            samples += found
            if reached >= stop:
                return y, np.array(samples[: t.size]).reshape(t.size, y.size)
            # An event that brings no progress is one of rounding: step over it.
            time = reached if reached > time else float(np.nextafter(time, stop))
        raise self._failure(time, f"more than {MOST_EVENTS} arrivals at a wall")

    def _settle(self, t: float, y: FloatArray, released: int | None) -> tuple[npt.NDArray[np.bool_], FloatArray]:
        """Which memristors rest at a wall, axes (memristor,), and the state with those exactly there.

        The one just `released` is free, whatever the rounding of its rate says.
        """
        s = np.clip(y[self._k :], 0.0, 1.0)
        rate = self._rates(t, np.concatenate([y[: self._k], s]))[self._k :]
        low, high = (s <= AT_WALL) & (rate <= 0.0), (s >= 1.0 - AT_WALL) & (rate >= 0.0)
        if released is not None:
            low[released] = high[released] = False
        s = np.where(low, 0.0, np.where(high, 1.0, s))
        return low | high, np.concatenate([y[: self._k], s])

    def _integrate(
        self, time: float, stop: float, y: FloatArray, held: npt.NDArray[np.bool_], times: FloatArray
    ) -> tuple[float, list[FloatArray], FloatArray, int | None]:
        """Up to `stop` or an event: where, the states at `times` until there, the state there, and who was released."""
        from scipy.integrate import solve_ivp

        k, gap = self._k, stop - time
        step = np.inf if self._max_step is None else self._max_step / gap
        events = [self._release(j, time, gap) if held[j] else self._arrival(j, time, gap) for j in range(held.size)]

        def slopes(u: float, state: FloatArray) -> FloatArray:
            rates = self._rates(time + u * gap if u < 1.0 else stop, state) * gap
            rates[k:][held] = 0.0
            return rates

        wanted = np.minimum((times - time) / gap, 1.0)
        message = ""
        for method, rtol, atol in METHODS:
            try:
                # LSODA warns of what its status tells.
                with warnings.catch_warnings(), np.errstate(all="ignore"):
                    warnings.simplefilter("ignore")
                    found = solve_ivp(slopes, (0.0, 1.0), y, method=method, t_eval=wanted, rtol=rtol, atol=atol,
                                      events=events, first_step=min(FIRST_STEP, step), max_step=step)  # fmt: skip
            except OhmloomError:
                raise
            except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                message = str(error)
                continue
            message = str(found.message)
            if found.status < 0 or not np.isfinite(found.y).all():
                continue
            # SciPy returns an empty list for no samples.
            at_samples = list(np.reshape(found.y, (y.size, -1)).T)
            for state in at_samples:
                state[k:] = np.clip(state[k:], 0.0, 1.0)
            if found.status == 0:
                return stop, at_samples, at_samples[-1], None
            j = int(np.argmin([e[0] if len(e) else np.inf for e in found.t_events]))
            state = np.array(found.y_events[j][0])
            state[k:] = np.clip(state[k:], 0.0, 1.0)
            if not held[j]:
                state[k + j] = round(state[k + j])
            return time + float(found.t_events[j][0]) * gap, at_samples, state, j if held[j] else None
        raise self._failure(time, message)

    def _arrival(self, j: int, time: float, gap: float) -> Callable[[float, FloatArray], float]:
        """Falls through 0 where the memristor `j` comes to a wall with its rate outward."""

        def event(u: float, y: FloatArray) -> float:
            s = float(y[self._k + j])
            inside = min(s, 1.0 - s)
            if inside > 0.0:
                return inside
            rate = float(self._rates(time + u * gap, y)[self._k + j])
            is_outward = rate <= 0.0 if s <= 0.0 else rate >= 0.0
            return min(inside, -sys.float_info.min) if is_outward else sys.float_info.min

        return TerminalEvent(event, -1.0)

    def _release(self, j: int, time: float, gap: float) -> Callable[[float, FloatArray], float]:
        """Rises through 0 where the rate of the memristor `j`, at a wall, begins to point inward."""

        def event(u: float, y: FloatArray) -> float:
            inward = float(self._rates(time + u * gap, y)[self._k + j]) * (1.0 if y[self._k + j] < 0.5 else -1.0)
            return inward if inward > 0.0 else min(inward, -sys.float_info.min)

        return TerminalEvent(event, 1.0)

    def _rates(self, t: float, y: FloatArray) -> FloatArray:
        key = y.tobytes()
        if self._last is not None and self._last[0] == t and self._last[1] == key:
            return self._last[2].copy()
        self._evaluations += 1
        if self._evaluations > MOST_EVALUATIONS:
            raise self._failure(t, f"more than {MOST_EVALUATIONS} evaluations of its rates")
        system, k = self.system, self._k
        s = np.clip(y[k:], -BEYOND, 1.0 + BEYOND)
        begin, stop = self._piece
        nudge = INSIDE * (stop - begin)
        side = system.right_side(t, y[:k], min(max(t, begin + nudge), stop - nudge))
        x = self._guess = system.solve(side, s, self._guess)
        charging = x[system.capacitor_rows] / system.capacitances
        rates = np.concatenate([charging, system.devices.rate(s, system.ports.T @ x)])
        self._last = t, key, rates
        return rates.copy()

    def _failure(self, t: float, got: str) -> OperationError:
        return OperationError(f"Netlist.simulate: expected to get past t = {t:.6g} s, got {got.rstrip('.')}. "
                              "Lower the sources, or give max_step.")  # fmt: skip


def _check_initial(system: System) -> None:
    """Refuse capacitors in a loop whose initial voltages disagree: the current would be infinite."""
    given: Any = {c.name: c for c in system.elements}
    initial = {c.name: c.initial for c in system.capacitors}
    for source, element in zip(system.sources, system._source_elements, strict=True):
        initial[element.name] = source.value(0.0)
    found = []
    for name, path in system.links.items():
        terms = [sign * initial.get(element.name, 0.0) for element, sign in path]
        total, own = sum(terms), given[name].initial
        if abs(total - own) > AGREE * max(map(abs, [*terms, own])):
            found.append(f"{name}.initial: expected {total:g} V, which {', '.join(e.name for e, _ in path)} put on it "
                         f"at t = 0, got {own:g} V. Correct it, or put a resistance in series.")  # fmt: skip
    if found:
        raise ParameterError(*found)


def _relative(unbalanced: float, largest: float) -> float:
    return unbalanced / largest if largest > 0.0 else unbalanced
