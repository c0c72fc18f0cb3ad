"""The compiled potentials of one crossbar, against a dense matrix, against `Crossbar`, and where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.circuits import Crossbar
from ohmloom.circuits._crossbar_kernels import SCRATCH, TOLERANCE, solve_potentials


def solved(g, v, *, r_row, r_column, r_driver=0.0, r_sense=0.0, guess=None, tolerance=TOLERANCE, source=None):
    """(column currents, u, w, iterations); scratch full of NaN, so that nothing is read before it is written."""
    m, n = g.shape
    with np.errstate(divide="ignore"):
        near, far = 1.0 / np.broadcast_to(r_row + r_driver, m), 1.0 / np.broadcast_to(r_column + r_sense, n)
    u, w = np.full((m, n), np.nan) if guess is None else guess.copy(), np.full((m, n), np.nan)
    source = np.zeros((m, n)) if source is None else source
    iterations = solve_potentials(
        g, source, (r_row, near, np.zeros(m)), (r_column, np.zeros(n), far), v, np.zeros(n), u, w,
        np.full((SCRATCH, m, n), np.nan), tolerance, guess is not None,
    )  # fmt: skip
    return (g * (u - w) + source).sum(axis=0), u, w, iterations


def an_array(m=15, n=11, seed=2):
    rng = np.random.default_rng(seed)
    return 10.0 ** rng.uniform(-6, -4, (m, n)), rng.uniform(-1, 1, m)


@pytest.mark.parametrize("shape", [(15, 11), (3, 20), (1, 1), (1, 6), (6, 1)])
def test_potentials_are_those_of_the_dense_matrix(shape, dense):
    m, n = shape
    g, v = an_array(m, n)
    drivers, senses = np.linspace(0.0, 90.0, m), np.linspace(0.0, 200.0, n)
    current, u, w, _ = solved(g, v, r_row=3.0, r_column=7.0, r_driver=drivers, r_sense=senses)
    expected = dense(g, v, 3.0, 7.0, drivers, senses)
    # The dense solution itself rounds at 1e-13.
    for found, known in zip((current, u, w), expected, strict=True):
        assert found == pytest.approx(known, abs=1e-12 * np.abs(known).max())


@pytest.mark.parametrize(
    "wires",
    [
        {"r_row": 0.0, "r_column": 5.0},
        {"r_row": 5.0, "r_column": 0.0},
        {"r_row": 0.0, "r_column": 0.0},
        {"r_row": 0.0, "r_column": 0.0, "r_driver": 40.0, "r_sense": 30.0},
        {"r_row": 0.0, "r_column": 2.0, "r_driver": 40.0, "r_sense": np.where(np.arange(11) == 4, np.inf, 10.0)},
        {"r_row": 4.0, "r_column": 2.0, "r_driver": np.where(np.arange(15) % 4 == 1, np.inf, 10.0)},
        {"r_row": 0.0, "r_column": 2.0, "r_driver": np.where(np.arange(15) % 4 == 1, np.inf, 0.0)},
        {"r_row": 1e-3, "r_column": 1e3, "r_sense": 5.0},
    ],
)
def test_potentials_are_those_of_a_read_for_any_ends(wires):
    g, v = an_array()
    # A whole row and a whole column open, too.
    g[3], g[:, 4] = 0.0, 0.0
    current, u, w, iterations = solved(g, v, **wires)
    read = Crossbar(conductance=g, **wires).read(v)
    assert iterations >= 0
    assert current == pytest.approx(read.current, abs=1e-11 * np.abs(read.current).max())
    held = g > 0.0
    assert (u - w)[held] == pytest.approx((read.v_row - read.v_column)[held], abs=1e-10)


def test_a_floating_line_keeps_its_digits_behind_small_resistances():
    # Held by devices of 1 uS to 3 uS behind 1 mohm, 1e9 times less: what comes into the row leaves it.
    g = np.array([[1e-4, 1e-4, 1e-4], [1e-6, 2e-6, 3e-6]])
    _, u, w, _ = solved(g, np.array([1.0, 0.0]), r_row=1e-3, r_column=1e-3, r_driver=np.array([0.0, np.inf]),
                        r_sense=np.array([0.0, 1e3, 2e3]))  # fmt: skip
    through = (g * (u - w))[1]
    # With pivots that subtract, 1e-7 of the current is lost.
    assert abs(through.sum()) <= 1e-9 * np.abs(through).max()


def test_a_warm_start_from_the_solution_needs_no_iterations_and_from_nearby_fewer():
    g, v = an_array()
    current, u, _, cold = solved(g, v, r_row=10.0, r_column=10.0)
    again, _, _, none = solved(g, v, r_row=10.0, r_column=10.0, guess=u)
    after, _, _, fewer = solved(g, v, r_row=10.0, r_column=10.0, guess=u * (1 + 1e-6))
    assert none == 0
    assert fewer < cold
    # Both solve to 1e-13 in energy.
    for found in (again, after):
        assert found == pytest.approx(current, abs=1e-12 * np.abs(current).max())


def test_a_looser_tolerance_takes_fewer_iterations_and_keeps_its_word():
    g, v = an_array()
    exact, _, _, most = solved(g, v, r_row=100.0, r_column=100.0)
    rough, _, _, fewer = solved(g, v, r_row=100.0, r_column=100.0, tolerance=1e-5)
    assert fewer < most
    error = np.abs(rough - exact).max() / np.abs(exact).max()
    assert 1e-12 < error < 1e-4


def test_currents_that_devices_drive_besides_add_up():
    g, v = an_array()
    rng = np.random.default_rng(5)
    source = rng.uniform(-1e-5, 1e-5, g.shape)
    together, *_ = solved(g, v, r_row=20.0, r_column=30.0, source=source)
    plain, *_ = solved(g, v, r_row=20.0, r_column=30.0)
    alone, *_ = solved(g, 0.0 * v, r_row=20.0, r_column=30.0, source=source)
    assert together == pytest.approx(plain + alone, abs=1e-12 * np.abs(together).max())
    # What is driven out of the rows arrives at the columns, all but what the devices lead back.
    assert np.abs(alone).max() > 1e-6


def test_no_solution_is_told():
    g, v = an_array()
    g[2, 2] = np.nan
    *_, iterations = solved(g, v, r_row=1.0, r_column=1.0)
    assert iterations == -1
