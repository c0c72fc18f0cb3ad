"""FMUs for other machines: how large one of all five platforms is, and that the same sources give the same bytes."""

import importlib.util
import os
import subprocess
import sys
import zipfile

import pytest

from ohmloom.devices import Device
from ohmloom.fmu import export_device
from ohmloom.fmu._compile import TARGETS

REPRODUCIBLE = ("x86_64-linux", "aarch64-linux", "x86_64-windows")  # a Mach-O file names itself anew each time
AGAIN = """
import os, sys
from ohmloom.devices import Device
from ohmloom.fmu import _compile, build, export_device
os.umask(0o077)
kept = {key: _compile.TARGETS[key] for key in sys.argv[2:]}
_compile.TARGETS.clear()
_compile.TARGETS.update(kept)
export_device(Device.load("hp_tio2"), sys.argv[1], fmi=3, platforms="all")
"""


def test_five_platforms_are_small_and_rebuilt_to_the_byte(tmp_path):
    """The first use of a target builds its C library, which takes minutes; from then on this takes seconds."""
    if importlib.util.find_spec("ziglang") is None:
        if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
            pytest.fail("ziglang is not installed, and OHMLOOM_REQUIRE_TOOLS is set")
        pytest.skip("ziglang is not installed: FMUs for other platforms are not built here")
    written = export_device(Device.load("hp_tio2"), tmp_path / "all.fmu", fmi=3, platforms="all")
    assert written.platforms == tuple(TARGETS)
    assert written.size < 100_000
    # Again in another process, folder, place on the globe and language, with another umask, and later.
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    again = tmp_path / "elsewhere" / "again.fmu"
    (tmp_path / "cache").mkdir()  # without it ziglang might hand out what it has compiled before
    environment = {
        **os.environ,
        "ZIG_LOCAL_CACHE_DIR": str(tmp_path / "cache"),
        "TMPDIR": str(again.parent),
        "TZ": "Pacific/Auckland",
        "LC_ALL": "C",
        "LANG": "C",
    }
    subprocess.run([sys.executable, "-c", AGAIN, str(again), *REPRODUCIBLE], env=environment, check=True)
    with zipfile.ZipFile(written.path) as first, zipfile.ZipFile(again) as second:
        names = second.namelist()
        assert len([name for name in names if name.startswith("binaries/")]) == len(REPRODUCIBLE)
        for name in names:
            assert first.read(name) == second.read(name), name
            assert first.getinfo(name).external_attr == second.getinfo(name).external_attr
            assert first.getinfo(name).date_time == second.getinfo(name).date_time
