"""Fits of same-law data: recovery, repeatability, joint fits, hold-out, weights, cards and files."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ohmloom.devices import Fit, Measurement, fit
from ohmloom.errors import FileFormatError

QUICK = {"screen": 30, "starts": 1}


@pytest.fixture(scope="module")
def linear(sweep):
    return fit(sweep("linear"), "linear", rng=np.random.default_rng(0), **QUICK)


@pytest.fixture(scope="module")
def joint(sweep):
    sweeps = [sweep("linear", 1, name="a"), sweep("linear", 2, name="b", s0=0.4, period=0.7)]
    held_out = sweep("linear", 3, name="c", s0=0.3, amplitude=0.8)
    return fit(sweeps, "linear", holdout=[held_out], rng=np.random.default_rng(0), **QUICK)


@pytest.mark.parametrize("law", ["hp_linear", "hp_biolek", "linear", "peo_pani_mirror", "tio2_threshold",
                                 "mirror_threshold", "peo_pani_redox"])  # fmt: skip
def test_data_of_a_law_are_fitted_to_their_noise_and_give_its_parameters_back(law, sweep, device, truths):
    found = fit(sweep(law, 1), law, rng=np.random.default_rng(0), **QUICK)
    assert found.relative_rms == pytest.approx(0.01, rel=0.15)  # 200 points: the noise's own rms is good to 5 %
    for name, interval in found.intervals.items():
        low, high = interval
        assert low <= device(law).parameters[name] <= high, name
    low, high = found.sweeps[0].s0_interval
    assert low <= truths[law][3] <= high


def test_the_same_generator_gives_the_same_bytes_whether_or_not_one_watches(sweep, tmp_path):
    seen = []
    for k, (seed, report) in enumerate([(0, None), (0, lambda *news: seen.append(news)), (1, None)]):
        fit(sweep("linear"), "linear", rng=np.random.default_rng(seed), report=report, **QUICK).save(tmp_path / f"{k}")
    first, second, other = ((tmp_path / f"{k}").read_bytes() for k in range(3))
    assert first == second
    assert first != other  # the starts differ
    seen = [news for news in seen if news[0]]
    assert [news[:2] for news in seen] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [news[2] for news in seen] == sorted((news[2] for news in seen), reverse=True)


def test_a_joint_fit_shares_parameters_and_gives_each_sweep_its_own_start(joint):
    assert [s.name for s in joint.sweeps] == ["a", "b"]
    assert joint.sweeps[0].s0 == pytest.approx(0.2, abs=0.01)  # the intervals' half widths are 0.003
    assert joint.sweeps[1].s0 == pytest.approx(0.4, abs=0.01)
    assert joint.relative_rms == pytest.approx(math.sqrt(np.mean([s.relative_rms**2 for s in joint.sweeps])), rel=1e-12)
    assert set(joint.weakest) == {"r_on", "r_off", "q_d", "s0 of a", "s0 of b"}


def test_a_held_out_sweep_is_predicted_with_its_start_state_alone_free(joint):
    (held_out,) = joint.holdout
    assert held_out.s0 == pytest.approx(0.3, abs=0.01)
    assert held_out.s0_interval is None
    assert joint.holdout_rms == held_out.relative_rms == pytest.approx(0.01, rel=0.15)
    loop = joint.device.simulate(np.array(held_out.v), np.array(held_out.t), s0=held_out.s0)
    # Two steps per sample against the accurate integrator.
    np.testing.assert_allclose(held_out.i_fit, loop.i, atol=2e-4 * np.abs(loop.i).max())
    assert not any("carry over" in text for text in joint.warnings)


def test_a_hold_out_sweep_changes_nothing_in_the_fit(sweep, linear):
    with_it = fit(sweep("linear"), "linear", holdout=[sweep("linear", 5, name="other")], rng=np.random.default_rng(0),
                  **QUICK)  # fmt: skip
    assert with_it.card == linear.card


def test_a_fit_that_does_not_carry_over_says_so(sweep, rng):
    other = sweep("linear", 5, name="other device", r_on=3e4)
    found = fit(sweep("linear"), "linear", holdout=[other], rng=rng, **QUICK)
    assert any(text.startswith("other device, held out, is predicted") and text.endswith("it does not carry over.")
               for text in found.warnings)  # fmt: skip


def test_fixed_and_freed_parameters(sweep, rng):
    found = fit(sweep("peo_pani_redox"), "peo_pani_redox", fixed={"k0": 1.0}, free=["mirror"], rng=rng, **QUICK)
    assert found.fitted == ("r_on", "r_off", "e0", "slope", "mirror")
    assert found.held == {"k0": 1.0, "q_d": 3.4e-4, "asymmetry": 1.0}
    sources = {n: v.source for n, v in zip(found.device.parameters, found.device.values, strict=True)}
    assert sources["k0"] == "fixed in the fit"
    assert sources["q_d"] == "the law's default, held in the fit"
    assert sources["mirror"].startswith("fitted to peo_pani_redox; 95 % below ")


def test_the_card_has_value_interval_source_and_digest(sweep, tmp_path, rng):
    sweep("linear").save(tmp_path / "loop.csv")
    read = Measurement.read_csv(tmp_path / "loop.csv")
    device = fit(read, "linear", rng=rng, name="mine", **QUICK).device
    assert device.name == "mine"
    assert device.source == "linear fitted to loop.csv"
    assert device.values[0].interval[0] < device.values[0].value < device.values[0].interval[1]
    assert [(d.file, d.sha256) for d in device.data] == [("loop.csv", read.sha256)]


def test_save_and_load(linear, tmp_path):
    path = tmp_path / "fit.json"
    linear.save(path)
    assert Fit.load(path) == linear
    text = path.read_text()
    changes = [
        ('"version": 1', '"version": 2'),
        ('"law": "linear"', '"law": 3'),
        ("[parameters.r_on]", "[parameters.x]"),
    ]
    for damaged in (text[:-40], *(text.replace(old, new) for old, new in changes)):
        path.write_text(damaged)
        with pytest.raises(FileFormatError, match=r"fit\.json"):
            Fit.load(path)


def optimum_of_a_resistor(v, i, weight):
    """Weighted least squares of i = g v."""
    return float(np.sum(weight**2 * v * i) / np.sum(weight**2 * v**2))


@pytest.mark.parametrize("weights", ["relative", "absolute", (2e-6, 0.3)])
def test_weights_do_what_they_say(weights, rng):
    """Two resistors of different size as one: a law that cannot move has an optimum to be had by hand."""
    t = np.linspace(0.0, 1.0, 50)
    v = [np.sin(2 * np.pi * t), 0.2 * np.sin(2 * np.pi * t + 0.3)]
    i = [1.1e-4 * v[0], 0.9e-4 * v[1] * (1.0 + 0.1 * np.sin(40 * t))]
    sweeps = [Measurement(name=f"{k}", t=t, v=v[k], i=i[k]) for k in range(2)]
    # Ratio 2 at q_d = 1e6 C: both states rest, and r_off = 1e-3 ... is far from the data, so s0 is all that counts.
    found = fit(sweeps, "linear", fixed={"q_d": 1e6, "r_off": 1e12}, weights=weights, rng=rng, **QUICK)
    g_model = [np.array(s.i_fit)[1:] / np.array(s.v)[1:] for s in found.sweeps]
    if weights == "relative":
        w = [1 / np.sqrt(np.mean(x**2)) * np.ones(50) for x in i]
    elif weights == "absolute":
        w = [np.ones(50)] * 2
    else:
        w = [1 / (2e-6 + 0.3 * np.abs(x)) for x in i]
    # Each sweep has its own s0, so each meets its own optimum.
    for k in range(2):
        assert np.median(g_model[k]) == pytest.approx(optimum_of_a_resistor(v[k], i[k], w[k]), rel=1e-5)


def test_coarse_sampling_makes_the_integrator_refine(sweep, rng):
    coarse = fit(sweep("hp_linear", points=40, noise=1e-3), "hp_linear", rng=rng, **QUICK)
    fine = fit(sweep("linear", points=400), "linear", rng=rng, **QUICK)
    assert fine.substeps == 2 < coarse.substeps
    assert coarse.integration_error <= max(0.02 * coarse.relative_rms, 1e-6) or coarse.substeps == 32


def test_walls_and_offset_are_reported(sweep, rng):
    loop = sweep("linear")
    shifted = Measurement(name="shifted", t=loop.t, v=loop.v, i=loop.i + 0.05 * np.abs(loop.i).max())
    found = fit(shifted, "linear", rng=rng, **QUICK)
    assert found.sweeps[0].zero_offset == pytest.approx(0.05, abs=0.01)
    assert any(text.startswith("shifted is not pinched: at v = 0 its current is +") for text in found.warnings)
    assert found.sweeps[0].at_upper_wall > 0.05  # four times the charge it holds
    assert found.sweeps[0].at_upper_wall == np.mean(np.array(found.sweeps[0].s) >= 1.0 - 1e-9)


def test_information_criteria(linear, joint):
    for found, unknowns in ((linear, 4), (joint, 5)):
        base = found.n_eff * math.log(found.relative_rms**2)
        assert found.aic == pytest.approx(base + 2 * unknowns, rel=1e-9)
        assert found.bic == pytest.approx(base + unknowns * math.log(found.n_eff), rel=1e-9)
        assert found.n_eff == pytest.approx(sum(s.n_eff for s in found.sweeps))
