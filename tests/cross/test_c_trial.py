"""The compiled trial against the hand-written C program of the benchmark, built here: equal in every spike count."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "trial.py"


def test_trials_equal_those_of_the_c_program():
    if not any(map(shutil.which, (os.environ.get("CC", ""), "gcc", "clang"))):
        if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
            pytest.fail("no C compiler, and OHMLOOM_REQUIRE_TOOLS is set")
        pytest.skip("no C compiler: the closed-loop trial is not compared with C here")
    words = [sys.executable, str(BENCHMARK), "--networks", "6", "--rounds", "1"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "equal in every spike count, event, pose and fitness" in done.stdout
