"""Compiled kernels are found again wherever the package is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import ohmloom

HITS = """
import numpy as np
from ohmloom import _jit
_jit.copy_flat(np.zeros(2), np.ones(2))
print(sum(_jit.copy_flat.stats.cache_hits.values()))
"""


def test_a_second_environment_compiles_nothing_again(tmp_path):
    def run(place: str) -> str:
        package = tmp_path / place / "ohmloom"
        package.mkdir(parents=True)
        for name in ("__init__.py", "_jit.py", "_kernel_cache.py"):
            shutil.copy(Path(ohmloom.__file__).parent / name, package / name)
        environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
        environment |= {"OHMLOOM_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path / place)}
        command = [sys.executable, "-c", HITS]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.strip()

    assert run("first") == "0"
    assert run("second") == "1"
