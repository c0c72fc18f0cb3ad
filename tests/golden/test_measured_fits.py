"""Fits of measured loops, to the errors that were reached; the data are not the project's and are not shipped."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from ohmloom.devices import Device, Measurement, fit

DATA = Path(os.environ.get("OHMLOOM_MEASURED_DATA") or Path(__file__).parents[2].parent / "shared" / "data")
pytestmark = pytest.mark.skipif(
    not (DATA / "knowm_w_sdc").is_dir(),
    reason="measured data, which may not be shipped, are not here: name their folder in OHMLOOM_MEASURED_DATA",
)


def knowm(frequency):
    return Measurement.read_csv(DATA / f"knowm_w_sdc/knowm_wsdc_5k_0p8V_{frequency}Hz_M1.csv", time=None,
                                voltage="v_memristor_V", current="i_uA", units={"i_uA": "uA"},
                                frequency=float(frequency))  # fmt: skip


def staircase():
    return Measurement.read_csv(DATA / "pani/small_mem4.csv", voltage="s", current="m", every=30)


@pytest.mark.parametrize(("law", "ceiling"), [("peo_pani_redox", 0.055), ("mirror_threshold", 0.055),
                                              ("tio2_threshold", 0.115)])  # fmt: skip
def test_knowm_at_100_hz(law, ceiling):
    assert fit(knowm(100), law, rng=np.random.default_rng(0), screen=60, starts=2).relative_rms <= ceiling


def test_polyaniline_loop():
    loop = Measurement.read_csv(DATA / "pani/IV_MLit10_1.txt", time=None, voltage="1", current="2",
                                sample_interval=1.0, rows=(182, 364))  # fmt: skip
    assert fit(loop, "peo_pani_redox", rng=np.random.default_rng(0), screen=60, starts=2).relative_rms <= 0.045


def test_polyaniline_staircase_and_the_shipped_card():
    found = fit(staircase(), "peo_pani_redox", rng=np.random.default_rng(0), screen=60, starts=2)
    assert found.relative_rms <= 0.070
    shipped = Device.load("peo_pani_redox").parameters
    for name in ("r_on", "r_off", "e0", "slope", "k0"):
        assert f"{found.parameters[name]:.4g}" == f"{shipped[name]:.4g}", name


def test_knowm_at_three_frequencies_with_one_held_out():
    found = fit([knowm(1), knowm(100)], "mirror_threshold", holdout=[knowm(10)], rng=np.random.default_rng(0),
                screen=60, starts=2)  # fmt: skip
    assert found.holdout_rms > found.relative_rms
    joint = fit(
        [knowm(1), knowm(10), knowm(100)], "mirror_threshold", rng=np.random.default_rng(0), screen=60, starts=2
    )
    assert len(joint.sweeps) == 3
