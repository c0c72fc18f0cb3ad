"""A hosted FMU as a two-terminal device: in a netlist, and beside a measurement."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.circuits import Constant, CurrentSource, Netlist, NetlistTrace
from ohmloom.circuits._netlist_transient import _Run
from ohmloom.circuits._stamps import System
from ohmloom.circuits._topology import Forest, check_topology
from ohmloom.circuits.elements import Capacitor, Resistor, Simple, VoltageSource
from ohmloom.circuits.waveforms import Waveform
from ohmloom.devices import Measurement
from ohmloom.errors import ParameterError, expect_number, expect_type
from ohmloom.fmu.host import Host

MOST_STEPS = 1_000_000


@dataclass(frozen=True, kw_only=True)
class HostedDevice:
    """A hosted FMU between two nodes: its input is a voltage of `p` above `n`, its output a current from `p` to `n`.

    Attributes
    ----------
    name, p, n
        As of a netlist's element.
    host
        The FMU.
    voltage, current
        Names of its input [V] and output [A].
    """

    name: str
    p: str
    n: str
    host: Host
    voltage: str = "v"
    current: str = "i"

    def __post_init__(self) -> None:
        """Check that the FMU has the two."""
        expect_type(f"{self.name}.host", self.host, Host)
        for field, there in (("voltage", self.host.inputs), ("current", self.host.outputs)):
            if getattr(self, field) not in there:
                raise ParameterError(f"{self.name}.{field}: expected one of {', '.join(there)}, got "
                                     f"{getattr(self, field)!r}. Name it as the FMU does.")  # fmt: skip

    @property
    def is_direct(self) -> bool:
        """Whether the current follows the voltage at once, rather than through a state alone."""
        needs = self.host.dependencies.get(self.current)
        return needs is None or self.voltage in needs


class _Held(Waveform):
    """A value that is set from outside, and held."""

    def __init__(self) -> None:
        self.level = 0.0

    def value(self, t: float) -> float:
        return self.level

    def slope(self, t: float) -> float:
        return 0.0

    def breakpoints(self, t_end: float) -> list[float]:
        return []

    def shortest_edge(self) -> float:
        return float("inf")

    def to_spice(self, t_end: float) -> str:
        return Constant(level=self.level).to_spice(t_end)


def simulate_hosted(netlist: Netlist, devices: Sequence[HostedDevice], *, t_end: float, step: float) -> NetlistTrace:
    """Follow a netlist with hosted devices, explicitly: each sees its voltage, and holds its current, for a step.

    The error falls with the step. A device whose current follows its voltage at once needs nodes whose voltage is held
    by capacitors and sources, since otherwise its own current would set it.

    Parameters
    ----------
    netlist
        Everything else.
    devices
        The hosted ones; they appear in the trace as elements.
    t_end, step
        Duration, and time between samples, in s.

    Raises
    ------
    ParameterError
        If an option is out of range, or a device would close an algebraic loop; names it.
    OperationError
        If an FMU or the integration fails.
    """
    where = "simulate_hosted"
    end, h = (expect_number(f"{where}: {name}", x, "a time in s") for name, x in (("t_end", t_end), ("step", step)))
    if not (h > 0.0 and end >= h and end / h <= MOST_STEPS):
        raise ParameterError(f"{where}: step: expected 0 < step <= t_end = {end:g} s, at most {MOST_STEPS} steps, "
                             f"got {h:g} s. Correct it.")  # fmt: skip
    for device in devices:
        _check_loop(where, netlist.flat, device)
    held = {device.name: _Held() for device in devices}
    parts = [CurrentSource(name=d.name, p=d.p, n=d.n, current=held[d.name]) for d in devices]
    whole = Netlist(elements=(*netlist.elements, *parts), name=netlist.name)
    check_topology(whole.flat, is_dc=False)
    system = System(whole.flat, whole.nodes, is_dc=False)
    run, k = _Run(system, None), len(system.capacitors)
    place = {node: j for j, node in enumerate(system.nodes)} | {"0": -1}
    count = round(end / h)
    corners = sorted({c for source in system.sources for c in source.breakpoints(count * h)})
    for device in devices:
        device.host.reset()
    y = run._start.copy()
    states, xs, currents, unbalanced = [], [], [], 0.0
    guess: FloatArray | None = None
    for n in range(count + 1):
        t = n * h
        guess = system.solve(system.right_side(t, y[:k], t), y[k:], guess)
        potentials = np.append(guess[: len(system.nodes)], 0.0)
        volts = {d.name: float(potentials[place[d.p]] - potentials[place[d.n]]) for d in devices}
        for d in devices:
            d.host.set({d.voltage: volts[d.name]})
            held[d.name].level = float(d.host.get([d.current])[d.current])
        guess = system.solve(system.right_side(t, y[:k], t), y[k:], guess)
        states.append(y)
        xs.append(guess)
        currents.append(system.currents(guess, t, y[k:]))
        unbalanced = max(unbalanced, system.unbalanced(currents[-1]))
        if n == count:
            break
        run._last = None  # of another current
        for begin, stop in pairwise([t, *(c for c in corners if t < c < t + h), (n + 1) * h]):
            y, _ = run._follow_piece(begin, stop, y, np.array([stop]))
        for d in devices:
            d.host.step(h)
    x, i, s = np.array(xs), np.array(currents), np.array(states)
    made = {"ohmloom": version("ohmloom"), "engine": "ohmloom, hosted", "netlist": netlist.name, "step": h,
            "fmus": [d.host.path.name for d in devices]}  # fmt: skip
    largest = float(np.abs(i).max(initial=0.0))
    by_name = {m.name: s[:, k + j] for j, m in enumerate(system.memristors)}
    return NetlistTrace(
        t=frozen_array("NetlistTrace.t", h * np.arange(count + 1), ("time",)),
        v={node: x[:, j] for j, node in enumerate(system.nodes)},
        i={element.name: i[:, j] for j, element in enumerate(system.elements)},
        s=by_name,
        q={m.name: by_name[m.name] * m.device.charge_scale for m in system.memristors},
        residual=unbalanced / largest if largest > 0.0 else unbalanced,
        provenance=json.dumps(made, sort_keys=True),
    )


def _check_loop(where: str, elements: Sequence[Simple], device: HostedDevice) -> None:
    if not device.is_direct:
        return
    forest = Forest()
    for element in elements:
        is_joint = isinstance(element, Resistor) and element.resistance == 0.0
        if isinstance(element, VoltageSource | Capacitor) or is_joint:
            forest.add(element)
    if forest.path(device.p, device.n) is None:
        raise ParameterError(f"{where}: {device.name}: expected capacitors and sources to hold the voltage between "
                             f"{device.p} and {device.n}, got one that its own current sets, an algebraic loop. Put a "
                             "capacitor across it, or export the whole as one flattened FMU.")  # fmt: skip


def reference_current(host: Host, sweep: Measurement, *, voltage: str = "v", current: str = "i") -> FloatArray:
    """Current [A] of a hosted device that sees the voltage of a sweep, axes (time,).

    Between two times it holds their mean; the current at a time is that at its voltage.

    Raises
    ------
    ParameterError
        If the sweep has a series resistor, whose voltage would depend on the current.
    OperationError
        If the FMU fails.
    """
    if sweep.series_resistance:
        raise ParameterError(f"{sweep.name}: expected the device's own voltage, got that of a source behind "
                             f"{sweep.series_resistance:g} Ohm, an algebraic loop. Subtract what the resistor "
                             "takes.")  # fmt: skip
    HostedDevice(name=host.path.name, p="p", n="n", host=host, voltage=voltage, current=current)
    host.reset()
    found = []
    for k, v in enumerate(sweep.v.tolist()):
        host.set({voltage: v})
        found.append(float(host.get([current])[current]))
        if k + 1 < sweep.t.size:
            host.step(float(sweep.t[k + 1] - sweep.t[k]), {voltage: 0.5 * (v + float(sweep.v[k + 1]))})
    return np.array(found)


def reference_errors(host: Host, sweeps: Sequence[Measurement]) -> Mapping[str, float]:
    """Relative RMS error of a hosted device's current by sweep: ``rms(i_fmu - i)/rms(i)``."""
    errors = {}
    for sweep in sweeps:
        scale = float(np.sqrt(np.mean(sweep.i**2)))
        miss = float(np.sqrt(np.mean((reference_current(host, sweep) - sweep.i) ** 2)))
        errors[sweep.name] = miss / scale if scale > 0.0 else float("inf")
    return errors
