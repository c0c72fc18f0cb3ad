"""Crossbars against the same circuit as a dense matrix, against limits worked by hand, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.circuits import Crossbar
from ohmloom.errors import ParameterError, UnknownNameError

# Both sides solve to rounding; conditioning of the dense matrix costs a few digits.
CLOSE = 1e-10

SETTINGS = [
    {"r_row": 1.0, "r_column": 1.0},
    {"r_row": 10.0, "r_column": 3.0, "r_driver": 5.0, "r_sense": 7.0},
    {"r_row": 100.0, "r_column": 0.1, "r_driver": 50.0, "drive": "both"},
    {"r_row": 10.0, "r_column": 10.0, "r_driver": 1.0, "r_sense": 2.0, "drive": "both", "sense": "both"},
]


def random_array(m, n, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return Crossbar(conductance=rng.uniform(1e-6, 1e-3, (m, n)), **settings), rng.uniform(-1.0, 1.0, m)


def against_dense(dense, array, v):
    """(currents, row and column potentials) of the plain circuit, for an array without batch."""
    return dense(
        array.conductance, v, array.r_row, array.r_column, array.r_driver, array.r_sense, array.drive, array.sense
    )


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize(("m", "n"), [(1, 1), (1, 5), (5, 1), (7, 5), (12, 16)])
def test_currents_and_potentials_are_those_of_the_plain_circuit(m, n, settings, dense):
    array, v = random_array(m, n, **settings)
    read = array.read(v)
    current, u, w = against_dense(dense, array, v)
    largest = np.abs(current).max()
    assert np.abs(read.current - current).max() <= CLOSE * largest
    assert np.abs(read.v_row - u).max() <= CLOSE
    assert np.abs(read.v_column - w).max() <= CLOSE
    assert np.abs(v @ array.operator() - current).max() <= CLOSE * largest
    assert read.residual < 1e-8
    assert read.device_power.min() >= 0.0


@pytest.mark.parametrize("settings", SETTINGS)
def test_floating_lines_carry_no_current_out(settings, dense):
    r_driver, r_sense = np.full(7, settings.get("r_driver", 0.0)), np.full(5, settings.get("r_sense", 0.0))
    r_driver[2], r_sense[3] = np.inf, np.inf
    array, v = random_array(7, 5, **{**settings, "r_driver": r_driver, "r_sense": r_sense})
    read = array.read(v)
    current, u, _ = against_dense(dense, array, v)
    assert read.current[3] == 0.0
    assert np.delete(read.current, 3) == pytest.approx(np.delete(current, 3), rel=1e-9)
    assert read.v_row == pytest.approx(u, abs=1e-10)
    assert v @ array.operator() == pytest.approx(read.current, abs=1e-10 * np.abs(current).max())


@pytest.mark.parametrize("wires", [(0.0, 5.0), (5.0, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("ends", [(0.0, 0.0), (20.0, 0.0), (0.0, 30.0), (10.0, 10.0)])
def test_no_wire_resistance_is_the_limit_of_little(wires, ends):
    """The difference falls in proportion to the resistance that stands for none."""
    settings = {"r_row": wires[0], "r_column": wires[1], "r_driver": ends[0], "r_sense": ends[1]}
    array, v = random_array(6, 8, **settings)
    exact = array.read(v).current
    gaps = []
    for small in (1e-2, 1e-3):
        nearly = array.replace(r_row=wires[0] or small, r_column=wires[1] or small)
        gaps.append(np.abs(nearly.read(v).current - exact).max())
    assert gaps[0] / gaps[1] == pytest.approx(10.0, rel=0.02)
    assert v @ array.operator() == pytest.approx(exact, rel=1e-12)


def test_without_any_resistance_it_is_the_matrix_product():
    array, v = random_array(9, 4)
    read = array.read(v)
    assert read.current == pytest.approx(v @ array.conductance, rel=1e-14)
    assert read.iterations == 0
    assert np.array_equal(array.operator(), array.conductance)


def test_leading_axes_broadcast_like_the_same_reads_one_by_one():
    rng = np.random.default_rng(1)
    g = rng.uniform(1e-6, 1e-3, (3, 2, 5, 4))
    array = Crossbar(conductance=g, r_row=10.0, r_column=20.0)
    v = rng.uniform(0.0, 1.0, (2, 5))
    read = array.read(v)
    assert read.current.shape == (3, 2, 4)
    assert read.v_row.shape == (3, 2, 5, 4)
    for a in range(3):
        for b in range(2):
            one = array.replace(conductance=g[a, b]).read(v[b])
            assert one.current.shape == (4,)
            assert read.current[a, b] == pytest.approx(one.current, rel=1e-11)
    assert np.einsum("bw,abwc->abc", v, array.operator()) == pytest.approx(read.current, rel=1e-11)


def test_many_patterns_on_one_array_are_one_read_each():
    array, _ = random_array(6, 3, r_row=10.0, r_column=10.0)
    v = np.random.default_rng(2).uniform(-1.0, 1.0, (7, 2, 6))
    read = array.read(v)
    assert read.current.shape == (7, 2, 3)
    assert read.current[4, 1] == pytest.approx(array.read(v[4, 1]).current, rel=1e-11)


def test_transposed_drive_is_reciprocal_and_the_plain_circuit_driven_from_below(dense):
    array, _ = random_array(5, 7, r_row=30.0, r_column=10.0, r_driver=4.0, r_sense=6.0)
    turned = array.read_transposed(np.eye(7))
    assert array.operator() == pytest.approx(turned.current.T, rel=1e-11)
    v = np.linspace(-1.0, 1.0, 7)
    read = array.read_transposed(v)
    # The plain circuit with rows and columns exchanged, its first row the near end of both.
    current, u, _ = dense(array.conductance.T[::-1, ::-1], v[::-1], 10.0, 30.0, np.full(7, 6.0), np.full(5, 4.0))
    assert read.current == pytest.approx(current[::-1], rel=1e-10)
    assert read.v_column == pytest.approx(u[::-1, ::-1].T, abs=1e-10)
    assert -read.device_current.sum(axis=1) == pytest.approx(read.current, rel=1e-10)
    assert read.residual < 1e-10


def test_a_ladder_is_its_continued_fraction():
    """One row, devices to ideal ground: the input resistance is r + 1/(g + 1/(r + 1/(g + ...)))."""
    n, r, g = 40, 7.0, 2e-3
    seen = np.inf
    for _ in range(n):
        seen = r + 1.0 / (g + 1.0 / seen)
    read = Crossbar(conductance=np.full((1, n), g), r_row=r).read([1.0])
    assert read.current.sum() == pytest.approx(1.0 / seen, rel=1e-12)


def test_current_in_is_current_out():
    array, v = random_array(20, 30, r_row=50.0, r_column=50.0, r_driver=10.0)
    read = array.read(v)
    entering = ((v - read.v_row[:, 0]) / 60.0).sum()
    assert read.current.sum() == pytest.approx(entering, rel=1e-9)


def test_all_open_all_short_and_no_voltage_simply_work():
    wires = {"r_row": 5.0, "r_column": 5.0}
    assert not Crossbar(conductance=np.zeros((4, 3)), **wires).read(np.ones(4)).current.any()
    shorted = Crossbar(conductance=np.full((4, 3), 1e6), **wires).read(np.ones(4))
    assert np.isfinite(shorted.current).all()
    assert shorted.current.sum() == pytest.approx(((1.0 - shorted.v_row[:, 0]) / 5.0).sum(), rel=1e-6)
    assert not Crossbar(conductance=np.ones((4, 3)), **wires).read(np.zeros(4)).current.any()
    alone = Crossbar(conductance=np.ones((2, 2)), r_driver=np.inf, r_sense=np.inf, **wires).read([1.0, 1.0])
    assert not alone.current.any()


def test_opens_and_stuck_devices_among_others(dense):
    rng = np.random.default_rng(3)
    g = np.exp(rng.normal(np.log(1e-5), 2.5, (30, 30)))
    g[rng.random((30, 30)) < 0.05], g[rng.random((30, 30)) < 0.01] = 0.0, 1e-2
    array, v = Crossbar(conductance=g, r_row=10.0, r_column=10.0), rng.uniform(0.0, 1.0, 30)
    current, _, _ = against_dense(dense, array, v)
    assert np.abs(array.read(v).current - current).max() <= CLOSE * np.abs(current).max()


def test_a_guess_saves_iterations_and_changes_nothing():
    array, v = random_array(64, 64, r_row=20.0, r_column=20.0)
    cold = array.read(v)
    g = array.conductance.copy()
    g[3, 5] *= 1.01
    changed = array.replace(conductance=g)
    warm, fresh = changed.read(v, guess=cold), changed.read(v)
    assert warm.iterations < fresh.iterations
    assert np.abs(warm.current - fresh.current).max() <= 1e-11 * np.abs(fresh.current).max()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Crossbar(conductance=[1.0, 2.0]),
         "Crossbar.conductance: expected axes (..., word_line, bit_line), none of them empty, got shape (2,). "
         "Give one row per word line."),
        (lambda: Crossbar(conductance=[[1.0, -1e-3]]),
         "Crossbar.conductance: expected finite conductances of 0 S or more, got -0.001 S. 0 is an open device."),
        (lambda: Crossbar(conductance=[[np.nan]]),
         "Crossbar.conductance: expected finite conductances of 0 S or more, got nan S. 0 is an open device."),
        (lambda: Crossbar(conductance=[["a"]]),
         "Crossbar.conductance: expected numbers in S, got [['a']]. Give an array."),
        (lambda: Crossbar(conductance=[[1.0]], r_row=-1.0), "Crossbar.r_row: expected 0 ohm or more, got -1 ohm. "
                                                            "Correct it."),
        (lambda: Crossbar(conductance=[[1.0]], r_column=np.inf),
         "Crossbar.r_column: expected a finite resistance per segment in ohm, got inf. Correct it."),
        (lambda: Crossbar(conductance=[[1.0]], r_driver=[1.0, 2.0]),
         "Crossbar.r_driver: expected one resistance, or axes (word_line=1,), got shape (2,). Give one per line."),
        (lambda: Crossbar(conductance=[[1.0]], r_sense=[-2.0]),
         "Crossbar.r_sense: expected 0 ohm or more, infinite for a floating line, got -2 ohm. Correct it."),
        (lambda: Crossbar(conductance=[[1.0]]).read([1.0, 2.0]),
         "Crossbar.read: v: expected axes (..., word_line=1), got shape (2,). Give one voltage per word line."),
        (lambda: Crossbar(conductance=[[1.0]]).read([np.nan]),
         "Crossbar.read: v: expected finite voltages, got NaN or infinity. Use r_driver=inf for a floating line."),
        (lambda: Crossbar(conductance=np.ones((3, 2, 2))).read(np.ones((4, 2))),
         "Crossbar.read: v: expected leading axes that broadcast against those of the conductances, (3,), got (4,). "
         "Put the batch axes of v where those of the conductances are."),
    ],
)  # fmt: skip
def test_what_it_refuses_is_told_field_rule_and_value(make, message):
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value) == message


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(UnknownNameError, match="Did you mean 'both'"):
        Crossbar(conductance=[[1.0]], drive="bot")
    with pytest.raises(UnknownNameError, match="Did you mean 'r_row'"):
        Crossbar(conductance=[[1.0]]).replace(r_rows=1.0)


def test_what_was_read_cannot_be_changed():
    read = Crossbar(conductance=np.ones((2, 2))).read([1.0, 1.0])
    with pytest.raises(ValueError, match="read-only"):
        read.current[0] = 0.0
