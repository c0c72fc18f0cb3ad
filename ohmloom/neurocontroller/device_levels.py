"""Stub until merged."""
from __future__ import annotations
from ohmloom.devices import Device


def state_of_weight(device: Device, weight: float, *, has_reference: bool) -> float:
    ratio = float(device.conductance(0.0) / device.conductance(1.0))
    read = ratio + weight * (1.0 - ratio) if has_reference else weight
    return float(device.state_at_weight(min(max(read, ratio), 1.0)))
