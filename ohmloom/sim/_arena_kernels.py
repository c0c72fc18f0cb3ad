"""Compiled arena: rays, lamp, wheels, bumps, reward, and the counter-based random numbers of a trial."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom._jit import kernel
from ohmloom._philox_kernels import philox, uniform

FORWARD, LEFT, RIGHT = 0, 1, 2
START, IR_NOISE, LIGHT_NOISE, SLIP = 0, 1, 2, 3  # channels of the random numbers
SLIP_STALL, SLIP_UNIFORM = 0, 1
FITNESS_FLOOR = 1e-6  # Section VIII-B: "capped so that f > 0"
FITNESS_CAP = 10000.0
GOAL_BONUS = 2500.0


class World(NamedTuple):
    """Constants of an arena in SI units, as the kernels read them; the meaning of each is with ``Arena``."""

    dynamic: bool
    half_width: float
    box_half_width: float
    lamp_x: float
    lamp_y: float
    lamp_height: float
    lamp_power: float
    light_saturation: float
    light_dark: float
    light_lit: float
    shadow: bool
    ir_range: float
    sensor_points: np.ndarray
    sensor_bearings: np.ndarray
    robot_radius: float
    axle: float
    speed: float
    timestep: float
    reverse_distance: float
    reverse_piece: float
    bump_cost: int
    start_line: float
    goal: float
    max_timesteps: int
    ir_noise: float
    light_noise: float
    slip_mode: int
    slip: float
    restart_second_part: bool


class RobotState(NamedTuple):
    """What changes during a trial."""

    pose: np.ndarray  # [x, y, heading]
    counts: np.ndarray  # [st, bumps, part, executed timesteps, done]
    best: np.ndarray  # [best fitness]


@kernel
def _segment_hits_box(x0: float, y0: float, dx: float, dy: float, half: float) -> float:
    """Where the ray (x0, y0) + t (dx, dy), t >= 0, enters [-half, half]^2; infinity if it misses."""
    enter, leave = 0.0, math.inf
    for start, step in ((x0, dx), (y0, dy)):
        if step == 0.0:
            if abs(start) > half:
                return math.inf
        else:
            t0, t1 = (-half - start) / step, (half - start) / step
            enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    return enter if enter <= leave else math.inf


@kernel
def ray_distance(world: World, x: float, y: float, dx: float, dy: float) -> float:
    """Distance in m from a point inside the walls to the nearest surface in the unit direction (dx, dy)."""
    distance = math.inf
    for start, step in ((x, dx), (y, dy)):
        if step > 0.0:
            distance = min(distance, (world.half_width - start) / step)
        elif step < 0.0:
            distance = min(distance, (-world.half_width - start) / step)
    distance = min(distance, _segment_hits_box(x, y, dx, dy, world.box_half_width))
    return max(distance, 0.0)


@kernel
def sense(world: World, state: RobotState, key: np.uint64, sensors: FloatArray) -> None:
    """Fill `sensors` (6,): IR 0, 2, 5, then light 0, 2, 5, each in [0, 1]."""
    x, y, heading = state.pose[0], state.pose[1], state.pose[2]
    cos_h, sin_h = math.cos(heading), math.sin(heading)
    margin = world.robot_radius + world.ir_range
    near_wall = max(abs(x), abs(y)) + margin > world.half_width
    near_box = max(abs(x), abs(y)) - margin < world.box_half_width
    for k in range(3):
        forward, left = world.sensor_points[k, 0], world.sensor_points[k, 1]
        px, py = x + cos_h * forward - sin_h * left, y + sin_h * forward + cos_h * left
        axis = heading + world.sensor_bearings[k]
        dx, dy = math.cos(axis), math.sin(axis)
        sensors[k] = 0.0
        if near_wall or near_box:
            sensors[k] = max(0.0, 1.0 - ray_distance(world, px, py, dx, dy) / world.ir_range)
        lx, ly = world.lamp_x - px, world.lamp_y - py
        square = lx * lx + ly * ly + world.lamp_height * world.lamp_height
        cosine = (lx * dx + ly * dy) / math.sqrt(square)
        # t = 1 is the lamp, so an entry before it is a shadow.
        if cosine > 0.0 and world.shadow and _segment_hits_box(px, py, lx, ly, world.box_half_width) < 1.0:
            cosine = 0.0
        lit = max(0.0, cosine) * world.lamp_power / (4.0 * math.pi * square) / world.light_saturation
        sensors[3 + k] = min(1.0, lit)
    if world.dynamic:
        _add_noise(world, state.counts[3], key, sensors)


@kernel
def _add_noise(world: World, executed: int, key: np.uint64, sensors: FloatArray) -> None:
    ir = philox(key, executed, IR_NOISE)
    light = philox(key, executed, LIGHT_NOISE)
    dark, lit = world.light_dark, world.light_lit
    for k in range(3):
        factor = 1.0 + world.ir_noise * (2.0 * uniform(ir[k]) - 1.0)
        sensors[k] = min(1.0, sensors[k] * factor)
        factor = 1.0 + world.light_noise * (2.0 * uniform(light[k]) - 1.0)
        reading = (dark - (dark - lit) * sensors[3 + k]) * factor
        sensors[3 + k] = (dark - min(max(reading, lit), dark)) / (dark - lit)


@kernel
def touches(world: World, x: float, y: float) -> bool:
    """Whether the robot's disc at (x, y) would overlap a wall or the box."""
    r = world.robot_radius
    if max(abs(x), abs(y)) > world.half_width - r:
        return True
    dx = max(abs(x) - world.box_half_width, 0.0)
    dy = max(abs(y) - world.box_half_width, 0.0)
    return dx * dx + dy * dy < r * r


@kernel
def move(world: World, state: RobotState, key: np.uint64, action: int) -> None:
    """Carry out an action for one timestep, bump included; st and the executed timesteps advance."""
    left = right = world.speed * world.timestep
    if action == LEFT:
        left *= 0.5
    elif action == RIGHT:
        right *= 0.5
    if world.dynamic:
        words = philox(key, state.counts[3], SLIP)
        u_left, u_right = uniform(words[0]), uniform(words[1])
        if world.slip_mode == SLIP_STALL:
            left = 0.0 if u_left < world.slip else left
            right = 0.0 if u_right < world.slip else right
        else:
            left *= 1.0 + world.slip * (2.0 * u_left - 1.0)
            right *= 1.0 + world.slip * (2.0 * u_right - 1.0)
    x, y, heading = state.pose[0], state.pose[1], state.pose[2]
    turn = (right - left) / world.axle
    half = 0.5 * turn
    chord = 0.5 * (left + right)
    if half != 0.0:
        chord *= math.sin(half) / half
    new_x = x + chord * math.cos(heading + half)
    new_y = y + chord * math.sin(heading + half)
    state.counts[0] += 1
    state.counts[3] += 1
    if touches(world, new_x, new_y):
        _back_off(world, state)
    else:
        state.pose[0], state.pose[1] = new_x, new_y
        heading = heading + turn
        if heading > math.pi:
            heading -= 2.0 * math.pi
        elif heading <= -math.pi:
            heading += 2.0 * math.pi
        state.pose[2] = heading


@kernel
def _back_off(world: World, state: RobotState) -> None:
    """Section VIII-A: reverse 10 cm, as far as it is free, for 10 timesteps; the move itself is undone."""
    dx, dy = math.cos(state.pose[2]), math.sin(state.pose[2])
    pieces = round(world.reverse_distance / world.reverse_piece)
    for _ in range(pieces):
        x, y = state.pose[0] - world.reverse_piece * dx, state.pose[1] - world.reverse_piece * dy
        if touches(world, x, y):
            break
        state.pose[0], state.pose[1] = x, y
    state.counts[0] += world.bump_cost
    state.counts[1] += 1


@kernel
def place(world: World, state: RobotState, key: np.uint64) -> None:
    """Uniform in the corner x + y < start_line, facing north (+y)."""
    words = philox(key, 0, START)
    u, v = uniform(words[0]), uniform(words[1])
    if u + v > 1.0:
        u, v = 1.0 - u, 1.0 - v
    corner = world.robot_radius - world.half_width
    leg = world.start_line - 2.0 * corner
    state.pose[0], state.pose[1] = corner + u * leg, corner + v * leg
    state.pose[2] = 0.5 * math.pi


@kernel
def begin(world: World, state: RobotState, key: np.uint64) -> None:
    place(world, state, key)
    state.counts[:] = 0
    state.best[0] = FITNESS_FLOOR


@kernel
def judge(world: World, state: RobotState, key: np.uint64) -> None:
    """Reward at the end of a timestep (eq. 14; Section XII for the dynamic task)."""
    x, y, st = state.pose[0], state.pose[1], state.counts[0]
    if not world.dynamic:
        if x + y >= world.goal:
            state.best[0] = max(state.best[0], FITNESS_CAP + GOAL_BONUS - st)
            state.counts[2] = 1
            state.counts[4] = 1
        else:
            state.best[0] = max(state.best[0], min(FITNESS_CAP, 1000.0 / (world.goal - (x + y))) - st)
    elif state.counts[2] == 0 and x + y >= world.goal:
        state.best[0] = 1.0
        state.counts[2] = 1
        if world.restart_second_part:
            place(world, state, key)
    elif state.counts[2] == 1 and y - x >= world.goal:
        state.best[0] = 2.0
        state.counts[2] = 2
        state.counts[4] = 1
    if st >= world.max_timesteps:
        state.counts[4] = 1
