"""Closed loops: one compiled call, the plain loop and the plain controller agree; bookkeeping; files; refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ohmloom.errors import FileFormatError, MissingFileError, ParameterError
from ohmloom.neurocontroller import Network, Readings, SpikingController
from ohmloom.sim import Arena, Trial, _trial_kernels, run_trial
from ohmloom.sim._arena_kernels import RobotState
from ohmloom.sim.trial import draw_trial_key, trial_fitness

ARRAYS = ("path", "st", "sensors", "actions", "output_spikes")
SCALARS = ("fitness", "solved", "timesteps", "bumps", "task", "trial_key")


class Driver:
    """Answers from a list, then forward."""

    def __init__(self, answers=()):
        self.answers = answers

    def reset(self):
        self.left = list(self.answers)

    def step(self, sensors):
        return self.left.pop(0) if self.left else "forward"


def assert_same(a, b):
    for name in SCALARS:
        assert getattr(a, name) == getattr(b, name), name
    for name in ARRAYS:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name


@pytest.mark.parametrize("action_delay", [0, 1])
@pytest.mark.parametrize("task", ["static", "dynamic"])
@pytest.mark.parametrize("readings", [{}, {"weight_at": "emission"}], ids=["masked", "general"])
def test_three_ways_to_run_a_trial_agree(task, action_delay, readings):
    readings = Readings(synapse_gain=0.5, **readings)
    network = Network.random(system="HET", rng=np.random.default_rng(7), readings=readings)
    arena = Arena.paper(task=task).replace(max_timesteps=300)
    options = {"trial_key": 2**64 - 3, "action_delay": action_delay}
    one_call = run_trial(SpikingController(network), arena, **options)
    seen = []
    loop = run_trial(SpikingController(network), arena, **options, on_timestep=seen.append)
    plain = run_trial(SpikingController(network, implementation="plain"), arena, **options)
    assert seen == list(range(len(one_call.actions)))
    assert_same(one_call, loop)
    assert_same(one_call, plain)
    assert one_call.output_spikes.shape == (len(one_call.actions), 2)
    assert {*one_call.actions.tolist()} == {0, 1, 2}
    assert one_call.bumps > 0


def test_a_whole_trial_of_the_plain_controller():
    network = Network.random(system="HP", rng=np.random.default_rng(3))
    a, b = (run_trial(SpikingController(network, implementation=i), trial_key=6) for i in ("compiled", "plain"))
    assert_same(a, b)
    assert a.timesteps >= 4000


def test_a_controller_may_be_used_again():
    network = Network.random(system="PEO", rng=np.random.default_rng(3))
    controller = SpikingController(network)
    arena = Arena.paper().replace(max_timesteps=200)
    first = run_trial(controller, arena, trial_key=1)
    run_trial(controller, arena, trial_key=2)
    assert_same(first, run_trial(controller, arena, trial_key=1))
    assert not np.array_equal(first.path, run_trial(controller, arena, trial_key=2).path)


def test_bookkeeping():
    trial = run_trial(Driver(), Arena.paper().replace(max_timesteps=800), trial_key=1)
    executed = len(trial.actions)
    assert trial.path.shape == (executed + 1, 3)
    assert trial.st.shape == (executed + 1,)
    assert trial.sensors.shape == (executed, 6)
    assert trial.output_spikes.shape == (0, 2)
    steps = np.diff(trial.st)
    assert set(steps.tolist()) == {1, 11}
    assert trial.bumps == np.sum(steps == 11) > 3
    assert trial.timesteps == trial.st[-1] == executed + 10 * trial.bumps
    assert trial.st[0] == 0
    assert trial.st[-2] < 800 <= trial.st[-1]
    # A bump shows as a jump of 10 cm back.
    jumps = np.linalg.norm(np.diff(trial.path[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(jumps[steps == 11], 0.1, atol=1e-12)
    np.testing.assert_allclose(jumps[steps == 1], 0.00384, atol=1e-12)
    assert trial.path[0, 2] == math.pi / 2
    assert not trial.solved


def test_fitness_is_the_best_along_the_path():
    trial = run_trial(Driver(["right"] * 20), Arena.paper().replace(max_timesteps=900), trial_key=1)
    along = 1000 / (1.6 - trial.path[1:, :2].sum(axis=1)) - trial.st[1:]
    assert trial.fitness == pytest.approx(max(along.max(), 1e-6), rel=1e-12)


def test_a_solved_trial():
    # The goal line moved close: x + y starts below -1.5 and north is ahead.
    arena = Arena.paper().replace(goal=-1.2)
    trial = run_trial(Driver(), arena, trial_key=1)
    assert trial.solved
    assert trial.path[-1, :2].sum() >= -1.2 > trial.path[-2, :2].sum()
    assert trial.timesteps == len(trial.actions) < 300
    assert trial.fitness == 12500 - trial.timesteps


def test_the_dynamic_task_counts_rewards():
    arena = Arena.paper(task="dynamic").replace(goal=-1.2, max_timesteps=400)
    solved = run_trial(Driver(), arena, trial_key=1)
    assert (solved.fitness, solved.solved) == (2.0, True)
    # A quarter turn, then east along the south wall: x + y reaches -0.4 there, y - x does not.
    half = run_trial(Driver(["right"] * 42), arena.replace(goal=-0.4, slip=0.0), trial_key=1)
    none = run_trial(Driver(), arena.replace(goal=1.6), trial_key=1)
    assert (none.fitness, none.solved) == (0.0, False)
    assert (half.fitness, half.solved) == (1.0, False)


def test_action_delay_moves_with_the_answer_before():
    answers = ["left", "right", "right", "left", "left", "right"]
    arena = Arena.paper().replace(max_timesteps=6)
    now = run_trial(Driver(answers), arena, trial_key=1)
    late = run_trial(Driver(answers), arena, trial_key=1, action_delay=1)
    assert now.actions.tolist() == [1, 2, 2, 1, 1, 2]
    assert late.actions.tolist() == [0, 1, 2, 2, 1, 1]


def test_the_generator_draws_only_the_key():
    rng, twin = np.random.default_rng(4), np.random.default_rng(4)
    arena = Arena.paper(task="dynamic").replace(max_timesteps=50)
    drawn = run_trial(Driver(), arena, rng=rng)
    key = draw_trial_key(twin)
    assert drawn.trial_key == key
    assert rng.random() == twin.random()
    assert_same(drawn, run_trial(Driver(), arena, trial_key=key))


def test_keys_use_all_64_bits():
    rng = np.random.default_rng(0)
    keys = [draw_trial_key(rng) for _ in range(200)]
    assert max(keys) > 2**63
    assert max(keys) < 2**64
    assert all(isinstance(key, int) for key in keys)


@pytest.mark.parametrize("task", ["static", "dynamic"])
def test_fitness_without_a_recording_is_the_same(task):
    arena = Arena.paper(task=task).replace(max_timesteps=300)
    for seed in range(6):
        controller = SpikingController(Network.random(system="HET", rng=np.random.default_rng(seed)))
        trial = run_trial(controller, arena, trial_key=seed)
        assert trial_fitness(controller, arena, seed) == (trial.fitness, trial.solved, len(trial.actions))


def test_save_and_load(tmp_path):
    network = Network.random(system="HET", rng=np.random.default_rng(1))
    trial = run_trial(SpikingController(network), Arena.paper().replace(max_timesteps=80), trial_key=2**63 + 1)
    trial.save(tmp_path / "a" / "trial.npz")
    loaded = Trial.load(tmp_path / "a" / "trial.npz")
    assert_same(trial, loaded)
    assert loaded.provenance == trial.provenance
    assert loaded.provenance["arena"]["max_timesteps"] == 80
    loaded.save(tmp_path / "b.npz")
    assert (tmp_path / "b.npz").read_bytes() == (tmp_path / "a" / "trial.npz").read_bytes()
    # From its own provenance the trial can be run again.
    arena = Arena(**loaded.provenance["arena"])
    assert_same(trial, run_trial(SpikingController(network), arena, trial_key=loaded.trial_key))


def test_damaged_trial_files(tmp_path):
    path = tmp_path / "trial.npz"
    run_trial(Driver(), Arena.paper().replace(max_timesteps=20), trial_key=1).save(path)
    data = path.read_bytes()
    for damaged in (b"", b"text", data[:100], data[:-30], data[: len(data) // 2],
                    data[:300] + bytes(60) + data[360:]):  # fmt: skip
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError, match=r"trial\.npz: expected an npz file of a trial, got"):
            Trial.load(path)
    np.savez(path, path=np.zeros((2, 3)))
    with pytest.raises(FileFormatError, match="header: expected text"):
        Trial.load(path)
    with pytest.raises(MissingFileError, match="expected a trial file"):
        Trial.load(tmp_path / "none.npz")


def test_arrays_of_a_trial_are_locked_and_checked():
    trial = run_trial(Driver(), Arena.paper().replace(max_timesteps=5), trial_key=1)
    with pytest.raises(ValueError, match="read-only"):
        trial.path[0, 0] = 1.0
    with pytest.raises(ParameterError, match=r"^Trial\.path: expected axes \(time, pose=3\), got shape \(4, 2\)"):
        Trial(fitness=0.0, solved=False, timesteps=0, bumps=0, path=np.zeros((4, 2)), st=trial.st, task="static",
              sensors=trial.sensors, actions=trial.actions, output_spikes=trial.output_spikes, trial_key=1)  # fmt: skip


def test_plot_and_table():
    trial = run_trial(Driver(), Arena.paper().replace(max_timesteps=5), trial_key=1)
    axes = trial.plot()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert len(axes.lines[0].get_xdata()) == 6
    assert trial.plot(axes) is axes
    assert "goal not reached" in axes.get_title()
    assert "<th>fitness</th>" in trial._repr_html_()


@pytest.mark.parametrize("answer", ["back", 0, None, ["forward"], np.array([1, 2])], ids=str)
def test_an_answer_that_is_no_action(answer):
    with pytest.raises(ParameterError) as caught:
        run_trial(Driver([answer]), trial_key=1)
    assert str(caught.value) == (
        "run_trial.controller: expected step() to return 'forward', 'left' or 'right', "
        f"got {answer!r}. Return one of these."
    )


@pytest.mark.parametrize(("arguments", "message"), [
    ({}, "run_trial: expected either rng or trial_key, got both or none. Pass one of them."),
    ({"trial_key": 1, "rng": np.random.default_rng(1)},
     "run_trial: expected either rng or trial_key, got both or none. Pass one of them."),
    ({"trial_key": 1, "action_delay": 2},
     "run_trial.action_delay: expected an integer from 0 to 1, got 2. Correct it."),
    ({"trial_key": 2**64},
     f"run_trial.trial_key: expected an integer from 0 to 18446744073709551615, got {2**64}. Correct it."),
    ({"trial_key": -1},
     "run_trial.trial_key: expected an integer from 0 to 18446744073709551615, got -1. Correct it."),
    ({"trial_key": 1.5},
     "run_trial.trial_key: expected an integer from 0 to 18446744073709551615, got 1.5. Correct it."),
])  # fmt: skip
def test_wrong_arguments(arguments, message):
    with pytest.raises(ParameterError) as caught:
        run_trial(Driver(), **arguments)
    assert str(caught.value) == message


def test_a_recording_never_goes_beyond_its_rows():
    arena = Arena.paper().replace(max_timesteps=30)
    wiring, state = SpikingController(Network.random(system="HP", rng=np.random.default_rng(1))).kernel_arguments
    rows, spare = 11, 5  # fewer rows than timesteps, and what lies behind them in the same memory
    path, seen = np.full((rows + spare, 3), 7.0), np.full((rows + spare, 6), 7.0)
    st, acted = (np.full(rows + spare, 7, dtype=np.int64) for _ in range(2))
    spikes = np.full((rows + spare, 2), 7, dtype=np.int64)
    executed = _trial_kernels.run(
        arena.world(), RobotState(np.zeros(3), np.zeros(5, dtype=np.int64), np.zeros(1)), np.uint64(1), wiring, state,
        np.zeros(wiring.neurons, dtype=np.int64), np.zeros(6), 0, True, path[:rows], st[:rows], seen[:rows],
        acted[:rows], spikes[:rows],
    )  # fmt: skip
    assert executed == rows - 1
    for array in (path, seen, st, acted, spikes):
        assert (array[rows:] == 7).all()


@pytest.mark.parametrize(("field", "controller", "changes"), [
    ("controller", None, {}), ("controller", "HET", {}), ("controller", object(), {}),
    ("arena", Driver(), {"arena": 1}),
    ("rng", Driver(), {"rng": 3, "trial_key": None}), ("trial_key", Driver(), {"trial_key": True}),
    ("action_delay", Driver(), {"action_delay": True}), ("on_timestep", Driver(), {"on_timestep": 1}),
])  # fmt: skip
def test_objects_of_a_wrong_type(field, controller, changes):
    with pytest.raises(ParameterError, match=rf"^run_trial\.{field}: expected .*, got "):
        run_trial(controller, **({"trial_key": 1} | changes))
