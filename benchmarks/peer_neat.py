"""Evaluations per second of neat-python: the peer that ``peers.py`` runs. Needs neat-python, not ohmloom.

Run: python benchmarks/peer_neat.py SENSORS GENERATIONS. SENSORS is a JSON list of six-number rows; to evaluate a
genome is to activate its recurrent network once for each row, without an arena. Without rows nothing is evaluated, and
what remains is the library's own work.
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import neat

# The library asks for every value; those that say how much changes are near its examples'.
CONFIG = """
[NEAT]
pop_size = 100
fitness_criterion = max
fitness_threshold = 1e9
no_fitness_termination = True
reset_on_extinction = True
[DefaultGenome]
num_inputs = 6
num_hidden = 9
num_outputs = 2
feed_forward = False
initial_connection = partial_nodirect 0.5
compatibility_disjoint_coefficient = 1.0
compatibility_weight_coefficient = 0.5
conn_add_prob = 0.2
conn_delete_prob = 0.2
node_add_prob = 0.1
node_delete_prob = 0.1
bias_init_mean = 0.0
bias_init_stdev = 1.0
bias_replace_rate = 0.1
bias_mutate_rate = 0.7
bias_mutate_power = 0.5
bias_max_value = 30.0
bias_min_value = -30.0
response_init_mean = 1.0
response_init_stdev = 0.0
response_replace_rate = 0.0
response_mutate_rate = 0.0
response_mutate_power = 0.0
response_max_value = 30.0
response_min_value = -30.0
activation_default = sigmoid
activation_options = sigmoid
activation_mutate_rate = 0.0
aggregation_default = sum
aggregation_options = sum
aggregation_mutate_rate = 0.0
weight_init_mean = 0.0
weight_init_stdev = 1.0
weight_replace_rate = 0.1
weight_mutate_rate = 0.8
weight_mutate_power = 0.5
weight_max_value = 30.0
weight_min_value = -30.0
enabled_default = True
enabled_mutate_rate = 0.01
[DefaultStagnation]
[DefaultSpeciesSet]
compatibility_threshold = 3.0
[DefaultReproduction]
"""


def main(source: Path, generations: int) -> None:
    """Run one evolution and print its CPU time and number of evaluations."""
    rows = json.loads(source.read_text())
    rng = random.Random(1)
    random.seed(1)
    evaluations = 0

    def evaluate(genomes: list[tuple[int, Any]], config: Any) -> None:
        nonlocal evaluations
        for _, genome in genomes:
            evaluations += 1
            if rows:
                network = neat.nn.RecurrentNetwork.create(genome, config)
                for row in rows:
                    network.activate(row)
            genome.fitness = rng.random()

    with tempfile.NamedTemporaryFile("w", suffix=".ini") as file:
        file.write(CONFIG)
        file.flush()
        config = neat.Config(
            neat.DefaultGenome, neat.DefaultReproduction, neat.DefaultSpeciesSet, neat.DefaultStagnation, file.name
        )
    population = neat.Population(config)
    begin = time.process_time()
    population.run(evaluate, generations)
    print(json.dumps({"seconds": time.process_time() - begin, "evaluations": evaluations}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
