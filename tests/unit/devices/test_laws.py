"""The laws against formulas worked by hand in exact fractions, and what every law must satisfy."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmloom.devices import LAWS, Device

GOLDEN = Path(__file__).parents[2] / "golden"
STATES = [0.0, 1e-6, 0.0097, 0.125, 0.5, 0.75, 0.99, 1.0]
# A few roundings of double arithmetic.
ROUNDING = 1e-14


def defaults(law_name):
    return tuple(parameter.default for parameter in LAWS[law_name].parameters)


def exact(values):
    return tuple(Fraction(value) for value in values)


@pytest.mark.parametrize("s", STATES)
@pytest.mark.parametrize("p", [(100.0, 16e3, 100.0), (0.01, 1.0, 100.0), (1e4, 1e6, 100.0)])
def test_hp_linear_is_equation_7_on_the_charge_of_equation_8(p, s):
    r_on, r_off, beta = exact(p)
    q_max = (r_on - r_off) / (-r_on * r_off * beta)
    memristance = r_off - r_off * r_on * beta * (Fraction(s) * q_max)
    assert LAWS["hp_linear"].conductance(s, 0.0, p) == pytest.approx(float(1 / memristance), rel=ROUNDING)
    assert LAWS["hp_linear"].charge_scale(p) == pytest.approx(float(q_max), rel=ROUNDING)


@pytest.mark.parametrize("s", STATES)
@pytest.mark.parametrize("p", [(0.01, 1.0, 0.99), (11500.0, 1.15e6, 3.4e-4)])
def test_peo_pani_mirror_is_equation_9_as_read(p, s):
    r_on, r_off, _ = exact(p)
    memristance = r_off - (r_off - r_on) * Fraction(s)
    g = 1 / r_on + 1 / r_off - 1 / (r_on + r_off - memristance)
    assert LAWS["peo_pani_mirror"].conductance(s, 0.0, p) == pytest.approx(float(g), rel=ROUNDING)


@pytest.mark.parametrize("s", STATES)
def test_linear_law_joins_its_ends_by_a_straight_line(s):
    p = (1e4, 1e6, 9.9e-7)
    r_on, r_off, _ = exact(p)
    g = 1 / r_off + (1 / r_on - 1 / r_off) * Fraction(s)
    assert LAWS["linear"].conductance(s, 0.0, p) == pytest.approx(float(g), rel=ROUNDING)


def test_beta_is_mobility_over_thickness_squared():
    mobility, thickness = 1e-14, 10e-9
    for name in ("hp_tio2", "hp_tio2_10k", "hp_tio2_paper"):
        assert Device.load(name).parameters["beta"] == pytest.approx(mobility / thickness**2, rel=1e-14)


def test_charge_scale_is_strukovs_times_one_minus_the_ratio():
    device = Device.load("hp_tio2")
    strukov = (10e-9) ** 2 / (1e-14 * 100.0)
    assert strukov == pytest.approx(1e-4, rel=1e-14)
    assert device.charge_scale == pytest.approx(strukov * (1 - 100 / 16e3), rel=1e-14)


@given(st.floats(0.0, 0.99))
def test_normalised_weights_are_the_papers(q):
    s = min(q / 0.99, 1.0)
    # The quotient q/0.99 is only known to a rounding, which the steep end enlarges 100 times.
    assert Device.load("hp_tio2_paper").weight(s) == pytest.approx(0.01 / (1 - q), rel=1e-13)
    assert Device.load("peo_pani_paper").weight(s) == pytest.approx(1.01 - 0.01 / (0.01 + q), rel=1e-13)


@given(st.floats(0.0, 1.0))
def test_peo_weight_is_the_mirror_image_of_hp(s):
    hp, peo = Device.load("hp_tio2_paper"), Device.load("peo_pani_paper")
    # 1 - s rounds by up to 1e-16, times the slope of W, up to 99.
    assert peo.weight(s) == pytest.approx(1.01 - hp.weight(1.0 - s), abs=4e-14)


@pytest.mark.parametrize(("kind", "card"), [("HP", "hp_tio2_paper"), ("PEO", "peo_pani_paper")])
def test_weights_agree_with_the_golden_curves(kind, card):
    device = Device.load(card)
    rows = json.loads((GOLDEN / "04_weight_curves.json").read_text())["rows"]
    assert len(rows) == 8
    for row in rows:
        state = row["n_positive_events_from_q0"] / 1000
        assert device.weight(state) == pytest.approx(row[kind], rel=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_is_passive_and_rises_with_its_state(name):
    s = np.linspace(0.0, 1.0, 1001)
    g = LAWS[name].conductance(s, 0.0, defaults(name))
    assert g.shape == s.shape
    assert (g > 0).all()
    assert (np.diff(g) > 0).all()


@pytest.mark.parametrize("name", LAWS)
def test_every_law_gives_the_same_for_floats_arrays_and_lists_of_parameters(name):
    law, s = LAWS[name], np.array([[0.0, 0.25], [0.5, 1.0]])
    p = defaults(name)
    together = law.conductance(s, np.full_like(s, 0.1), np.array(p))
    apart = [[law.conductance(x, 0.1, list(p)) for x in row] for row in s.tolist()]
    # numpy's vector functions and those of the C library differ in the last bit, which Newton's rule passes on.
    np.testing.assert_allclose(together, apart, rtol=1e-14)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_moves_its_state_with_the_sign_of_the_current(name):
    law, p = LAWS[name], defaults(name)
    for v in (0.5, -0.5):
        i = law.conductance(0.5, v, p) * v
        assert law.charge_rate(0.5, v, i, p) * v >= 0.0
    assert law.charge_scale(p) > 0.0


@pytest.mark.parametrize("name", LAWS)
def test_every_law_declares_usable_parameters(name):
    law = LAWS[name]
    assert law.name == name
    assert law.doc
    assert len(set(law.parameter_names)) == len(law.parameters)
    for parameter in law.parameters:
        assert parameter.lower <= parameter.default <= parameter.upper
        assert parameter.lower < parameter.upper
        assert parameter.unit
        assert parameter.doc
        if parameter.scale == "log":
            assert parameter.lower > 0
