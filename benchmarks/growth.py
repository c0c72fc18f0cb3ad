"""How a trial's time and memory grow with the network, from 100 to 10,000 synapses and to the largest one.

    python benchmarks/growth.py [--networks 5] [--rounds 3]

Fully connected HET networks drive the robot for up to 500 timesteps in one call, all sizes in turn; CPU time per step
and synapse is the median over rounds of the mean over networks. Spikes per neuron and step and STDP events per synapse
and step are those of the same trials: the time follows them. Memory is that of all arrays of a network and its state,
without the tables of levels, which all networks share.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.sim import Arena, run_trial
from ohmloom.sim.trial import trial_fitness

SIZES = (9, 20, 35, 54, 55, 90, 134)  # 54 are the most that one word of a mask holds
LARGEST = 1000
STEPS = 21


def memory(controller: SpikingController) -> int:
    """Bytes of the wiring and the state."""
    wiring, state = controller.kernel_arguments
    own = (*wiring._replace(tables=None, up=None, down=None), *state)
    return sum(value.nbytes for value in own if isinstance(value, np.ndarray))


def activity(controller: SpikingController, sensors: np.ndarray) -> tuple[float, float]:
    """Spikes per neuron and step, STDP events per synapse and step."""
    controller.reset()
    spikes = 0
    for values in sensors:
        controller.step(values)
        spikes += int(controller.spike_counts.sum())
    steps, network = STEPS * len(sensors), controller.network
    return spikes / steps / network.neurons, sum(controller.events) / steps / len(network.synapses)


class Size:
    """Networks of one size, and what has been measured of them."""

    def __init__(self, hidden: int, networks: int, arena: Arena) -> None:
        born = [
            Network.random(system="HET", rng=np.random.default_rng(k), hidden=hidden, enable_probability=1.0)
            for k in range(networks)
        ]
        self.hidden, self.arena, self.synapses = hidden, arena, len(born[0].synapses)
        self.controllers = [SpikingController(network) for network in born]
        trials = [run_trial(controller, arena, trial_key=k) for k, controller in enumerate(self.controllers)]
        self.steps = STEPS * sum(len(trial.actions) for trial in trials)
        both = [activity(c, trial.sensors) for c, trial in zip(self.controllers, trials, strict=True)]
        self.spikes, self.events = np.mean(both, axis=0).tolist()
        self.times: list[float] = []

    def measure(self) -> None:
        """One round: ns of CPU time per step and synapse."""
        begin = time.process_time()
        for key, controller in enumerate(self.controllers):
            trial_fitness(controller, self.arena, key)
        self.times.append((time.process_time() - begin) / self.steps / self.synapses * 1e9)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--networks", type=int, default=5, help="of each size")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    sizes = [Size(hidden, options.networks, Arena(task="static", max_timesteps=500)) for hidden in SIZES]
    sizes.append(Size(LARGEST, 1, Arena(task="static", max_timesteps=20)))
    for _ in range(options.rounds):
        for size in sizes:
            size.measure()
    print(f"{'hidden':>6}{'synapses':>10}{'spikes':>8}{'events':>8}{'ns':>7}{'to first':>10}{'bytes':>7}{'MB':>8}")
    for size in sizes:
        ratio = statistics.median(a / b for a, b in zip(size.times, sizes[0].times, strict=True))
        held = memory(size.controllers[0])
        print(f"{size.hidden:>6}{size.synapses:>10}{size.spikes:>8.2f}{size.events:>8.2f}{statistics.median(size.times):>7.2f}"
              f"{ratio:>10.2f}{held / size.synapses:>7.0f}{held / 1e6:>8.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
