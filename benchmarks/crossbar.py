"""Reads of crossbars with wire resistance beside badcrossbar's, in one process: CPU time, error, memory, growth.

    python benchmarks/crossbar.py [--sizes 16,64,128,256] [--rounds 3]

Needs badcrossbar (`pip install '.[bench]'`, and Debian's libcairo2-dev to build its drawing library). Set
OMP_NUM_THREADS=1 for one thread. Errors are the largest difference of a current over the largest current.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ohmloom.circuits import Crossbar

WIRES = (1.0, 10.0)  # ohm per segment
G_LOW, G_HIGH = 1e-6, 1e-4  # S
MEMORY_SIZE, GROWTH_SIZES, LARGEST = 512, (64, 128, 256, 512), 1024
BATCH, BATCH_SIZE, BATCH_SAMPLE = 1000, 16, 50


def make(n: int, r: float, lead: tuple[int, ...] = ()) -> tuple[Crossbar, np.ndarray]:
    rng = np.random.default_rng(n)
    g = rng.uniform(G_LOW, G_HIGH, (*lead, n, n))
    return Crossbar(conductance=g, r_row=r, r_column=r), rng.uniform(0.0, 1.0, n)


def cpu(function, rounds: int) -> tuple[float, object]:
    """Least CPU time of a few runs, and the last result."""
    best = np.inf
    for _ in range(rounds):
        start = time.process_time()
        found = function()
        best = min(best, time.process_time() - start)
    return best, found


def peer(array: Crossbar, v: np.ndarray) -> np.ndarray:
    import badcrossbar

    solution = badcrossbar.compute(v[:, None], 1.0 / array.conductance, r_i_word_line=array.r_row,
                                   r_i_bit_line=array.r_column)  # fmt: skip
    return np.ravel(solution.currents.output)


def reads(sizes: list[int], rounds: int) -> None:
    print(f"{'one read':>12}{'ohm':>5}{'ohmloom':>12}{'badcrossbar':>13}{'ratio':>7}{'error':>9}{'iterations':>12}")
    for n in sizes:
        for r in WIRES:
            array, v = make(n, r)
            ours, read = cpu(lambda array=array, v=v: array.read(v), 3 * rounds)
            theirs, wanted = cpu(lambda array=array, v=v: peer(array, v), 1 if n > 128 else rounds)
            error = np.abs(read.current - wanted).max() / np.abs(wanted).max()
            print(f"{n:8} x {n:<3}{r:3.0f}{1e3 * ours:10.2f}ms{1e3 * theirs:11.1f}ms{theirs / ours:6.0f}x{error:9.0e}"
                  f"{read.iterations:12}", flush=True)  # fmt: skip


def batch(rounds: int) -> None:
    array, v = make(BATCH_SIZE, 10.0, (BATCH,))
    ours, read = cpu(lambda: array.read(v), rounds)
    singles = [array.replace(conductance=g) for g in array.conductance[:BATCH_SAMPLE]]
    theirs, wanted = cpu(lambda: np.array([peer(one, v) for one in singles]), 1)
    theirs *= BATCH / BATCH_SAMPLE
    error = np.abs(read.current[:BATCH_SAMPLE] - wanted).max() / np.abs(wanted).max()
    print(f"\n{BATCH} reads of {BATCH_SIZE} x {BATCH_SIZE}: {1e3 * ours:.1f} ms against {theirs:.2f} s in a loop "
          f"(scaled from {BATCH_SAMPLE}), {theirs / ours:.0f}x, error {error:.0e}", flush=True)  # fmt: skip


def operators(sizes: list[int], rounds: int) -> None:
    import badcrossbar

    print(f"\n{'operator':>12}{'ohmloom':>12}{'badcrossbar':>13}{'ratio':>7}{'error':>9}")
    for n in [size for size in sizes if size <= 128]:
        array, _ = make(n, 10.0)
        ours, found = cpu(array.operator, rounds)
        theirs, solution = cpu(lambda array=array, n=n: badcrossbar.compute(
            np.eye(n), 1.0 / array.conductance, r_i_word_line=10.0, r_i_bit_line=10.0), 1)  # fmt: skip
        wanted = solution.currents.output
        error = np.abs(found - wanted).max() / np.abs(wanted).max()
        print(f"{n:8} x {n:<3}{1e3 * ours:9.1f}ms{1e3 * theirs:11.1f}ms{theirs / ours:6.0f}x{error:9.0e}", flush=True)


def growth(rounds: int) -> None:
    times = []
    for n in (*GROWTH_SIZES, LARGEST):
        array, v = make(n, 10.0)
        times.append(cpu(lambda array=array, v=v: array.read(v), rounds if n < LARGEST else 1)[0])
    *times, largest = times
    exponent = np.polyfit(np.log(GROWTH_SIZES), np.log(times), 1)[0]
    print(f"\ngrowth of one read at 10 ohm, N = {GROWTH_SIZES[0]} to {GROWTH_SIZES[-1]}: exponent {exponent:.2f}; "
          f"N = {LARGEST}: {largest:.2f} s", flush=True)  # fmt: skip


def memory() -> None:
    """Growth of the resident memory by one read, each in a process of its own."""
    grown = {}
    for who in ("ohmloom", "badcrossbar"):
        done = subprocess.run([sys.executable, __file__, "--memory", who], capture_output=True, text=True, check=True)
        grown[who] = float(done.stdout)
    print(f"memory of one read, N = {MEMORY_SIZE}: {grown['ohmloom']:.0f} MB against {grown['badcrossbar']:.0f} MB, "
          f"{grown['badcrossbar'] / grown['ohmloom']:.0f}x")  # fmt: skip


def grow(who: str) -> None:
    """Print by how many MB the peak grows."""
    logging.disable(logging.INFO)
    small, array = make(8, 10.0), make(MEMORY_SIZE, 10.0)
    read = peer if who == "badcrossbar" else (lambda crossbar, v: crossbar.read(v))
    read(*small)
    # What is resident now, not the peak of the imports: the read must go beyond that to be seen at all.
    before = status("VmRSS")
    read(*array)
    print(status("VmHWM") - before)


def status(field: str) -> float:
    """A figure of this process in MB; a child's getrusage would begin with its parent's peak."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(field)) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="16,64,128,256")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--memory", choices=("ohmloom", "badcrossbar"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.memory:
        grow(chosen.memory)
        return
    logging.disable(logging.INFO)
    sizes = [int(size) for size in chosen.sizes.split(",")]
    reads(sizes, chosen.rounds)
    batch(chosen.rounds)
    operators(sizes, chosen.rounds)
    growth(chosen.rounds)
    memory()


if __name__ == "__main__":
    main()
