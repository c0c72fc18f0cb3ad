"""Many dies in one call: each trial is the one that the die runs alone."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import champion
from ohmloom.sim import Arena, run_dies, run_trial

ARENA = Arena(task="static", max_timesteps=300)
KEYS = [[11, 12], [21, 22], [31, 32]]


@pytest.fixture(scope="module")
def dies():
    spread, ideal = Hardware.load("het_mixed").nonidealities, Hardware.load("ideal")
    plan = place(champion("HET"), ideal.model_copy(update={"nonidealities": spread}))
    return [plan.sample(seed=3, die=k) for k in range(len(KEYS))]


def test_a_batch_is_its_dies_run_alone(dies):
    runs = run_dies(dies, ARENA, trial_keys=KEYS)
    for d, die in enumerate(dies):
        alone = EmulatedController(die)
        for t, key in enumerate(KEYS[d]):
            trial = run_trial(alone, ARENA, trial_key=key)
            assert (runs.fitness[d, t], runs.solved[d, t], runs.timesteps[d, t]) == (
                trial.fitness, trial.solved, len(trial.actions)
            )  # fmt: skip
            assert runs.ledgers[d][t] == alone.ledger
    # Dies and starts differ, or the comparison would show nothing.
    assert len({ledger.charge for row in runs.ledgers for ledger in row}) == np.size(KEYS)


@pytest.mark.parametrize("keys", [[[1], [2]], [[1], [2], [3, 4]]])
def test_keys_that_are_not_as_many_for_each_die_are_refused(dies, keys):
    with pytest.raises(
        ParameterError, match=r"^run_dies\.trial_keys: expected as many keys for each of 3 dies, got \["
    ):
        run_dies(dies, ARENA, trial_keys=keys)


def test_a_batch_wants_dies_and_whole_keys(dies):
    with pytest.raises(ParameterError, match=r"^run_dies\.dies\[0\]: expected Die, got 1\."):
        run_dies([1], ARENA, trial_keys=[[1]])
    with pytest.raises(ParameterError, match=r"^run_dies\.trial_keys\[0\]\[1\]: "):
        run_dies(dies[:1], ARENA, trial_keys=[[1, -1]])
