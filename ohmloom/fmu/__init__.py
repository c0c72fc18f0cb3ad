"""FMI: models as FMUs that other tools run, and FMUs of other tools run here.

`export_device`, `export_crossbar`, `export_controller`, `export_arena` and `export_system` write FMUs of FMI 2.0 or
3.0, with their C sources and a library inside; `check` says whether an FMU works, `run` and `run_ssp` run one, or a
system of several, and a `Host` is one to step by hand, all in processes of their own. All quantities are SI.
"""

from __future__ import annotations

from ohmloom.fmu.build import Export
from ohmloom.fmu.check import Check, CheckRow, check
from ohmloom.fmu.crossbar import export_crossbar
from ohmloom.fmu.device import export_device
from ohmloom.fmu.discrete import export_arena, export_controller
from ohmloom.fmu.hardware import export_hardware_controller
from ohmloom.fmu.host import Host
from ohmloom.fmu.hosted import HostedArena, HostedController
from ohmloom.fmu.hosted_device import HostedDevice, reference_errors, simulate_hosted
from ohmloom.fmu.run import FmuTrace, run
from ohmloom.fmu.ssp import run_ssp
from ohmloom.fmu.system import export_system

__all__ = [
    "Check", "CheckRow", "Export", "FmuTrace", "Host", "HostedArena", "HostedController", "HostedDevice", "check",
    "export_arena", "export_controller", "export_crossbar", "export_device", "export_hardware_controller",
    "export_system", "reference_errors", "run", "run_ssp", "simulate_hosted",
]  # fmt: skip
