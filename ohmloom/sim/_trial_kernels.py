"""A whole trial of a compiled controller in one call."""

from __future__ import annotations

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom._jit import copy_flat, kernel
from ohmloom.neurocontroller._kernels import ControllerState, Wiring, reset, timestep
from ohmloom.sim._arena_kernels import RobotState, World, begin, judge, move, sense


@kernel
def run(
    world: World, robot: RobotState, key: np.uint64, wiring: Wiring, controller: ControllerState,
    counts: IntArray, sensors: FloatArray, action_delay: int, record: bool,
    path: FloatArray, st: IntArray, seen: FloatArray, acted: IntArray, spikes: IntArray,
) -> int:  # fmt: skip
    """Run until the goal or the end, recording if `record`. Returns the executed timesteps.

    A recording also ends with its rows: nothing is written beyond them, whatever the arena.
    """
    reset(wiring, controller)
    begin(world, robot, key)
    delayed = 0
    executed = 0
    if record:
        copy_flat(path[0], robot.pose)
        st[0] = 0
    rows = path.shape[0] - 1
    while robot.count[4] == 0 and not (record and executed >= rows):
        sense(world, robot, key, sensors)
        action = timestep(wiring, controller, sensors, counts)
        if action_delay:
            action, delayed = delayed, action
        move(world, robot, key, action)
        judge(world, robot, key)
        if record:
            copy_flat(seen[executed], sensors)
            acted[executed] = action
            spikes[executed, 0] = counts[wiring.neurons - 2]
            spikes[executed, 1] = counts[wiring.neurons - 1]
            copy_flat(path[executed + 1], robot.pose)
            st[executed + 1] = robot.count[0]
        executed += 1
    return executed
