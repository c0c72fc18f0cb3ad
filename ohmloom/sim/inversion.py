"""Requirements: for a figure that fails or is marginal, the least change of one parameter that would pass.

Found by bisection. A figure passes with a margin of 20 %, as in a study. `LEVERS` says in which parameters a figure is
taken to be monotone.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ohmloom.errors import OhmloomError
from ohmloom.mapping import EmulatedController, Hardware, Ledger, Plan, place
from ohmloom.mapping.hardware import UNITS
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.sim import figures_array as array
from ohmloom.sim import figures_behaviour as behaviour
from ohmloom.sim import figures_cost as cost
from ohmloom.sim.agreement import Agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.figures import FAIL, MARGINAL, MARGINAL_BELOW, NON_INFERIORITY, Figure
from ohmloom.sim.sampling import Sampled, sample_dies
from ohmloom.sim.sensitivity import Stream
from ohmloom.sim.verdict import all_ledgers, of_whole_trial
from ohmloom.sim.work import Work
from ohmloom.units import format_quantity

PRECISION = 0.005  # of the parameter: what is printed has three digits
REACH = 1e4  # how many times larger or smaller a parameter may become
SPREAD_DIES = 40
SPREADS = "nonidealities"


@dataclass(frozen=True, kw_only=True)
class Needs:
    """What a study knows when it asks for requirements.

    Attributes
    ----------
    plan, arena, seed
        What is placed where; the world; of starts and dies.
    check
        The nominal die beside the discrete controller.
    sampled
        What the sampled dies did.
    whole
        Timesteps of the whole trial, where `check` saw only its beginning.
    work
        Where dies are tried.
    """

    plan: Plan
    arena: Arena
    seed: int
    check: Agreement
    sampled: Sampled
    whole: int | None = None
    work: Work | None = None

    @property
    def nominal(self) -> Ledger:
        """What the nominal die spends in a whole trial."""
        return of_whole_trial(self.check, self.whole)

    @property
    def ledgers(self) -> dict[str, Ledger]:
        """What the nominal and the sampled dies spent."""
        return all_ledgers(self.check, self.sampled, self.whole)


@dataclass(frozen=True, kw_only=True)
class Lever:
    """A parameter, where it stands, where it may go, and the margin that a figure has there.

    Attributes
    ----------
    parameter, unit, now, end
        ``end`` is the farthest value tried, on the side on which the figure gets better.
    margin
        Margin of the figure at a value, rising towards ``end``.
    note
        What else changes with it.
    """

    parameter: str
    unit: str
    now: float
    end: float
    margin: Callable[[float], float]
    note: str = ""


def requirements(figures: tuple[Figure, ...], case: Needs) -> tuple[dict[str, Any], ...]:
    """What each failing or marginal figure needs, one row a parameter; ``needed`` is None where it does not help."""
    rows = []
    for figure in figures:
        if figure.status not in (FAIL, MARGINAL):
            continue
        for lever in LEVERS.get(figure.name, _none)(case):
            needed = least_change(lever)
            rows.append({"figure": figure.name, "parameter": lever.parameter, "unit": lever.unit, "now": lever.now,
                         "needed": needed, "sentence": _sentence(figure.name, lever, needed)})  # fmt: skip
    return tuple(rows)


def least_change(lever: Lever) -> float | None:
    """Value nearest to ``now`` at which the figure passes, to half a percent; None if it does not even at the end.

    A lever that can go down to 0 is halved on a linear scale, any other on a logarithmic one.

    >>> found = least_change(Lever(parameter="x", unit="s", now=1.0, end=100.0, margin=lambda x: x / 10.0 - 0.8))
    >>> 10.0 <= found <= 10.1
    True
    """
    if lever.margin(lever.end) < MARGINAL_BELOW:
        return None
    bad, good = lever.now, lever.end
    while abs(good - bad) > PRECISION * abs(good) and abs(good - bad) > 1e-6 * abs(lever.now):
        middle = math.sqrt(bad * good) if good > 0.0 and bad > 0.0 else 0.5 * (bad + good)
        if lever.margin(middle) >= MARGINAL_BELOW:
            good = middle
        else:
            bad = middle
    return good


def _sentence(figure: str, lever: Lever, needed: float | None) -> str:
    now = format_quantity(lever.now, lever.unit)
    if needed is None:
        end = format_quantity(lever.end, lever.unit)
        return f"{figure} does not pass for any {lever.parameter} from {now} to {end}{lever.note}"
    sign = ">=" if lever.end > lever.now else "<="
    return f"{figure} passes if {lever.parameter} {sign} {format_quantity(needed, lever.unit)} (now {now}){lever.note}"


def _none(_: Needs) -> Iterator[Lever]:
    return iter(())


def _margin(figure: Figure) -> float:
    return math.inf if figure.margin is None else figure.margin


def with_resistance(hardware: Hardware, kind: str, r_on: float, folder: Path) -> Hardware:
    """The same spec with a card of another R_on and the same ratio for one kind, saved in `folder`."""
    card = hardware.devices[kind]
    scaled = card.replace(r_on=r_on, r_off=card.parameters["r_off"] * r_on / card.parameters["r_on"])
    path = folder / f"{kind}.toml"
    scaled.save(path)
    return hardware.model_copy(update={"cards": {**hardware.cards, kind: str(path)}})


def _scalable_kinds(plan: Plan) -> list[str]:
    devices = plan.hardware.devices
    return sorted({t.kind for t in plan.tiles if {"r_on", "r_off"} <= set(devices[t.kind].parameters)})


def _r_on(case: Needs, margin: Callable[[Hardware], float], kinds: list[str]) -> Iterator[Lever]:
    hardware = case.plan.hardware
    for kind in kinds:
        now = hardware.devices[kind].parameters["r_on"]

        def at_r_on(r_on: float, kind: str = kind) -> float:
            with tempfile.TemporaryDirectory() as folder:
                return _or_worst(lambda: margin(with_resistance(hardware, kind, r_on, Path(folder))))

        yield Lever(parameter=f"devices.{kind}.r_on", unit="Ohm", now=now, end=REACH * now, margin=at_r_on,
                    note=", at the same ratio of R_off to R_on")  # fmt: skip


def _wires(case: Needs, margin: Callable[[Hardware], float]) -> Iterator[Lever]:
    hardware = case.plan.hardware
    both = {n: q.value for n in ("r_row", "r_column") if (q := getattr(hardware.wires, n)).value > 0.0}
    if both:
        now = max(both.values())

        def at_wire(r: float) -> float:
            return _or_worst(lambda: margin(hardware.with_values({f"wires.{n}": v * r / now for n, v in both.items()})))

        name = max(both, key=lambda n: both[n])
        yield Lever(parameter=f"wires.{name}", unit="Ohm", now=now, end=now / REACH, margin=at_wire,
                    note=", rows and columns in proportion")  # fmt: skip


def _or_worst(margin: Callable[[], float]) -> float:
    # What cannot be placed does not pass.
    try:
        return margin()
    except OhmloomError:
        return -math.inf


def _read_error(case: Needs) -> Iterator[Lever]:
    def margin(hardware: Hardware) -> float:
        return _margin(array.read_error(hardware, _placed_alike(case.plan, hardware)))

    worst = max((t for t in case.plan.tiles if t.read_error), key=lambda t: t.read_error.built if t.read_error else 0.0)
    yield from _r_on(case, margin, [kind for kind in _scalable_kinds(case.plan) if kind == worst.kind])
    yield from _wires(case, margin)


def _placed_alike(plan: Plan, hardware: Hardware) -> Plan:
    """Placed again in as many tiles: smaller ones are another way to pass, with other costs."""
    uncut = place(plan.network, hardware.with_values({"limits.read_error": 1.0}))
    return uncut if len(uncut.tiles) == len(plan.tiles) else place(plan.network, hardware)


def _event_fidelity(case: Needs) -> Iterator[Lever]:
    """Wires where the nominal die loses events, else the spread of thresholds."""
    stream = Stream.of(case.plan, case.arena, seed=case.seed)

    def margin(hardware: Hardware) -> float:
        # Where each synapse stands is left as it is: only what its device sees is asked for.
        emulated = EmulatedController(replace(case.plan, hardware=hardware).nominal())
        for sensors in stream.sensors:
            emulated.step(sensors)
        ledger = emulated.ledger
        return _margin(behaviour.event_fidelity(hardware, ledger.lost, ledger.spurious, ledger.ideal_events, 0))

    if margin(case.plan.hardware) < MARGINAL_BELOW:
        kinds = [kind for kind in _scalable_kinds(case.plan) if kind in PLASTIC_KINDS]
        yield from _r_on(case, margin, kinds)
        yield from _wires(case, margin)
    else:
        yield from _spread_of_thresholds(case, behaviour.EVENT_FIDELITY_LIMIT * case.nominal.ideal_events)


def _spread_of_thresholds(case: Needs, limit: float = array.MISFIRES_LIMIT) -> Iterator[Lever]:
    spread = case.plan.hardware.nonidealities.threshold
    if spread is not None and spread.value > 0.0:

        def margin(sigma: float) -> float:
            changed = case.plan.hardware.with_values({"nonidealities.threshold": sigma})
            value = array.threshold_margin(changed, case.nominal).value
            return 1.0 - (value or 0.0) / limit

        yield Lever(parameter="nonidealities.threshold", unit="1", now=spread.value, end=0.0, margin=margin)


def _simple(
    name: str, figure: Callable[[Needs, Hardware], Figure], *, up: bool, note: str = ""
) -> Callable[[Needs], Iterator[Lever]]:
    """A lever whose figure is a formula of the spec's quantities."""

    def levers(case: Needs) -> Iterator[Lever]:
        quantity = case.plan.hardware.quantities().get(name)
        if quantity is not None and quantity.value > 0.0:
            end = quantity.value * REACH if up else quantity.value / REACH
            yield Lever(parameter=name, unit=UNITS[name], now=quantity.value, end=end, note=note,
                        margin=lambda x: _margin(figure(case, case.plan.hardware.with_values({name: x}))))  # fmt: skip

    return levers


def _time_per_step(case: Needs) -> Iterator[Lever]:
    """Voltage of a metered pulse, whose time goes with its inverse; duration of pulses of fixed length."""
    hardware = case.plan.hardware
    voltage, budget = hardware.drive.pulse_voltage.value, cost.STEP_BUDGET
    slowest = max(case.ledgers.values(), key=lambda ledger: ledger.worst_programming_time)
    reads, writes = slowest.reading_time, slowest.worst_programming_time
    if hardware.drive.mode in ("charge_metered", "exact_width", "voltage") and hardware.drive.pulse_duration is None:
        yield Lever(parameter="drive.pulse_voltage", unit="V", now=voltage, end=voltage * REACH,
                    margin=lambda v: 1.0 - (reads + writes * voltage / v) / budget,
                    note=", with the threshold in proportion")  # fmt: skip
    if hardware.drive.pulse_duration is not None:
        now = hardware.drive.pulse_duration.value
        yield Lever(parameter="drive.pulse_duration", unit="s", now=now, end=now / REACH,
                    margin=lambda t: 1.0 - (reads + writes * t / now) / budget,
                    note=", with a current or voltage that brings the same charge or flux")  # fmt: skip
    if hardware.drive.parallelism != "array" and writes > 0.0:
        at_once = max(len(t.rows) * (len(t.columns) if hardware.drive.parallelism == "cell" else 1)
                      for t in case.plan.tiles)  # fmt: skip
        yield Lever(parameter="drive.parallelism", unit="1", now=1.0, end=float(at_once),
                    margin=lambda n: 1.0 - (reads + writes / n) / budget,
                    note=", in cells of a line that are written side by side")  # fmt: skip


def _power(case: Needs) -> Iterator[Lever]:
    def at_voltage(c: Needs, hardware: Hardware) -> Figure:
        # The ledgers' energy is that of the spec's own voltage, and goes with it where the charge is given.
        scale = hardware.drive.pulse_voltage.value / c.plan.hardware.drive.pulse_voltage.value
        scaled = {k: replace(one, programming_energy=one.programming_energy * scale) for k, one in c.ledgers.items()}
        return cost.programming_power(hardware, scaled)

    if case.plan.hardware.drive.mode == "charge_metered":
        yield from _simple("drive.pulse_voltage", at_voltage, up=False, note=", with the threshold in proportion")(case)


def _spreads(case: Needs) -> Iterator[Lever]:
    """All spreads times one factor; decided by the difference itself, since so few dies leave wide intervals."""
    hardware = case.plan.hardware
    spreads = {
        name: q.value for name, q in hardware.quantities().items()
        if name.startswith(SPREADS) and q.value > 0.0 and UNITS[name] == "1"
    }  # fmt: skip
    given = case.sampled.success
    if not spreads or (given is not None and given.ideal == 0.0):  # nothing to lose it by, or nothing to lose
        return

    def margin(factor: float) -> float:
        plan = replace(case.plan, hardware=hardware.with_values({name: factor * x for name, x in spreads.items()}))
        success = sample_dies(plan, case.arena, dies=SPREAD_DIES, seed=case.seed, work=case.work).success
        assert success is not None
        return MARGINAL_BELOW if success.hardware - success.ideal >= NON_INFERIORITY else -1.0

    at_factor = _six(margin)
    if at_factor(1.0) < MARGINAL_BELOW:  # else it is the dies that are too few, not the spreads too large
        yield Lever(parameter=SPREADS, unit="1", now=1.0, end=1.0 / 64.0, margin=at_factor,
                    note=f": all spreads times one factor, by the difference on {SPREAD_DIES} dies")  # fmt: skip


def _six(margin: Callable[[float], float]) -> Callable[[float], float]:
    """A margin on a grid of factors of two, so that no more than six are ever sampled."""
    known: dict[int, float] = {}

    def on_grid(x: float) -> float:
        k = math.floor(math.log2(x) + 1e-9)
        if k not in known:
            known[k] = margin(2.0**k)
        return known[k]

    return on_grid


LEVERS: MappingProxyType[str, Callable[[Needs], Iterator[Lever]]] = MappingProxyType({
    "event_fidelity": _event_fidelity,
    "threshold_margin": _spread_of_thresholds,
    "read_error": _read_error,
    "disturb": lambda case: (
        lever for name in ("nonidealities.half_select", "nonidealities.read_disturb") for lever in _simple(
            name, lambda c, h: array.disturb(h, c.plan, c.nominal, c.check.spikes), up=False)(case)
    ),
    "time_per_step": _time_per_step,
    "programming_power": _power,
    "endurance": _simple("endurance.pulses", lambda c, h: cost.endurance(h, c.ledgers), up=True),
    "closed_loop_success": _spreads,
})  # fmt: skip
