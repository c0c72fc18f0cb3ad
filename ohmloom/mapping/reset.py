"""Back to the start of a trial: write-verify of every device, with pulses, time and energy."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from ohmloom.circuits.tables import write_rows
from ohmloom.devices import Device
from ohmloom.errors import expect_type
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.passage import Passage, passage, pulse_duration
from ohmloom.mapping.plan import Plan
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS

STEP: Final = 1e-4  # of s, for the slope of the conductance at the target


@dataclass(frozen=True, kw_only=True)
class DeviceReset:
    """One device back to its initial conductance, from that end of its range from which it takes longer.

    Attributes
    ----------
    synapse, tile, row, column
        Where it stands.
    target, tolerance
        Conductance to reach, and how far off it may stay [S].
    from_off, from_on
        Time of the pulses from either end of the range [s]; infinite where the drive does not get there.
    start, sign
        The end that is counted, 0 or 1, and the sign of the pulses.
    pulses
        Whole pulses, then shorter ones, so that the last cannot step over the tolerance.
    last_part
        Longest of the last pulses, as a part of a whole one.
    duration, energy
        With a read after every pulse [s]; in the device [J].
    every_trial
        False for a programmed device, which is written once.
    """

    synapse: int
    tile: int
    row: int
    column: int
    target: float
    tolerance: float
    from_off: float
    from_on: float
    start: int
    sign: int
    pulses: int
    last_part: float
    duration: float
    energy: float
    every_trial: bool


@dataclass(frozen=True, kw_only=True)
class ResetPlan:
    """Reset of all devices of a plan.

    Attributes
    ----------
    devices
        In the order of the plan's crosspoints.
    tile_durations
        Of each tile, its plastic devices only [s]; cells one after the other, columns side by side, or row by row, as
        ``drive.parallelism`` has it.
    duration, energy
        Of a reset before a trial; tiles are written side by side [s], [J].
    first_duration
        Of programming the constant synapses, once [s].
    """

    devices: tuple[DeviceReset, ...]
    tile_durations: tuple[float, ...]
    duration: float
    energy: float
    first_duration: float

    def table(self) -> list[dict[str, Any]]:
        """One row a device; units in the column names."""
        units = {"target": "S", "tolerance": "S", "from_off": "s", "from_on": "s", "duration": "s", "energy": "J"}
        return [
            {f"{key}_{units[key]}" if key in units else key: value for key, value in asdict(device).items()}
            for device in self.devices
        ]

    def write_csv(self, path: Path | str) -> None:
        """Write `table`, whole or not at all."""
        rows = self.table()
        names = [f.name for f in fields(DeviceReset)] if not rows else list(rows[0])
        write_rows(path, names, [list(row.values()) for row in rows])


def plan_reset(plan: Plan) -> ResetPlan:
    """How every device gets back to its initial conductance before a trial.

    A trial leaves a plastic device anywhere in its range, so each is counted from the end from which the spec's pulses
    take longer. After every pulse the device is read; the tolerance is the standard deviation that the spec states for
    write-verify.

    Raises
    ------
    ParameterError
        If `plan` is no Plan.

    Examples
    --------
    >>> from ohmloom.mapping import Hardware, place
    >>> from ohmloom.neurocontroller import champion
    >>> reset = plan_reset(place(champion("HP"), Hardware.load("hp_1t1r")))
    >>> reset.devices[0].pulses, round(reset.devices[0].from_off, 3)
    (990, 0.5)
    """
    expect_type("plan_reset.plan", plan, Plan)
    hardware, cards = plan.hardware, plan.hardware.devices
    verify = hardware.read.duration.value
    if hardware.converter is not None and hardware.converter.duration is not None:
        verify += hardware.converter.duration.value
    found = []
    for point in plan.crosspoints:
        kind = plan.tiles[point.tile].kind
        device = cards[kind]
        up, down = passage(device, 0.0, point.state, hardware), passage(device, 1.0, point.state, hardware)
        is_down = down.duration > up.duration
        chosen = down if is_down else up
        tolerance = _tolerance(device, hardware)
        part = _last_part(device, point.state, tolerance)
        pulses = _pulses(device, hardware, chosen, part)
        found.append(DeviceReset(
            synapse=point.synapse, tile=point.tile, row=point.row, column=point.column, target=point.conductance,
            tolerance=tolerance, from_off=up.duration, from_on=down.duration, start=int(is_down),
            sign=-1 if is_down else 1, pulses=pulses, last_part=part, duration=chosen.duration + pulses * verify,
            energy=chosen.energy, every_trial=kind in PLASTIC_KINDS,
        ))  # fmt: skip
    tiles = range(len(plan.tiles))
    durations = tuple(_tile_duration([d for d in found if d.tile == t and d.every_trial], hardware) for t in tiles)
    first = [_tile_duration([d for d in found if d.tile == t and not d.every_trial], hardware) for t in tiles]
    return ResetPlan(
        devices=tuple(found), tile_durations=durations, duration=max(durations, default=0.0),
        energy=sum(d.energy for d in found if d.every_trial), first_duration=max(first, default=0.0),
    )  # fmt: skip


def _tolerance(device: Device, hardware: Hardware) -> float:
    spread = hardware.nonidealities.write_verify
    return 0.0 if spread is None else float(spread.value * device.conductance(1.0))


def _last_part(device: Device, state: float, tolerance: float) -> float:
    """Part of a pulse that moves the conductance by no more than the width of the band around the target."""
    low, high = max(state - STEP, 0.0), min(state + STEP, 1.0)
    slope = float(device.conductance(high) - device.conductance(low)) / (high - low)
    step = slope / MEM_LIFETIME
    return 1.0 if tolerance == 0.0 else min(1.0, 2.0 * tolerance / step)


def _pulses(device: Device, hardware: Hardware, chosen: Passage, part: float) -> int:
    fixed = pulse_duration(device, hardware)
    whole = chosen.events if hardware.drive.mode != "voltage" or fixed is None else chosen.duration / fixed
    if not math.isfinite(whole):
        return 0
    rest = whole - math.floor(whole)
    return math.floor(whole) + math.ceil(rest / part)


def _tile_duration(devices: list[DeviceReset], hardware: Hardware) -> float:
    parallelism = hardware.drive.parallelism
    if not devices:
        return 0.0
    if parallelism == "cell":
        return sum(d.duration for d in devices)
    if parallelism == "column":
        return max(sum(d.duration for d in devices if d.column == j) for j in {d.column for d in devices})
    # Verified cells end one by one, so an array without selection goes row by row, with half the voltage on the others.
    return sum(max(d.duration for d in devices if d.row == i) for i in {d.row for d in devices})
