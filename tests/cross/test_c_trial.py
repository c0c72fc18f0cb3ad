"""The compiled trial against the hand-written C program of the benchmark, built here: equal in every spike count."""

import os
import subprocess
import sys
from pathlib import Path

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "trial.py"


def test_trials_equal_those_of_the_c_program(need_tool):
    need_tool("the closed-loop trial is not compared with C here", os.environ.get("CC", ""), "gcc", "clang")
    words = [sys.executable, str(BENCHMARK), "--networks", "6", "--rounds", "1"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "equal in every spike count, event, pose and fitness" in done.stdout
