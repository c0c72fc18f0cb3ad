"""Rays end at the first surface, robots never enter a wall, and no wall is a trap."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ohmloom.sim import Arena
from ohmloom.sim._arena_kernels import FORWARD, LEFT, RIGHT, RobotState, move, ray_distance, touches

WORLD = Arena.paper().world()
place = st.floats(-1.0, 1.0)
angle = st.floats(-math.pi, math.pi)


@settings(max_examples=300, deadline=None)
@given(x=place, y=place, heading=angle, pieces=st.integers(2000, 5000))
def test_a_ray_ends_at_the_first_surface(x, y, heading, pieces):
    assume(max(abs(x), abs(y)) > 0.4)
    dx, dy = math.cos(heading), math.sin(heading)
    distance = ray_distance(WORLD, x, y, dx, dy)
    assert 0 <= distance <= 2 * math.sqrt(2)
    # Everything before the end is free ...
    t = np.linspace(0.0, distance, pieces)
    reach = np.maximum(np.abs(x + t * dx), np.abs(y + t * dy))
    assert (reach <= 1 + 1e-12).all()
    assert (reach >= 0.4 - 1e-12).all()
    # ... and the end lies on a wall or on the box.
    assert min(abs(reach[-1] - 1.0), abs(reach[-1] - 0.4)) < 1e-12


def robot_at(x, y, heading):
    return RobotState(np.array([x, y, heading]), np.zeros(5, dtype=np.int64), np.zeros(1))


@settings(max_examples=150, deadline=None)
@given(x=place, y=place, heading=angle, seed=st.integers(0, 2**32), task=st.sampled_from(["static", "dynamic"]))
def test_the_robot_never_overlaps_a_wall(x, y, heading, seed, task):
    world = Arena.paper(task=task).world()
    assume(not touches(world, x, y))
    robot = robot_at(x, y, heading)
    rng = np.random.default_rng(seed)
    for action in np.repeat(rng.integers(0, 3, 40), rng.integers(1, 30, 40)):
        before = robot.pose.copy()
        move(world, robot, np.uint64(seed), action)
        assert not touches(world, robot.pose[0], robot.pose[1])
        assert -math.pi <= robot.pose[2] <= math.pi
        # A timestep leads 3.84 mm (4.3 mm with slip) ahead or 10 cm back, no further.
        assert np.linalg.norm(robot.pose[:2] - before[:2]) <= 0.1 + 1e-9


def leads_away(pose, turn, count):
    """Whether `count` timesteps of a turn, then straight on, lead 20 cm away from where the robot is now."""
    robot = robot_at(*pose)
    for action in [turn] * count + [FORWARD] * 80:
        move(WORLD, robot, np.uint64(0), action)
        if math.dist(robot.pose[:2], pose[:2]) >= 0.2:
            return True
    return False


@settings(max_examples=150, deadline=None)
@given(x=place, y=place, heading=angle, actions=st.lists(st.sampled_from([FORWARD, LEFT, RIGHT]), max_size=6))
def test_no_wall_is_a_trap(x, y, heading, actions):
    """From any legal pose and after any contact some actions lead at least 20 cm away from it."""
    assume(not touches(WORLD, x, y))
    robot = robot_at(x, y, heading)
    contacts = 0
    for action in [*actions, *[FORWARD] * 800]:
        bumps = robot.counts[1]
        contact = robot.pose.copy()
        move(WORLD, robot, np.uint64(0), action)
        if robot.counts[1] > bumps:
            contacts += 1
            here = robot.pose.copy()
            away = any(leads_away(here, turn, count) for count in range(0, 171, 10) for turn in (LEFT, RIGHT))
            assert away, (contact, here)
            if contacts == 3:
                break
    assert contacts > 0
