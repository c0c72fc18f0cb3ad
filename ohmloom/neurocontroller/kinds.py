"""The kinds of synapse: how a plastic weight follows from its charge, exactly, on an integer lattice.

The charge of the paper (R_on = 0.01, R_off = 1, beta = 100, q_max = 0.99, 1000 events from end to end) is
counted in units in which the start value, the event and q_max are all integers, so that weights are the same
bits everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

MEM_LIFETIME = 1000  # Section IX: events from one end of the range to the other
INITIAL_WEIGHT = 0.5  # Section VI-A: memristive synapses always start here


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Charge of one kind of plastic synapse, in lattice units.

    Attributes
    ----------
    start, event, top
        Charge at W = 0.5, change by one STDP event (eq. 12), largest charge; the smallest is 0.
    unit
        Lattice units per unit of the paper's normalised charge.
    weight
        Weight in [0, 1] from the lattice charge.
    """

    start: int
    event: int
    top: int
    unit: int
    weight: Callable[[int], float]

    def moved(self, charge: int, sign: int) -> int:
        """Charge after one event, positive or negative."""
        return min(max(charge + sign * self.event, 0), self.top)


def hp_weight(q: int) -> float:
    """W = R_on / M with eq. 7; `q` in 1/100000 of the paper's charge.

    >>> round(hp_weight(98000), 12), round(hp_weight(99000), 12)
    (0.5, 1.0)
    """
    return 0.01 / (1 - q / 100000)


def peo_pani_weight(q: int) -> float:
    """Eq. 9 read as the mirror image of HP; `q` in 1/5100000 of the paper's charge.

    >>> round(peo_pani_weight(49000), 12), peo_pani_weight(5049000)
    (0.5, 1.0)
    """
    return 1.01 - 0.01 / (0.01 + q / 5100000)


def linear_weight(q: int) -> float:
    """The linear resistor: one event moves W by 1/1000 (Section V-3)."""
    return q / 1000


def reads_with_reference(kind: str) -> bool:
    """Linear and constant kinds have W = (G - G_off)/(G_on - G_off); the memristive ones W = G/G_on."""
    return kind in ("linear", "constant")


def charge_levels(lattice: Lattice) -> list[int]:
    """All charges that events from the start value can reach, ends included, in ascending order."""
    charges = {*range(lattice.start % lattice.event, lattice.top + 1, lattice.event)}
    charges |= {*range(0, lattice.top + 1, lattice.event), lattice.top}
    return sorted(charges)


LATTICES = MappingProxyType(
    {
        "hp": Lattice(start=98000, event=99, top=99000, unit=100000, weight=hp_weight),
        "peo_pani": Lattice(start=49000, event=5049, top=5049000, unit=5100000, weight=peo_pani_weight),
        "linear": Lattice(start=500, event=1, top=1000, unit=1000, weight=linear_weight),
    }
)
PLASTIC_KINDS = tuple(LATTICES)
KINDS = (*PLASTIC_KINDS, "constant")
SYSTEMS = MappingProxyType(
    {
        "HP": ("hp",),
        "PEO": ("peo_pani",),
        "LIN": ("linear",),
        "GA": ("constant",),
        "HET": PLASTIC_KINDS,
    }
)
