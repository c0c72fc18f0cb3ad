"""Coordinates of a fit and what the data suggest for them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ohmloom.devices import LAWS
from ohmloom.devices.fitting._coordinates import choose
from ohmloom.devices.fitting._features import Features


@pytest.mark.parametrize("law", LAWS)
def test_values_and_coordinates_are_inverse(law):
    coordinates = choose(LAWS[law], {}, ())
    defaults = {p.name: p.default for p in LAWS[law].parameters}
    values = coordinates.values(coordinates.of_values(defaults))
    assert list(values) == list(defaults)
    for name, value in values.items():
        assert value == pytest.approx(defaults[name], rel=1e-12), name


def test_r_off_is_a_ratio_only_beside_a_fitted_r_on():
    both, alone = choose(LAWS["linear"], {}, ()), choose(LAWS["linear"], {"r_on": 50.0}, ())
    values = {"r_on": 50.0, "r_off": 5e3, "q_d": 1e-6}
    assert both.of_values(values)[1] == pytest.approx(math.log(100.0))
    assert alone.of_values(values)[0] == pytest.approx(math.log(5e3))
    # The logarithm of r_off is the sum of two coordinates.
    assert (both.transform() @ both.of_values(values))[1] == pytest.approx(math.log(5e3))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("size", [1e-5, 1.0, 1e5])
def test_every_point_of_the_box_is_a_valid_device(law, size, sweep, device):
    loop = sweep("linear")
    scaled = type(loop)(name="x", t=loop.t, v=loop.v * size, i=loop.i)
    coordinates, features, rng = choose(LAWS[law], {}, ()), Features.of([scaled]), np.random.default_rng(0)
    low, high = coordinates.bounds(features)
    assert (low < high).all()
    # In the middle and at random starts; the corner beyond the largest r_off is held at it.
    points = [0.5 * (low + high), np.where(coordinates.has_ratio, high, high)]
    points += [np.clip(coordinates.random(features, rng), low, high) for _ in range(20)]
    for z in points:
        values = coordinates.values(z)
        for p in LAWS[law].parameters:
            assert p.lower * (1 - 1e-12) <= values[p.name] <= p.upper * (1 + 1e-12) or p.scale == "linear", p.name
        if "r_off" in values:
            assert values["r_on"] < values["r_off"] <= 1e12


@pytest.mark.parametrize("law", ["linear", "tio2_threshold", "mirror_threshold", "peo_pani_redox", "hp_biolek"])
def test_sizes_from_data_are_near_the_truth(law, sweep, device):
    """Well within the four decades that a fit looks at; a window makes the charge that passes a poor guide to beta."""
    truth = device(law).parameters
    suggested = choose(LAWS[law], {}, ()).nominal(Features.of([sweep(law)]))
    for p in LAWS[law].parameters:
        if p.name in suggested and p.scale == "log":
            factor = 100 if p.name == "beta" else 30
            assert 1 / factor < suggested[p.name] / truth[p.name] < factor, p.name


def test_random_starts_spread_over_two_decades(sweep):
    coordinates, features = choose(LAWS["linear"], {}, ()), Features.of([sweep("linear")])
    nominal = coordinates.nominal(features)["q_d"]
    rng = np.random.default_rng(0)
    found = [coordinates.values(coordinates.random(features, rng))["q_d"] / nominal for _ in range(200)]
    assert 0.1 <= min(found) < 0.12
    assert 8.0 < max(found) <= 10.0
