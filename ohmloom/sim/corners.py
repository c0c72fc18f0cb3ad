"""Corners: the same study on hardware that is slow, noisy, faulty, or all of that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

from ohmloom.errors import MappingError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network
from ohmloom.sim.agreement import agreement
from ohmloom.sim.arena import Arena
from ohmloom.sim.figures import FAIL, Figure
from ohmloom.sim.sampling import sample_dies, start_key
from ohmloom.sim.statistics import Success
from ohmloom.sim.verdict import study_figures, study_verdict
from ohmloom.sim.work import Progress, Work

DIES = 50  # of a corner, at most
HOT = 358.15  # K
SLOW_WIRES = 2.46 / 1.06  # a segment at 22 nm over one at 40 nm, NeuroSim's wire table
SIGMAS = 3.0
# ReRamSB of aihwkit's presets (dw_min_std, dw_min_dtod); read noise as in CrossSim's parameters.
NOISY = {"nonidealities.cycle_to_cycle": 3.75, "nonidealities.event_charge": 0.3, "nonidealities.read_noise": 0.01}
# One cell in ten, as MNSIM 2.0 divides them (Device_SAF = 9, 1).
FAULTY = {"nonidealities.stuck_off": 0.09, "nonidealities.stuck_on": 0.01}


def _slow(hardware: Hardware) -> Hardware:
    wires = {
        f"wires.{name}": SLOW_WIRES * getattr(hardware.wires, name).value
        for name in ("r_row", "r_column")
        if getattr(hardware.wires, name).value > 0.0
    }
    spread = hardware.nonidealities.threshold
    threshold = hardware.drive.threshold.value * (1.0 + SIGMAS * (0.0 if spread is None else spread.value))
    values = wires | {"drive.threshold": threshold}
    if hardware.environment is not None:
        values["environment.temperature"] = max(HOT, hardware.environment.temperature.value)
    return hardware.with_values(values)


def _noisy(hardware: Hardware) -> Hardware:
    return hardware.with_values(NOISY)


def _faulty(hardware: Hardware) -> Hardware:
    return hardware.with_values(FAULTY)


def _worst(hardware: Hardware) -> Hardware:
    return _slow(_noisy(_faulty(hardware)))


CORNERS: MappingProxyType[str, tuple[str, Callable[[Hardware], Hardware]]] = MappingProxyType({
    "slow": ("wires of the 22 nm node (2.3 times the resistance of 40 nm), every threshold three sigma higher, 85 C "
             "where the spec has an environment", _slow),
    "noisy": ("375 % from event to event and 30 % from device to device, as aihwkit's ReRamSB preset; read noise 1 %",
              _noisy),
    "faulty": ("one cell in ten faulty, 9 % stuck off and 1 % on, as in MNSIM; repaired on the spec's spare lines",
               _faulty),
    "worst": ("slow, noisy and faulty at once", _worst),
})  # fmt: skip


def corner(name: str, description: str, figures: tuple[Figure, ...], success: Success | None, verdict: str) -> Any:
    """One corner as plain values."""
    return {"name": name, "description": description, "success": None if success is None else asdict(success),
            "figures": [asdict(figure) for figure in figures], "verdict": verdict}  # fmt: skip


def run_corners(
    network: Network,
    hardware: Hardware,
    arena: Arena,
    *,
    dies: int,
    seed: int,
    work: Work,
    progress: Progress | None = None,
) -> tuple[dict[str, Any], ...]:
    """Figures, success and verdict at each corner but the typical one, on the starts and draws of the typical study.

    A corner at which the network cannot be placed FAILs, with the reason in its description.
    """
    found = []
    for k, (name, (description, change)) in enumerate(CORNERS.items()):
        try:
            changed = change(hardware)
            plan = place(network, changed)
        except MappingError as error:
            found.append(corner(name, f"{description}; cannot be built: {error}", (), None, FAIL))
        else:
            check = agreement(network, changed, arena=arena, die=plan.nominal(), trial_key=start_key(seed, 0))
            sampled = sample_dies(plan, arena, dies=min(dies, DIES), seed=seed, work=work)
            figures = study_figures(plan, check, sampled, seed=seed)
            found.append(corner(name, description, figures, sampled.success, study_verdict(figures, {})[0]))
        if progress is not None:
            progress(k + 1, len(CORNERS))
    return tuple(found)
