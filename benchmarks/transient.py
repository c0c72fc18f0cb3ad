"""Memristive crossbars through time beside ngspice on the exported deck, and a trial's worth of pulses.

Run with one thread: ``OPENBLAS_NUM_THREADS=1 python benchmarks/transient.py``. ngspice's time is that of its process,
start and output included; the deck is written before.
"""

from __future__ import annotations

import resource
import time

import numpy as np

from ohmloom.circuits import MemristorCrossbar, PulseTrain, memristor_netlist, run_ngspice
from ohmloom.devices import Device

DEVICE = Device.load("hp_tio2_10k")
# At 1 V, a thousandth of the state's whole range at W = 1: a pulse of the size of an STDP event.
PULSE = DEVICE.flux(1.0) / 100.0
CASES = [(16, 1.0, 10), (16, 10.0, 10), (32, 10.0, 2)]
REPEATS = 5
TIMESTEPS, STEPS = 100, 21


def case(n: int, r: float, pulses: int) -> tuple[MemristorCrossbar, PulseTrain]:
    """An array of n x n with random states and pulses, three different delays."""
    rng = np.random.default_rng(n)
    array = MemristorCrossbar(devices=DEVICE, s=rng.uniform(0.2, 0.8, (n, n)), r_row=r, r_column=r)
    train = PulseTrain.rectangular(
        rng.uniform(-1.0, 1.0, (pulses, n)), columns=n, width=0.8 * PULSE, edge=0.01 * PULSE, period=1.5 * PULSE,
        delays=np.arange(n) % 3 * 0.1 * PULSE,
    )  # fmt: skip
    return array, train


def refined(array: MemristorCrossbar, train: PulseTrain) -> np.ndarray:
    """The final states with every segment cut into eight, at the tightest tolerance."""
    t = np.unique(np.concatenate([train.t[:-1] + k / 8 * np.diff(train.t) for k in range(8)] + [train.t]))
    rows, columns = (np.column_stack([np.interp(t, train.t, x) for x in v.T]) for v in (train.v_row, train.v_column))
    return array.simulate(t, rows, columns, tolerance=1e-13).s[-1]


def own_time(array: MemristorCrossbar, train: PulseTrain) -> tuple[float, np.ndarray]:
    """Best CPU time of several runs, and the final states."""
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        trace = array.simulate(train.t, train.v_row, train.v_column)
        best = min(best, time.process_time() - start)
    return best, trace.s[-1]


def main() -> None:
    """Print both tables."""
    own_time(*case(2, 1.0, 1))  # compile
    print("          array  ohm  pulses    ohmloom    ngspice  ratio  error  ngspice's error")
    for n, r, pulses in CASES:
        array, train = case(n, r, pulses)
        spent, found = own_time(array, train)
        netlist = memristor_netlist(array, train)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        theirs = run_ngspice(netlist, relative_tolerance=1e-6, timeout=3000.0)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        peer = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        exact = refined(array, train)
        s = np.array([[theirs.s[f"D_{i}_{j}"][-1] for j in range(n)] for i in range(n)])
        print(f"{n:>8} x {n:<4} {r:>4g} {pulses:>7} {1e3 * spent:>8.1f}ms {peer:>9.2f}s {peer / spent:>5.0f}x "
              f"{np.abs(found - exact).max():>6.0e} {np.abs(s - exact).max():>8.0e}")  # fmt: skip
    trial()


def trial() -> None:
    """The pulses of 100 timesteps on a 15 x 11 array: in each step, every line at rest, at its head or at its tail."""
    rng = np.random.default_rng(0)
    m, n, pulses = 15, 11, TIMESTEPS * STEPS
    array = MemristorCrossbar(devices=DEVICE, s=rng.uniform(0.2, 0.8, (m, n)), r_row=1.0, r_column=1.0)
    rows, columns = (rng.choice([0.0, 0.0, -0.5, 0.5], (pulses, size)) for size in (m, n))
    width = DEVICE.flux(1.0) / 1000.0
    train = PulseTrain.rectangular(rows, columns=n, column_levels=columns, width=width, edge=0.01 * width,
                                   period=2.0 * width)  # fmt: skip
    spent, _ = own_time(array, train)
    print(f"\n15 x 11 at 1 ohm, {TIMESTEPS} timesteps of {STEPS} steps, a pulse each: {spent:.2f} s "
          f"({1e6 * spent / pulses:.0f} us per pulse)")  # fmt: skip


if __name__ == "__main__":
    main()
