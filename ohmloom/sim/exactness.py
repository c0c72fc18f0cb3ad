"""The exact box: what must hold before any figure of an emulation means anything, on a spec's own cards.

Each entry of `EXACT` is one function of a `Case`; it returns whether it holds, or a text that says why it does not
apply.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits import Crossbar
from ohmloom.devices import LAWS, Device
from ohmloom.mapping import Hardware, Plan, place
from ohmloom.mapping.pulses import pulse_of
from ohmloom.neurocontroller import LATTICES, Network
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS, charge_levels, reads_with_reference
from ohmloom.neurocontroller.plain import stdp_sign
from ohmloom.sim.agreement import Agreement, agreement
from ohmloom.sim.arena import Arena

PULSE_TOLERANCE = 1e-9  # of an event
WIDTH_TOLERANCE = 1e-8  # of an event
LATTICE_TOLERANCE = 1e-12
CURRENT_TOLERANCE = 1e-12  # of the largest current
SLOPE_TOLERANCE = 0.05  # of 1
HISTORY = 8  # steps: 65,536 pairs of spike trains
STATES = (0.0, 1e-4, 0.0097, 0.25, 0.5, 0.75, 0.98, 0.9899, 0.9996, 1.0)
SKEWED_STEPS, SKEW_SEED = 200, 12
NO_PLASTIC = "no plastic synapse"
Rule = Callable[[int, int, int], int]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A plan and how it is checked.

    Attributes
    ----------
    plan
        Network and hardware.
    trial_key, arena
        The trial that networks are compared in.
    perturb
        Relative error of every event's charge; 0 is right.
    integrate
        Whether networks follow the devices' differential equations, and not their closed forms.
    rule
        ``rule(ls_pre, ls_post, stdp_threshold)``: eqs. 10 and 11, or another to see the box turn red.
    """

    plan: Plan
    trial_key: int
    arena: Arena
    perturb: float = 0.0
    integrate: bool = False
    rule: Rule = stdp_sign

    @property
    def hardware(self) -> Hardware:
        """The spec."""
        return self.plan.hardware

    @property
    def network(self) -> Network:
        """The network."""
        return self.plan.network

    @property
    def plastic(self) -> dict[str, Device]:
        """Cards of the plastic kinds that the network uses."""
        used = {tile.kind for tile in self.plan.tiles}
        return {kind: d for kind, d in self.hardware.devices.items() if kind in used and kind in PLASTIC_KINDS}

    @property
    def not_ideal(self) -> list[str]:
        """Plastic kinds whose law has no flux: nothing about them is claimed to be exact."""
        return [kind for kind, device in self.plastic.items() if LAWS[device.law].flux is None]

    @cached_property
    def charge(self) -> Agreement:
        """Charge-exact drive on selected cells without wires, beside the discrete model of the spec's cards."""
        return self._network("charge_metered", "cards")

    @cached_property
    def flux(self) -> Agreement:
        """Pulses of fixed voltage without wires, beside the flux-discrete model of the same cards."""
        return self._network("voltage", "flux")

    def _network(self, mode: str, model: Literal["cards", "flux"]) -> Agreement:
        return agreement(
            self.network, exact_variant(self.hardware, mode), arena=self.arena, perturb=self.perturb,
            trial_key=self.trial_key, model=model, integrate=self.integrate, as_wired=not self.hardware.wires.is_ideal,
        )  # fmt: skip


def exact_variant(hardware: Hardware, mode: str) -> Hardware:
    """The same cards and waveform on selected cells without wires, whose events are written in another mode."""
    zero = hardware.wires.r_row.model_copy(update={"value": 0.0})
    wires = hardware.wires.model_copy(update={"r_row": zero, "r_column": zero, "r_driver": None, "r_sense": None})
    array = hardware.array.model_copy(
        update={"access": "1T1R", "disabled": "masked", "unformed_conductance": None, "signs": "row_polarity"}
    )
    keep = {} if mode == hardware.drive.mode == "voltage" else {"pulse_duration": None}
    # The exactness is of pulses, not of what a slot cuts off them, nor of what a driver can carry.
    drive = hardware.drive.model_copy(
        update={"mode": mode, "parallelism": "column", "pulse_shape": "rectangular", "edge": None, "slot": None,
                "compliance_current": None, "compliance_voltage": None, **keep}
    )  # fmt: skip
    return hardware.model_copy(update={"wires": wires, "array": array, "drive": drive})


def rule_table(case: Case) -> bool | str:
    """The waveform writes exactly what the rule asks for, for every pair of ls values."""
    return _signs(case) if case.plastic else NO_PLASTIC


def _signs(case: Case) -> bool:
    readings = case.network.readings
    size = range(readings.last_spike + 1)
    return all(
        _written(case, pre, post) == case.rule(pre, post, readings.stdp_threshold)
        for pre, post in itertools.product(size, size)
    )


def _written(case: Case, pre: int, post: int) -> float:
    drive = case.hardware.drive
    written = 0.0
    for phase in drive.volts.phases:
        v = phase.column[post] - phase.row[pre]
        written += phase.duration * ((v > drive.threshold.value) - (v < -drive.threshold.value))
    return written


def pair_histories(case: Case) -> bool | str:
    """All pairs of eight-step spike trains, followed step by step, give the same events by waveform and by rule."""
    if not case.plastic:
        return NO_PLASTIC
    last, threshold = case.network.readings.last_spike, case.network.readings.stdp_threshold
    trains = np.array(list(itertools.product((0, 1), repeat=HISTORY)))
    ls = np.zeros(len(trains), dtype=np.int64)
    for step in range(HISTORY):
        ls = np.where(trains[:, step] == 1, last, ls)
        pre, post = np.meshgrid(ls, ls, indexing="ij")
        written = np.zeros(pre.shape)
        for phase in case.hardware.drive.volts.phases:
            v = np.array(phase.column)[post] - np.array(phase.row)[pre]
            limit = case.hardware.drive.threshold.value
            written += phase.duration * ((v > limit).astype(float) - (v < -limit))
        asked = np.array([[case.rule(a, b, threshold) for b in range(last + 1)] for a in range(last + 1)])
        if (written != asked[pre, post]).any():
            return False
        ls = np.maximum(ls - 1, 0)
    return True


def current_pulse(case: Case) -> bool | str:
    """A current pulse, integrated, moves the charge by one event, to the walls and no further."""
    return _pulses(case, _after_current, PULSE_TOLERANCE)


def voltage_pulse(case: Case) -> bool | str:
    """A pulse of fixed voltage, integrated, ends where the closed form of the flux says."""
    return _pulses(case, _after_voltage, PULSE_TOLERANCE)


def exact_width_pulse(case: Case) -> bool | str:
    """A voltage pulse of width (phi(q + dq) - phi(q))/V, integrated, moves the charge by one event."""
    return _pulses(case, _after_width, WIDTH_TOLERANCE)


def network_charge(case: Case) -> bool | str:
    """Charge-exact drive on selected cells is the discrete model of the same cards, spike for spike."""
    return _not_claimed(case) or case.charge.exact


def network_flux(case: Case) -> bool | str:
    """Pulses of fixed voltage are the flux-discrete model of the same cards, spike for spike."""
    if not case.plastic:
        return NO_PLASTIC
    return _not_claimed(case) or case.flux.exact


def lattice(case: Case) -> bool | str:
    """Weights of the cards are those of the paper's integer lattice."""
    if not case.plastic:
        return NO_PLASTIC
    other = [kind for kind, device in case.plastic.items() if not _is_paper_law(kind, device)]
    if other:
        return f"the cards of {', '.join(other)} have not the paper's law and ratio 100, so their weights are others"
    return all(_lattice_error(kind, device) <= LATTICE_TOLERANCE for kind, device in case.plastic.items())


def wire_limit(case: Case) -> bool | str:
    """Read errors of the largest tile vanish in proportion to the resistance of the wires."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    # Resistances at which the error is small but far above rounding.
    unit = 1e-6 / float(g.max())
    exact = g.sum(axis=0)
    errors = []
    for r in (unit, 10.0 * unit):
        read = Crossbar(conductance=g, r_row=r, r_column=r).read(np.ones(g.shape[0])).current
        errors.append(float(np.abs(read - exact).max() / exact.max()))
    return bool(abs(np.log10(errors[1] / errors[0]) - 1.0) <= SLOPE_TOLERANCE)


def ladder(case: Case) -> bool | str:
    """One word line with its devices draws the current of the continued fraction."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    row, r = g[int(g.sum(axis=1).argmax())], _segment(case)
    # A device into virtual ground through one segment of its column.
    inward = 0.0
    for conductance in row[::-1]:
        branch = conductance / (1.0 + r * conductance)
        inward = (branch + inward) / (1.0 + r * (branch + inward))
    current = Crossbar(conductance=row[None, :], r_row=r, r_column=r).read(np.ones(1)).current.sum()
    return bool(abs(current - inward) <= CURRENT_TOLERANCE * inward)


def column_serial_delay(case: Case) -> bool | str:
    """Columns read one after the other through taps see every spike after its delay, to the last bit."""
    from ohmloom.mapping._fabric import READ_FIELDS, READ_STATE
    from ohmloom.mapping._kernels import read_column

    synapses = case.network.synapses
    if not synapses:
        return "no synapse"
    rng, n = np.random.default_rng(SKEW_SEED), case.network.neurons
    spikes = (rng.random((SKEWED_STEPS, n)) < 0.3).astype(np.float64)
    order = sorted(range(len(synapses)), key=lambda k: (synapses[k].post, synapses[k].pre))
    reads = np.zeros(len(order), dtype=READ_FIELDS)
    state = np.zeros(len(order), dtype=READ_STATE)
    reads["sender"] = [synapses[k].pre for k in order]
    reads["tap"] = [case.network.delay(synapses[k]) for k in order]
    # Dyadic weights add without rounding, so that the order of a sum can hide nothing.
    state["weight"] = rng.integers(-64, 65, len(order)) / 64.0
    posts = np.array([synapses[k].post for k in order])
    starts = np.searchsorted(posts, np.arange(n + 1))
    slots = 1 << int(reads["tap"].max()).bit_length()
    ring = np.zeros((slots, n))
    for now in range(SKEWED_STEPS):
        for j in range(n):
            late = now - reads["tap"]
            arrived = np.where(late >= 0, spikes[np.maximum(late, 0), reads["sender"]], 0.0)
            if read_column(starts, reads, state, ring, j, now)[0] != (arrived * state["weight"])[posts == j].sum():
                return False
        ring[now % slots] = spikes[now]
    return True


def kirchhoff(case: Case) -> bool | str:
    """All that enters the word lines of the largest tile leaves its bit lines."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    r = _segment(case)
    array = Crossbar(conductance=g, r_row=r, r_column=r)
    v = np.linspace(1.0, -0.5, g.shape[0])
    read = array.read(v)
    entering = ((v[:, None] - read.v_row[:, :1]) / r).sum()
    scale = np.abs(read.current).sum()
    return bool(abs(entering - read.current.sum()) <= CURRENT_TOLERANCE * scale * max(1.0, 1.0 / (r * g.max())))


EXACT: Mapping[str, Callable[[Case], bool | str]] = MappingProxyType(
    {
        one.__name__: one
        for one in (
            rule_table, pair_histories, current_pulse, voltage_pulse, exact_width_pulse, network_charge, network_flux,
            lattice, wire_limit, ladder, column_serial_delay, kirchhoff,
        )
    }
)  # fmt: skip


def exact_box(case: Case, progress: Callable[[str], None] | None = None) -> tuple[dict[str, bool], dict[str, str]]:
    """What holds, by name, and what does not apply, with the reason; `progress` is called with each name."""
    holds: dict[str, bool] = {}
    skipped: dict[str, str] = {}
    for name, test in EXACT.items():
        if progress is not None:
            progress(name)
        found = test(case)
        if isinstance(found, str):
            skipped[name] = found
        else:
            holds[name] = bool(found)
    return holds, skipped


def case_of(network: Network, hardware: Hardware, *, trial_key: int, arena: Arena, **options: Any) -> Case:
    """A case whose plan is placed here."""
    return Case(plan=place(network, hardware), trial_key=trial_key, arena=arena, **options)


def _not_claimed(case: Case) -> str | None:
    if case.not_ideal:
        laws = ", ".join(f"{kind} ({case.plastic[kind].law})" for kind in case.not_ideal)
        return f"{laws}: the state is not moved by the current alone, so no exactness is claimed"
    return None


def _pulses(case: Case, after: Callable[..., tuple[float, float]], tolerance: float) -> bool | str:
    if not case.plastic:
        return NO_PLASTIC
    reason = _not_claimed(case)
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
    w = np.array([float(device.weight(q / one.top)) for q in levels])
    if reads_with_reference(kind):
        w_off, w_on = float(device.weight(0.0)), float(device.weight(1.0))
        w = (w - w_off) / (w_on - w_off)
    return float(np.abs(w - [one.weight(q) for q in levels]).max())


def _largest_grid(case: Case) -> FloatArray | None:
    """Conductances of the tile with most devices, axes (word_line, bit_line)."""
    plan = case.plan
    if not plan.crosspoints:
        return None
    counts = np.bincount([point.tile for point in plan.crosspoints])
    t = int(counts.argmax())
    g = np.zeros((len(plan.tiles[t].rows), len(plan.tiles[t].columns)))
    for point in plan.crosspoints:
        if point.tile == t:
            g[point.row, point.column] = point.conductance
    return g


def _segment(case: Case) -> float:
    """Ohm per segment of the spec, or 1 where it has none."""
    return case.hardware.wires.r_row.value or 1.0
