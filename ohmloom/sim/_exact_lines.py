"""Entries of the exact box about lines: wires against the laws that they must follow, taps against delays."""

from __future__ import annotations

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.circuits import Crossbar
from ohmloom.sim.exact_case import Case

CURRENT_TOLERANCE = 1e-12  # of the largest current
SLOPE_TOLERANCE = 0.05  # of 1
SKEWED_STEPS, SKEW_SEED = 200, 12


def wire_limit(case: Case) -> bool | str:
    """Read errors of the largest tile vanish in proportion to the resistance of the wires."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    # Resistances at which the error is small but far above rounding.
    unit = 1e-6 / float(g.max())
    exact = g.sum(axis=0)
    errors = []
    for r in (unit, 10.0 * unit):
        read = Crossbar(conductance=g, r_row=r, r_column=r).read(np.ones(g.shape[0])).current
        errors.append(float(np.abs(read - exact).max() / exact.max()))
    return bool(abs(np.log10(errors[1] / errors[0]) - 1.0) <= SLOPE_TOLERANCE)


def ladder(case: Case) -> bool | str:
    """One word line with its devices draws the current of the continued fraction."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    row, r = g[int(g.sum(axis=1).argmax())], _segment(case, g)
    # A device into virtual ground through one segment of its column.
    inward = 0.0
    for conductance in row[::-1]:
        branch = conductance / (1.0 + r * conductance)
        inward = (branch + inward) / (1.0 + r * (branch + inward))
    current = Crossbar(conductance=row[None, :], r_row=r, r_column=r).read(np.ones(1)).current.sum()
    return bool(abs(current - inward) <= CURRENT_TOLERANCE * inward)


def column_serial_delay(case: Case) -> bool | str:
    """Columns read one after the other through taps see every spike after its delay, to the last bit."""
    from ohmloom.mapping._fabric import READ_FIELDS, READ_STATE, lateness, power_of_two
    from ohmloom.mapping._kernels import read_column

    synapses = case.network.synapses
    if not synapses:
        return "no synapse"
    rng, n = np.random.default_rng(SKEW_SEED), case.network.neurons
    spikes = (rng.random((SKEWED_STEPS, n)) < 0.3).astype(np.float64)
    order = sorted(range(len(synapses)), key=lambda k: (synapses[k].post, synapses[k].pre))
    reads = np.zeros(len(order), dtype=READ_FIELDS)
    state = np.zeros(len(order), dtype=READ_STATE)
    reads["sender"] = [synapses[k].pre for k in order]
    reads["tap"] = [case.network.delay(synapses[k]) for k in order]
    reads["late"] = lateness(reads["tap"], reads["sender"], n)
    # Dyadic weights add without rounding, so that the order of a sum can hide nothing.
    state["weight"] = rng.integers(-64, 65, len(order)) / 64.0
    posts = np.array([synapses[k].post for k in order])
    starts = np.searchsorted(posts, np.arange(n + 1)).astype(np.uint64)
    slots = power_of_two(int(reads["tap"].max()) + 1)
    ring = np.zeros((slots, power_of_two(n)))
    flat = ring.reshape(-1)
    for now in range(SKEWED_STEPS):
        begin = np.uint64((now + slots) * ring.shape[1])
        for j in range(n):
            late = now - reads["tap"]
            arrived = np.where(late >= 0, spikes[np.maximum(late, 0), reads["sender"]], 0.0)
            if read_column(starts, reads, state, flat, j, begin)[0] != (arrived * state["weight"])[posts == j].sum():
                return False
        ring[now % slots, :n] = spikes[now]
    return True


def kirchhoff(case: Case) -> bool | str:
    """All that enters the word lines of the largest tile leaves its bit lines."""
    g = _largest_grid(case)
    if g is None:
        return "no synapse"
    r = _segment(case, g)
    array = Crossbar(conductance=g, r_row=r, r_column=r)
    v = np.linspace(1.0, -0.5, g.shape[0])
    read = array.read(v)
    entering = ((v[:, None] - read.v_row[:, :1]) / r).sum()
    # Of what the devices carry: with voltages of both signs, the lines' currents all but cancel in some networks.
    scale = np.abs((read.v_row - read.v_column) * g).sum()
    return bool(abs(entering - read.current.sum()) <= CURRENT_TOLERANCE * scale * max(1.0, 1.0 / (r * g.max())))


def _largest_grid(case: Case) -> FloatArray | None:
    """Conductances of the tile with most devices, axes (word_line, bit_line)."""
    plan = case.plan
    if not plan.crosspoints:
        return None
    counts = np.bincount([point.tile for point in plan.crosspoints])
    t = int(counts.argmax())
    g = np.zeros((len(plan.tiles[t].rows), len(plan.tiles[t].columns)))
    for point in plan.crosspoints:
        if point.tile == t:
            g[point.row, point.column] = point.conductance
    return g


def _segment(case: Case, g: FloatArray) -> float:
    """Ohm per segment of the spec, or a hundredth of the least resistance of its devices where it has none."""
    return case.hardware.wires.r_row.value or 0.01 / float(g.max())
