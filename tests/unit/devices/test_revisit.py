"""The charge-revisit test: it tells charge-driven devices from others, and says when it cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ohmloom.devices import Device
from ohmloom.devices.measurement import Measurement
from ohmloom.devices.revisit import Revisit, charge_revisit
from ohmloom.errors import ParameterError

DATA = Path(__file__).parents[3].parent / "shared" / "data"
TIME = np.linspace(0.0, 1.0, 401)
SINE = np.sin(2.0 * np.pi * TIME)


def ideal(voltage=SINE, *, card="hp_tio2", s0=0.3, noise=0.0):
    loop = Device.load(card).simulate(voltage, TIME, s0=s0)
    i = loop.i + noise * loop.i.std() * np.random.default_rng(7).normal(size=TIME.size)
    return Measurement(name=card, t=loop.t, v=loop.v, i=i)


def with_state(rate, voltage=SINE):
    """A device with ``G = 1 mS * s`` whose state moves by ``rate(s, v)``, not by the current."""
    s = np.full(TIME.size, 0.5)
    for k in range(TIME.size - 1):
        s[k + 1] = np.clip(s[k] + rate(s[k], voltage[k]) * (TIME[k + 1] - TIME[k]), 0.02, 1.0)
    return Measurement(name="other", t=TIME, v=voltage, i=1e-3 * s * voltage)


def relaxing(s, v):
    return 8.0 * v - 40.0 * (s - 0.5)


def test_an_ideal_memristor_follows_its_charge_and_its_flux():
    found = charge_revisit(ideal())
    assert found.net_over_throughput < 1e-3  # one period of a sine without an end wall returns its charge
    # 20 bins leave the slope inside a bin: 1/20^2 of the variance where log G is linear in rank.
    assert found.unexplained_by_charge < 0.005
    assert found.unexplained_by_flux < 0.005
    assert found.verdict.startswith("The conductance follows the charge: points at equal charge in different passes ")
    assert found.verdict.endswith("unexplained (at equal flux 0.23 %). A charge-driven law such as hp_linear may fit.")


def test_one_per_cent_of_noise_does_not_hide_an_ideal_memristor():
    assert charge_revisit(ideal(noise=0.01)).unexplained_by_charge < 0.02  # noise against a spread of log G of 0.27


def test_a_state_that_relaxes_does_not_follow_the_charge():
    found = charge_revisit(with_state(relaxing))
    assert found.unexplained_by_charge > 0.5
    assert found.verdict.startswith("The conductance does not follow the charge: points at equal charge")
    assert "Compare laws with thresholds or a redox reaction" in found.verdict


def test_an_ideal_memristor_that_rests_at_its_wall_is_not_called_charge_driven():
    """The charge that flows at the wall does not move the state; the verdict says to look there."""
    found = charge_revisit(ideal(card="hp_tio2_10k"))
    assert found.unexplained_by_charge > 0.1
    assert "in part" in found.verdict
    assert found.verdict.endswith("check whether the state reached a limit.")


def test_a_sweep_of_one_polarity_cannot_tell():
    found = charge_revisit(ideal(np.abs(SINE), s0=0.1))
    assert found.net_over_throughput == pytest.approx(1.0, abs=1e-12)  # rounding
    assert (found.unexplained_by_charge, found.unexplained_by_flux) == (None, None)
    assert found.verdict == (
        "This sweep cannot tell whether the conductance follows the charge: the current flows one way (net charge 100 "
        "% of all that moved), so hardly any charge is visited twice, and a charge-driven law can look right without "
        "being so. Add a sweep of both polarities."
    )


def test_a_resistor_has_nothing_to_tell():
    found = charge_revisit(Measurement(name="r", t=TIME, v=SINE, i=1e-3 * SINE))
    assert (found.unexplained_by_charge, found.unexplained_by_flux) == (None, None)
    assert found.verdict.startswith("The conductance hardly changes in this sweep (by ")
    assert found.verdict.endswith("so what it depends on cannot be tested. Sweep further or slower.")


def test_too_few_points_cannot_tell():
    whole = ideal()
    few = Measurement(name="few", t=whole.t[::20], v=whole.v[::20], i=whole.i[::20])
    found = charge_revisit(few)
    assert found.unexplained_by_charge is None
    assert found.verdict.startswith("This sweep cannot tell whether the conductance follows the charge: too few points")


def test_the_result_does_not_depend_on_scale_or_on_the_order_of_polarities():
    plain = charge_revisit(with_state(relaxing))
    device = with_state(relaxing)
    scaled = Measurement(name="s", t=1e6 * device.t, v=-1e-3 * device.v, i=-1e-9 * device.i)
    found = charge_revisit(scaled)
    # Rounding may move a point at the edge of a bin into the next.
    assert found.unexplained_by_charge == pytest.approx(plain.unexplained_by_charge, rel=0.05)
    assert found.net_over_throughput == pytest.approx(plain.net_over_throughput, rel=1e-9)


def test_small_voltages_do_not_count():
    """Whatever an offset does to i/v near zero."""
    device = ideal()
    i = device.i + np.where(np.abs(SINE) < 0.09, 1e-2 * np.abs(device.i).max(), 0.0)
    found = charge_revisit(Measurement(name="offset", t=TIME, v=SINE, i=i))
    assert found.unexplained_by_charge < 0.01


def test_the_voltage_is_that_of_the_device_behind_its_resistor():
    device = with_state(relaxing)
    source = device.v + 5e3 * device.i
    behind = Measurement(name="b", t=TIME, v=source, i=device.i, series_resistance=5e3)
    found, plain = charge_revisit(behind), charge_revisit(device)
    # The same up to points at the edge of a bin or of the smallest voltage, which rounding moves.
    assert found.unexplained_by_charge == pytest.approx(plain.unexplained_by_charge, rel=0.01)
    assert found.unexplained_by_flux == pytest.approx(plain.unexplained_by_flux, rel=0.01)


def test_many_cycles_of_a_rectifier_do_not_pass_for_revisits():
    """Each cycle takes back 1 % of its charge: bins hold both directions, but hardly any charge is met twice."""
    v = np.sin(20.0 * np.pi * TIME)
    found = charge_revisit(Measurement(name="rectifier", t=TIME, v=v, i=np.where(v > 0, 1e-3, 1e-5) * v))
    assert found.net_over_throughput > 0.95
    assert found.unexplained_by_charge is None
    assert "the current flows one way (net charge 98 % of all that moved)" in found.verdict


def test_a_symmetric_sweep_does_not_see_a_static_nonlinearity():
    """A known limit of the test, as its docstring says: each charge is met at the same size of voltage twice."""
    found = charge_revisit(Measurement(name="sinh", t=TIME, v=SINE, i=1e-3 * np.sinh(3.0 * SINE)))
    assert found.unexplained_by_charge < 0.02


def test_what_is_no_measurement_is_refused():
    with pytest.raises(ParameterError) as caught:
        charge_revisit(None)
    assert str(caught.value) == (
        "charge_revisit.measurement: expected Measurement, got None. Pass a value of this type."
    )


def measured(name, **options) -> Revisit:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{name} is not here: the data may not be copied into the project")
    return charge_revisit(Measurement.read_csv(path, **options))


def test_a_knowm_loop_mostly_follows_its_charge_and_not_its_flux():
    found = measured(
        "knowm_w_sdc/knowm_wsdc_5k_0p8V_100Hz_M1.csv", voltage="v_source_V", current="i_uA", units={"i_uA": "uA"},
        frequency=100.0, series_resistance=5e3,
    )  # fmt: skip
    # An earlier study of the same file found 0.12 and 0.56, with bins of its own.
    assert found.unexplained_by_charge == pytest.approx(0.12, abs=0.03)
    assert found.unexplained_by_flux == pytest.approx(0.56, abs=0.05)
    assert found.verdict.startswith("The conductance mostly follows the charge: ")


def test_polyaniline_loops_flow_one_way_and_cannot_tell():
    found = measured("pani/IV_MLit10_1.txt", voltage="1", current="2", sample_interval=1.0, rows=(182, 364))
    assert found.net_over_throughput > 0.99
    assert found.unexplained_by_charge is None
    assert "(net charge 99.6 % of all that moved)" in found.verdict


def test_the_net_charge_of_vanishing_times_is_still_a_share():
    sweep = Measurement(name="short", t=1e-320 * np.arange(4.0), v=[0.0, 1.0, -1.0, 0.0], i=[0.0, 1e-9, -1e-9, 0.0])
    assert charge_revisit(sweep).net_over_throughput == pytest.approx(0.0, abs=1e-3)  # 1e-320 has three digits
