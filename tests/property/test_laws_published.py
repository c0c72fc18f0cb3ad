"""Laws against their published equations, written here a second time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from ohmloom.devices import LAWS

STATES = (0.0, 0.2, 0.5, 0.83, 1.0)


def defaults(name):
    return {parameter.name: parameter.default for parameter in LAWS[name].parameters}


def rate(name, s, v, **changes):
    law = LAWS[name]
    p = tuple((defaults(name) | changes).values())
    return law.charge_rate(s, v, law.conductance(s, v, p) * v, p) / law.charge_scale(p)


@pytest.mark.parametrize("p", [1.0, 2.0, 7.0])
@pytest.mark.parametrize("s", STATES)
@pytest.mark.parametrize("v", [0.4, -0.4])
def test_windows_are_their_formulas(s, v, p):
    drift = rate("hp_linear", s, v)
    step = 1.0 if v < 0 else 0.0
    windows = {
        "hp_joglekar": 1 - (2 * s - 1) ** (2 * p),
        "hp_biolek": 1 - (s - step) ** (2 * p),
        "hp_prodromakis": 1 - ((s - 0.5) ** 2 + 0.75) ** p,
    }
    for name, window in windows.items():
        # At a wall only rounding is left of the formula.
        assert rate(name, s, v, exponent=p) == pytest.approx(drift * window, rel=1e-12, abs=1e-14 * abs(drift))
    scaled = rate("hp_prodromakis", s, v, exponent=p, height=3.0)
    assert scaled == pytest.approx(3.0 * rate("hp_prodromakis", s, v, exponent=p), rel=1e-14)


@pytest.mark.parametrize("s", STATES)
def test_the_mirror_law_is_the_mirror_image_of_hp(s):
    r_on, r_off = 70.0, 9e3
    hp = LAWS["hp_linear"].conductance(1.0 - s, 0.0, (r_on, r_off, 1.0))
    mirror = LAWS["peo_pani_mirror"].conductance(s, 0.0, (r_on, r_off, 1.0))
    assert mirror == pytest.approx(1 / r_on + 1 / r_off - hp, rel=1e-13)


@pytest.mark.parametrize("v", [0.2, 0.5, 0.61])
def test_redox_tends_to_the_nernst_state_at_the_sum_of_both_rates(v):
    p = defaults("peo_pani_redox")
    e0, slope, k0 = p["e0"], p["slope"], p["k0"]
    steady = 1 / (1 + math.exp(-(v - e0) / slope))
    total = k0 * (math.exp((v - e0) / 2 / slope) + math.exp(-(v - e0) / 2 / slope))
    assert rate("peo_pani_redox", steady, v) == pytest.approx(0.0, abs=1e-15 * total)
    for s in STATES:
        assert rate("peo_pani_redox", s, v) == pytest.approx(total * (steady - s), rel=1e-12, abs=1e-15 * total)


def test_asymmetric_redox_by_hand():
    # v - e0 = 0.1 V: oxidation e^(0.1/0.1) = e, reduction e^-(0.1/0.2) = e^-0.5.
    at = {"e0": 0.5, "slope": 0.05, "k0": 2.0, "asymmetry": 2.0}
    assert rate("peo_pani_redox", 0.25, 0.6, **at) == pytest.approx(
        2 * (math.e * 0.75 - math.exp(-0.5) * 0.25), rel=1e-13
    )
    steady = math.e / (math.e + math.exp(-0.5))
    assert rate("peo_pani_redox", steady, 0.6, **at) == pytest.approx(0.0, abs=1e-14)


def test_redox_conductance_is_linear_or_mirror():
    p = defaults("peo_pani_redox")
    for share in (0.0, 1.0, 0.3):
        values = tuple((p | {"mirror": share}).values())
        ends = (p["r_on"], p["r_off"], 1.0)
        wanted = (1 - share) * LAWS["linear"].conductance(0.4, 0.0, ends)
        wanted += share * LAWS["peo_pani_mirror"].conductance(0.4, 0.0, ends)
        assert LAWS["peo_pani_redox"].conductance(0.4, 0.0, values) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("name", ["tio2_threshold", "mirror_threshold"])
def test_thresholds_open_over_20_mv_and_each_side_has_its_charge(name):
    at = {"v_set": 0.3, "v_reset": 0.15, "q_set": 2e-6, "q_reset": 5e-6}
    p = tuple((defaults(name) | at).values())
    for v, opening, charge in ((0.34, 1 / (1 + math.exp(-2)), 2e-6), (-0.13, 1 / (1 + math.exp(1)), 5e-6)):
        i = LAWS[name].conductance(0.6, v, p) * v
        assert rate(name, 0.6, v, **at) == pytest.approx(i * opening / charge, rel=1e-12)


def test_tio2_conduction_is_sinh():
    p = defaults("tio2_threshold")
    low = 1 / p["r_off"] + (1 / p["r_on"] - 1 / p["r_off"]) * 0.3
    for v in (1e-5, 4.9e-4, 5.1e-4, 0.7, -0.7):
        wanted = low * math.sinh(p["b"] * v) / (p["b"] * v)
        # 1e-3: where the series takes over, its next term is 1e-14.
        assert LAWS["tio2_threshold"].conductance(0.3, v, tuple(p.values())) == pytest.approx(wanted, rel=1e-13)


def test_vteam_rates_by_hand_in_memtorchs_numbers():
    """k_on = -10 m/s, k_off = 5e-4 m/s, 3 nm; v_on = -0.2 V, v_off = 0.02 V; terminals exchanged."""
    at = {"v_set": 0.2, "v_reset": 0.02}
    assert rate("vteam", 0.4, 0.6, **at) == pytest.approx(10 / 3e-9 * (0.6 / 0.2 - 1) ** 3, rel=1e-13)
    assert rate("vteam", 0.4, -0.05, **at) == pytest.approx(-5e-4 / 3e-9 * (0.05 / 0.02 - 1), rel=1e-13)
    assert rate("vteam", 0.4, 0.19, **at) == 0.0
    assert rate("vteam", 0.4, -0.019, **at) == 0.0


@pytest.mark.parametrize(
    ("x", "v", "published"),
    [
        (0.2, 0.5, 7.5 * (math.exp(0.5) - math.exp(0.09))),
        (0.6, 0.5, 7.5 * (math.exp(0.5) - math.exp(0.09)) * math.exp(-0.3) * ((0.3 - 0.6) / 0.7 + 1)),
        (0.6, -1.0, -2.0 * (math.e - math.exp(0.75))),
        (0.2, -1.0, -2.0 * (math.e - math.exp(0.75)) * math.exp(5 * (0.2 + 0.5 - 1)) * 0.2 / (1 - 0.5)),
        (0.2, 0.08, 0.0),
        (0.2, -0.74, 0.0),
    ],
)
def test_yakopcic_rates_by_hand_with_miaos_numbers(x, v, published):
    x_min = defaults("yakopcic")["x_min"]
    s = (x - x_min) / (1 - x_min)
    assert rate("yakopcic", s, v) * (1 - x_min) == pytest.approx(published, rel=1e-12)
    g = LAWS["yakopcic"].conductance(s, v, tuple(defaults("yakopcic").values()))
    assert g * v == pytest.approx(0.11 * x * math.sinh(0.5 * v), rel=1e-12)


def simmons(u, w, p):
    """Current of the gap: J. G. Simmons 1963, rectangular barrier with image force, u in V, w in m."""
    e, h, eps0 = 1.602176634e-19, 6.62607015e-34, 8.8541878128e-12
    phi0 = p["barrier"]
    lam = e * math.log(2) / (8 * math.pi * p["permittivity"] * eps0 * w)
    w1 = 1.2 * lam * w / phi0
    w2 = w1 + w * (1 - 9.2 * lam / (3 * phi0 + 4 * lam - 2 * u))
    dw = w2 - w1
    phi = phi0 - u * (w1 + w2) / (2 * w) - 1.15 * lam * w / dw * math.log(w2 * (w - w1) / (w1 * (w - w2)))
    b = 10.246e9 * dw
    # e/(2 pi h) of the paper times e, for potentials in volts.
    j = e * e * p["area"] / (2 * math.pi * h * dw**2)
    return j * (phi * math.exp(-b * math.sqrt(phi)) - (phi + u) * math.exp(-b * math.sqrt(phi + u)))


@pytest.mark.parametrize("width", [1.2e-9, 1.4e-9, 1.8e-9])
@pytest.mark.parametrize("v", [0.05, -0.3, 0.6])
def test_pickett_conducts_as_simmons_barrier_and_a_resistor(width, v):
    p = defaults("pickett")
    u = brentq(lambda u: u + p["r_s"] * simmons(u, width, p) - abs(v), 1e-9, abs(v), xtol=1e-16, rtol=1e-14)
    s = (p["w_max"] - width) / (p["w_max"] - p["w_min"])
    g = LAWS["pickett"].conductance(s, v, tuple(p.values()))
    assert g == pytest.approx(simmons(u, width, p) / abs(v), rel=1e-9)


@pytest.mark.parametrize("v", [0.5, -0.5])
def test_pickett_moves_as_published_with_terminals_exchanged(v):
    p = defaults("pickett")
    for w in (1.3e-9, 1.6e-9):
        s = (p["w_max"] - w) / (p["w_max"] - p["w_min"])
        i = abs(v * LAWS["pickett"].conductance(s, v, tuple(p.values())))
        if v > 0:
            dw = (
                -40e-6 * math.sinh(i / 8.9e-6) * math.exp(-math.exp(-(w - 1.8e-9) / 107e-12 - i / 500e-6) - w / 107e-12)
            )
        else:
            dw = 3.5e-6 * math.sinh(i / 115e-6) * math.exp(-math.exp((w - 1.2e-9) / 107e-12 - i / 500e-6) - w / 107e-12)
        assert rate("pickett", s, v) == pytest.approx(-dw / (p["w_max"] - p["w_min"]), rel=1e-9)


def test_pickett_current_grows_with_the_voltage_across_the_ends_of_its_formula():
    """Where the gap becomes a resistor the current has no step, for the thinnest and the thickest gap."""
    p = tuple(defaults("pickett").values())
    v = np.geomspace(0.05, 3.0, 4001)
    for s in (0.0, 0.5, 1.0):
        i = LAWS["pickett"].conductance(s, v, p) * v
        growth = np.diff(np.log(i)) / np.diff(np.log(v))
        assert growth.min() > 0.0
        # A jump would be a growth of hundreds over one of these steps of 0.1 %.
        assert growth.max() < 20.0
