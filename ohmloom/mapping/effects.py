"""Values of the non-idealities as they act on a die, of temperature and of the time that lines take to settle."""

from __future__ import annotations

import math

from ohmloom.mapping.die import Die, physical_shape
from ohmloom.mapping.hardware import Hardware
from ohmloom.mapping.plan import Plan
from ohmloom.mapping.pulses import pulse_area

TIMESTEP = 0.032  # [s], Section VIII-A
BOLTZMANN = 8.617333262e-5  # [eV/K], CODATA 2018


def line_delay(plan: Plan) -> float:
    """Sum of the Elmore delays of the longest row and the longest column of a plan [s]; 0 without capacitance."""
    wires, (m, width) = plan.hardware.wires, widest_tile(plan)
    if wires.c_segment is None:
        return 0.0
    ohm, c = wires.resistances, wires.c_segment.value
    row = c * width * (ohm["r_driver"] + ohm["r_row"] * (width + 1) / 2.0)
    return row + c * m * (ohm["r_sense"] + ohm["r_column"] * (m + 1) / 2.0)


class Effects:
    """Values of the effects that act on this die; none on the nominal one."""

    def __init__(self, die: Die) -> None:
        self._spec = None if die.seed is None else die.plan.hardware.nonidealities
        self._plan, self._hardware = die.plan, die.plan.hardware

    def __getitem__(self, name: str) -> float:
        quantity = None if self._spec is None else getattr(self._spec, name)
        return 0.0 if quantity is None else float(quantity.value)

    @property
    def bits(self) -> int:
        if self._spec is None:
            return 0
        converter = self._hardware.converter
        own = None if converter is None else converter.bits
        return int(self["quantisation"]) if own is None else int(own.value)

    @property
    def settled(self) -> float:
        constant = self["settling"] + (0.0 if self._spec is None else line_delay(self._plan))
        return 1.0 if constant == 0.0 else 1.0 - math.exp(-self._hardware.read.duration.value / constant)

    @property
    def decay(self) -> float:
        constant = 0.0 if self._spec is None else retention_time(self._hardware)
        return 1.0 if constant is None or constant == 0.0 else math.exp(-TIMESTEP / constant)

    @property
    def pulse_size(self) -> float:
        """What shape and temperature leave of an event."""
        size = pulse_area(self._hardware.drive)
        return size if self._spec is None else size * speed_up(self._hardware, "drift_activation")


def speed_up(hardware: Hardware, energy: str) -> float:
    """How much faster a process of this activation energy is than at the cards' temperature (Arrhenius)."""
    environment = hardware.environment
    activation = None if environment is None else getattr(environment, energy)
    if environment is None or activation is None:
        return 1.0
    cold, now = environment.card_temperature.value, environment.temperature.value
    return math.exp(activation.value / BOLTZMANN * (1.0 / cold - 1.0 / now))


def retention_time(hardware: Hardware) -> float | None:
    """Time constant of retention at the array's temperature [s]; None where the spec declares none."""
    retention = hardware.nonidealities.retention
    return None if retention is None else float(retention.value) / speed_up(hardware, "retention_activation")


def widest_tile(plan: Plan) -> tuple[int, int]:
    """Word and bit lines of the largest tile, reference column included."""
    shapes = [physical_shape(plan, t) for t in range(len(plan.tiles))]
    wide = [n + int(tile.has_reference) for (_, n), tile in zip(shapes, plan.tiles, strict=True)]
    return max((m for m, _ in shapes), default=1), max(wide, default=1)
