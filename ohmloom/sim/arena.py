"""The arena and the Khepera II robot (Section VIII): constants with their sources."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ohmloom._arrays import FloatArray, frozen_array
from ohmloom.errors import ParameterError, UnknownNameError, expect_integer, expect_number, shown

if TYPE_CHECKING:
    from ohmloom.sim._arena_kernels import World

# Webots' Khepera2.proto (projects/robots/k-team/khepera2): sensors 0, 2 and 5, x forward, y left.
SENSOR_POINTS = ((0.015, 0.027), (0.029, 0.007), (0.015, -0.027))
SENSOR_BEARINGS = (math.radians(63.2), 0.0, math.radians(-68.5))
Task = Literal["static", "dynamic"]
MOST_TIMESTEPS = 1_000_000  # a recording of these takes 100 MB
MOST_PIECES = 10_000
SMALLEST, LARGEST = 1e-6, 1e6  # SI; between them nothing in the kernels overflows or divides by 0

_Rule = tuple[str, Callable[[float], bool]]
_POSITIVE: _Rule = (f"a finite number > 0, from {SMALLEST:g} to {LARGEST:g}", lambda v: SMALLEST <= v <= LARGEST)
_NOT_NEGATIVE: _Rule = (f"a number from 0 to {LARGEST:g}", lambda v: 0.0 <= v <= LARGEST)
_BOUNDED: _Rule = (f"a number from {-LARGEST:g} to {LARGEST:g}", lambda v: abs(v) <= LARGEST)
_FRACTION: _Rule = ("a fraction in [0, 1)", lambda v: 0.0 <= v < 1.0)
_RULES: dict[str, _Rule] = {
    **dict.fromkeys(("half_width", "lamp_height", "light_saturation", "ir_range", "robot_radius", "axle", "speed",
                     "timestep", "reverse_piece"), _POSITIVE),
    **dict.fromkeys(("box_half_width", "lamp_power", "light_dark", "light_lit", "reverse_distance"), _NOT_NEGATIVE),
    **dict.fromkeys(("lamp", "start_line", "goal"), _BOUNDED),
    **dict.fromkeys(("slip", "ir_noise", "light_noise"), _FRACTION),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Arena:
    """A walled square with a box in the middle, a lamp in a corner and a two-wheeled robot; SI units.

    Attributes
    ----------
    task
        ``static``: reach x + y >= goal. ``dynamic``: then y - x >= goal, noise, wheel slip (Section XII).
    half_width, box_half_width
        Walls at +-half_width, box from -box_half_width to +box_half_width, both in x and y [m].
    lamp, lamp_height, lamp_power
        Position [m], height above the sensors' plane (0.15 m walls less 0.017 m) [m], radiant power [W].
    light_saturation, light_dark, light_lit
        Irradiance at which the light sensor saturates [W/m^2]; its readings in the dark and fully lit.
    shadow
        Whether the box casts a shadow (Webots' default and ours: no).
    ir_range
        Distance at which the infrared reading reaches 0 [m].
    sensor_points, sensor_bearings
        (3, 2) positions on the body, x forward, y left [m]; (3,) axes, counter-clockwise from forward [rad].
    robot_radius, axle, speed, timestep
        Body radius, distance between wheels [m], full wheel speed [m/s], length of a timestep [s].
    reverse_distance, reverse_piece, bump_cost
        A bump backs off this far in pieces of this length [m] and costs this many timesteps.
    start_line, goal, max_timesteps
        Starts lie in x + y < start_line [m]; goal line [m]; a trial ends when st reaches max_timesteps.
    ir_noise, light_noise, slip_mode, slip
        Relative uniform noise of the readings; ``stall``: a wheel does not move with probability slip;
        ``uniform``: its speed varies by +-slip. Only in the dynamic task.
    second_part_start
        Where the second part of the dynamic task begins: ``goal`` (where the first ended) or ``start``.
    """

    task: Task = "static"
    half_width: float = 1.0
    box_half_width: float = 0.4
    lamp: tuple[float, float] = (1.0, 1.0)
    lamp_height: float = 0.133
    lamp_power: float = 15.0
    light_saturation: float = 0.2
    light_dark: float = 500.0
    light_lit: float = 8.0
    shadow: bool = False
    ir_range: float = 0.05
    sensor_points: FloatArray = field(default_factory=lambda: np.array(SENSOR_POINTS))
    sensor_bearings: FloatArray = field(default_factory=lambda: np.array(SENSOR_BEARINGS))
    robot_radius: float = 0.032
    axle: float = 0.052
    speed: float = 0.12
    timestep: float = 0.032
    reverse_distance: float = 0.10
    reverse_piece: float = 0.01
    bump_cost: int = 10
    start_line: float = -1.5
    goal: float = 1.6
    max_timesteps: int = 4000
    ir_noise: float = 0.02
    light_noise: float = 0.10
    slip_mode: Literal["stall", "uniform"] = "stall"
    slip: float = 0.10
    second_part_start: Literal["goal", "start"] = "goal"

    def __post_init__(self) -> None:
        for name, axes in (
            ("sensor_points", ("sensor=3", "coordinate=2")),
            ("sensor_bearings", ("sensor=3",)),
        ):
            object.__setattr__(self, name, frozen_array(f"Arena.{name}", getattr(self, name), axes))
        choices = {"task": ("static", "dynamic"), "slip_mode": ("stall", "uniform"),
                   "second_part_start": ("goal", "start")}  # fmt: skip
        for name, allowed in choices.items():
            value = getattr(self, name)
            if not isinstance(value, str) or value not in allowed:
                raise ParameterError(f"Arena.{name}: expected {' or '.join(map(repr, allowed))}, "
                                     f"got {shown(value)}. Use one of these.")  # fmt: skip
        for name, (rule, is_kept) in _RULES.items():
            self._take(name, rule, is_kept)
        for name, low in (("bump_cost", 0), ("max_timesteps", 1)):
            object.__setattr__(self, name, expect_integer(f"Arena.{name}", getattr(self, name), low, MOST_TIMESTEPS))
        if not isinstance(self.shadow, bool):
            raise ParameterError(f"Arena.shadow: expected True or False, got {shown(self.shadow)}. Use one of these.")
        self._check_geometry()

    def _take(self, name: str, rule: str, is_kept: Callable[[float], bool]) -> None:
        """Check the number, or both of a pair, and keep it as a float."""
        value = getattr(self, name)
        is_pair = name == "lamp"
        if is_pair and not (isinstance(value, tuple | list) and len(value) == 2):
            raise ParameterError(f"Arena.{name}: expected {rule}, got {shown(value)}. Correct it.")
        numbers = tuple(expect_number(f"Arena.{name}", v, rule) for v in (value if is_pair else (value,)))
        if not all(is_kept(number) for number in numbers):
            raise ParameterError(f"Arena.{name}: expected {rule}, got {shown(value)}. Correct it.")
        object.__setattr__(self, name, numbers if is_pair else numbers[0])

    def _check_geometry(self) -> None:
        gap = self.half_width - self.box_half_width
        if gap <= 2 * self.robot_radius:
            raise ParameterError(f"Arena.box_half_width: expected a gap to the wall wider than the robot, "
                                 f"got {gap} m. Make the box smaller.")  # fmt: skip
        if self.start_line <= 2 * (self.robot_radius - self.half_width):
            raise ParameterError(f"Arena.start_line: expected a line that leaves room to start, "
                                 f"got {self.start_line} m. Raise it.")  # fmt: skip
        if self.start_line > 0.0:
            raise ParameterError(f"Arena.start_line: expected at most 0 m, so that every start lies inside the walls, "
                                 f"got {self.start_line} m. Lower it.")  # fmt: skip
        if self.light_dark <= self.light_lit:
            raise ParameterError(f"Arena.light_dark: expected more than light_lit = {self.light_lit}, "
                                 f"got {self.light_dark}. Raise it.")  # fmt: skip
        if self.reverse_distance > MOST_PIECES * self.reverse_piece:
            raise ParameterError(f"Arena.reverse_piece: expected at least reverse_distance / {MOST_PIECES}, "
                                 f"got {self.reverse_piece} m. Raise it.")  # fmt: skip
        if np.abs(self.sensor_points).max() > self.half_width:
            raise ParameterError(f"Arena.sensor_points: expected points on the body, got one "
                                 f"{np.abs(self.sensor_points).max()} m away. Give them in m.")  # fmt: skip
        if np.abs(self.sensor_bearings).max() > 2 * math.pi:
            raise ParameterError(f"Arena.sensor_bearings: expected -2 pi to 2 pi rad, "
                                 f"got {np.abs(self.sensor_bearings).max()}. Give them in rad.")  # fmt: skip

    @classmethod
    def paper(cls, *, task: Task = "static") -> Arena:
        """The arena of the paper's Section VIII, or of its Section XII for the dynamic task."""
        return cls(task=task)

    def replace(self, **changes: Any) -> Arena:
        """Copy with some constants changed."""
        for name in changes:
            if name not in self.__dataclass_fields__:
                raise UnknownNameError.of("Arena.replace", name, self.__dataclass_fields__)
        return replace(self, **changes)

    def settings(self) -> dict[str, Any]:
        """All constants as plain values, for run files and provenance."""
        return asdict(self) | {
            "lamp": list(self.lamp),
            "sensor_points": self.sensor_points.tolist(),
            "sensor_bearings": self.sensor_bearings.tolist(),
        }

    def world(self) -> World:
        """The constants as the kernels read them."""
        from ohmloom.sim._arena_kernels import SLIP_STALL, SLIP_UNIFORM, World

        return World(
            self.task == "dynamic", self.half_width, self.box_half_width, *self.lamp, self.lamp_height,
            self.lamp_power, self.light_saturation, self.light_dark, self.light_lit, self.shadow,
            self.ir_range, self.sensor_points, self.sensor_bearings, self.robot_radius, self.axle,
            self.speed, self.timestep, self.reverse_distance, self.reverse_piece, self.bump_cost,
            self.start_line, self.goal, self.max_timesteps, self.ir_noise, self.light_noise,
            SLIP_STALL if self.slip_mode == "stall" else SLIP_UNIFORM, self.slip,
            self.second_part_start == "start",
        )  # fmt: skip
