"""Several studies side by side: which network on which hardware is nearest to working."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ohmloom.errors import MappingError
from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import Network
from ohmloom.sim.feasibility import Feasibility
from ohmloom.sim.figures import FAIL, MARGINAL, PASS

CANNOT_BE_BUILT = "CANNOT BE BUILT"
ORDER = (PASS, MARGINAL, FAIL, CANNOT_BE_BUILT)


def why_not_built(network: Network, hardware: Hardware) -> str | None:
    """Why a network cannot be placed on a spec, in a few words; None if it can."""
    missing = sorted({synapse.kind for synapse in network.synapses} - set(hardware.cards))
    if missing:
        return f"no card for {', '.join(missing)}"
    try:
        place(network, hardware)
    except MappingError as error:
        return error.problems[0]
    return None


def not_built(network: Network, hardware: Hardware, reason: str) -> dict[str, Any]:
    """What stands for a study of a pair that cannot be built."""
    return {"network": network.name, "hardware": hardware.name, "verdict": CANNOT_BE_BUILT, "reasons": [reason]}


def rank_studies(found: Sequence[Feasibility | Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Best first: by verdict, then by success on hardware, then by how many figures fail and by how much.

    Parameters
    ----------
    found
        Studies, and what `not_built` gave for pairs without one.

    Returns
    -------
    list of dict
        ``rank`` from 1 (None if it cannot be built), ``network``, ``hardware``, ``verdict``, ``success`` and ``ideal``
        (None without dies), ``failing`` (names of figures), ``worst_margin`` (of those), ``reason``.
    """
    rows = [_row(one) for one in found]
    rows.sort(key=lambda row: (
        ORDER.index(row["verdict"]), -(row["success"] or 0.0), len(row["failing"]), -(row["worst_margin"] or 0.0),
    ))  # fmt: skip
    ranks = [None if row["verdict"] == CANNOT_BE_BUILT else k + 1 for k, row in enumerate(rows)]
    return [{"rank": rank, **row} for rank, row in zip(ranks, rows, strict=True)]


def _row(one: Feasibility | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(one, Mapping):
        return {"network": one["network"], "hardware": one["hardware"], "verdict": one["verdict"], "success": None,
                "ideal": None, "failing": [], "worst_margin": None, "reason": one["reasons"][0]}  # fmt: skip
    failing = [figure for figure in one.figures if figure.status == FAIL]
    margins = [figure.margin for figure in failing if figure.margin is not None]
    return {
        "network": one.provenance["network"], "hardware": one.provenance["hardware"], "verdict": one.verdict,
        "success": None if one.success is None else one.success.hardware,
        "ideal": None if one.success is None else one.success.ideal, "failing": [figure.name for figure in failing],
        "worst_margin": min(margins, default=None), "reason": one.reasons[0] if one.reasons else "",
    }  # fmt: skip
