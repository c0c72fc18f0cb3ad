"""Repair: permutations onto faulty grids, against brute force over all of them."""

from itertools import permutations

import numpy as np
import pytest

from ohmloom.errors import MappingError, ParameterError
from ohmloom.mapping.repair import GOOD, STUCK_OFF, STUCK_ON, repair, unrepaired


def cost_of(faults, demand, importance, rows, columns):
    """The rule in words, crosspoint by crosspoint."""
    total = 0.0
    for (i, j), wanted in np.ndenumerate(demand):
        fault = faults[rows[i], columns[j]]
        if (wanted and fault != GOOD) or (not wanted and fault == STUCK_ON):
            total += importance[i, j]
    return total


def best_of_all(faults, demand, importance):
    m, n = demand.shape
    return min(
        cost_of(faults, demand, importance, rows, columns)
        for rows in permutations(range(faults.shape[0]), m)
        for columns in permutations(range(faults.shape[1]), n)
    )


def case(rng, spare):
    faults = rng.choice([GOOD, STUCK_ON, STUCK_OFF], size=(3 + spare, 3 + spare), p=[0.6, 0.2, 0.2])
    return faults, rng.random((3, 3)) < 0.5, rng.uniform(0.1, 5.0, (3, 3))


@pytest.mark.parametrize("spare", [0, 1])
def test_cost_is_that_of_the_rule_and_never_below_the_best_of_all_permutations(spare):
    reached = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        faults, demand, importance = case(rng, spare)
        found = repair(faults, demand, importance, starts=30, rng=rng)
        assert found.cost == pytest.approx(cost_of(faults, demand, importance, found.rows, found.columns))
        best = best_of_all(faults, demand, importance)
        assert found.cost >= best - 1e-12
        reached += found.cost <= best + 1e-12
    # A heuristic: from thirty starts on a grid this small it may miss one or two of forty.
    assert reached >= 38


def test_lines_are_a_permutation_and_residual_faults_are_listed_by_importance():
    faults = np.full((4, 4), STUCK_OFF)
    faults[0, :2] = GOOD
    demand = np.ones((2, 3), dtype=bool)
    importance = np.array([[5.0, 1.0, 4.0], [2.0, 3.0, 0.0]])
    found = repair(faults, demand, importance, rng=np.random.default_rng(0))
    assert len(set(found.rows.tolist())) == 2
    assert len(set(found.columns.tolist())) == 3
    # One good row with two good crosspoints takes row 0 and its two most important synapses.
    assert found.residual == ((1, 1), (1, 0), (0, 1), (1, 2))
    assert found.cost == 6.0
    assert not found.is_complete


def test_order_as_placed_stays_where_it_works():
    found = repair(np.zeros((5, 4)), np.ones((3, 2), dtype=bool), rng=np.random.default_rng(0))
    assert (found.rows.tolist(), found.columns.tolist(), found.residual) == ([0, 1, 2], [0, 1], ())


def test_disabled_crosspoint_may_stand_on_a_device_that_is_off_but_not_on_one_that_is_on():
    assert unrepaired([[STUCK_OFF]], [[False]]).residual == ()
    assert unrepaired([[STUCK_ON]], [[False]]).residual == ((0, 0),)
    assert unrepaired([[STUCK_OFF]], [[True]]).residual == ((0, 0),)


def test_spare_lines_help_only_with_permutation():
    faults = np.zeros((4, 4), dtype=int)
    faults[0, 0] = STUCK_OFF
    demand = np.ones((3, 3), dtype=bool)
    assert unrepaired(faults, demand).residual == ((0, 0),)
    assert repair(faults, demand, rng=np.random.default_rng(0)).is_complete


def test_more_starts_never_cost_more():
    costs = []
    for starts in (1, 4, 16):
        rng = np.random.default_rng(2)
        faults = rng.choice([GOOD, STUCK_ON, STUCK_OFF], size=(13, 13), p=[0.85, 0.05, 0.10])
        demand = rng.random((12, 12)) < 0.5
        costs.append(repair(faults, demand, starts=starts, rng=np.random.default_rng(5)).cost)
    assert costs[0] > costs[1] >= costs[2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([[3]], [[True]]), r"^repair\.faults: expected 0 \(good\), 1 \(stuck on\) or 2 \(stuck off\), got 3\."),
        (([[0]], [[0.5]]), r"^repair\.demand: expected true or false, got 0\.5\."),
        (([0], [[True]]), r"^repair\.faults: expected axes \(physical_row, physical_column\), got shape \(1,\)"),
        (([[0]], [[True]], [[-1.0]]), r"^repair\.importance: expected numbers >= 0, got -1\."),
        (([[0]], [[True]], [[1.0, 2.0]]), r"^repair\.importance: expected axes \(logical_row=1, logical_column=1\)"),
    ],
)
def test_bad_arrays_are_refused(arguments, words):
    with pytest.raises(ParameterError, match=words):
        repair(*arguments, rng=np.random.default_rng(0))


@pytest.mark.parametrize(("shape", "word"), [((1, 2), "rows"), ((2, 1), "columns")])
def test_a_grid_smaller_than_the_demand_is_refused(shape, word):
    with pytest.raises(MappingError, match=rf"^repair\.faults: expected at least 2 {word}, .* got 1\."):
        repair(np.zeros(shape), np.ones((2, 2), dtype=bool), rng=np.random.default_rng(0))


def test_starts_and_generator_are_checked():
    with pytest.raises(ParameterError, match=r"^repair\.starts: expected an integer >= 1, got 0\."):
        repair([[0]], [[True]], starts=0, rng=np.random.default_rng(0))
    with pytest.raises(ParameterError, match=r"^repair\.rng: expected Generator, got 7\."):
        repair([[0]], [[True]], rng=7)
