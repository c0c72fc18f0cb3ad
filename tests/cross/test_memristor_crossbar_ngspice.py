"""Memristors in a crossbar with wires, through time, against ngspice on the exported deck."""

import numpy as np
import pytest

from ohmloom.circuits import MemristorCrossbar, PulseTrain, memristor_netlist, run_ngspice
from ohmloom.devices import Device
from ohmloom.errors import ParameterError

DEVICE = Device.load("hp_tio2_10k")
PULSE = DEVICE.flux(1.0) / 40.0  # at 1 V, a fortieth of the whole range


@pytest.fixture(autouse=True)
def ngspice(need_tool):
    return need_tool("transients of crossbars are not compared", "ngspice")


def array_and_train(r, **changes):
    rng = np.random.default_rng(5)
    given = {"devices": DEVICE, "s": rng.uniform(0.2, 0.8, (4, 4)), "r_row": r, "r_column": r} | changes
    levels = np.array([[1.0, 0.5, -0.5, 0.8], [-0.3, 0.9, 0.2, -1.0]])
    train = PulseTrain.rectangular(levels, columns=4, width=PULSE, edge=PULSE / 20, period=2 * PULSE,
                                   column_levels=[[0.0, 0.2, 0.0, 0.0], [0.0, 0.0, -0.4, 0.0]],
                                   delays=[0.0, PULSE / 10, PULSE / 5, 0.0])  # fmt: skip
    return MemristorCrossbar(**given), train


def difference(array, train, **settings):
    found = run_ngspice(memristor_netlist(array, train), **settings)
    s = np.array([[found.s[f"D_{i}_{j}"][-1] for j in range(4)] for i in range(4)])
    trace = array.simulate(train.t, train.v_row, train.v_column)
    assert np.abs(trace.s[-1] - trace.s[0]).max() > 0.01
    return np.abs(s - trace.s[-1]).max()


@pytest.mark.parametrize("r", [1.0, 10.0])
def test_states_equal_ngspices_at_its_own_settings_and_nearer_at_tighter_ones(r):
    """ngspice's error falls with its steps and tolerance, towards our result: 2e-6, then 1e-8 of the range of s."""
    array, train = array_and_train(r)
    assert difference(array, train, relative_tolerance=1e-6) <= 2e-6
    assert difference(array, train, relative_tolerance=1e-9, max_step=PULSE / 2000) <= 1e-8


def test_drivers_senses_and_two_driven_ends_are_in_the_deck():
    array, train = array_and_train(5.0, r_driver=50.0, r_sense=20.0, drive="both")
    assert difference(array, train, relative_tolerance=1e-6) <= 2e-6


def test_several_kinds_and_open_crosspoints_are_in_the_deck():
    kinds = np.arange(16).reshape(4, 4) % 3 - 1
    array, train = array_and_train(5.0, devices=(DEVICE, Device.load("linear")), kind=kinds)
    netlist = memristor_netlist(array, train)
    names = {element.name for element in netlist.flat}
    assert "D_0_1" in names
    assert "D_0_0" not in names
    found = run_ngspice(netlist)
    trace = array.simulate(train.t, train.v_row, train.v_column)
    for (i, j), kind in np.ndenumerate(kinds):
        if kind >= 0:
            assert found.s[f"D_{i}_{j}"][-1] == pytest.approx(trace.s[-1, i, j], abs=2e-6)


def test_a_train_for_another_array_is_refused():
    array, _ = array_and_train(1.0)
    train = PulseTrain.rectangular([[1.0, 1.0]], columns=2, width=1e-3, edge=1e-5, period=2e-3)
    with pytest.raises(ParameterError, match="expected 4 rows and 4 columns from t = 0 on, got 2 and 2"):
        memristor_netlist(array, train)
