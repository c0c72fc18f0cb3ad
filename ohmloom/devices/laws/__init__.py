"""Device laws, one file each. A new law is a file here and a line in `LAWS`."""

from __future__ import annotations

from ohmloom.devices.laws import (
    hp_biolek,
    hp_joglekar,
    hp_linear,
    hp_prodromakis,
    linear,
    mirror_threshold,
    peo_pani_mirror,
    peo_pani_redox,
    pickett,
    tio2_threshold,
    vteam,
    yakopcic,
)
from ohmloom.devices.laws._law import Law, Parameter

__all__ = ["LAWS", "Law", "Parameter"]

# The order is the numbering of the compiled kernels.
LAWS: dict[str, Law] = {
    "hp_linear": hp_linear.LAW,
    "linear": linear.LAW,
    "peo_pani_mirror": peo_pani_mirror.LAW,
    "hp_joglekar": hp_joglekar.LAW,
    "hp_biolek": hp_biolek.LAW,
    "hp_prodromakis": hp_prodromakis.LAW,
    "tio2_threshold": tio2_threshold.LAW,
    "mirror_threshold": mirror_threshold.LAW,
    "peo_pani_redox": peo_pani_redox.LAW,
    "vteam": vteam.LAW,
    "yakopcic": yakopcic.LAW,
    "pickett": pickett.LAW,
}
