"""Pulse schedule: what every line does in each slot while a network runs for some steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.circuits import PulseTrain
from ohmloom.circuits.tables import write_rows
from ohmloom.errors import MappingError, ParameterError, expect_integer, expect_type
from ohmloom.mapping.passage import Pulse, pulse, pulse_duration
from ohmloom.mapping.plan import Crosspoint, Plan
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS

BoolArray = npt.NDArray[np.bool_]
Event = tuple[Crosspoint, int]  # where, and its sign
STEP: Final = 0.032 / 21  # s: a timestep of 32 ms has 21 steps
SENSORS: Final = (0.5,) * 6  # without a history: every sensor half activated
EDGE: Final = 0.01  # of the shortest slot: edges of a pulse train, where the spec names none
COLUMNS: Final = (
    "tile", "step", "slot", "action", "begin_s", "end_s", "line", "neuron", "voltage_V", "current_A", "selects",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Slot:
    """A span of time in which no line of a tile changes.

    Attributes
    ----------
    tile, step
        Which tile, and which step of the network.
    action
        ``read`` or ``write``.
    begin, duration
        [s].
    rows, columns
        Lines held at a voltage other than 0: index and voltage [V].
    selected
        Cells (row, column) that are read or written; the transistors of all others are closed, if there are any.
    current
        Into the selected cell [A], where the drive pushes currents; else None.
    energy, idle_energy
        In the selected devices, and in those that see a part of the voltage [J].
    """

    tile: int
    step: int
    action: str
    begin: float
    duration: float
    rows: tuple[tuple[int, float], ...]
    columns: tuple[tuple[int, float], ...]
    selected: tuple[tuple[int, int], ...]
    current: float | None = None
    energy: float = 0.0
    idle_energy: float = 0.0

    @property
    def end(self) -> float:
        """[s]."""
        return self.begin + self.duration


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """All slots of all tiles for a history of spikes.

    Attributes
    ----------
    plan, spikes
        What runs, and which neuron spiked in which step, axes (step, neuron).
    slots
        By step, tile and time. Tiles work side by side; a step begins when the last tile has ended the one before.
    busy
        Time that each step needs, axes (step,) [s].
    """

    plan: Plan
    spikes: BoolArray
    slots: tuple[Slot, ...]
    busy: tuple[float, ...]

    @property
    def late_steps(self) -> int:
        """Steps that need more than the 1.524 ms they have."""
        return sum(time > STEP for time in self.busy)

    def table(self) -> list[dict[str, Any]]:
        """One row for each driven line of each slot, with the neuron's name; units in the column names."""
        labels, rows = self.plan.network.labels(), []
        for number, slot in enumerate(self.slots):
            tile = self.plan.tiles[slot.tile]
            cells = " ".join(f"{i}/{j}" for i, j in slot.selected)
            lines = [(f"row {i}", labels[tile.rows[i]], v) for i, v in slot.rows]
            lines += [(f"column {j}", labels[tile.columns[j]], v) for j, v in slot.columns]
            for line, neuron, voltage in lines or [("", "", 0.0)]:
                rows.append(dict(zip(COLUMNS, (
                    slot.tile, slot.step, number, slot.action, slot.begin, slot.end, line, neuron,
                    voltage, "" if slot.current is None else slot.current, cells,
                ), strict=True)))  # fmt: skip
        return rows

    def write_csv(self, path: Path | str) -> None:
        """Write `table`, whole or not at all."""
        write_rows(path, list(COLUMNS), [list(row.values()) for row in self.table()])

    def train(self, tile: int) -> PulseTrain:
        """The slots of one tile as pulses on its lines, for `MemristorCrossbar.simulate` and decks.

        Each pulse keeps its slot; its edges take a hundredth of the shortest slot, inside it.

        Raises
        ------
        MappingError
            If cells are selected by transistors, which a pulse on a line cannot say, or nothing is driven.
        """
        tile = expect_integer("Schedule.train.tile", tile, 0, len(self.plan.tiles) - 1)
        if self.plan.hardware.array.access != "passive":
            raise MappingError(f"Schedule.train: expected array.access = 'passive', got "
                               f"{self.plan.hardware.array.access!r} of {self.plan.hardware.name}. Lines alone do not "
                               "say which cell a transistor selects; use the table.")  # fmt: skip
        slots = [slot for slot in self.slots if slot.tile == tile and (slot.rows or slot.columns)]
        if not slots:
            raise MappingError(f"Schedule.train: expected pulses on tile {tile}, got none. Give a longer history.")
        made = self.plan.tiles[tile]
        edge = EDGE * min(slot.duration for slot in slots)
        t, v_row, v_column = [0.0], [np.zeros(len(made.rows))], [np.zeros(len(made.columns))]
        for slot in slots:
            rows, columns = np.zeros(len(made.rows)), np.zeros(len(made.columns))
            for lines, volts in ((rows, slot.rows), (columns, slot.columns)):
                for k, v in volts:
                    lines[k] = v
            corners = ((slot.begin, 0.0), (slot.begin + edge, 1.0), (slot.end - edge, 1.0), (slot.end, 0.0))
            for time, share in corners:
                if time > t[-1]:
                    t.append(time)
                    v_row.append(share * rows)
                    v_column.append(share * columns)
        return PulseTrain(t=np.array(t), v_row=np.array(v_row), v_column=np.array(v_column))


def first_spikes(network: Network, steps: int = 21, *, sensors: tuple[float, ...] = SENSORS) -> BoolArray:
    """Spikes of the ideal network in its first steps under constant sensors, axes (step, neuron)."""
    controller = SpikingController(network)
    controller.begin_timestep()
    return np.array([controller.spikes(sensors) for _ in range(steps)], dtype=np.bool_).reshape(steps, network.neurons)


def pulse_schedule(plan: Plan, spikes: npt.ArrayLike | None = None) -> Schedule:
    """Read slots, then programming slots, of every step, for given spikes.

    While a column is read, the row of each of its synapses is driven if the tap of its shift register holds a spike.
    Then every line takes the level of its neuron's ls, and the spec's parallelism says which cells are selected when.
    Devices move along, since a metered pulse lasts as long as its device needs.

    Parameters
    ----------
    plan
        What is placed where.
    spikes
        Which neuron spiked in which step, axes (step, neuron); by default the first timestep of the ideal network with
        all sensors at 0.5.

    Raises
    ------
    ParameterError
        If `spikes` has other axes.
    MappingError
        If the spec has skewed clocks, for which a step is not one moment.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import champion
    >>> schedule = pulse_schedule(place(champion("HP"), Hardware.load("hp_1t1r")))
    >>> len(schedule.busy), schedule.slots[0].action
    (21, 'read')
    """
    expect_type("pulse_schedule.plan", plan, Plan)
    if plan.hardware.array.delays == "retimed":
        raise MappingError(f"pulse_schedule: expected array.delays = 'column_serial', got 'retimed' of "
                           f"{plan.hardware.name}: with skewed clocks a step is not one moment.")  # fmt: skip
    network = plan.network
    history = first_spikes(network) if spikes is None else np.asarray(spikes)
    if history.dtype != np.bool_ or history.ndim != 2 or history.shape[1] != network.neurons:
        raise ParameterError(f"pulse_schedule.spikes: expected booleans, axes (step, neuron={network.neurons}), got "
                             f"{history.dtype} of shape {history.shape}. Give one column a neuron.")  # fmt: skip
    states = np.array([point.state for point in plan.crosspoints])
    ls = np.zeros(network.neurons, dtype=np.int64)
    slots: list[Slot] = []
    busy, now = [], 0.0
    for step in range(len(history)):
        ls[history[step]] = network.readings.last_spike
        reads = [slot for t in range(len(plan.tiles)) for slot in _reads(plan, t, step, history, now)]
        read_end = max((slot.end for slot in reads), default=now)
        writes = [
            slot
            for t, tile in enumerate(plan.tiles)
            if tile.kind in PLASTIC_KINDS
            for slot in _writes(plan, t, step, ls, states, read_end)
        ]
        slots += [*reads, *writes]
        end = max((slot.end for slot in (*reads, *writes)), default=now)
        busy.append(end - now)
        now = max(now + STEP, end)
        ls = np.maximum(ls - 1, 0)
    return Schedule(plan=plan, spikes=history, slots=tuple(slots), busy=tuple(busy))


def _reads(plan: Plan, tile: int, step: int, history: BoolArray, begin: float) -> Iterator[Slot]:
    """Columns one after the other."""
    volts, duration = plan.hardware.read.voltage.value, plan.hardware.read.duration.value
    if plan.hardware.converter is not None and plan.hardware.converter.duration is not None:
        duration += plan.hardware.converter.duration.value
    by_row = plan.hardware.array.signs == "row_polarity"
    points = [p for p in plan.crosspoints if p.tile == tile]
    for j in range(len(plan.tiles[tile].columns)):
        cells = [p for p in points if p.column == j]
        rows = [
            (p.row, volts * (p.polarity if by_row else 1))
            for p in cells
            if step >= p.tap and history[step - p.tap, plan.network.synapses[p.synapse].pre]
        ]
        yield Slot(
            tile=tile, step=step, action="read", begin=begin + j * duration, duration=duration, columns=(),
            rows=tuple(sorted(rows)), selected=tuple(sorted((p.row, p.column) for p in cells)),
        )  # fmt: skip


def _writes(plan: Plan, tile: int, step: int, ls: IntArray, states: FloatArray, begin: float) -> Iterator[Slot]:
    drive, made = plan.hardware.drive, plan.tiles[tile]
    points = [p for p in plan.crosspoints if p.tile == tile]
    for phase in drive.volts.phases:
        level = {p: phase.column[ls[made.columns[p.column]]] - phase.row[ls[made.rows[p.row]]] for p in points}
        fired = [(p, 1 if v > 0.0 else -1) for p, v in level.items() if abs(v) > drive.threshold.value]
        lines = (
            tuple((i, phase.row[ls[pre]]) for i, pre in enumerate(made.rows) if phase.row[ls[pre]] != 0.0),
            tuple((j, phase.column[ls[q]]) for j, q in enumerate(made.columns) if phase.column[ls[q]] != 0.0),
        )
        split = _all_at_once if drive.parallelism == "array" else _one_by_one
        for slot in split(plan, Slot(tile=tile, step=step, action="write", begin=begin, duration=phase.duration,
                                     rows=lines[0], columns=lines[1], selected=()), fired, states):  # fmt: skip
            yield slot
            begin = max(begin, slot.end)


def _all_at_once(plan: Plan, phase: Slot, fired: list[Event], states: FloatArray) -> Iterator[Slot]:
    """Every line at its level; currents of both signs cannot share a line, voltages can."""
    kind, begin = plan.tiles[phase.tile].kind, phase.begin
    if plan.hardware.drive.mode == "voltage":
        fixed = pulse_duration(plan.hardware.devices[kind], plan.hardware)
        assert fixed is not None
        duration = fixed * phase.duration
        idle = duration * sum(_power(plan, point, phase, states) for point in _others(plan, phase.tile, fired))
        done = _moved(plan, kind, fired, states, phase.duration)
        if phase.rows or phase.columns:
            yield replace(phase, duration=duration, selected=_cells(fired), idle_energy=idle,
                          energy=sum(p.energy for p in done))  # fmt: skip
        return
    for sign in (1, -1):
        group = [event for event in fired if event[1] == sign]
        if group:
            done = _moved(plan, kind, group, states, phase.duration)
            duration = max(p.duration for p in done)
            yield replace(phase, begin=begin, duration=duration, selected=_cells(group),
                          current=_current(plan, kind, sign), energy=sum(p.energy for p in done))  # fmt: skip
            begin += duration


def _one_by_one(plan: Plan, phase: Slot, fired: list[Event], states: FloatArray) -> Iterator[Slot]:
    """One cell at a time, in the whole tile or in each column."""
    kind, clocks = plan.tiles[phase.tile].kind, dict[int, float]()
    for point, sign in sorted(fired, key=lambda event: (event[0].column, event[0].row)):
        line = point.column if plan.hardware.drive.parallelism == "column" else 0
        begin = clocks.get(line, phase.begin)
        done = _moved(plan, kind, [(point, sign)], states, phase.duration)[0]
        yield replace(
            phase, begin=begin, duration=done.duration, energy=done.energy,
            rows=tuple(r for r in phase.rows if r[0] == point.row),
            columns=tuple(c for c in phase.columns if c[0] == point.column), selected=_cells([(point, sign)]),
            current=_current(plan, kind, sign),
        )  # fmt: skip
        clocks[line] = begin + done.duration


def _cells(events: list[Event]) -> tuple[tuple[int, int], ...]:
    return tuple(sorted((point.row, point.column) for point, _ in events))


def _moved(plan: Plan, kind: str, events: list[Event], states: FloatArray, share: float) -> list[Pulse]:
    """Write the cells; what each pulse did."""
    device, done = plan.hardware.devices[kind], []
    for point, sign in events:
        done.append(pulse(device, float(states[point.synapse]), sign, plan.hardware, share))
        states[point.synapse] = done[-1].state
    return done


def _others(plan: Plan, tile: int, fired: list[Event]) -> list[Crosspoint]:
    selected = {point for point, _ in fired}
    return [point for point in plan.crosspoints if point.tile == tile and point not in selected]


def _power(plan: Plan, point: Crosspoint, phase: Slot, states: FloatArray) -> float:
    """Of a device that sees what its two lines are held at [W]."""
    volts = dict(phase.columns).get(point.column, 0.0) - dict(phase.rows).get(point.row, 0.0)
    device = plan.hardware.devices[plan.tiles[point.tile].kind]
    return volts**2 * float(device.conductance(float(states[point.synapse])))


def _current(plan: Plan, kind: str, sign: int) -> float | None:
    drive = plan.hardware.drive
    if drive.mode != "current" or drive.pulse_duration is None:
        return None
    return sign * plan.hardware.devices[kind].charge_scale / MEM_LIFETIME / drive.pulse_duration.value
