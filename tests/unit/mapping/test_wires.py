"""Emulation through wires, against the static crossbar and against a dense nodal solve written here."""

import numpy as np
import pytest

from ohmloom.circuits import Crossbar
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.mapping.effects import line_delay
from ohmloom.mapping.fabric import build_fabric
from ohmloom.mapping.waveform import WAVEFORMS
from ohmloom.neurocontroller import Network, Synapse
from ohmloom.neurocontroller.plain import stdp_sign

SENSORS = (0.0, 0.3, 0.0, 0.2, 0.8, 1.0)
NETWORK = Network.random(system="HP", rng=np.random.default_rng(3))
MIXED = Network.random(system="HET", rng=np.random.default_rng(5))


def dense_potentials(g, v_row, v_column, r_row, r_column):
    """Potentials of row and column nodes by Kirchhoff's law at each node; drivers before column 0 and after the
    last row."""
    m, n = g.shape
    a, b = np.zeros((2 * m * n, 2 * m * n)), np.zeros(2 * m * n)

    def connect(x, y, conductance):
        a[x, x] += conductance
        a[y, y] += conductance
        a[x, y] -= conductance
        a[y, x] -= conductance

    def hold(x, voltage, conductance):
        a[x, x] += conductance
        b[x] += conductance * voltage

    def row(i, j):
        return i * n + j

    def column(i, j):
        return m * n + i * n + j

    for i in range(m):
        hold(row(i, 0), v_row[i], 1.0 / r_row)
        for j in range(n):
            connect(row(i, j), column(i, j), g[i, j])
            if j + 1 < n:
                connect(row(i, j), row(i, j + 1), 1.0 / r_row)
            if i + 1 < m:
                connect(column(i, j), column(i + 1, j), 1.0 / r_column)
    for j in range(n):
        hold(column(m - 1, j), v_column[j], 1.0 / r_column)
    x = np.linalg.solve(a, b)
    return x[: m * n].reshape(m, n), x[m * n :].reshape(m, n)


def grid_of(plan, conductances):
    (tile,) = plan.tiles
    g = np.zeros((len(tile.rows), len(tile.columns)))
    for point in plan.crosspoints:
        g[point.row, point.column] = conductances[point.synapse]
    return g


@pytest.mark.parametrize("spec", ["hp_strukov", "hp_1t1r"])
def test_columns_read_what_the_crossbar_says(spec):
    plan = place(NETWORK, Hardware.load(spec))
    emulated = EmulatedController(plan.nominal())
    for _ in range(3):
        emulated.step(SENSORS)
    for t, tile in enumerate(plan.tiles):
        points = [point for point in plan.crosspoints if point.tile == t]
        g = np.zeros((len(tile.rows), len(tile.columns)))
        for point in points:
            g[point.row, point.column] = emulated.conductances[point.synapse]
        operator = Crossbar(conductance=g, r_row=1.06, r_column=1.06).operator()
        g_on = float(plan.hardware.devices[tile.kind].conductance(1.0))
        wanted = [operator[point.row, point.column] / g_on for point in points]
        got = emulated.read_weights[[point.synapse for point in points]]
        np.testing.assert_allclose(got, wanted, rtol=1e-9)  # the solver's tolerance, with some digits to spare
    assert np.abs(emulated.read_weights / emulated.weights - 1.0).max() > 1e-4


def test_a_reference_column_drops_like_any_other():
    plan = place(MIXED, Hardware.load("het_mixed"))
    emulated = EmulatedController(plan.nominal())
    (t,) = [t for t, tile in enumerate(plan.tiles) if tile.kind == "linear"]
    tile, device = plan.tiles[t], plan.hardware.devices["linear"]
    g_on, g_off = float(device.conductance(1.0)), float(device.conductance(0.0))
    g = np.zeros((len(tile.rows), len(tile.columns) + 1))
    g[:, -1] = g_off
    points = [point for point in plan.crosspoints if point.tile == t]
    for point in points:
        g[point.row, point.column] = point.conductance
    operator = Crossbar(conductance=g, r_row=1.06, r_column=1.06).operator()
    wanted = [(operator[p.row, p.column] - operator[p.row, -1]) / (g_on - g_off) for p in points]
    np.testing.assert_allclose(emulated.read_weights[[p.synapse for p in points]], wanted, rtol=1e-8)


@pytest.mark.parametrize("spec", ["hp_strukov", "hp_passive"])
def test_lost_events_agree_with_a_dense_recount(spec):
    """Every step once more: voltages by a dense solve of all nodes, thresholds and the rule by hand."""
    plan = place(NETWORK, Hardware.load(spec))
    drive, synapses = plan.hardware.drive, NETWORK.synapses
    emulated = EmulatedController(plan.nominal())
    (tile,) = plan.tiles
    unit = drive.pulse_voltage.value / WAVEFORMS[drive.waveform].event
    levels = unit * np.array(WAVEFORMS[drive.waveform].phases[0].row)
    ls, lost, ideal, seen = np.zeros(NETWORK.neurons, dtype=int), 0, 0, 0
    for _ in range(120):
        before = emulated.conductances
        spiked = emulated.spikes(SENSORS)
        ls = np.where(spiked, 3, ls)
        u, w = dense_potentials(
            grid_of(plan, before), levels[ls[list(tile.rows)]], levels[ls[list(tile.columns)]], 1.06, 1.06
        )
        for point in plan.crosspoints:
            synapse = synapses[point.synapse]
            v = w[point.row, point.column] - u[point.row, point.column]
            fired = int(v > drive.threshold.value) - int(v < -drive.threshold.value)
            wanted = stdp_sign(int(ls[synapse.pre]), int(ls[synapse.post]), 4)
            ideal += wanted != 0
            lost += wanted not in (0, fired)
            seen += fired != 0
        ls = np.maximum(ls - 1, 0)
    assert (emulated.ledger.lost, emulated.ledger.ideal_events, emulated.ledger.events) == (lost, ideal, seen)
    assert ideal > 500
    assert (lost > 100) == (spec == "hp_strukov")


def test_a_switching_device_takes_the_flux_that_it_sees(changed):
    """One step against the dense solve, with the device's own law integrated over a pulse that the wires weaken."""
    plan = place(NETWORK, changed("hp_passive", wires={"r_row": 20.0, "r_column": 20.0}, limits={"read_error": 0.9}))
    emulated = EmulatedController(plan.nominal())
    device, drive = plan.hardware.devices["hp"], plan.hardware.drive
    levels = 0.5 * np.array([0, 0, -1, 1])
    (tile,) = plan.tiles
    ls = np.zeros(NETWORK.neurons, dtype=int)
    moved = 0
    for _ in range(40):
        s_before, g_before = emulated.states, emulated.conductances
        ls = np.where(emulated.spikes(SENSORS), 3, ls)
        # Small steps of the whole array: Euler's rule on 400 parts of the pulse.
        s, parts = s_before.copy(), 400
        duration = emulated.die.plan.hardware.drive.pulse_duration
        assert duration is None
        pulse = device.charge_scale / 1000 / float(device.conductance(float(device.state_at_weight(0.5))))
        start = None
        for _ in range(parts):
            g = np.asarray(device.conductance(s))
            u, w = dense_potentials(
                grid_of(plan, g), levels[ls[list(tile.rows)]], levels[ls[list(tile.columns)]], 20.0, 20.0
            )
            v = np.array([w[p.row, p.column] - u[p.row, p.column] for p in plan.crosspoints])
            start = v if start is None else start
            rate = np.where(np.abs(start) > drive.threshold.value, g * v, 0.0)
            s = np.clip(s + rate * pulse / drive.pulse_voltage.value / parts / device.charge_scale, 0.0, 1.0)
        if (s != s_before).any():
            moved += 1
            # Euler's rule errs by some 1e-3 of an event here, a wire that is left out by 1e-2 or more.
            np.testing.assert_allclose(emulated.states, s, atol=3e-6)
        ls = np.maximum(ls - 1, 0)
        if moved == 3:
            break
        assert g_before.shape == s.shape
    assert moved == 3


def test_wires_without_resistance_are_no_wires(changed):
    bare = EmulatedController(place(NETWORK, changed("hp_1t1r", wires={"r_row": 0.0, "r_column": 0.0})).nominal())
    thin = EmulatedController(place(NETWORK, changed("hp_1t1r", wires={"r_row": 1e-9, "r_column": 1e-9})).nominal())
    for _ in range(5):
        assert bare.step(SENSORS) == thin.step(SENSORS)
    np.testing.assert_allclose(bare.weights, thin.weights, rtol=1e-9)


def test_a_selected_cell_loses_what_its_wires_take(changed):
    """A fixed voltage through a series resistance moves a linear device by phi(s') - phi(s) + R dq = V T."""
    spec = changed(
        "hp_1t1r", drive={"mode": "voltage"}, wires={"r_row": 100.0, "r_column": 100.0}, limits={"read_error": 0.9}
    )
    network = Network(system="HP", hidden=("excitatory",), synapses=(Synapse(0, 6, "hp", 0.5),))
    emulated = EmulatedController(place(network, spec).nominal())
    device = spec.devices["hp"]
    s = emulated.states[0]
    while emulated.ledger.events == 0:
        s = emulated.states[0]
        emulated.spikes((1.0, 0, 0, 0, 0, 0))
    sign = np.sign(emulated.states[0] - s)
    r_on, r_off = (device.parameters[name] for name in ("r_on", "r_off"))

    def flux(x):
        return device.charge_scale * (r_off * x - (r_off - r_on) * x * x / 2)

    applied = device.charge_scale / 1000 / float(device.conductance(float(device.state_at_weight(0.5))))
    passed = flux(emulated.states[0]) - flux(s) + 200.0 * device.charge_scale * (emulated.states[0] - s)
    assert passed == pytest.approx(sign * applied, rel=1e-9)


def test_capacitance_delays_a_read_by_the_elmore_delay_of_the_longest_lines(changed):
    wires = {"c_segment": 1e-10, "r_driver": 50.0, "r_sense": 5.0}
    plan = place(NETWORK, changed("hp_1t1r", wires=wires, limits={"read_error": 0.9}))
    (tile,) = plan.tiles
    # Each segment's resistance, and that of the end, charges all capacitances behind it.
    row = sum(1e-10 * (50.0 + 1.06 * (k + 1)) for k in range(len(tile.columns)))
    column = sum(1e-10 * (5.0 + 1.06 * (k + 1)) for k in range(len(tile.rows)))
    assert line_delay(plan) == pytest.approx(row + column, rel=1e-12)
    late, _, _ = build_fabric(plan.sample(seed=1))
    assert late.constants["settled"][0] == pytest.approx(1.0 - np.exp(-1e-7 / (row + column)), rel=1e-12)
    nominal, _, _ = build_fabric(plan.nominal())
    assert nominal.constants["settled"][0] == 1.0
