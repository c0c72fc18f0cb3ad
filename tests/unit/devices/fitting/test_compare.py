"""Comparison of laws on the same sweeps."""

from __future__ import annotations

import numpy as np
import pytest

from ohmloom.devices import compare
from ohmloom.devices.fitting import Comparison
from ohmloom.errors import FileFormatError

LAWS = ["hp_linear", "linear", "peo_pani_redox"]


@pytest.fixture(scope="module")
def comparison(sweep):
    held_out = sweep("linear", 2, name="other", amplitude=0.7, s0=0.4)
    return compare(sweep("linear"), LAWS, holdout=[held_out], rng=np.random.default_rng(0), screen=30, starts=1)


def test_the_law_that_made_the_data_comes_first(comparison):
    assert comparison.ranking[0].law == comparison.by_holdout[0] == "linear"
    assert comparison.ranking[0].delta_bic == 0.0
    assert comparison.ranking[1].delta_bic > 10.0
    assert [row.unknowns for row in comparison.ranking if row.law == "peo_pani_redox"] == [6]


def test_another_law_in_the_list_changes_no_fit(comparison, sweep):
    held_out = sweep("linear", 2, name="other", amplitude=0.7, s0=0.4)
    fewer = compare(sweep("linear"), ["linear"], holdout=[held_out], rng=np.random.default_rng(0), screen=30, starts=1)
    assert fewer.fits["linear"] == comparison.fits["linear"]


def test_save_and_load(comparison, tmp_path):
    path = tmp_path / "comparison.json"
    comparison.save(path)
    assert Comparison.load(path) == comparison
    path.write_text(path.read_text().replace('"by_holdout"', '"by_chance"'))
    with pytest.raises(FileFormatError, match=r"comparison\.json"):
        Comparison.load(path)
