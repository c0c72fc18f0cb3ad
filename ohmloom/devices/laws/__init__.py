"""Device laws, one file each. A new law is a file here and a line in `LAWS`."""

from __future__ import annotations

from ohmloom.devices.laws import hp_linear, linear, peo_pani_mirror
from ohmloom.devices.laws._law import Law, Parameter

__all__ = ["LAWS", "Law", "Parameter"]

LAWS: dict[str, Law] = {
    "hp_linear": hp_linear.LAW,
    "linear": linear.LAW,
    "peo_pani_mirror": peo_pani_mirror.LAW,
}
