"""Choose a champion per system from evolution runs, by success on fresh starts that evolution never saw.

Run: python examples/champions/choose.py --out examples/champions RUN...

Every network of every final population is tried on fresh starts, the better ones on more: 40 starts for all, 160 more
for the best 40, 800 more for the best 8. The best of these is tried on 1000 further starts, and only these are
reported. Writes <system>.net.json and champions.csv; the same runs give the same files. Needs the run folders of
`ohmloom evolve` (the commands stand in champions.csv).
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import multiprocessing
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from ohmloom._files import write_atomic
from ohmloom.neurocontroller import Network
from ohmloom.sim.evolution import EvolutionSettings
from ohmloom.sim.population import PopulationState, run_starts

ROUNDS = ((40, 40), (160, 8), (800, 1))  # starts more, networks kept
TEST_STARTS = 1000
SCREEN_STREAM, TEST_STREAM = 11, 12  # evolution's own streams have keys of two numbers
SEED = 2012


def keys(stream: int, first: int, count: int) -> list[int]:
    """Trial keys number `first` to `first + count` of a stream."""
    words = np.random.SeedSequence(SEED, spawn_key=(stream,)).generate_state(first + count, np.uint64)
    return [int(word) for word in words[first:]]


def candidates(run: Path) -> tuple[EvolutionSettings, list[tuple[int, int, Network]]]:
    """Settings of a run, and (repeat, birth, network) of all final populations."""
    settings = EvolutionSettings.model_validate(json.loads((run / "run.json").read_text())["settings"])
    found = []
    for repeat in range(settings.repeats):
        saved = json.loads((run / "populations" / f"{settings.system}_{repeat}.json").read_text())
        population = PopulationState(settings.arena(), np.random.default_rng(0), starts=1, reevaluate=False)
        population.restore(saved["population"], settings.system, settings.readings)
        found += [(repeat, individual.birth, individual.network) for individual in population.individuals]
    return settings, found


def command(settings: EvolutionSettings) -> str:
    """The command that made a run."""
    words = f"ohmloom evolve --system {settings.system} --repeats {settings.repeats}"
    words += f" --generations {settings.generations} --seed {settings.seed} --starts {settings.starts}"
    words += " --reevaluate" if settings.reevaluate else ""
    return words + f" --out runs/{settings.system}-{settings.seed}"


def choose(runs: list[Path], out: Path) -> dict[str, object]:
    """Screen the networks of one system's runs, test the best, write it; its row of the table."""
    entries, commands = [], []
    for run in runs:
        settings, found = candidates(run)
        entries += [(settings, *entry) for entry in found]
        commands.append(command(settings))
    system = entries[0][0].system
    solved, tried = np.zeros(len(entries)), 0
    alive = list(range(len(entries)))
    for starts, kept in ROUNDS:
        batch = keys(SCREEN_STREAM, tried, starts)
        for k in alive:
            solved[k] += run_starts(entries[k][3], entries[k][0].arena(), batch)[1]
        tried += starts
        alive = sorted(alive, key=lambda k: (-solved[k], k))[:kept]
    settings, repeat, birth, network = entries[alive[0]]
    fitness, reached = run_starts(network, settings.arena(), keys(TEST_STREAM, 0, TEST_STARTS))
    interval = binomtest(reached, TEST_STARTS).proportion_ci(method="wilson")
    provenance = {
        "command": command(settings), "seed": settings.seed, "repeat": repeat, "birth": birth,
        "generation": settings.generations, "task": settings.task, "starts": settings.starts,
        "trial_key": keys(TEST_STREAM, 0, 1)[0], "fitness": float(fitness[0]),
        "fresh_starts": TEST_STARTS, "fresh_starts_solved": reached, "mean_fitness": float(fitness.mean()),
    }  # fmt: skip
    network.replace(name=system, provenance=provenance).save(out / f"{system}.net.json")
    return {
        "system": system, "runs": " ; ".join(commands), "networks_screened": len(entries),
        "screening_starts": tried, "screening_success": solved[alive[0]] / tried, "test_starts": TEST_STARTS,
        "test_success": reached / TEST_STARTS, "test_low": round(interval.low, 4),
        "test_high": round(interval.high, 4), "mean_fitness": round(float(fitness.mean()), 1),
        "hidden": len(network.hidden), "synapses": len(network.synapses),
    }  # fmt: skip


def main() -> None:
    """Screen, test, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=1, help="processes; they do not change the result")
    options = parser.parse_args()
    systems: dict[str, list[Path]] = defaultdict(list)
    for run in options.runs:
        systems[candidates(run)[0].system].append(run)
    rows = []
    with ProcessPoolExecutor(options.workers, multiprocessing.get_context("spawn")) as pool:
        for row in pool.map(choose, systems.values(), [options.out] * len(systems)):
            rows.append(row)
            print(f"{row['system']}: {row['test_success']:.1%} of {TEST_STARTS} fresh starts, "
                  f"best of {row['networks_screened']} networks", flush=True)  # fmt: skip
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(options.out / "champions.csv", buffer.getvalue())


if __name__ == "__main__":
    main()
