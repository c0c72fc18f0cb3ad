"""CPU time of whole trials: a die without wires beside the discrete controller, and dies with wires.

Both run the same network from the same start, in turn, in one process with one thread; the table has the median ratio.

    python benchmarks/emulation.py [--rounds 7] [--timesteps 1000] [NETWORK ...]
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, SpikingController, champion
from ohmloom.sim import Arena, Controller, run_trial
from ohmloom.sim.exact_case import exact_variant


def seconds(controller: Controller, arena: Arena) -> float:
    """CPU time of one trial."""
    start = time.process_time()
    run_trial(controller, arena, trial_key=1)
    return time.process_time() - start


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--timesteps", type=int, default=1000)
    options.add_argument("networks", nargs="*")
    chosen = options.parse_args()
    arena = Arena(task="static", max_timesteps=chosen.timesteps)
    networks = {name: champion(name) for name in ("HET", "GA", "PEO", "HP", "LIN")}
    networks["HET at birth"] = Network.random(system="HET", rng=np.random.default_rng(1))
    print(f"{'network':14}{'hardware':24}{'timesteps':>10}{'events':>10}{'s per 1000':>12}{'to discrete':>13}")
    for name, network in networks.items():
        if chosen.networks and name not in chosen.networks:
            continue
        discrete = SpikingController(network)
        specs = {"het_mixed, no wires": exact_variant(Hardware.load("het_mixed"), "charge_metered")}
        specs["het_mixed, wires"] = Hardware.load("het_mixed")
        if name == "HP":
            specs |= {f"{spec}, wires": Hardware.load(spec) for spec in ("hp_1t1r", "hp_passive", "hp_strukov")}
        for title, hardware in specs.items():
            die = EmulatedController(place(network, hardware).nominal())
            trial = run_trial(die, arena, trial_key=1)
            run_trial(discrete, arena, trial_key=1)
            ratios, times = [], []
            for _ in range(chosen.rounds if "no wires" in title else 1):
                plain = seconds(discrete, arena)
                times.append(seconds(die, arena))
                ratios.append(times[-1] / plain)
            steps = len(trial.actions)
            per_thousand = statistics.median(times) / steps * 1000.0
            ratio = f"{statistics.median(ratios):.2f}" if "no wires" in title else ""
            print(f"{name:14}{title:24}{steps:>10}{die.ledger.events:>10,}{per_thousand:>12.3f}{ratio:>13}")


if __name__ == "__main__":
    main()
