"""Selection, replacement and re-evaluation on small populations with made-up fitness."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from ohmloom.neurocontroller import Network, Readings
from ohmloom.sim import Arena, population
from ohmloom.sim.population import IndividualState, PopulationState, roulette, run_starts, start_keys

SHORT = Arena.paper().replace(max_timesteps=30)


def found(state, system, size):
    for _ in range(size):
        state.found(system, 0.5, Readings())


def individual(birth, fitness):
    network = Network.random(system="HP", rng=np.random.default_rng(birth), hidden=2)
    return IndividualState(network=network, birth=birth, trial_keys=[birth], total=fitness, trials=1)


def made_of(fitness, **options):
    state = PopulationState(SHORT, np.random.default_rng(1), **({"starts": 1, "reevaluate": False} | options))
    state.individuals = [individual(birth, value) for birth, value in enumerate(fitness)]
    state.births = len(fitness)
    return state


def draws(fitness, count=6000):
    rng = np.random.default_rng(2)
    found = Counter(roulette(np.array(fitness, dtype=float), rng) for _ in range(count))
    return [found[k] / count for k in range(len(fitness))]


def test_roulette_is_proportional():
    assert draws([1, 0, 3, 6]) == pytest.approx([0.1, 0.0, 0.3, 0.6], abs=0.03)


def test_what_has_no_fitness_is_never_drawn():
    assert draws([0, 0, 2, 0]) == [0, 0, 1, 0]


def test_roulette_is_uniform_if_all_fitness_is_0():
    assert draws([0, 0, 0, 0]) == pytest.approx([0.25] * 4, abs=0.03)


def test_roulette_draws_with_replacement():
    rng = np.random.default_rng(2)
    pairs = [(roulette(np.ones(3), rng), roulette(np.ones(3), rng)) for _ in range(300)]
    assert any(a == b for a, b in pairs)


class Fixed:
    """Stands for the trials: every new network gets the next fitness of a list."""

    def __init__(self, *values):
        self.values = list(values)
        self.keys = []

    def __call__(self, network, arena, keys):
        self.keys.append(list(keys))
        return np.full(len(keys), self.values.pop(0)), np.zeros(len(keys), dtype=bool)


def test_the_two_worst_of_all_leave(monkeypatch):
    state = made_of([5.0, 1.0, 4.0, 2.0, 3.0])
    monkeypatch.setattr(population, "run_starts", Fixed(10.0, 9.0))
    state.advance()
    assert [i.birth for i in state.individuals] == [0, 2, 4, 5, 6]
    assert [i.fitness for i in state.individuals] == [5.0, 4.0, 3.0, 10.0, 9.0]


def test_bad_offspring_leave_at_once(monkeypatch):
    state = made_of([5.0, 4.0, 3.0])
    monkeypatch.setattr(population, "run_starts", Fixed(1.0, 2.0))
    state.advance()
    assert [i.birth for i in state.individuals] == [0, 1, 2]
    assert state.births == 5


def test_among_equals_the_oldest_leave(monkeypatch):
    state = made_of([7.0, 7.0, 7.0, 8.0])
    monkeypatch.setattr(population, "run_starts", Fixed(7.0, 7.0))
    state.advance()
    assert [i.birth for i in state.individuals] == [2, 3, 4, 5]
    assert state.best().birth == 3


def test_the_best_is_the_oldest_among_equals():
    assert made_of([1.0, 4.0, 4.0]).best().birth == 1


def test_parents_are_tried_again_only_if_asked(monkeypatch):
    state = made_of([6.0, 0.0, 0.0])
    trials = Fixed(1.0, 1.0)
    monkeypatch.setattr(population, "run_starts", trials)
    state.advance()
    assert len(trials.keys) == 2
    assert state.individuals[0].trials == 1

    state = made_of([6.0, 0.0, 0.0], reevaluate=True)
    trials = Fixed(2.0, 1.0, 1.0, 1.0)
    monkeypatch.setattr(population, "run_starts", trials)
    state.advance()
    # Individual 0 is both parents: 6, then 2 and 1 on fresh starts.
    assert state.individuals[0].trials == 3
    assert state.individuals[0].fitness == pytest.approx(3.0)
    assert len({key for keys in trials.keys for key in keys}) == 4


def test_fitness_is_the_mean_over_the_starts():
    network = Network.random(system="HET", rng=np.random.default_rng(7))
    keys = start_keys(11, 5)
    assert keys[0] == 11
    assert len({*keys}) == 5
    together, _ = run_starts(network, SHORT, keys)
    alone = [run_starts(network, SHORT, [key])[0][0] for key in keys]
    assert together.tolist() == alone
    state = PopulationState(SHORT, np.random.default_rng(1), starts=5, reevaluate=False)
    found(state, "HET", 3)
    for member in state.individuals:
        fitness, _ = run_starts(member.network, SHORT, start_keys(member.trial_keys[0], 5))
        assert member.trials == 5
        assert member.fitness == pytest.approx(fitness.mean(), rel=1e-14)


def test_a_dynamic_population_without_rewards_has_fitness_0():
    arena = Arena.paper(task="dynamic").replace(max_timesteps=20)
    state = PopulationState(arena, np.random.default_rng(1), starts=1, reevaluate=False)
    found(state, "HP", 4)
    assert [i.fitness for i in state.individuals] == [0.0] * 4


def test_the_first_solution_is_remembered():
    arena = SHORT.replace(goal=-1.9, start_line=-1.5)  # every start is beyond this line
    state = PopulationState(arena, np.random.default_rng(1), starts=1, reevaluate=False)
    assert state.first_solved is None
    found(state, "LIN", 3)
    assert state.first_solved == 0
    assert state.observe()["mean_success"] == 1.0


@pytest.mark.parametrize("system", ["GA", "HET"])
def test_a_checkpoint_continues_exactly(system):
    options = {"starts": 2, "reevaluate": True}
    whole = PopulationState(SHORT, np.random.default_rng(4), **options)
    found(whole, system, 5)
    whole.advance()
    table = json.loads(json.dumps(whole.to_table()))
    other = PopulationState(SHORT, np.random.default_rng(999), **options)
    other.restore(table, system, Readings())
    assert other.to_table() == whole.to_table()
    for state in (whole, other):
        for _ in range(4):
            state.advance()
    assert other.to_table() == whole.to_table()
    assert other.observe() == whole.observe()


def test_observations_are_means_over_the_population():
    state = made_of([1.0, 2.0, 6.0])
    row = state.observe()
    assert (row["best_fitness"], row["mean_fitness"]) == (6.0, 3.0)
    assert (row["nodes"], row["hidden"]) == (10.0, 2.0)
    assert row["connectivity"] == pytest.approx(np.mean([i.network.connectivity for i in state.individuals]))


def test_first_reward_and_first_solution_are_counted_in_trials(monkeypatch):
    outcomes = iter([([0.0, 0.0], [False, False]), ([0.0, 1.0], [False, False]), ([2.0, 1.0], [True, False])])

    def trials(network, arena, keys):
        fitness, reached = next(outcomes)
        return np.array(fitness), np.array(reached)

    monkeypatch.setattr(population, "run_starts", trials)
    state = PopulationState(Arena(task="dynamic"), np.random.default_rng(1), starts=2, reevaluate=False)
    found(state, "HET", 3)
    assert (state.first_reward_trial, state.first_solved_trial, state.trials) == (3, 4, 6)
    again = PopulationState(Arena(task="dynamic"), np.random.default_rng(2), starts=2, reevaluate=False)
    again.restore(state.to_table(), "HET", Readings())
    assert again.to_table() == state.to_table()


def test_an_observation_counts_the_best_networks_synapses_by_layer():
    state = made_of([1.0, 4.0, 2.0])
    row, best = state.observe(), state.best().network
    counts = {name: value for name, value in row.items() if name.startswith("best_") and isinstance(value, int)}
    assert len(counts) == 12
    assert sum(counts.values()) == len(best.synapses)
    outputs = range(6 + len(best.hidden), best.neurons)
    assert counts["best_hp_hidden_output"] == sum(s.kind == "hp" and s.post in outputs for s in best.synapses)
