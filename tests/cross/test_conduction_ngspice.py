"""Reads of devices that are not ohmic against ngspice, each device a behavioural source of the same formula."""

import re

import numpy as np
import pytest

from ohmloom.circuits import Crossbar, SelectorConduction, SinhConduction, crossbar_netlist, run_ngspice

SINH, SELECTOR = SinhConduction(scale=0.25), SelectorConduction(threshold=0.4, width=0.05, leak=1e-3)
FORMULAS = {
    SINH: "{g}*0.25*sinh(({v})/0.25)",
    SELECTOR: "{g}*({v})*(0.001+0.999*0.5*(1+tanh(0.5*(abs({v})-0.4)/0.05)))",
}


@pytest.fixture(autouse=True)
def ngspice(need_tool):
    return need_tool("devices that are not ohmic are not compared", "ngspice")


@pytest.mark.parametrize("conduction", FORMULAS)
def test_currents_and_potentials_equal_ngspices(conduction):
    rng = np.random.default_rng(4)
    g, v = rng.uniform(1e-4, 5e-3, (4, 3)), np.array([1.0, -0.6, 0.0, 0.8])
    array = Crossbar(conductance=g, r_row=5.0, r_column=3.0, r_driver=10.0, r_sense=2.0, conduction=conduction)
    deck = crossbar_netlist(array.replace(conduction=None), v).to_spice(relative_tolerance=1e-9)
    lines = []
    for line in deck.splitlines():
        found = re.match(r"\S*D_(\d+)_(\d+) (\S+) (\S+) ", line)
        if found:
            i, j, p, n = found.groups()
            formula = FORMULAS[conduction].format(g=repr(float(g[int(i), int(j)])), v=f"v({p})-v({n})")
            line = f"BD_{i}_{j} {p} {n} i={formula}"
        lines.append(line)
    assert sum(line.startswith("BD_") for line in lines) == g.size
    point, read = run_ngspice("\n".join(lines)), array.read(v)
    # ngspice ends its Newton iteration at reltol 1e-9.
    for (i, j), u in np.ndenumerate(read.v_row):
        assert point.v[f"row_{i}_{j}"][0] == pytest.approx(u, abs=1e-8)
        assert point.v[f"column_{i}_{j}"][0] == pytest.approx(read.v_column[i, j], abs=1e-8)
    sensed = [point.v[f"column_3_{j}"][0] / 5.0 for j in range(3)]
    assert np.abs(read.current - sensed).max() <= 1e-7 * np.abs(read.current).max()
