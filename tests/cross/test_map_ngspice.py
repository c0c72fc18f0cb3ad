"""Decks of a placed network in ngspice: the currents are those of the crossbar that the emulation solves."""

import numpy as np
import pytest

from ohmloom.circuits import run_ngspice
from ohmloom.mapping import Hardware, place, tile_crossbar, tile_deck
from ohmloom.mapping.grid import read_voltages
from ohmloom.neurocontroller import champion


@pytest.mark.parametrize(
    ("network", "spec", "array"),
    [
        ("HP", "hp_strukov", {}),
        ("GA", "hp_1t1r", {"spare_rows": 1, "spare_columns": 1}),
        ("HET", "het_mixed", {"signs": "differential_pair"}),
        ("LIN", "ideal", {"disabled": "present"}),
    ],
)
def test_ngspice_reads_the_currents_of_the_crossbar(need_tool, network, spec, array):
    need_tool("runs the decks of 'ohmloom map'", "ngspice")
    hardware = Hardware.load(spec)
    plan = place(champion(network), hardware.model_copy(update={"array": hardware.array.model_copy(update=array)}))
    for tile in range(len(plan.tiles)):
        wanted = tile_crossbar(plan, tile).read(read_voltages(plan, tile)).current
        trace = run_ngspice(tile_deck(plan, tile))
        found = [into_sense(tile_deck(plan, tile), trace, j) for j in range(len(wanted))]
        # ngspice solves resistors to rounding, but its answer has 15 digits of voltages of which a sense sees little.
        assert np.array(found) == pytest.approx(wanted, rel=1e-6, abs=1e-9 * np.abs(wanted).max())


def into_sense(deck, trace, column):
    """Current into a sense: through its resistor, or through the source that stands for one of no resistance."""
    (line,) = [line.split() for line in deck.splitlines() if line.split()[:1] in ([f"RS_{column}"], [f"VS_{column}"])]
    if line[0].startswith("V"):
        return trace.i[line[0].lower()][0]
    return trace.v[line[1]][0] / float(line[3])
