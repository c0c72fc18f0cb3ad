"""Morris and Sobol': against SALib on the same points, against the closed form of the Ishigami function, by hand."""

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.sim.screening import morris_effects, morris_sample, saltelli_sample, sobol_indices

BOUNDS = {"num_vars": 3, "names": ["x", "y", "z"], "bounds": [[0.0, 1.0]] * 3}


def ishigami(u):
    x, y, z = np.moveaxis(2 * np.pi * u - np.pi, -1, 0)
    return np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def test_effects_of_a_line_are_its_slopes():
    sample = morris_sample(3, 5, rng=np.random.default_rng(1))
    found = morris_effects(sample, sample @ np.array([2.0, -1.0, 0.0]))
    assert found.mu_star == pytest.approx([2.0, 1.0, 0.0], abs=1e-12)
    assert found.sigma == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_trajectories_stay_on_the_grid_and_move_every_factor_once():
    sample = morris_sample(4, 20, rng=np.random.default_rng(2))
    assert set(np.round(3 * sample.ravel()).astype(int)) == {0, 1, 2, 3}
    assert np.allclose(3 * sample, np.round(3 * sample))
    assert (np.sort((np.diff(sample, axis=1) != 0.0).argmax(axis=2), axis=1) == np.arange(4)).all()


def test_morris_is_salibs():
    from SALib.analyze import morris

    sample = morris_sample(3, 12, rng=np.random.default_rng(3))
    y = ishigami(sample)
    theirs = morris.analyze(BOUNDS, sample.reshape(-1, 3), y.ravel(), num_levels=4, seed=1)
    ours = morris_effects(sample, y)
    assert ours.mu_star == pytest.approx(np.asarray(theirs["mu_star"]), rel=1e-9)
    assert ours.sigma == pytest.approx(np.asarray(theirs["sigma"]), rel=1e-9)


def test_sobol_is_salibs():
    from SALib.analyze import sobol

    y = ishigami(saltelli_sample(3, 256, seed=1))
    theirs = sobol.analyze(BOUNDS, y.ravel(), calc_second_order=False, seed=1)
    ours = sobol_indices(y)
    assert ours.first == pytest.approx(theirs["S1"], rel=1e-9, abs=1e-12)
    assert ours.total == pytest.approx(theirs["ST"], rel=1e-9)


def test_sobol_of_ishigami_is_its_closed_form():
    found = sobol_indices(ishigami(saltelli_sample(3, 4096, seed=2)))
    # Closed forms for a = 7, b = 0.1; 4096 quasi-random points leave errors of about 1 %.
    assert found.first == pytest.approx([0.3139, 0.4424, 0.0], abs=0.01)
    assert found.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.01)
    assert (found.total_interval[:, 0] < found.total).all()
    assert (found.total < found.total_interval[:, 1]).all()


def test_nothing_varies():
    assert sobol_indices(np.ones((8, 4))).total.tolist() == [0.0, 0.0]


def test_number_of_points_is_a_power_of_two():
    with pytest.raises(ParameterError, match=r"saltelli_sample\.n: expected a power of two, got 12\. Take 16"):
        saltelli_sample(3, 12)


def test_every_point_needs_an_output():
    with pytest.raises(ParameterError, match=r"morris_effects\.output: expected axes"):
        morris_effects(morris_sample(2, 3, rng=np.random.default_rng(1)), np.zeros((3, 2)))
