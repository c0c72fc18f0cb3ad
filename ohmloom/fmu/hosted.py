"""Hosted FMUs where the house has parts of its own: a trial's controller, and its arena."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.errors import OperationError, ParameterError
from ohmloom.fmu._discrete_code import SENSORS, key_parts
from ohmloom.fmu.host import Host
from ohmloom.neurocontroller import ACTIONS
from ohmloom.sim.trial import Score

TIMESTEP = 0.032  # s, where an FMU suggests none
SPIKES = ("spikes_left", "spikes_right")
POSE = ("x", "y", "heading")


class HostedController:
    """A hosted FMU that drives the robot: six sensors in, `action` out, as `export_controller` has them.

    Examples
    --------
    >>> HostedController("controller.fmu")
    Traceback (most recent call last):
    ohmloom.errors.ParameterError: HostedController: host: expected a Host, got 'controller.fmu'. Make one of the file.
    """

    def __init__(self, host: Host) -> None:
        _need("HostedController", host, SENSORS, ("action",))
        self._host, self._step = host, host.step_size or TIMESTEP
        self._spikes = [name for name in SPIKES if name in host.outputs]
        self._counts = np.zeros(2, dtype=np.int64)

    def reset(self) -> None:
        """Back to the start of a trial."""
        self._host.reset()

    def step(self, sensors: Sequence[float] | FloatArray, /) -> str:
        """One timestep."""
        given = dict(zip(SENSORS, map(float, sensors), strict=True))
        found = self._host.step(self._step, given, ["action", *self._spikes])
        if found["action"] not in range(len(ACTIONS)):
            raise OperationError(
                f"{self._host.path}: action: expected 0, 1 or 2, got {found['action']}. Check the FMU."
            )
        self._counts = np.array([found.get(name, 0) for name in SPIKES], dtype=np.int64)
        return ACTIONS[int(found["action"])]

    @property
    def output_spikes(self) -> IntArray:
        """Spikes of the left and the right output in the last timestep, (2,); 0 if the FMU tells none."""
        return self._counts


class HostedArena:
    """A hosted FMU in which the robot is driven, with the variables of `export_arena`; for `run_trial`."""

    def __init__(self, host: Host) -> None:
        _need("HostedArena", host, ("action",), (*SENSORS, *POSE, "st", "solved", "done"))
        self._host, self._step = host, host.step_size or TIMESTEP
        self._now: dict[str, Any] = {}
        self.task = "dynamic" if "slip" in host.variables else "static"

    def begin(self, trial_key: int, /) -> None:
        """Place the robot for a trial with this key."""
        self._host.reset(key_parts(trial_key))
        self._now = self._host.get(self._host.outputs)

    def sense(self) -> FloatArray:
        """Sensors (6,)."""
        return np.array([self._now[name] for name in SENSORS])

    def move(self, action: int, /) -> None:
        """Carry out an action for one timestep."""
        self._now = self._host.step(self._step, {"action": action}, self._host.outputs)

    def pose(self) -> FloatArray:
        """(3,): x [m], y [m], heading [rad]."""
        return np.array([self._now[name] for name in POSE])

    def score(self) -> Score:
        """How far the trial has come."""
        now = self._now
        return Score(st=int(now["st"]), bumps=int(now.get("bumps", 0)), fitness=float(now.get("fitness", 0.0)),
                     solved=bool(now["solved"]), done=bool(now["done"]))  # fmt: skip

    def settings(self) -> dict[str, Any]:
        """Where it runs."""
        return {"fmu": self._host.path.name}


def _need(where: str, host: object, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    if not isinstance(host, Host):
        raise ParameterError(f"{where}: host: expected a Host, got {host!r}. Make one of the file.")
    for kind, wanted, there in (("input", inputs, host.inputs), ("output", outputs, host.outputs)):
        missing = [name for name in wanted if name not in there]
        if missing:
            raise ParameterError(f"{host.path}: expected the {kind}s {', '.join(wanted)}, got none named "
                                 f"{', '.join(missing)}. Host another FMU.")  # fmt: skip
