"""Reset before a trial: times and pulses by hand, and by the law's own equation."""

import csv

import numpy as np
import pytest

from ohmloom.errors import ParameterError
from ohmloom.mapping import Hardware, place, plan_reset
from ohmloom.mapping.passage import passage, pulse, pulse_duration
from ohmloom.mapping.pulses import pulse_of
from ohmloom.neurocontroller import Network, champion

HP = place(champion("HP"), Hardware.load("hp_1t1r"))
HET = place(Network.random(system="HET", rng=np.random.default_rng(3)), Hardware.load("het_mixed"))


def test_from_off_takes_the_flux_of_the_law():
    # At 1 V from M = 1 Mohm to 20 kohm along q: 989.9 events of 1 nC, each with the mean of its two ends.
    device = HP.hardware.devices["hp"]
    q_d, r_on, r_off = device.charge_scale, 1e4, 1e6
    s = HP.crosspoints[0].state
    wanted = q_d * (r_off * s - (r_off - r_on) * s * s / 2) / 1.0
    # The closed form of the same integral; rounding only.
    device = plan_reset(HP).devices[0]
    assert device.from_off == pytest.approx(wanted, rel=1e-9)
    assert device.duration == pytest.approx(wanted + 990 * 100e-9, rel=1e-9)  # a read after every pulse


def test_the_end_that_takes_longer_is_counted():
    by_kind = {HET.tiles[d.tile].kind: d for d in plan_reset(HET).devices}
    assert (by_kind["hp"].start, by_kind["hp"].sign) == (0, 1)
    assert (by_kind["peo_pani"].start, by_kind["peo_pani"].sign) == (1, -1)
    assert by_kind["peo_pani"].from_on > by_kind["peo_pani"].from_off


def test_the_last_pulses_cannot_step_over_the_tolerance():
    """At W = 0.5 an event moves an HP device by 0.0249 G_on; a band of +-0.005 wants shorter ones."""
    spread = HP.hardware.nonidealities.model_copy(
        update={"write_verify": HP.hardware.nonidealities.write_verify.model_copy(update={"value": 0.005})}
    )
    fine = place(HP.network, HP.hardware.model_copy(update={"nonidealities": spread}))
    coarse, finer = plan_reset(HP).devices[0], plan_reset(fine).devices[0]
    assert coarse.last_part == 1.0
    assert finer.last_part == pytest.approx(0.01 / 0.02475, rel=1e-2)  # slope 49.5 W per range, a thousandth of it
    assert (coarse.pulses, finer.pulses) == (990, 989 + 3)


@pytest.mark.parametrize(("parallelism", "sum_over"), [("cell", "all"), ("column", "column"), ("array", "row")])
def test_what_is_written_at_once(parallelism, sum_over):
    drive = HP.hardware.drive.model_copy(update={"parallelism": parallelism})
    plan = place(HP.network, HP.hardware.model_copy(update={"drive": drive}))
    reset = plan_reset(plan)
    times = {(d.row, d.column): d.duration for d in reset.devices}
    one = max(times.values())
    assert min(times.values()) == pytest.approx(one)  # all start at the same weight
    columns = {j for _, j in times}
    longest = max(sum(1 for _, c in times if c == j) for j in columns)
    wanted = {"all": len(times), "column": longest, "row": len({i for i, _ in times})}[sum_over]
    assert reset.duration == pytest.approx(wanted * one)


def test_constant_devices_are_programmed_once():
    reset = plan_reset(place(champion("GA"), Hardware.load("hp_1t1r")))
    assert reset.duration == reset.energy == 0.0
    assert reset.first_duration > 0.0
    assert not any(d.every_trial for d in reset.devices)


def test_table_names_units(tmp_path):
    plan_reset(HP).write_csv(tmp_path / "reset.csv")
    with (tmp_path / "reset.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(HP.crosspoints)
    assert {"target_S", "tolerance_S", "duration_s", "energy_J", "pulses"} <= set(rows[0])
    assert float(rows[3]["target_S"]) == HP.crosspoints[3].conductance


def test_only_a_plan_can_be_reset():
    with pytest.raises(ParameterError, match=r"^plan_reset\.plan: expected Plan, got None"):
        plan_reset(None)


@pytest.mark.parametrize(("spec", "kind"), [("hp_1t1r", "hp"), ("peo_pani_redox", "peo_pani")])
def test_passage_is_what_the_device_itself_does_under_that_voltage(spec, kind):
    """The time to a state, tried by simulating the device for that time."""
    hardware = Hardware.load(spec)
    device = hardware.devices[kind]
    end, volts = 0.3, hardware.drive.pulse_voltage.value
    way = passage(device, 0.1, end, hardware)
    t = np.linspace(0.0, way.duration, 2001)
    trace = device.simulate(np.full(t.size, volts), t, s0=0.1)
    # The simulation's own tolerance.
    assert trace.s[-1] == pytest.approx(end, abs=1e-6)
    assert np.trapezoid(volts * trace.i, t) == pytest.approx(way.energy, rel=1e-5)


def test_a_pulse_of_fixed_voltage_is_right_at_half_and_moves_a_redox_device_by_its_own_rate():
    hardware = Hardware.load("peo_pani_redox")
    device = hardware.devices["peo_pani"]
    middle = float(device.state_at_weight(0.5))
    done = pulse(device, middle, 1, hardware)
    assert done.duration == pulse_duration(device, hardware)
    # Over one event the rate of this card changes by less than two hundredths.
    assert done.state - middle == pytest.approx(1e-3, rel=0.01)
    way = passage(device, middle, done.state, hardware)
    assert (way.duration, way.energy) == pytest.approx((done.duration, done.energy), rel=1e-6)


@pytest.mark.parametrize(("spec", "kind"), [("hp_passive", "hp"), ("hp_strukov", "hp"), ("peo_pani_redox", "peo_pani")])
def test_pulses_are_as_long_as_those_of_the_emulation(spec, kind):
    hardware = Hardware.load(spec)
    wanted = pulse_of(hardware, kind, has_reference=False).duration
    assert pulse_duration(hardware.devices[kind], hardware) == pytest.approx(wanted, rel=1e-12)


def test_what_a_drive_cannot_reach_takes_for_ever():
    hardware = Hardware.load("peo_pani_redox")
    weak = hardware.drive.model_copy(
        update={"pulse_voltage": hardware.drive.pulse_voltage.model_copy(update={"value": 0.1})}
    )
    assert (
        passage(hardware.devices["peo_pani"], 0.1, 0.9, hardware.model_copy(update={"drive": weak})).duration == np.inf
    )


def test_a_current_carries_its_charge_through_the_mean_resistance():
    hardware = Hardware.load("ideal")
    device = hardware.devices["hp"]
    way = passage(device, 0.2, 0.4, hardware)
    current = device.charge_scale / 1000 / 0.0005
    assert way.duration == pytest.approx(0.2 * 1000 * 0.0005)
    # M is linear in s, so its mean is that at s = 0.3.
    assert way.energy == pytest.approx(current**2 * way.duration * float(device.memristance(0.3)))


@pytest.mark.parametrize("spec", ["ideal", "hp_passive"])
def test_a_part_of_a_pulse_moves_a_part_as_far(spec):
    hardware = Hardware.load(spec)
    device = hardware.devices["hp"]
    whole, half = (pulse(device, 0.3, 1, hardware, share=share) for share in (1.0, 0.5))
    assert half.duration == whole.duration / 2
    # Over half an event M changes by less than a thousandth.
    assert half.state - 0.3 == pytest.approx((whole.state - 0.3) / 2, rel=1e-3)
    assert half.energy == pytest.approx(whole.energy / 2, rel=1e-3)
