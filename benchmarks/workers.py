"""Wall time of the same evolutions with one worker and with several, and of as many programs that share nothing.

Run: python benchmarks/workers.py [--workers 2] [--repeats 8] [--generations 200] [--rounds 3]. Prints the efficiency,
the time of one worker over N times that of N, and the same for N programs with a share of the repeats each: the most
that the machine gives. Compiles before the clock starts.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ohmloom.sim import EvolutionSettings, evolve
from ohmloom.sim.evolution import claim_evolution, run_repeat


def run(settings: EvolutionSettings, workers: int) -> None:
    """Evolve in a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        evolve(settings, out=Path(folder) / "run", workers=workers)


def run_share(settings: EvolutionSettings, share: range) -> None:
    """Some of the repeats."""
    with tempfile.TemporaryDirectory() as folder:
        claim_evolution(settings, Path(folder) / "run")
        for repeat in share:
            run_repeat(settings, Path(folder) / "run", repeat, lambda: False, lambda *_: None)


def run_apart(settings: EvolutionSettings, programs: int) -> None:
    """The same repeats, shared among processes of which none waits for another."""
    spawn = multiprocessing.get_context("spawn")
    shares = [range(k, settings.repeats, programs) for k in range(programs)]
    started = [spawn.Process(target=run_share, args=(settings, share)) for share in shares]
    for process in started:
        process.start()
    for process in started:
        process.join()
        if process.exitcode != 0:
            raise SystemExit(f"a program ended with {process.exitcode}: its time says nothing")


def seconds(function: Callable[[EvolutionSettings, int], None], settings: EvolutionSettings, workers: int) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    function(settings, workers)
    return time.perf_counter() - start


def main() -> None:
    """Run all three in turn, several times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=8)
    parser.add_argument("--generations", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    run(EvolutionSettings(system="HET", generations=0, population=3), 1)
    settings = EvolutionSettings(system="HET", repeats=options.repeats, generations=options.generations, seed=1)
    pooled, apart = [], []
    for _ in range(options.rounds):
        one, many = seconds(run, settings, 1), seconds(run, settings, options.workers)
        pooled.append(one / (options.workers * many))
        apart.append(one / (options.workers * seconds(run_apart, settings, options.workers)))
        print(f"1 worker {one:.1f} s, {options.workers} workers {many:.1f} s, efficiency {pooled[-1]:.2f}; "
              f"programs apart {apart[-1]:.2f}", flush=True)  # fmt: skip
    print(
        f"median efficiency {statistics.median(pooled):.2f}; programs that share nothing {statistics.median(apart):.2f}"
    )


if __name__ == "__main__":
    main()
