"""Crossbars against badcrossbar, which solves the whole nodal matrix: currents and potentials of every node."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ohmloom.circuits import Crossbar

SCRIPT = Path(__file__).with_name("badcrossbar_solutions.py")
WIRES = [(1.0, 1.0), (10.0, 10.0), (100.0, 0.1)]
SHAPES = [(1, 1), (1, 6), (6, 1), (8, 5), (16, 16), (20, 33)]


def cases():
    """(conductances, voltages (pattern, word_line), wires), some devices open."""
    rng = np.random.default_rng(7)
    for m, n in SHAPES:
        for wires in WIRES:
            g = rng.uniform(1e-6, 1e-3, (m, n))
            g[rng.random((m, n)) < 0.1 * (m * n > 10)] = 0.0
            yield g, rng.uniform(-1.0, 1.0, (3, m)), wires


@pytest.fixture(scope="module")
def solutions(tmp_path_factory):
    """badcrossbar's solutions of all cases, in one run of its own interpreter."""
    python = os.environ.get("OHMLOOM_BADCROSSBAR_PYTHON")
    if python is None:
        reason = "OHMLOOM_BADCROSSBAR_PYTHON names no interpreter with badcrossbar: crossbars are not compared with it"
        if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
            pytest.fail(reason)
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("badcrossbar")
    given = {"cases": np.array(len(list(cases())))}
    for k, (g, v, wires) in enumerate(cases()):
        given |= {f"g_{k}": g, f"v_{k}": v, f"wires_{k}": np.array(wires)}
    np.savez(folder / "given.npz", **given)
    done = subprocess.run([python, str(SCRIPT), str(folder / "given.npz"), str(folder / "found.npz")],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return np.load(folder / "found.npz")


@pytest.mark.parametrize("k", range(len(SHAPES) * len(WIRES)))
def test_currents_and_potentials_equal_badcrossbars(solutions, k):
    g, v, (r_row, r_column) = list(cases())[k]
    array = Crossbar(conductance=g, r_row=r_row, r_column=r_column)
    read = array.read(v)
    wanted = solutions[f"current_{k}"].reshape(v.shape[0], -1)
    # Outputs of opposite inputs nearly cancel, so errors count against the largest current.
    assert np.abs(read.current - wanted).max() <= 1e-10 * np.abs(wanted).max()
    assert np.abs(v @ array.operator() - wanted).max() <= 1e-10 * np.abs(wanted).max()
    # badcrossbar keeps patterns in the last axis.
    for ours, theirs in ((read.v_row, "v_row"), (read.v_column, "v_column")):
        potentials = solutions[f"{theirs}_{k}"].reshape(*g.shape, -1)
        assert np.abs(ours - np.moveaxis(potentials, -1, 0)).max() <= 1e-9
