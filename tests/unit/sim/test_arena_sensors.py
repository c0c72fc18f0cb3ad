"""Infrared and light readings at poses worked out by hand, and their noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ohmloom.sim import Arena
from ohmloom.sim._arena_kernels import RobotState, sense

ARENA = Arena.paper()


def robot_at(x, y, degrees):
    return RobotState(np.array([x, y, math.radians(degrees)]), np.zeros(5, dtype=np.int64), np.zeros(1))


def read(x, y, degrees, arena=ARENA, *, key=0, timestep=0):
    robot = robot_at(x, y, degrees)
    robot.counts[3] = timestep
    sensors = np.full(6, np.nan)
    sense(arena.world(), robot, np.uint64(key), sensors)
    return sensors


def expected_light(x, y, degrees):
    """Section VIII's lamp, written once more with vectors in three dimensions."""
    heading = math.radians(degrees)
    turn = np.array([[math.cos(heading), -math.sin(heading), 0], [math.sin(heading), math.cos(heading), 0], [0, 0, 1]])
    readings = []
    for point, bearing in zip(((15, 27), (29, 7), (15, -27)), (63.2, 0.0, -68.5), strict=True):
        sensor = np.array([x, y, 0.0]) + turn @ np.array([*point, 0.0]) / 1000
        axis = turn @ np.array([math.cos(math.radians(bearing)), math.sin(math.radians(bearing)), 0.0])
        to_lamp = np.array([1.0, 1.0, 0.133]) - sensor
        d = np.linalg.norm(to_lamp)
        irradiance = 15 * max(0.0, axis @ to_lamp / d) / (4 * math.pi * d**2)
        raw = 500 - 492 * min(1.0, irradiance / 0.2)
        readings.append((500 - raw) / 492)
    return readings


def test_light_by_hand():
    # Front sensor at (-0.757, -0.721): d^2 = 1.757^2 + 1.721^2 + 0.133^2 = 6.0666 m^2, cos = 1.721 / 2.4630,
    # E = 15 * 0.69873 / (4 pi 6.0666) = 0.13748 W/m^2. Right one at (-0.723, -0.735) with its axis at 21.5 degrees:
    # cos = 2.2390 / 2.4488, d^2 = 5.9966 m^2, E = 0.18200 W/m^2. The left one faces away.
    np.testing.assert_allclose(read(-0.75, -0.75, 90)[3:], [0.0, 0.13748 / 0.2, 0.18200 / 0.2], atol=5e-5)


@pytest.mark.parametrize("pose", [(-0.75, -0.75, 90), (-0.75, 0.0, 90), (-0.75, 0.1, 45), (-0.3, 0.5, 45),
                                  (0.5, -0.9, 120), (-0.9, -0.9, -20), (-0.6, 0.9, 75)])  # fmt: skip
def test_light_formula(pose):
    # Relative to a reading of 1; both sides round in their last digits only.
    np.testing.assert_allclose(read(*pose)[3:], expected_light(*pose), atol=1e-13)


def test_light_saturates_and_vanishes():
    assert read(0.3, 0.9, 0)[3:].tolist() == [1.0, 1.0, 1.0]
    assert read(0.9, 0.9, -135)[3:].tolist() == [0.0, 0.0, 0.0]


def test_the_box_casts_a_shadow_only_if_asked():
    lit = read(-0.5, -0.5, 45)
    dark = read(-0.5, -0.5, 45, ARENA.replace(shadow=True))
    assert lit[4] > 0.9
    assert dark[3:].tolist() == [0.0, 0.0, 0.0]
    assert read(-0.6, 0.6, 0, ARENA.replace(shadow=True)).tolist() == read(-0.6, 0.6, 0).tolist()


def test_infrared_by_hand():
    # Facing the north wall from y = 0.965. Front: 1 - 0.965 - 0.029 = 0.006 m. Left: 0.020 m to the wall at 153.2
    # degrees, 0.020 / sin = 0.04436 m. Right, at 21.5 degrees: 0.020 / sin = 0.0546 m, beyond 0.05 m.
    np.testing.assert_allclose(read(-0.8, 0.965, 90)[:3], [1 - 0.044358 / 0.05, 1 - 0.006 / 0.05, 0.0], atol=2e-5)


def test_infrared_falls_linearly_to_0_at_5_cm():
    for distance in (0.003, 0.01, 0.025, 0.049, 0.0499):
        reading = read(0.0, 1 - 0.029 - distance, 90)[1]
        assert reading == pytest.approx(1 - distance / 0.05, abs=1e-12)
    assert read(0.0, 1 - 0.029 - 0.0501, 90)[1] == 0.0


def test_infrared_sees_the_box_from_each_side():
    for degrees, x, y in ((0, -1, 0), (90, 0, -1), (180, 1, 0), (270, 0, 1)):
        reach = 0.4 + 0.029 + 0.02
        assert read(x * reach, y * reach, degrees)[1] == pytest.approx(0.6, abs=1e-12)
        assert read(x * reach, y * reach, degrees + 180)[1] == 0.0


def test_infrared_is_0_in_the_open():
    for degrees in range(0, 360, 30):
        assert read(-0.7, -0.7, degrees)[:3].tolist() == [0.0, 0.0, 0.0]


def test_the_static_task_has_no_noise():
    assert read(-0.8, 0.951, 90, key=1, timestep=3).tolist() == read(-0.8, 0.951, 90, key=2, timestep=9).tolist()


def test_noise_is_uniform_within_its_bounds():
    arena = Arena.paper(task="dynamic")
    pose = (-0.8, 0.965, 90)
    clean = read(*pose)
    assert 0 < clean[0] < 0.2
    noisy = np.array([read(*pose, arena, key=7, timestep=t) for t in range(3000)])
    for infrared in (0, 1):
        ratio = noisy[:, infrared] / clean[infrared] - 1
        assert np.abs(ratio).max() <= 0.02 + 1e-12
        assert np.std(ratio) == pytest.approx(0.02 / math.sqrt(3), rel=0.05)
        assert np.mean(ratio) == pytest.approx(0, abs=0.001)
    # Half lit, so that neither end cuts the light's noise.
    raw = np.array([500 - 492 * read(-0.75, -0.75, 90, arena, key=7, timestep=t)[4] for t in range(3000)])
    ratio = raw / (500 - 492 * read(-0.75, -0.75, 90)[4]) - 1
    assert np.abs(ratio).max() <= 0.10 + 1e-12
    assert np.std(ratio) == pytest.approx(0.10 / math.sqrt(3), rel=0.05)
    # A sensor in the dark reads 500 at most: half of its noise is cut.
    dark = noisy[:, 3]
    assert clean[3] == 0.0
    assert 0.45 < np.mean(dark == 0.0) < 0.55
    assert dark.max() == pytest.approx(0.1 * 500 / 492, rel=0.01)
    assert ((noisy >= 0) & (noisy <= 1)).all()


def test_noise_differs_between_sensors_timesteps_and_keys():
    arena = Arena.paper(task="dynamic")
    pose = (-0.8, 0.965, 90)
    clean, noisy = read(*pose), read(*pose, arena, key=7, timestep=5)
    assert len({*(noisy[[0, 1]] / clean[[0, 1]])}) == 2
    assert read(*pose, arena, key=7, timestep=5).tolist() == noisy.tolist()
    assert read(*pose, arena, key=8, timestep=5)[1] != noisy[1]
    assert read(*pose, arena, key=7, timestep=6)[1] != noisy[1]
