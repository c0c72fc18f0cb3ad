"""Static reads of devices that are not ohmic."""

import numpy as np
import pytest
from scipy.optimize import fsolve

from ohmloom.circuits import Crossbar, SelectorConduction, SinhConduction
from ohmloom.errors import OhmloomError, OperationError

CONDUCTIONS = [SinhConduction(scale=0.25), SelectorConduction(threshold=0.4, width=0.03, leak=1e-3)]
SINH = Crossbar(conductance=[[1e-3]], conduction=CONDUCTIONS[0])


def residual(x, array, v):
    """Kirchhoff's law at every node, written out; x holds row, then column potentials."""
    m, n = array.shape
    u, w = x[: m * n].reshape(m, n), x[m * n :].reshape(m, n)
    device = array.conduction.current(array.conductance, u - w)
    left = np.column_stack([v, u])
    along = -np.diff(left, axis=1) / np.array([array.r_row + array.r_driver[0]] + [array.r_row] * (n - 1))
    rows = along - np.column_stack([along[:, 1:], np.zeros(m)]) - device
    below = np.vstack([w, np.zeros(n)])
    down = -np.diff(below, axis=0) / np.array([array.r_column] * (m - 1) + [array.r_column + array.r_sense[0]])[:, None]
    columns = device - down + np.vstack([np.zeros(n), down[:-1]])
    return np.concatenate([rows.ravel(), columns.ravel()]) * 1e3


@pytest.mark.parametrize("conduction", CONDUCTIONS)
def test_equals_kirchhoffs_laws_written_out_for_scipy(conduction):
    rng = np.random.default_rng(1)
    g = rng.uniform(1e-4, 1e-2, (3, 4))
    g[1, 1] = 0.0
    array = Crossbar(conductance=g, r_row=5.0, r_column=3.0, r_driver=20.0, r_sense=7.0, conduction=conduction)
    v = np.array([1.0, 0.6, -0.8])
    read = array.read(v)
    start = np.concatenate([read.v_row.ravel(), read.v_column.ravel()])
    # Started elsewhere, SciPy finds the same point.
    found = fsolve(residual, start + rng.uniform(-0.02, 0.02, start.size), args=(array, v), xtol=1e-13)
    assert np.abs(residual(found, array, v)).max() < 1e-9
    assert np.abs(found - start).max() <= 1e-9
    assert read.residual < 1e-10
    assert np.abs(read.device_current - conduction.current(g, read.v_row - read.v_column)).max() <= 1e-11


@pytest.mark.parametrize("conduction", CONDUCTIONS)
def test_slope_is_the_derivative_of_the_current(conduction):
    g, v, h = np.full(81, 1e-3), np.linspace(-1.0, 1.0, 81), 1e-6
    differences = (conduction.current(g, v + h) - conduction.current(g, v - h)) / (2 * h)
    assert np.allclose(differences, conduction.slope(g, v), rtol=1e-6, atol=1e-9)


def test_a_batch_and_patterns_read_as_one_by_one():
    rng = np.random.default_rng(2)
    g, v = rng.uniform(1e-4, 1e-3, (2, 1, 4, 3)), rng.uniform(-1.0, 1.0, (5, 4))
    array = Crossbar(conductance=g, r_row=2.0, r_column=2.0, conduction=CONDUCTIONS[0])
    together = array.read(v).current
    assert together.shape == (2, 5, 3)
    for k in range(2):
        for pattern in range(5):
            alone = array.replace(conductance=g[k, 0]).read(v[pattern]).current
            assert np.allclose(alone, together[k, pattern], rtol=1e-9, atol=1e-15)


def test_without_wires_the_currents_are_the_formulas():
    array = Crossbar(conductance=np.full((2, 2), 1e-3), conduction=CONDUCTIONS[0])
    wanted = CONDUCTIONS[0].current(np.full(2, 1e-3), np.array([1.0, -0.5])).sum()
    assert np.allclose(array.read([1.0, -0.5]).current, wanted, rtol=1e-12)


def test_at_low_voltage_sinh_is_ohmic_and_a_selector_leaks():
    g = np.full((3, 3), 1e-3)
    ohmic = Crossbar(conductance=g, r_row=10.0, r_column=10.0)
    low = ohmic.replace(conduction=CONDUCTIONS[0]).read([1e-4] * 3).current
    assert np.allclose(low, ohmic.read([1e-4] * 3).current, rtol=1e-6)
    leaking = ohmic.replace(conduction=CONDUCTIONS[1], r_row=0.0, r_column=0.0).read([0.05] * 3).current
    assert np.allclose(leaking, 3 * 0.05 * 1e-3 * 1e-3, rtol=0.02)


def test_reversed_voltages_reverse_all_currents_and_transposed_reads_are_reads_of_the_turned_array():
    rng = np.random.default_rng(3)
    array = Crossbar(conductance=rng.uniform(1e-4, 1e-3, (4, 3)), r_row=3.0, r_column=5.0, conduction=CONDUCTIONS[1])
    v = rng.uniform(-1.0, 1.0, 4)
    assert np.allclose(array.read(-v).current, -array.read(v).current, rtol=1e-10)
    assert array.read_transposed([0.5, -0.5, 1.0]).residual < 1e-10


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SinhConduction(scale=0.0), "SinhConduction.scale: expected more than 0 V, got 0 V"),
        (
            lambda: SelectorConduction(threshold=0.5, width=-1.0, leak=0.1),
            "SelectorConduction.width: expected more than",
        ),
        (lambda: SelectorConduction(threshold=0.5, width=0.1, leak=0.0), r"SelectorConduction.leak: expected a share"),
        (lambda: Crossbar(conductance=[[1.0]], conduction="sinh"), "Crossbar.conduction: expected a SinhConduction"),
        (lambda: Crossbar(conductance=[[1.0]], conduction=CONDUCTIONS[0]).operator(), "expected ohmic devices"),
        (
            lambda: SINH.read([1.0], guess=SINH.read([1.0])),
            "guess: expected none for devices that are not ohmic",
        ),
    ],
)
def test_bad_conductions_are_refused(make, words):
    with pytest.raises(OhmloomError, match=words):
        make()


def test_voltages_beyond_the_formula_are_an_error_and_no_numbers():
    with pytest.raises(OperationError, match="overflows"):
        Crossbar(conductance=[[1e-3]], r_row=1.0, r_column=1.0, conduction=SinhConduction(scale=1e-3)).read([1.0])


def test_stuck_devices_have_their_conductance_whatever_they_had():
    g = np.full((2, 3), 1e-4)
    mask = np.array([[True, False, False], [False, False, True]])
    array = Crossbar(conductance=g, r_row=1.0, r_column=1.0)
    assert array.with_stuck(mask, 0.0).conductance.tolist() == np.where(mask, 0.0, g).tolist()
    batch = array.with_stuck(np.stack([mask, ~mask]), 1e-2)
    assert batch.conductance.shape == (2, 2, 3)
    assert (batch.conductance[1] == np.where(mask, 1e-4, 1e-2)).all()
    with pytest.raises(OhmloomError, match="with_stuck: where: expected booleans"):
        array.with_stuck(np.ones((3, 3), dtype=bool), 0.0)
    with pytest.raises(OhmloomError, match="with_stuck: where: expected booleans"):
        array.with_stuck(mask.astype(int), 0.0)
    with pytest.raises(OhmloomError, match="0 S or more, got -1"):
        array.with_stuck(mask, -1.0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (4, 3)])
@pytest.mark.parametrize("g", [0.0, 1e6])
def test_all_open_all_short_and_no_voltage_simply_work(shape, g):
    """All short: 1 uohm devices behind 1 ohm of wire; what limits the current is the wire."""
    array = Crossbar(conductance=np.full(shape, g), r_row=1.0, r_column=1.0)
    read = array.read(np.ones(shape[0]))
    assert array.read(np.zeros(shape[0])).current.tolist() == [0.0] * shape[1]
    if g == 0.0:
        assert read.current.tolist() == [0.0] * shape[1]
    else:
        assert 0.0 < read.current.sum() <= shape[0]
        assert read.residual < 1e-6
