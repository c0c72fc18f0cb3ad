"""Crossbars of memristors through time: against single devices, against reads, against themselves refined."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.circuits import Crossbar, CrossbarTrace, MemristorCrossbar, PulseTrain
from ohmloom.devices import LAWS, CardValue, Device
from ohmloom.errors import OperationError, ParameterError

T = np.linspace(0.0, 1.0, 41)


def threshold_device():
    values = {"r_on": 2e3, "r_off": 4e4, "b": 2.0, "v_set": 0.4, "v_reset": 0.3, "q_set": 3e-5, "q_reset": 2e-5}
    entries = tuple(CardValue(value=value, source="made up") for value in values.values())
    return Device(name="threshold", law="tio2_threshold", source="made up", values=entries)


DEVICES = [Device.load(name) for name in ("hp_tio2_10k", "peo_pani", "linear")] + [threshold_device()]


@pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)
def test_one_device_without_wires_is_the_device_alone(device):
    v = np.sin(2 * np.pi * T)
    alone = device.simulate(v, T, s0=0.3)
    trace = MemristorCrossbar(devices=device, s=[[0.3]]).simulate(T, v[:, None])
    # Both integrate to about 1e-9 of the range.
    assert trace.s[:, 0, 0] == pytest.approx(alone.s, abs=2e-8)
    assert trace.current[:, 0] == pytest.approx(alone.i, abs=1e-7 * np.abs(alone.i).max())
    assert np.ptp(alone.s) > 0.01


@pytest.mark.parametrize("duration", [1e-3, 1.0, 100.0])
@pytest.mark.parametrize("name", LAWS)
def test_every_law_moves_in_an_array_as_alone(name, duration):
    values = tuple(CardValue(value=parameter.default, source="made up") for parameter in LAWS[name].parameters)
    device = Device(name="defaults", law=name, source="made up", values=values)
    t, v = duration * T, 0.8 * np.sin(2 * np.pi * T)
    array = MemristorCrossbar(devices=device, s=[[0.3]])
    if (name, duration) == ("pickett", 100.0):
        # At 0.77 V its rate passes 1e20/s: from wall to wall in less than the times of a double resolve.
        with pytest.raises(OperationError, match=r"^MemristorCrossbar\.simulate: expected every step to converge, got "
                                                 r"none after t = 20 s\. Give t finer steps"):  # fmt: skip
            array.simulate(t, v[:, None])
        return
    alone, trace = device.simulate(v, t, s0=0.3), array.simulate(t, v[:, None])
    # Steps of 1e-10 add up over hundreds of steps; a wall that is taken for reached is an error of 1e-5 to 1.
    assert trace.s[:, 0, 0] == pytest.approx(alone.s, abs=5e-9)
    assert trace.current[:, 0] == pytest.approx(alone.i, abs=1e-8 * np.abs(alone.i).max())


def test_laws_of_all_sorts_in_one_array_with_wires_do_not_depend_on_segments_or_tolerance():
    devices = tuple(Device.load(name) for name in ("hp_tio2_10k", "peo_pani_redox", "yakopcic_miao"))
    t, v = np.linspace(0.0, 10.0, 201), np.sin(np.linspace(0.0, 2 * np.pi, 201))[:, None] * [0.8, 0.5]
    array = MemristorCrossbar(devices=devices, s=[[0.4, 0.6, 0.3], [0.5, 0.2, 0.5]], kind=[[0, 1, 2], [2, 0, 1]],
                              r_row=50.0, r_column=50.0)  # fmt: skip
    trace = array.simulate(t, v)
    finer = np.linspace(0.0, 10.0, 801)
    again = array.simulate(finer, np.stack([np.interp(finer, t, x) for x in v.T], axis=1), tolerance=1e-12)
    # The same drive, other segments.
    assert trace.s == pytest.approx(again.s[::4], abs=5e-9)
    assert (np.ptp(trace.s, axis=0) > 1e-3).all()


def mixed_array(r=5.0):
    rng = np.random.default_rng(4)
    kind = rng.integers(-1, 3, (5, 4))
    return MemristorCrossbar(
        devices=tuple(DEVICES[:3]), s=rng.uniform(0.1, 0.9, (5, 4)), kind=kind, r_row=r, r_column=2 * r, r_driver=50.0,
        r_sense=20.0,
    )  # fmt: skip


def pulses():
    t = np.array([0.0, 1e-3, 9e-3, 1e-2, 1.1e-2, 2e-2])
    v = np.array([0.0, 1.0, 1.0, 0.0, -1.0, -1.0])[:, None] * np.array([1.0, 0.5, 0.0, -0.7, 0.2])
    return t, v


def test_currents_are_those_of_a_read_of_the_same_states():
    array, (t, v) = mixed_array(), pulses()
    trace = array.simulate(t, v)
    for k in (1, 2, 4):
        now = MemristorCrossbar(devices=array.devices, s=trace.s[k], kind=array.kind, r_row=5.0, r_column=10.0,
                                r_driver=50.0, r_sense=20.0)  # fmt: skip
        read = now.crossbar().read(v[k])
        assert trace.current[k] == pytest.approx(read.current, rel=1e-9, abs=1e-15)
    assert isinstance(array.crossbar(), Crossbar)


def test_a_tighter_tolerance_changes_nothing_that_the_first_one_promised():
    array, (t, v) = mixed_array(), pulses()
    loose, tight = array.simulate(t, v), array.simulate(t, v, tolerance=1e-13)
    assert tight.steps >= loose.steps
    assert np.abs(loose.s - tight.s).max() <= 1e-9
    assert np.abs(tight.s[-1] - tight.s[0]).max() > 1e-3


def test_energy_is_conserved_and_open_crosspoints_take_none():
    array, (t, v) = mixed_array(), pulses()
    trace = array.simulate(t, v)
    assert (trace.energy[-1][array.kind < 0] == 0.0).all()
    lost = trace.supplied - trace.energy[-1].sum()
    assert 0.0 < lost < 0.2 * trace.supplied
    without = MemristorCrossbar(devices=array.devices, s=array.s, kind=array.kind).simulate(t, v)
    assert without.energy[-1].sum() == pytest.approx(without.supplied, rel=1e-9)


def test_columns_that_hold_a_voltage_count_against_the_rows():
    t = np.array([0.0, 1e-2])
    device = DEVICES[0]
    between = MemristorCrossbar(devices=device, s=[[0.5]]).simulate(t, [[0.7], [0.7]], [[-0.3], [-0.3]])
    across = MemristorCrossbar(devices=device, s=[[0.5]]).simulate(t, [[1.0], [1.0]])
    assert between.s == pytest.approx(across.s, abs=1e-12)


def test_a_device_that_rests_at_its_wall_leaves_when_the_drive_turns():
    device = DEVICES[0]
    flux = device.flux(1.0)
    # Past the wall by half its range and back by a quarter: the rest is lost at the wall.
    t = np.array([0.0, 1.0, 1.0 + 1e-9, 2.0])
    v = flux * np.array([1.5, 1.5, -0.25, -0.25])[:, None]
    end = MemristorCrossbar(devices=device, s=[[0.0]]).simulate(t, v).s[:, 0, 0]
    assert end[1] == 1.0
    assert end[-1] == pytest.approx(device.state_at_flux(0.75 * flux), abs=1e-6)


def test_a_trace_is_saved_and_loaded_whole(tmp_path):
    t, v = pulses()
    trace = mixed_array().simulate(t, v)
    trace.save(tmp_path / "trace.npz")
    again = CrossbarTrace.load(tmp_path / "trace.npz")
    assert np.array_equal(again.s, trace.s)
    assert (again.supplied, again.steps, again.provenance) == (trace.supplied, trace.steps, trace.provenance)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MemristorCrossbar(devices=(), s=[[0.5]]),
         "MemristorCrossbar.devices: expected at least one Device, got none. Load a card."),
        (lambda: MemristorCrossbar(devices=DEVICES[0], s=[[1.5]]),
         "MemristorCrossbar.s: expected states in [0, 1], got 1.5. Divide charges by the device's charge_scale."),
        (lambda: MemristorCrossbar(devices=DEVICES[0], s=[[0.5]], kind=[[1]]),
         "MemristorCrossbar.kind: expected axes (word_line=1, bit_line=1) with numbers from -1 to 0, got shape (1, 1) "
         "from 0 to 1. Number the devices from 0."),
        (lambda: MemristorCrossbar(devices=DEVICES[0], s=[[0.5]]).simulate([0.0, 0.0], [[1.0], [1.0]]),
         "MemristorCrossbar.simulate: t: expected at least two times in s, strictly increasing, got 2. A pulse of no "
         "length has no place; drop repeats."),
        (lambda: MemristorCrossbar(devices=DEVICES[0], s=[[0.5]]).simulate([0.0, 1.0], [[1.0]]),
         "MemristorCrossbar.simulate: v_row: expected axes (time=2, word_line=1), got shape (1, 1). "
         "Give one per time and line."),
    ],
)  # fmt: skip
def test_what_it_refuses_is_told_field_rule_and_value(make, message):
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value) == message


# Volts at which each law moves within T, or relaxes there, without being too stiff for explicit steps.
DRIVEN = {"pickett": 0.3, "vteam": 0.5, "yakopcic": 0.8}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_follows_its_single_device_where_wires_do_not_resist(law):
    values = tuple(CardValue(value=parameter.default, source="default") for parameter in LAWS[law].parameters)
    device = Device(name=law, law=law, source="defaults", values=values)
    t = np.array([0.0, 0.05, 0.5, 0.55, 0.6, 1.0, 1.05]) * 1e-3
    v = np.array([0.0, 1.0, 1.0, 0.0, -0.5, -0.5, 0.0]) * DRIVEN.get(law, 1.0)
    trace = MemristorCrossbar(devices=device, s=[[0.3, 0.6]]).simulate(t, v[:, None])
    for k, s0 in enumerate((0.3, 0.6)):
        alone = device.simulate(lambda x: np.interp(x, t, v), t, s0=s0)
        # Device.simulate's own error is 1e-9 of the range.
        assert np.abs(trace.s[:, 0, k] - alone.s).max() <= 1e-8


def test_a_law_that_is_too_stiff_is_an_error_that_names_the_time():
    array = MemristorCrossbar(devices=Device.load("pickett"), s=[[0.3]])
    with pytest.raises(OperationError, match="expected every step to converge, got none after t = "):
        array.simulate([0.0, 5e-5, 5e-4], [[0.0], [1.0], [1.0]])


def test_a_trials_worth_of_pulses_ends_where_the_sums_of_their_fluxes_do_walls_included():
    """100 timesteps on 15 x 11 without wires: a device's flux is the sum of its pulses', clipped after each."""
    device, rng = Device.load("hp_tio2_10k"), np.random.default_rng(3)
    levels = [0.0, 0.0, -0.5, 0.5]
    rows, columns = rng.choice(levels, (2100, 15)), rng.choice(levels, (2100, 11))
    top = device.flux(1.0)
    width, edge = top / 100, top / 10_000
    train = PulseTrain.rectangular(rows, columns=11, column_levels=columns, width=width, edge=edge, period=2 * width)
    s0 = rng.uniform(0.2, 0.8, (15, 11))
    trace = MemristorCrossbar(devices=device, s=s0).simulate(train.t, train.v_row, train.v_column)
    flux, hits = device.flux(s0), 0
    for row, column in zip(rows, columns, strict=True):
        wanted = flux + (row[:, None] - column) * (width + edge)
        flux = np.clip(wanted, 0.0, top)
        hits += int((flux != wanted).sum())
    assert hits > 500  # walls are part of the test
    # 1e-10 a step, the bound asked for; near s = 1 the state is steepest in the flux.
    assert np.abs(device.flux(trace.s[-1]) - flux).max() <= 1e-9 * top
