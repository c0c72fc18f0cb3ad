"""The figures of a feasibility study: each with value, unit, limit, margin, source and status."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices import Device
from ohmloom.mapping import Hardware, Ledger, Plan, Quantity
from ohmloom.mapping.quantity import ASSUMED as ASSUMED_SOURCE
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP
from ohmloom.sim.statistics import Success, pairs_needed
from ohmloom.units import format_quantity

PASS, MARGINAL, FAIL, ASSUMED, NOT_RUN = "PASS", "MARGINAL", "FAIL", "ASSUMED", "NOT_RUN"
MARGINAL_BELOW = 0.2
TIMESTEP = 0.032  # Section VIII-A
STEP_BUDGET = TIMESTEP / STEPS_PER_TIMESTEP
EVENT_FIDELITY_LIMIT = 0.001
NON_INFERIORITY = -0.05
READ_ERROR_LIMIT = 0.01
WAKE_UP_LIMIT = 0.05  # of full scale: half of what one disabled device in ten would add to a column
USEFUL_RANGE = 0.9  # of W, Section V: "90% of the total range of W within 90 STDP steps"
DESIGN_SOURCE = "ohmloom's criterion"
PARALLELISM = {
    "cell": "one cell at a time",
    "column": "one cell of every column at a time",
    "array": "all cells at once, first up and then down",
}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of a study.

    Attributes
    ----------
    name, value, unit
        What was found, in SI; value None where it was not run.
    limit, margin
        The limit, and (limit - value) / abs(limit) with the sign of the good direction; None without a limit.
    source
        Where the limit comes from.
    status
        PASS, MARGINAL (margin under 20 %), FAIL, ASSUMED (an assumed input decides), or NOT_RUN.
    detail
        How the value comes about, in a sentence.
    """

    name: str
    value: float | None
    unit: str
    limit: float | None
    margin: float | None
    source: str
    status: str
    detail: str

    @property
    def sentence(self) -> str:
        """Why this figure binds, in one sentence that names it."""
        if self.value is None or self.limit is None:
            return f"{self.name}: {self.detail}"
        value, limit = format_quantity(self.value, self.unit), format_quantity(self.limit, self.unit)
        return f"{self.name} is {value} against a limit of {limit} ({self.status}): {self.detail}"


def margin_of(value: float, limit: float, *, low_is_good: bool) -> float:
    """(limit - value) / abs(limit), positive on the good side.

    >>> margin_of(1.0, 2.0, low_is_good=True), margin_of(1.0, 2.0, low_is_good=False)
    (0.5, -0.5)
    """
    return (limit - value if low_is_good else value - limit) / abs(limit)


def status_of(margin: float) -> str:
    """PASS, MARGINAL or FAIL.

    >>> status_of(0.5), status_of(0.1), status_of(-0.1)
    ('PASS', 'MARGINAL', 'FAIL')
    """
    return FAIL if margin < 0.0 else MARGINAL if margin < MARGINAL_BELOW else PASS


def _figure(
    name: str,
    value: Callable[[Mapping[str, float]], float],
    unit: str,
    limit: Quantity | None,
    inputs: Mapping[str, Quantity],
    detail: str,
    *,
    low_is_good: bool,
) -> Figure:
    """A figure that is a formula of spec quantities; it is tried at both ends of every assumed one."""
    nominal = value({key: quantity.value for key, quantity in inputs.items()})
    if limit is None:
        return Figure(name=name, value=nominal, unit=unit, limit=None, margin=None, source="no limit in the spec",
                      status=ASSUMED, detail=detail)  # fmt: skip
    margin = margin_of(nominal, limit.value, low_is_good=low_is_good)
    statuses = set()
    for corner in itertools.product(limit.extremes, *(quantity.extremes for quantity in inputs.values())):
        at_corner = value(dict(zip(inputs, corner[1:], strict=True)))
        statuses.add(status_of(margin_of(at_corner, corner[0], low_is_good=low_is_good)))
    status = status_of(margin) if statuses <= {status_of(margin)} else ASSUMED
    if status == ASSUMED:
        names = [key for key, quantity in inputs.items() if quantity.is_assumed]
        names += ["its limit"] if limit.is_assumed else []
        detail += f" The status rests on what is assumed of {' and '.join(names)}."
    return Figure(name=name, value=nominal, unit=unit, limit=limit.value, margin=margin, source=limit.source,
                  status=status, detail=detail)  # fmt: skip


def time_per_step(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Reading and programming time of the worst step of all dies, against 32 ms / 21."""
    where = max(ledgers, key=lambda name: ledgers[name].worst_programming_time)
    ledger = ledgers[where]
    drive, read = hardware.drive, hardware.read
    columns = ledger.reading_time / read.duration.value
    inputs = {"read.duration": read.duration}
    if drive.mode == "charge_metered":
        inputs["drive.pulse_voltage"] = drive.pulse_voltage

    def value(at: Mapping[str, float]) -> float:
        # A metered pulse is as long as its charge takes, so its time goes with 1/V.
        voltage = at.get("drive.pulse_voltage", drive.pulse_voltage.value)
        return columns * at["read.duration"] + ledger.worst_programming_time * drive.pulse_voltage.value / voltage

    limit = Quantity(value=STEP_BUDGET, source="Howard et al. 2012, Sections IV-A and VIII-A: 32 ms / 21 steps")
    detail = (
        f"the worst step, on {where}, reads for {format_quantity(ledger.reading_time, 's')} and programs for "
        f"{format_quantity(ledger.worst_programming_time, 's')} "
        f"(mean {format_quantity(ledger.mean_programming_time, 's')}), {PARALLELISM[drive.parallelism]}."
    )
    return _figure("time_per_step", value, "s", limit, inputs, detail, low_is_good=True)


def _timesteps(ledger: Ledger) -> float:
    return max(ledger.steps / STEPS_PER_TIMESTEP, 1.0)


def _energy(hardware: Hardware, ledger: Ledger) -> tuple[Callable[[Mapping[str, float]], float], dict[str, Quantity]]:
    """Energy per timestep as a formula of the spec's quantities."""
    drive, read, neuron = hardware.drive, hardware.read, hardware.neuron
    inputs = {"read.voltage": read.voltage, "read.duration": read.duration}
    inputs["neuron.energy_per_spike"] = neuron.energy_per_spike
    if drive.mode == "charge_metered":
        inputs["drive.pulse_voltage"] = drive.pulse_voltage

    def value(at: Mapping[str, float]) -> float:
        voltage = at.get("drive.pulse_voltage", drive.pulse_voltage.value)
        programming = ledger.programming_energy * voltage / drive.pulse_voltage.value
        squared = (at["read.voltage"] / read.voltage.value) ** 2 * at["read.duration"] / read.duration.value
        spikes = ledger.spikes * at["neuron.energy_per_spike"]
        return (programming + ledger.read_energy * squared + spikes) / _timesteps(ledger)

    return value, inputs


def _hungriest(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> str:
    def per_timestep(name: str) -> float:
        energy, inputs = _energy(hardware, ledgers[name])
        return energy({key: quantity.value for key, quantity in inputs.items()})

    return max(ledgers, key=per_timestep)


def programming_power(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Mean power of devices and neurons over a trial, of the die that draws most, if every timestep takes 32 ms."""
    where = _hungriest(hardware, ledgers)
    ledger = ledgers[where]
    energy, inputs = _energy(hardware, ledger)
    per = {
        "programming": ledger.programming_energy,
        "reading": ledger.read_energy,
        "spikes": ledger.spikes * hardware.neuron.energy_per_spike.value,
    }
    shares = ", ".join(f"{name} {format_quantity(e / _timesteps(ledger), 'J')}" for name, e in per.items())
    detail = f"per timestep on {where}: {shares}; if it takes 32 ms; drivers and meters are not in it."
    limit = hardware.limits.programming_power
    return _figure("programming_power", lambda at: energy(at) / TIMESTEP, "W", limit, inputs, detail, low_is_good=True)


def energy_per_timestep(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Energy of devices and neurons per timestep, of the die that draws most; its limit is that of the power."""
    where = _hungriest(hardware, ledgers)
    ledger = ledgers[where]
    energy, inputs = _energy(hardware, ledger)
    power = hardware.limits.programming_power
    limit = None
    if power is not None:
        spread = None if power.range is None else (power.range[0] * TIMESTEP, power.range[1] * TIMESTEP)
        limit = Quantity(value=power.value * TIMESTEP, source=power.source, range=spread)
    pulses = ledger.pulses / _timesteps(ledger)
    detail = f"{pulses:.0f} pulses per timestep on {where}; the limit is that of the power times 32 ms."
    return _figure("energy_per_timestep", energy, "J", limit, inputs, detail, low_is_good=True)


def _busiest(ledgers: Mapping[str, Ledger]) -> str:
    return max(ledgers, key=lambda name: ledgers[name].most_pulses)


def pulses_per_device(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Pulses that the busiest device of all dies gets in a trial."""
    where = _busiest(ledgers)
    ledger = ledgers[where]
    limit = None
    if hardware.limits.endurance is not None:
        pulses, trials = hardware.endurance.pulses, hardware.limits.endurance
        ends = [p / t for p in pulses.extremes for t in trials.extremes]
        sources = f"endurance.pulses ({pulses.source}) / limits.endurance ({trials.source})"
        is_assumed = pulses.is_assumed or trials.is_assumed
        limit = Quantity(
            value=pulses.value / trials.value, source=f"assumed: {sources}" if is_assumed else sources,
            range=(min(ends), max(ends)) if is_assumed else None,
        )  # fmt: skip
    detail = f"the busiest device, on {where}, in a trial of {_timesteps(ledger):.0f} executed timesteps."
    most = float(ledger.most_pulses)
    return _figure("pulses_per_device", lambda _: most, "pulses", limit, {}, detail, low_is_good=True)


def endurance(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Trials until the busiest device has had the pulses it survives."""
    where = _busiest(ledgers)
    ledger = ledgers[where]
    if ledger.most_pulses == 0:
        limit = hardware.limits.endurance
        return Figure(name="endurance", value=None, unit="trials", limit=limit.value if limit else None, margin=None,
                      source=limit.source if limit else "no limit in the spec", status=PASS,
                      detail="no device is pulsed, so none wears out.")  # fmt: skip
    inputs = {"endurance.pulses": hardware.endurance.pulses}
    survives = hardware.endurance.pulses.value
    detail = f"the busiest device, on {where}, gets {ledger.most_pulses:,} pulses a trial and survives {survives:g}."
    return _figure(
        "endurance", lambda at: at["endurance.pulses"] / max(ledger.most_pulses, 1), "trials",
        hardware.limits.endurance, inputs, detail, low_is_good=False,
    )  # fmt: skip


def read_error(hardware: Hardware, plan: Plan) -> Figure:
    """Worst share of the read voltage that a device does not see, with all rows driven and every plastic device at
    G_on."""
    found = {tile.name: tile.read_error.built for tile in plan.tiles if tile.read_error is not None}
    worst = max(found, key=lambda name: found[name]) if found else None
    own = hardware.limits.read_error
    limit = Quantity(value=READ_ERROR_LIMIT, source=DESIGN_SOURCE) if own is None else own
    inputs = {f"wires.{name}": q for name in ("r_row", "r_column") if (q := getattr(hardware.wires, name)).value > 0.0}
    nominal = 0.0 if worst is None else found[worst]

    def value(at: Mapping[str, float]) -> float:
        # Of first order the error goes with the resistance, and it never exceeds 1.
        scale = sum(at.values()) / sum(q.value for q in inputs.values()) if inputs else 1.0
        return nominal * scale / (1.0 - nominal + nominal * scale)

    detail = "no device, or no wire resistance, so nothing drops." if nominal == 0.0 else (
        f"IR drop at the worst crosspoint of the tile {worst}, all rows read at once and every plastic device at G_on."
    )  # fmt: skip
    return _figure("read_error", value, "1", limit, inputs, detail, low_is_good=True)


def wake_up(hardware: Hardware, disabled_weights: FloatArray) -> Figure:
    """Mean weight that devices at crosspoints without a synapse have at the end of a trial."""
    own = hardware.limits.wake_up
    limit = Quantity(value=WAKE_UP_LIMIT, source=DESIGN_SOURCE) if own is None else own
    value = float(disabled_weights.mean()) if disabled_weights.size else 0.0
    what = hardware.array.disabled
    detail = (f"{disabled_weights.size} disabled devices that are {what} conduct with a mean W of {value:.3g} after "
              "a trial."
              if disabled_weights.size else f"disabled crosspoints are {what}, so none conducts or "
                                            "learns.")  # fmt: skip
    return _figure("wake_up", lambda _: value, "1", limit, {}, detail, low_is_good=True)


def useful_events(device: Device, *, is_referenced: bool) -> float:
    """Least number of events that moves W by 0.9.

    A memristive card of ratio 100 has 90.9 of them, the paper's "90 STDP steps" (Section V).
    """
    s = np.linspace(0.0, 1.0, 1_000_001)
    w = np.asarray(device.weight(s), dtype=np.float64)
    if is_referenced:
        w = (w - w[0]) / (w[-1] - w[0])
    if w[-1] - w[0] < USEFUL_RANGE:
        return 0.0
    reached = np.interp(w + USEFUL_RANGE, w, s, right=np.inf)
    return float((reached - s).min() * MEM_LIFETIME)


def useful_event_range(hardware: Hardware, plan: Plan) -> Figure:
    """Smallest useful range among the plastic kinds of the plan."""
    found = {
        tile.kind: useful_events(hardware.devices[tile.kind], is_referenced=tile.has_reference)
        for tile in plan.tiles
        if tile.kind in PLASTIC_KINDS
    }
    limit = hardware.limits.useful_event_range
    if not found:
        return Figure(name="useful_event_range", value=None, unit="events", limit=limit.value if limit else None,
                      margin=None, source=limit.source if limit else "no limit in the spec", status=PASS,
                      detail="no plastic synapse, so no event has to fit.")  # fmt: skip
    kind = min(found, key=lambda k: found[k])
    detail = "events that move W by 0.9: " + ", ".join(f"{k} {v:.1f}" for k, v in found.items()) + "."
    return _figure("useful_event_range", lambda _: found[kind], "events", limit, {}, detail, low_is_good=False)


def event_fidelity(hardware: Hardware, lost: int, spurious: int, ideal: int, dies: int) -> Figure:
    """Lost and spurious events as a fraction of those that eqs. 10 and 11 ask for."""
    if ideal == 0 and lost + spurious == 0:
        return Figure(name="event_fidelity", value=0.0, unit="1", limit=EVENT_FIDELITY_LIMIT, margin=1.0,
                      source=DESIGN_SOURCE, status=PASS,
                      detail="no STDP event was asked for, and none was written.")  # fmt: skip
    value = (lost + spurious) / max(ideal, 1)
    margin = margin_of(value, EVENT_FIDELITY_LIMIT, low_is_good=True)
    where = f"{dies} sampled dies" if dies else "the nominal die"
    detail = f"{lost} lost and {spurious} spurious of {ideal} events on {where}."
    return Figure(name="event_fidelity", value=value, unit="1", limit=EVENT_FIDELITY_LIMIT, margin=margin,
                  source=DESIGN_SOURCE, status=_sampled_status(margin, hardware),
                  detail=detail)  # fmt: skip


def capped_by_cards(figure: Figure, plan: Plan) -> Figure:
    """A figure that follows from device cards cannot pass on assumed values of theirs."""
    assumed = [
        f"{tile.card}.{name}"
        for tile in plan.tiles
        for name, source in plan.hardware.devices[tile.kind].sources.items()
        if source.strip().lower().startswith(ASSUMED_SOURCE)
    ]
    if not assumed or figure.status not in (PASS, MARGINAL):
        return figure
    detail = f"{figure.detail} It rests on what the device cards assume: {', '.join(assumed)}."
    return replace(figure, status=ASSUMED, detail=detail)


def closed_loop_success(hardware: Hardware, success: Success | None) -> Figure:
    """Lower 95 % bound of success on hardware minus success of the ideal controller."""
    name, unit, source = "closed_loop_success", "1", f"{DESIGN_SOURCE}: non-inferiority margin of 5 points"
    if success is None:
        return Figure(name=name, value=None, unit=unit, limit=NON_INFERIORITY, margin=None, source=source,
                      status=NOT_RUN, detail="no die was sampled; run with --dies.")  # fmt: skip
    low, high = success.interval
    margin = margin_of(low, NON_INFERIORITY, low_is_good=False)
    counts = (
        f"{round(success.hardware * success.n)} of {success.n} on hardware, {round(success.ideal * success.n)} ideal, "
        f"95 % interval of the difference {low:+.3f} to {high:+.3f}, McNemar p = {success.p:.3g}"
    )
    if success.ideal == 0.0:
        status, more = FAIL, "the ideal controller never reached the goal, so there is nothing that hardware could keep"
    elif margin >= 0.0:
        status, more = "", ""
    elif high < NON_INFERIORITY:
        status, more = FAIL, "the difference is beyond the margin"
    else:
        # Neither shown to be good enough nor shown not to be: more dies are needed, not another verdict.
        status = NOT_RUN
        needed = pairs_needed(success.only_hardware, success.only_ideal, success.n, NON_INFERIORITY)
        more = f"{success.n} dies do not decide" + (f"; about {needed} would, at this rate" if needed else "")
    if status:
        margin_shown = margin if status == FAIL else None
        return Figure(name=name, value=low, unit=unit, limit=NON_INFERIORITY, margin=margin_shown, source=source,
                      status=status, detail=f"{counts}; {more}.")  # fmt: skip
    return Figure(name=name, value=low, unit=unit, limit=NON_INFERIORITY, margin=margin, source=source,
                  status=_sampled_status(margin, hardware), detail=f"{counts}.")  # fmt: skip


def _sampled_status(margin: float, hardware: Hardware) -> str:
    """A figure from sampled dies cannot pass on assumed non-idealities."""
    status = status_of(margin)
    effects = hardware.quantities().items()
    is_assumed = any(q.is_assumed and q.value > 0.0 for name, q in effects if name.startswith("nonidealities."))
    return ASSUMED if status == PASS and is_assumed else status
