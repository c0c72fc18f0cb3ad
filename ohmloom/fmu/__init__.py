"""FMI: models as FMUs that other tools run, and FMUs of other tools run here.

`export_device` writes an FMU of FMI 2.0 or 3.0 with its C sources and a library inside; `check` says whether an FMU
works, and `run` runs one, both in processes of their own. All quantities are SI.
"""

from __future__ import annotations

from ohmloom.fmu.build import Export
from ohmloom.fmu.check import Check, CheckRow, check
from ohmloom.fmu.device import export_device
from ohmloom.fmu.discrete import export_arena, export_controller
from ohmloom.fmu.run import FmuTrace, run

__all__ = ["Check", "CheckRow", "Export", "FmuTrace", "check", "export_arena", "export_controller", "export_device",
           "run"]
