"""CPU time of one evolution run of the paper's size: 100 networks, then generations of two offspring, one start each.

Run: python benchmarks/evolution.py [--system HET] [--generations 1000] [--seed 1]. Compiles before the clock starts.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from ohmloom.sim import EvolutionSettings, evolve


def main() -> None:
    """Run once to compile, then once with the clock."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--system", default="HET")
    parser.add_argument("--generations", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        evolve(EvolutionSettings(system=options.system, generations=0, population=3), out=Path(folder) / "compile")
        settings = EvolutionSettings(system=options.system, generations=options.generations, seed=options.seed)
        cpu, wall = time.process_time(), time.perf_counter()
        outcome = evolve(settings, out=Path(folder) / "run").repeats[0]
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    trials = settings.population + 2 * settings.generations
    print(
        f"{options.system}: {trials} trials in {cpu:.1f} s CPU ({wall:.1f} s wall), {trials / cpu:.0f} trials per CPU s"
    )
    print(f"best fitness {outcome.best_fitness:.0f}, goal first reached in generation {outcome.first_solved}")


if __name__ == "__main__":
    main()
