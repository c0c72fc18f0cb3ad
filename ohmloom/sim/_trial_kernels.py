"""A whole trial of a compiled controller in one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import choose_by_type, copy_flat, kernel
from ohmloom.mapping import _kernels as emulated
from ohmloom.mapping._fabric import Fabric
from ohmloom.neurocontroller import _kernels as discrete
from ohmloom.sim._arena_kernels import RobotState, World, begin, judge, move, sense


def _reset(wiring: Any, controller: Any) -> None:
    _RESETS[type(wiring)](wiring, controller)


def _reset_discrete(wiring: Any, controller: Any) -> None:
    discrete.reset(wiring, controller)


def _reset_emulated(wiring: Any, controller: Any) -> None:
    emulated.reset(wiring, controller)


def _timestep(wiring: Any, controller: Any, sensors: FloatArray, counts: IntArray) -> int:
    return _TIMESTEPS[type(wiring)](wiring, controller, sensors, counts)


def _timestep_discrete(wiring: Any, controller: Any, sensors: FloatArray, counts: IntArray) -> int:
    return discrete.inlined_timestep(wiring, controller, sensors, counts)


def _timestep_emulated(wiring: Any, controller: Any, sensors: FloatArray, counts: IntArray) -> int:
    return emulated.timestep(wiring, controller, sensors, counts)


_RESETS: dict[type, Callable[..., None]] = {discrete.Wiring: _reset_discrete, Fabric: _reset_emulated}
_TIMESTEPS: dict[type, Callable[..., int]] = {discrete.Wiring: _timestep_discrete, Fabric: _timestep_emulated}
choose_by_type(_reset, _RESETS)
choose_by_type(_timestep, _TIMESTEPS)


@kernel
def run(
    world: World, robot: RobotState, key: np.uint64, wiring: Any, controller: Any,
    counts: IntArray, sensors: FloatArray, action_delay: int, record: bool,
    path: FloatArray, st: IntArray, seen: FloatArray, acted: IntArray, spikes: IntArray,
) -> int:  # fmt: skip
    """Run until the goal or the end, recording if `record`. Returns the executed timesteps.

    `wiring` and `controller` are of the discrete controller or of an emulated die; `counts` (neuron,) is scratch.

    A recording also ends with its rows: nothing is written beyond them, whatever the arena.
    """
    _reset(wiring, controller)
    begin(world, robot, key)
    delayed = 0
    executed = 0
    if record:
        copy_flat(path[0], robot.pose)
        st[0] = 0
    rows = path.shape[0] - 1
    while robot.counts[4] == 0 and not (record and executed >= rows):
        sense(world, robot, key, sensors)
        action = _timestep(wiring, controller, sensors, counts)
        if action_delay:
            action, delayed = delayed, action
        move(world, robot, key, action)
        judge(world, robot, key)
        if record:
            copy_flat(seen[executed], sensors)
            acted[executed] = action
            spikes[executed, 0] = counts[counts.shape[0] - 2]
            spikes[executed, 1] = counts[counts.shape[0] - 1]
            copy_flat(path[executed + 1], robot.pose)
            st[executed + 1] = robot.counts[0]
        executed += 1
    return executed
