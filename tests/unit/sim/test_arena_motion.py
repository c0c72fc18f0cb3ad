"""Wheels, bumps, slip, starts and reward."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.sim import Arena
from ohmloom.sim._arena_kernels import FORWARD, LEFT, RIGHT, RobotState, begin, judge, move, touches

ARENA = Arena.paper()
DYNAMIC = Arena.paper(task="dynamic")
STEP = 0.12 * 0.032


def robot_at(x, y, degrees):
    return RobotState(np.array([x, y, math.radians(degrees)]), np.zeros(5, dtype=np.int64), np.array([1e-6]))


def go(robot, action, arena=ARENA, *, key=0, times=1):
    world = arena.world()
    for _ in range(times):
        move(world, robot, np.uint64(key), action)
    return robot


def integrated(pose, left, right, pieces=1000):
    """Unicycle equations by the midpoint rule in small pieces."""
    x, y, heading = pose
    turn = (right - left) / 0.052 / pieces
    way = (right + left) / 2 / pieces
    for _ in range(pieces):
        x += way * math.cos(heading + turn / 2)
        y += way * math.sin(heading + turn / 2)
        heading += turn
    return x, y, heading


@pytest.mark.parametrize(("action", "left", "right"),
                         [(FORWARD, STEP, STEP), (LEFT, STEP / 2, STEP), (RIGHT, STEP, STEP / 2)])  # fmt: skip
@pytest.mark.parametrize("degrees", [0, 37, 179, -120])
def test_the_arc_is_exact(action, left, right, degrees):
    robot = go(robot_at(-0.7, -0.7, degrees), action)
    x, y, heading = integrated((-0.7, -0.7, math.radians(degrees)), left, right)
    # The midpoint rule's own error is way * (turn / pieces)^2 / 24, about 2e-13 m, beside 1000 roundings.
    np.testing.assert_allclose(robot.pose[:2], [x, y], rtol=0, atol=1e-12)
    assert math.cos(robot.pose[2] - heading) == pytest.approx(1.0, abs=1e-15)


def test_forward_is_3_84_mm():
    robot = go(robot_at(-0.7, -0.7, 0), FORWARD)
    assert robot.pose.tolist() == pytest.approx([-0.7 + 0.00384, -0.7, 0.0], abs=1e-15)


@pytest.mark.parametrize(("action", "side"), [(LEFT, 1), (RIGHT, -1)])
def test_turns_have_a_radius_of_78_mm(action, side):
    robot = robot_at(-0.7, -0.7, 0)
    centre = np.array([-0.7, -0.7 + side * 0.078])
    headings = []
    for _ in range(171):
        go(robot, action)
        headings.append(robot.pose[2])
        assert np.linalg.norm(robot.pose[:2] - centre) == pytest.approx(0.078, abs=1e-13)
    assert math.degrees(headings[0]) == pytest.approx(side * 2.1156, abs=1e-4)
    assert max(map(abs, headings)) <= math.pi
    # 2 pi / 0.036923 = 170.2 timesteps make a circle.
    assert side * headings[169] < 0 < side * headings[170]


def test_a_bump_undoes_the_move_backs_off_10_cm_and_costs_10():
    robot = go(robot_at(-0.5, 0.967, 90), FORWARD)
    assert robot.pose.tolist() == pytest.approx([-0.5, 0.867, math.pi / 2], abs=1e-14)
    assert robot.counts.tolist() == [11, 1, 0, 1, 0]


def test_a_bump_while_turning_keeps_the_heading():
    robot = go(robot_at(-0.5, 0.967, 90), LEFT)
    assert robot.pose.tolist() == pytest.approx([-0.5, 0.867, math.pi / 2], abs=1e-14)


def test_backing_off_goes_as_far_as_it_is_free():
    # Between box and wall only y in 0.932 to 0.968 is free here: three pieces of 1 cm.
    robot = go(robot_at(0.0, 0.967, 90), FORWARD, ARENA.replace(box_half_width=0.9))
    assert robot.pose[:2].tolist() == pytest.approx([0.0, 0.937], abs=1e-14)
    assert robot.counts.tolist() == [11, 1, 0, 1, 0]


@pytest.mark.parametrize(("x", "y", "expected"), [
    (0.968, 0.0, False), (0.9681, 0.0, True), (0.0, -0.9681, True), (0.0, 0.4321, False), (0.0, 0.4319, True),
    (0.0, 0.0, True), (0.4 + 0.0227, 0.4 + 0.0227, False), (0.4 + 0.0226, 0.4 + 0.0226, True),
    (-0.4 - 0.0226, 0.4 + 0.0226, True),
])  # fmt: skip
def test_touching(x, y, expected):
    # 0.032 / sqrt(2) = 0.02263 m from each side at a corner of the box.
    assert touches(ARENA.world(), x, y) == expected


def test_one_move_costs_one_timestep():
    assert go(robot_at(-0.7, -0.7, 90), FORWARD, times=5).counts.tolist() == [5, 0, 0, 5, 0]


def wheels(arena, timesteps):
    """Way of the left and the right wheel in each timestep, going forward from one pose."""
    world, found = arena.world(), []
    for t in range(timesteps):
        robot = robot_at(-0.7, -0.7, 0)
        robot.counts[3] = t
        move(world, robot, np.uint64(99), FORWARD)
        turn = robot.pose[2]
        way = math.hypot(robot.pose[0] + 0.7, robot.pose[1] + 0.7)
        way *= 1.0 if turn == 0 else (turn / 2) / math.sin(turn / 2)
        found.append((way - turn * 0.026, way + turn * 0.026))
    return np.array(found) / STEP


def test_each_wheel_stalls_in_one_of_ten_timesteps():
    ways = wheels(DYNAMIC, 20000)
    stalled = ways < 1e-9
    assert np.allclose(ways[~stalled], 1.0, atol=1e-9)
    # Standard deviations are 0.0021 and 0.0007.
    assert np.mean(stalled, axis=0).tolist() == pytest.approx([0.1, 0.1], abs=0.009)
    assert np.mean(stalled.all(axis=1)) == pytest.approx(0.01, abs=0.003)


def test_uniform_slip_varies_the_speed_by_a_tenth():
    ways = wheels(DYNAMIC.replace(slip_mode="uniform"), 4000)
    assert ways.min() >= 0.9 - 1e-9
    assert ways.max() <= 1.1 + 1e-9
    assert np.std(ways, axis=0).tolist() == pytest.approx([0.1 / math.sqrt(3)] * 2, rel=0.05)


def test_the_static_task_has_no_slip():
    assert np.allclose(wheels(ARENA, 200), 1.0, atol=1e-9)


def starts(arena, count):
    found = []
    for key in range(count):
        robot = robot_at(0, 0, 0)
        begin(arena.world(), robot, np.uint64(key * 0x9E3779B97F4A7C15 % 2**64))
        found.append(robot.pose.copy())
    return np.array(found)


def test_starts_are_uniform_in_the_corner_and_face_north():
    poses = starts(ARENA, 8000)
    x, y = poses[:, 0], poses[:, 1]
    assert (poses[:, 2] == math.pi / 2).all()
    assert min(x.min(), y.min()) > -0.968
    assert (x + y).max() < -1.5
    # Halving the sides cuts the triangle into four of equal area; a standard deviation is 0.0048.
    leg = -1.5 + 2 * 0.968
    u, v = (x + 0.968) / leg, (y + 0.968) / leg
    parts = [np.mean(part) for part in (u + v < 0.5, u > 0.5, v > 0.5, (u < 0.5) & (v < 0.5) & (u + v > 0.5))]
    assert parts == pytest.approx([0.25] * 4, abs=0.024)


def judged(arena, x, y, st, *, part=0, best=1e-6):
    robot = robot_at(x, y, 0)
    robot.counts[0], robot.counts[2], robot.best[0] = st, part, best
    judge(arena.world(), robot, np.uint64(5))
    return robot


@pytest.mark.parametrize(("x", "y", "st", "fitness"), [
    (0.0, 0.0, 100, 1000 / 1.6 - 100), (0.3, 0.3, 100, 900.0), (-0.75, -0.75, 10, 1000 / 3.1 - 10),
    (0.79, 0.8, 500, 9500.0), (0.65, 0.95 - 1e-9, 10, 9990.0), (0.65, 0.96, 700, 11800.0),
    (0.8, 0.8, 709, 11791.0), (-0.75, -0.75, 4000, 1e-6),
])  # fmt: skip
def test_fitness_of_eq_14_with_floor_cap_and_goal(x, y, st, fitness):
    assert judged(ARENA, x, y, st).best[0] == pytest.approx(fitness, rel=1e-12)


def test_the_best_fitness_is_kept():
    assert judged(ARENA, 0.0, 0.0, 100, best=600.0).best[0] == 600.0


def test_a_trial_ends_at_the_goal_or_at_4000():
    assert judged(ARENA, 0.0, 0.0, 3999).counts[4] == 0
    assert judged(ARENA, 0.0, 0.0, 4000).counts.tolist() == [4000, 0, 0, 0, 1]
    assert judged(ARENA, 0.0, 0.0, 4009).counts[4] == 1
    assert judged(ARENA, 0.65, 0.96, 10).counts.tolist() == [10, 0, 1, 0, 1]


def test_the_dynamic_task_has_two_parts():
    first = judged(DYNAMIC, 0.65, 0.96, 10)
    assert (first.best[0], first.counts.tolist()) == (1.0, [10, 0, 1, 0, 0])
    assert first.pose.tolist() == [0.65, 0.96, 0.0]  # goes on from there
    again = judged(DYNAMIC, 0.65, 0.96, 20, part=1, best=1.0)
    assert (again.best[0], again.counts[2], again.counts[4]) == (1.0, 1, 0)
    second = judged(DYNAMIC, -0.65, 0.96, 30, part=1, best=1.0)
    assert (second.best[0], second.counts[2], second.counts[4]) == (2.0, 2, 1)
    early = judged(DYNAMIC, -0.65, 0.96, 30)
    assert (early.counts[2], early.counts[4]) == (0, 0)
    assert judged(DYNAMIC, 0.0, 0.5, 4000, part=1, best=1.0).counts.tolist() == [4000, 0, 1, 0, 1]


def test_the_second_part_may_begin_at_the_start():
    arena = DYNAMIC.replace(second_part_start="start")
    robot = robot_at(0, 0, 0)
    begin(arena.world(), robot, np.uint64(5))
    start = robot.pose.tolist()
    assert judged(arena, 0.65, 0.96, 10).pose.tolist() == start


def test_settings_hold_plain_values_of_every_constant():
    settings = ARENA.settings()
    assert settings["sensor_points"] == [[0.015, 0.027], [0.029, 0.007], [0.015, -0.027]]
    rebuilt = Arena(**settings)
    assert rebuilt.settings() == settings


def test_arrays_of_an_arena_are_locked():
    with pytest.raises(ValueError, match="read-only"):
        ARENA.sensor_points[0, 0] = 1.0


@pytest.mark.parametrize(("changes", "message"), [
    ({"task": "statik"}, "Arena.task: expected 'static' or 'dynamic', got 'statik'. Use one of these."),
    ({"slip_mode": "slide"}, "Arena.slip_mode: expected 'stall' or 'uniform', got 'slide'. Use one of these."),
    ({"speed": 0.0}, "Arena.speed: expected a finite number > 0, from 1e-06 to 1e+06, got 0.0. Correct it."),
    ({"ir_range": float("nan")},
     "Arena.ir_range: expected a finite number > 0, from 1e-06 to 1e+06, got nan. Correct it."),
    ({"slip": 1.0}, "Arena.slip: expected a fraction in [0, 1), got 1.0. Correct it."),
    ({"max_timesteps": 0}, "Arena.max_timesteps: expected an integer from 1 to 1000000, got 0. Correct it."),
    ({"start_line": -1.95}, "Arena.start_line: expected a line that leaves room to start, got -1.95 m. Raise it."),
    ({"sensor_bearings": [0.0, 1.0]},
     "Arena.sensor_bearings: expected axes (sensor=3), got shape (2,). Check sensor=3."),
    ({"sensor_points": [[0, 0], [0, 0], [0, float("inf")]]},
     "Arena.sensor_points: expected finite numbers, got NaN or infinity. Check the input."),
])  # fmt: skip
def test_wrong_constants(changes, message):
    with pytest.raises(ParameterError) as caught:
        ARENA.replace(**changes)
    assert str(caught.value) == message


@pytest.mark.parametrize("value", ["a", None, math.nan, math.inf, -1e300, 10**400, True])
@pytest.mark.parametrize("name", sorted({*Arena.__dataclass_fields__} - {"shadow", "slip_mode", "second_part_start"}))
def test_no_constant_takes_what_is_no_sensible_number(name, value):
    with pytest.raises(ParameterError, match=rf"^Arena\.{name}: expected ") as caught:
        ARENA.replace(**{name: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("changes", [
    {"bump_cost": -1}, {"bump_cost": 1.0}, {"shadow": 1}, {"lamp": (1.0, math.nan)}, {"lamp": (1.0,)},
    {"light_dark": 8.0}, {"reverse_piece": 1e-6}, {"start_line": 0.1}, {"sensor_bearings": [0, 0, 7]},
    {"sensor_points": [[0, 0], [0, 0], [0, 27]]}, {"slip_mode": ["stall"]},
])  # fmt: skip
def test_constants_that_the_kernels_could_not_follow(changes):
    with pytest.raises(ParameterError, match=rf"^Arena\.{next(iter(changes))}: expected "):
        ARENA.replace(**changes)


def test_numbers_of_other_types_become_plain_ones():
    arena = ARENA.replace(half_width=1, bump_cost=np.int64(10), lamp=[1, 1])
    assert json.dumps(arena.settings()) == json.dumps(ARENA.settings())


def test_an_unknown_constant_offers_the_nearest():
    with pytest.raises(UnknownNameError, match=r"^Arena\.replace: .*Did you mean 'goal'\?$"):
        ARENA.replace(gaol=1.0)


def test_a_box_that_leaves_no_room():
    with pytest.raises(ParameterError, match=r"^Arena\.box_half_width: expected a gap to the wall wider than"):
        ARENA.replace(box_half_width=0.94)
