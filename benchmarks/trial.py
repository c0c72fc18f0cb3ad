"""Speed of the compiled closed-loop trial against hand-written C (``trial.c``, -O3), both in this process.

Run: python benchmarks/trial.py [--networks 40]. First compares output spikes, events, path end and fitness of every
trial exactly; then prints CPU time per step of both and their ratio, median over rounds in turn.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.neurocontroller.kinds import PLASTIC_KINDS
from ohmloom.neurocontroller.wiring import MASK_LIMIT
from ohmloom.sim import Arena, run_trial
from ohmloom.sim.trial import trial_fitness

LEVELS, KINDS = 2048, len(PLASTIC_KINDS)


class Net(ctypes.Structure):
    _fields_ = (
        ("neurons", ctypes.c_int64),
        ("direct", ctypes.c_uint64 * MASK_LIMIT),
        ("descending", ctypes.c_uint64 * MASK_LIMIT),
        ("plastic", ctypes.c_uint64 * MASK_LIMIT),
        ("sign", ctypes.c_double * MASK_LIMIT),
        ("kind", (ctypes.c_int8 * MASK_LIMIT) * MASK_LIMIT),
        ("first_weight", (ctypes.c_double * MASK_LIMIT) * MASK_LIMIT),
        ("first_level", (ctypes.c_int16 * MASK_LIMIT) * MASK_LIMIT),
        ("table", (ctypes.c_double * LEVELS) * KINDS),
        ("up", (ctypes.c_int16 * LEVELS) * KINDS),
        ("down", (ctypes.c_int16 * LEVELS) * KINDS),
    )


class Result(ctypes.Structure):
    _fields_ = (
        ("fitness", ctypes.c_double),
        ("x", ctypes.c_double),
        ("y", ctypes.c_double),
        ("heading", ctypes.c_double),
        ("st", ctypes.c_int64),
        ("bumps", ctypes.c_int64),
        ("executed", ctypes.c_int64),
        ("events", ctypes.c_int64),
        ("spike_hash", ctypes.c_int64),
    )


def fill(target, values) -> None:
    """Copy a numpy array into the leading corner of a ctypes array."""
    view = np.ctypeslib.as_array(target)
    view[tuple(slice(length) for length in values.shape)] = values


def c_network(controller: SpikingController) -> Net:
    """The C program's form of a network."""
    wiring = controller.kernel_arguments[0]
    net = Net(neurons=wiring.neurons)
    for name in ("direct", "descending", "plastic", "sign", "kind", "first_weight", "first_level"):
        fill(getattr(net, name), getattr(wiring, name))
    fill(net.table, wiring.tables)
    fill(net.up, wiring.up)
    fill(net.down, wiring.down)
    return net


def build(folder: str) -> ctypes.CDLL:
    """Compile trial.c; its own compiler flags are part of the comparison."""
    compiler = os.environ.get("CC") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        sys.exit("benchmarks/trial.py: expected a C compiler, got none. Install gcc or set CC.")
    library = Path(folder) / "trial.so"
    flags = ["-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(Path(__file__).with_name("trial.c")), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def main() -> None:
    """Compare, then time in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--networks", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    arena, rng = Arena.paper(), np.random.default_rng(1)
    controllers = [SpikingController(Network.random(system="HET", rng=rng)) for _ in range(options.networks)]
    keys = [int(rng.integers(2**63)) for _ in controllers]
    bearings = np.ascontiguousarray(arena.sensor_bearings)
    with tempfile.TemporaryDirectory() as folder:
        library = build(folder)
        nets = [c_network(controller) for controller in controllers]
        result = Result()

        def run_c(net: Net, key: int) -> None:
            library.run_trial(ctypes.byref(net), ctypes.c_uint64(key), bearings.ctypes.data_as(ctypes.c_void_p),
                              ctypes.c_int64(arena.max_timesteps), ctypes.byref(result))  # fmt: skip

        steps = 0
        for controller, net, key in zip(controllers, nets, keys, strict=True):
            run_c(net, key)
            trial = run_trial(controller, arena, trial_key=key)
            spike_hash = 0
            for left, right in trial.output_spikes.tolist():
                spike_hash = (spike_hash * 31 + left * 22 + right) % 2**64
            ours = (trial.fitness, *trial.path[-1], trial.timesteps, trial.bumps, len(trial.actions),
                    sum(controller.events), spike_hash)  # fmt: skip
            theirs = (result.fitness, result.x, result.y, result.heading, result.st, result.bumps, result.executed,
                      result.events, result.spike_hash % 2**64)  # fmt: skip
            if not all(a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(ours, theirs, strict=True)):
                sys.exit(f"different: ohmloom {ours}, C {theirs}")
            steps += 21 * len(trial.actions)
        print(f"{len(controllers)} HET trials, {steps} steps: equal in every spike count, event, pose and fitness")

        times: dict[str, list[float]] = {"ohmloom": [], "C": []}
        for _ in range(options.rounds):
            start = time.process_time()
            for controller, key in zip(controllers, keys, strict=True):
                trial_fitness(controller, arena, key)
            middle = time.process_time()
            for net, key in zip(nets, keys, strict=True):
                run_c(net, key)
            end = time.process_time()
            times["ohmloom"].append((middle - start) / steps * 1e9)
            times["C"].append((end - middle) / steps * 1e9)
    ratios = [a / b for a, b in zip(times["ohmloom"], times["C"], strict=True)]
    for name, values in times.items():
        print(f"{name:8} {statistics.median(values):7.1f} ns per step (min {min(values):.1f}, max {max(values):.1f})")
    print(f"ratio    {statistics.median(ratios):7.2f} (min {min(ratios):.2f}, max {max(ratios):.2f})")


if __name__ == "__main__":
    main()
