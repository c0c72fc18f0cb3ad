"""What a fit refuses, in exact words; and what once crashed it."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.devices import LAWS, Fit, Measurement, compare, fit
from ohmloom.errors import OhmloomError, OperationError, ParameterError, UnknownNameError

QUICK = {"screen": 15, "starts": 1}


@pytest.fixture(scope="module")
def loop(sweep):
    return sweep("linear")


def refused(match, *arguments, kind=ParameterError, rng="given", **options):
    generator = np.random.default_rng(0) if isinstance(rng, str) else rng
    with pytest.raises(kind) as error:
        fit(*arguments, rng=generator, **{**QUICK, **options})
    assert str(error.value) == match


NAMES = "hp_biolek, hp_joglekar, hp_linear, hp_prodromakis, linear, mirror_threshold, peo_pani_mirror, peo_pani_redox"
REDOX = "asymmetry, e0, k0, mirror, q_d, r_off, r_on, slope"


def test_names(loop):
    refused(f"fit.law: expected one of {NAMES}, pickett, tio2_threshold, vteam, yakopcic, got 'tio_threshold'. "
            "Did you mean 'tio2_threshold'?", loop, "tio_threshold", kind=UnknownNameError)  # fmt: skip
    refused("fit.fixed: expected one of q_d, r_off, r_on, got 'ron'. Did you mean 'r_on'?", loop, "linear",
            fixed={"ron": 1.0}, kind=UnknownNameError)  # fmt: skip
    refused(f"fit.free: expected one of {REDOX}, got 'miror'. Did you mean 'mirror'?", loop, "peo_pani_redox",
            free=["miror"], kind=UnknownNameError)  # fmt: skip
    refused("fit.free: expected each name once, got 'mirror' twice. Remove one.", loop, "peo_pani_redox",
            free=["mirror", "mirror"])  # fmt: skip
    refused("fit.free: expected no name that is fixed too, got 'mirror'. Drop one of the two.", loop, "peo_pani_redox",
            free=["mirror"], fixed={"mirror": 0.5})  # fmt: skip
    refused("fit.free: expected names in a list, got 'mirror'. Put them in brackets.", loop, "peo_pani_redox",
            free="mirror")  # fmt: skip
    refused("fit.fixed: expected Mapping, got ['r_on']. Pass a value of this type.", loop, "linear", fixed=["r_on"])
    refused("fit.name: expected str, got 3. Pass a value of this type.", loop, "linear", name=3)


def test_fixed_values(loop):
    refused("fit.fixed: r_on: expected 0.001 to 1e+12 Ohm, got 1e+13 Ohm. Check its unit.", loop, "linear",
            fixed={"r_on": 1e13})  # fmt: skip
    refused("fit.fixed: r_on: expected less than r_off = 100 Ohm, got 10000 Ohm. Lower r_on or raise r_off.", loop,
            "linear", fixed={"r_on": 1e4, "r_off": 100.0})  # fmt: skip
    refused("fit.fixed: expected at least one parameter of linear to fit, got all of them fixed. Free one.", loop,
            "linear", fixed={"r_on": 1e4, "r_off": 1e5, "q_d": 1e-6})  # fmt: skip


def test_sweeps(loop):
    short = Measurement(name="short", t=loop.t[:4], v=loop.v[:4], i=loop.i[:4])
    refused("fit.measurements: expected more points than the 4 unknowns of linear (r_on, r_off, q_d, s0), got 4. "
            "Measure more points, or fix parameters.", short, "linear")  # fmt: skip
    refused("fit.measurements: expected sweeps of different names, got 'linear' twice. Pass name= to read_csv.",
            [loop, loop], "linear")  # fmt: skip
    refused("fit.measurements: expected at least one Measurement, got none. Read one with read_csv.", [], "linear")
    refused("fit.measurements: expected Measurements in a list, got 'loop.csv'. Read them with read_csv.", "loop.csv",
            "linear")  # fmt: skip
    refused("fit.measurements: expected Measurement, got 3. Pass a value of this type.", [3], "linear")
    tiny = Measurement(name="tiny", t=loop.t, v=loop.v, i=1e-170 * loop.i)
    refused("fit.measurements: expected currents above 1e-150 A in size, got smaller ones. Check the unit.", tiny,
            "linear")  # fmt: skip


def test_settings(loop):
    refused("fit.rng: expected Generator, got None. Pass a value of this type.", loop, "linear", rng=None)
    refused("fit.screen: expected an integer from 1 to 1000000, got 1.5. Correct it.", loop, "linear", screen=1.5)
    refused("fit.starts: expected an integer from 1 to 10000, got True. Correct it.", loop, "linear", starts=True)
    refused("fit.weights: expected one of absolute, relative, got 'abs'. Did you mean 'absolute'?", loop, "linear",
            weights="abs", kind=UnknownNameError)  # fmt: skip
    refused("fit.weights: expected 'relative', 'absolute' or (a, b) for a + b |i|, got None. Give two numbers.", loop,
            "linear", weights=None)  # fmt: skip
    refused("fit.weights: expected a > 0 A and b >= 0 in a + b |i|, got a = 0 A, b = 0.1. Give the current's absolute "
            "and relative uncertainty.", loop, "linear", weights=(0.0, 0.1))  # fmt: skip
    for a in (1e-300, 1e300):  # squares of i/a overflow, or vanish
        refused(f"fit.weights: expected a + b |i| near the current's uncertainty, got a = {a:.6g} A, b = 0. "
                "Check the unit of a.", loop, "linear", weights=(a, 0.0))  # fmt: skip
    with pytest.raises(TypeError):
        fit(loop, "linear")


def test_what_compare_refuses(loop, rng):
    for laws in ([], "linear"):
        with pytest.raises(ParameterError, match="at least one law in a list"):
            compare(loop, laws, rng=rng)
    with pytest.raises(ParameterError, match="expected each law once, got 'linear' twice"):
        compare(loop, ["linear", "linear"], rng=rng)
    with pytest.raises(UnknownNameError, match="Did you mean 'linear'"):
        compare(loop, ["linear", "linera"], rng=rng)


@pytest.mark.parametrize("fixed", [{"r_off": 1e3}, {"r_on": 1e6}], ids=str)
def test_a_fixed_resistance_on_the_wrong_side_still_gives_a_valid_device(loop, rng, fixed):
    """Data say 10 to 100 kOhm."""
    values = fit(loop, "linear", rng=rng, fixed=fixed, **QUICK).device.parameters
    assert values["r_on"] < values["r_off"]


def test_numbers_of_numpy_are_saved_as_plain_ones(loop, rng, tmp_path):
    found = fit(loop, "linear", rng=rng, fixed={"r_on": np.float32(1e4)}, weights=(np.float32(1e-6), np.int64(0)),
                screen=np.int64(15), starts=np.int64(1))  # fmt: skip
    found.save(tmp_path / "fit.json")
    assert Fit.load(tmp_path / "fit.json") == found


EXTREMES = [(1e5, 1e9, 1e-15), (1e6, 1e-12, 1e6), (1e-6, 1e-12, 1e-15), (1e-30, 1.0, 1e-30), (1e3, 1.0, 1e-5)]
# pickett takes minutes: its formula is 100 times longer.
QUICK_LAWS = [name for name in LAWS if name != "pickett"]


@pytest.mark.parametrize("law", QUICK_LAWS)
def test_an_extreme_sweep_fits_or_is_refused_without_nan(loop, law, tmp_path):
    """1e5 V for 1e9 s with 1 fA among others; warnings from numpy are errors in tests."""
    few = Measurement(name="x", t=loop.t[::4], v=loop.v[::4], i=loop.i[::4])
    for v, t, i in EXTREMES[::2]:
        extreme = Measurement(name="x", t=few.t * t, v=few.v * v, i=few.i / np.abs(few.i).max() * i)
        try:
            found = fit(extreme, law, rng=np.random.default_rng(0), screen=5, starts=1)
        except OhmloomError as error:
            refusal = error
        else:
            found.save(tmp_path / "fit.json")  # refuses NaN
            assert Fit.load(tmp_path / "fit.json").device.law == law
            continue
        assert isinstance(refusal, OperationError)
        assert "to give a finite current from at least one start, got none." in str(refusal)


@pytest.mark.parametrize("name", ["", "a\nb", "a\udcff"])
def test_a_name_that_no_card_could_hold_is_refused_before_the_search(name):
    with pytest.raises(ParameterError, match=r"^fit.name: expected printable text, got .*\. Use another name\.$"):
        fit(Measurement.read_csv("redox"), "linear", rng=np.random.default_rng(0), name=name)
