"""A trial: a controller drives the robot until the goal or the end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ohmloom import __version__
from ohmloom._arrays import FloatArray, IntArray, frozen_array, read_arrays, write_arrays
from ohmloom.errors import FileFormatError, ParameterError, expect_integer, expect_type, shown
from ohmloom.sim.arena import Arena

ACTIONS = ("forward", "left", "right")


class Controller(Protocol):
    """Anything that can drive the robot."""

    def reset(self) -> None:
        """Back to the start of a trial."""

    def step(self, sensors: Any, /) -> str:
        """Sensors (6,) in, action out: ``forward``, ``left`` or ``right``."""


@runtime_checkable
class _Driver(Controller, Protocol):
    """For the check: a class without these methods is none."""


@runtime_checkable
class TrialArena(Protocol):
    """An arena that runs elsewhere, step by step: what a trial asks of it."""

    task: str

    def begin(self, trial_key: int, /) -> None:
        """Place the robot for a trial with this key."""

    def sense(self) -> Any:
        """Sensors (6,), each in [0, 1]."""

    def move(self, action: int, /) -> None:
        """Carry out an action, 0 forward, 1 left, 2 right, for one timestep."""

    def pose(self) -> Any:
        """(3,): x [m], y [m], heading [rad]."""

    def score(self) -> Score:
        """How far the trial has come."""

    def settings(self) -> dict[str, Any]:
        """Plain values for the trial's provenance."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """What an arena counts: as the fields of `Trial`, `st` being its `timesteps`; and whether the trial has ended."""

    st: int
    bumps: int
    fitness: float
    solved: bool
    done: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """What happened in one trial.

    Attributes
    ----------
    fitness
        Best value of eq. 14 over the trial (static), or rewards found, 0 to 2 (dynamic).
    solved
        Whether the goal was reached (dynamic: both goals).
    timesteps, bumps
        Counted timesteps st, 10 for each bump included; number of bumps.
    path
        (time, 3): x [m], y [m], heading [rad, 0 = +x, counter-clockwise]; executed timesteps + 1 rows.
    st
        (time,) counted timesteps beside each row of `path`.
    sensors, actions, output_spikes
        (timestep, 6) in [0, 1]; (timestep,) 0 forward, 1 left, 2 right; (timestep, 2) counts, or no rows if
        the controller has none.
    task, trial_key, provenance
        Task, the 64-bit key of the trial's random numbers, version and settings.
    """

    fitness: float
    solved: bool
    timesteps: int
    bumps: int
    path: FloatArray
    st: IntArray
    sensors: FloatArray
    actions: IntArray
    output_spikes: IntArray
    task: str
    trial_key: int
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, axes, dtype in (
            ("path", ("time", "pose=3"), np.float64), ("st", ("time",), np.int64),
            ("sensors", ("timestep", "sensor=6"), np.float64), ("actions", ("timestep",), np.int64),
            ("output_spikes", ("timestep", "output=2"), np.int64),
        ):  # fmt: skip
            object.__setattr__(self, name, frozen_array(f"Trial.{name}", getattr(self, name), axes, dtype=dtype))

    def save(self, path: Path | str) -> None:
        """Write the trial as npz, whole or not at all; the same trial gives the same bytes."""
        header, arrays = self.to_parts()
        write_arrays(path, "trial", 1, header, arrays)

    def to_parts(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Plain values and arrays of the trial, for files that hold it."""
        header = {k: getattr(self, k) for k in _SCALARS} | {"provenance": dict(self.provenance)}
        return header, {name: getattr(self, name) for name in TRIAL_ARRAYS}

    @classmethod
    def load(cls, path: Path | str) -> Trial:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError, FileFormatError
            If the file does not exist, or is not a whole trial.
        """
        header, arrays = read_arrays(path, "trial", 1, TRIAL_ARRAYS)
        try:
            return cls(**header, **arrays)
        except (ParameterError, TypeError) as error:
            raise FileFormatError(f"{path}: expected a trial saved by ohmloom, got {error}. Save it again.") from error

    def plot(self, ax: Any = None) -> Any:
        """Draw the path; an Axes in m."""
        from matplotlib.figure import Figure

        axes = Figure(figsize=(5, 5)).add_subplot() if ax is None else ax
        axes.plot(self.path[:, 0], self.path[:, 1])
        axes.set_aspect("equal")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_title(f"{'goal reached' if self.solved else 'goal not reached'} in {self.timesteps} timesteps")
        return axes

    def _repr_html_(self) -> str:
        cells = "".join(f"<tr><th>{k}</th><td>{getattr(self, k)}</td></tr>" for k in _SCALARS)
        return f"<table><caption>Trial</caption>{cells}</table>"


_SCALARS = ("fitness", "solved", "timesteps", "bumps", "task", "trial_key")
TRIAL_ARRAYS = ("path", "st", "sensors", "actions", "output_spikes")


def draw_trial_key(rng: np.random.Generator) -> int:
    """A 64-bit key for the random numbers of one trial."""
    return int(rng.integers(0, 2**64, dtype=np.uint64))


def run_trial(
    controller: Controller,
    arena: Arena | TrialArena | None = None,
    *,
    rng: np.random.Generator | None = None,
    trial_key: int | None = None,
    action_delay: int = 0,
    on_timestep: Callable[[int], None] | None = None,
) -> Trial:
    """Let `controller` drive the robot for one trial.

    Parameters
    ----------
    controller
        Any object with ``reset()`` and ``step(sensors)``; compiled controllers run in one call.
    arena
        Where; the paper's static arena by default. One that runs elsewhere, like a hosted FMU, is a `TrialArena`.
    rng, trial_key
        Exactly one: the generator that draws the trial's 64-bit key, or that key.
    action_delay
        0, or 1 to move with the action of the timestep before (the first is ``forward``), as a co-simulation
        master that adds a step of delay does.
    on_timestep
        Called after each timestep with its index, from 0; the trial then runs in the plain loop.

    Raises
    ------
    ParameterError
        If not exactly one of `rng` and `trial_key` is given, or the controller answers with no known action.

    Examples
    --------
    >>> class Blind:
    ...     def reset(self): pass
    ...     def step(self, sensors): return "forward"
    >>> trial = run_trial(Blind(), trial_key=1)
    >>> trial.solved, trial.timesteps
    (False, 4000)
    """
    expect_type("run_trial.controller", controller, _Driver, name="an object with reset() and step(sensors)")
    expect_type("run_trial.arena", arena, Arena, TrialArena, type(None), name="an Arena or None")
    expect_type("run_trial.rng", rng, np.random.Generator, type(None), name="a numpy Generator or None")
    if (rng is None) == (trial_key is None):
        raise ParameterError("run_trial: expected either rng or trial_key, got both or none. Pass one of them.")
    action_delay = expect_integer("run_trial.action_delay", action_delay, 0, 1)
    if on_timestep is not None and not callable(on_timestep):
        raise ParameterError(f"run_trial.on_timestep: expected a function of the timestep's index, "
                             f"got {shown(on_timestep)}. Pass a function.")  # fmt: skip
    if trial_key is None:
        assert rng is not None
        trial_key = draw_trial_key(rng)
    trial_key = expect_integer("run_trial.trial_key", trial_key, 0, 2**64 - 1)
    arena = arena if arena is not None else Arena.paper()
    arguments = getattr(controller, "kernel_arguments", (None, None))
    if arguments[0] is not None and on_timestep is None and isinstance(arena, Arena):
        trial = _run_compiled(arguments, arena, trial_key, action_delay)
        check_solved = getattr(controller, "check_solved", None)
        if check_solved is not None:
            check_solved()
        return trial
    place = _OwnArena(arena) if isinstance(arena, Arena) else arena
    return _run_plain(controller, place, trial_key, action_delay, on_timestep)


def trial_fitness(controller: Any, arena: Arena, trial_key: int) -> tuple[float, bool, int]:
    """Fitness, solved and executed timesteps of a trial, without a recording if the controller runs in one call."""
    from ohmloom.sim import _trial_kernels

    wiring, state = controller.kernel_arguments
    if wiring is None:
        trial = run_trial(controller, arena, trial_key=trial_key)
        return trial.fitness, trial.solved, len(trial.actions)
    robot = _new_robot()
    none = np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 6))
    executed = _trial_kernels.run(
        arena.world(), robot, np.uint64(trial_key), wiring, state, np.zeros(_neurons(wiring), dtype=np.int64),
        np.zeros(6), 0, False, *none, np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64),
    )  # fmt: skip
    return _fitness(arena, robot), _is_solved(arena, robot), int(executed)


def _new_robot() -> Any:
    from ohmloom.sim._arena_kernels import RobotState

    return RobotState(np.zeros(3), np.zeros(5, dtype=np.int64), np.zeros(1))


def _is_solved(arena: Arena, robot: Any) -> bool:
    return bool(robot.counts[2] == (2 if arena.task == "dynamic" else 1))


def _fitness(arena: Arena, robot: Any) -> float:
    # The floor above 0 is a matter of eq. 14; the dynamic task counts rewards.
    return float(robot.counts[2]) if arena.task == "dynamic" else float(robot.best[0])


def _run_compiled(arguments: Any, arena: Arena, key: int, action_delay: int) -> Trial:
    from ohmloom.sim import _trial_kernels

    wiring, state = arguments
    robot = _new_robot()
    rows = arena.max_timesteps + 1
    path, st = np.zeros((rows, 3)), np.zeros(rows, dtype=np.int64)
    seen, acted, spikes = (
        np.zeros((rows, 6)),
        np.zeros(rows, dtype=np.int64),
        np.zeros((rows, 2), dtype=np.int64),
    )
    n = _trial_kernels.run(
        arena.world(), robot, np.uint64(key), wiring, state, np.zeros(_neurons(wiring), dtype=np.int64),
        np.zeros(6), action_delay, True, path, st, seen, acted, spikes,
    )  # fmt: skip
    return _trial(_OwnArena(arena, robot), key, path[: n + 1], st[: n + 1], seen[:n], acted[:n], spikes[:n])


class _OwnArena:
    """The arena of the kernels, as a trial asks for one."""

    def __init__(self, arena: Arena, robot: Any = None) -> None:
        self._arena, self._world, self._robot = arena, arena.world(), _new_robot() if robot is None else robot
        self._key = np.uint64(0)
        self.task: str = arena.task

    def begin(self, trial_key: int, /) -> None:
        from ohmloom.sim import _arena_kernels

        self._key = np.uint64(trial_key)
        _arena_kernels.begin(self._world, self._robot, self._key)

    def sense(self) -> FloatArray:
        from ohmloom.sim import _arena_kernels

        sensors = np.zeros(6)
        _arena_kernels.sense(self._world, self._robot, self._key, sensors)
        return sensors

    def move(self, action: int, /) -> None:
        from ohmloom.sim import _arena_kernels

        _arena_kernels.move(self._world, self._robot, self._key, action)
        _arena_kernels.judge(self._world, self._robot, self._key)

    def pose(self) -> FloatArray:
        pose: FloatArray = self._robot.pose.copy()
        return pose

    def score(self) -> Score:
        count = self._robot.counts
        return Score(st=int(count[0]), bumps=int(count[1]), fitness=_fitness(self._arena, self._robot),
                     solved=_is_solved(self._arena, self._robot), done=bool(count[4]))  # fmt: skip

    def settings(self) -> dict[str, Any]:
        return self._arena.settings()


def _neurons(wiring: Any) -> int:
    return wiring.neurons if isinstance(wiring.neurons, int) else len(wiring.neurons)


def _run_plain(
    controller: Controller,
    arena: TrialArena,
    key: int,
    action_delay: int,
    on_timestep: Callable[[int], None] | None,
) -> Trial:
    controller.reset()
    arena.begin(key)
    path, st = [arena.pose()], [0]
    seen: list[FloatArray] = []
    acted: list[int] = []
    spikes: list[Any] = []
    delayed = 0
    while not arena.score().done:
        sensors = np.asarray(arena.sense(), dtype=np.float64)
        answer = controller.step(sensors.copy())
        if not isinstance(answer, str) or answer not in ACTIONS:
            raise ParameterError("run_trial.controller: expected step() to return 'forward', 'left' or "
                                 f"'right', got {answer!r}. Return one of these.")  # fmt: skip
        action = ACTIONS.index(answer)
        if action_delay:
            action, delayed = delayed, action
        arena.move(action)
        seen.append(sensors)
        acted.append(action)
        if hasattr(controller, "output_spikes"):
            spikes.append(controller.output_spikes)
        path.append(arena.pose())
        st.append(arena.score().st)
        if on_timestep is not None:
            on_timestep(len(acted) - 1)
    return _trial(arena, key, path, st, seen, acted, np.array(spikes, dtype=np.int64).reshape(-1, 2))


def _trial(arena: TrialArena, key: int, path: Any, st: Any, seen: Any, acted: Any, spikes: Any) -> Trial:
    score = arena.score()
    return Trial(
        fitness=score.fitness, solved=score.solved, timesteps=score.st, bumps=score.bumps, path=path, st=st,
        sensors=seen, actions=acted, output_spikes=spikes, task=arena.task, trial_key=key,
        provenance={"ohmloom": __version__, "arena": arena.settings()},
    )  # fmt: skip
