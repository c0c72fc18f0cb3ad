"""ohmloom's discrete controller beside Brian2 (C++ standalone), and `evolve` beside neat-python.

    python benchmarks/peers.py [--python PEERS/bin/python] [--rounds 7]

The peers run in an environment of their own, which has other versions of numpy: the interpreter of one, or a new one in
a temporary folder. Building Brian2's program takes a minute or two. All times are CPU time, measured in turn.

The network runs one trial in ohmloom's arena. Brian2 then gets the sensor values of that trial, open loop; the spikes
of every neuron and the final weight of every synapse are compared before anything is timed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from ohmloom.neurocontroller import LATTICES, Network, SpikingController
from ohmloom.sim import Arena, EvolutionSettings, evolve, run_trial
from ohmloom.sim.trial import trial_fitness

PEERS = ("brian2==2.9.0", "numpy==2.2.6", "setuptools<81", "neat-python==2.0.0")
HERE = Path(__file__).parent
KEY = 1


def say(text: str) -> None:
    """Progress, so that the table stays clean."""
    print(text, file=sys.stderr, flush=True)


def make_environment(folder: Path) -> Path:
    """The interpreter of a new environment with both peers."""
    say("installing Brian2 and neat-python in an environment of their own ...")
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    subprocess.run([str(python), "-m", "pip", "install", "-q", *PEERS], check=True)
    return python


def ask(python: Path, script: str, *arguments: object) -> Any:
    """What a peer's script prints, read as JSON."""
    # The peers must not find this environment's packages.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(python), str(HERE / script), *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{script}: {done.stderr.strip()}")
    return json.loads(done.stdout.splitlines()[-1])


def case_of(network: Network, sensors: np.ndarray) -> dict[str, Any]:
    """A network and its sensor values for Brian2's script."""
    tables: dict[str, dict[str, list[Any]]] = {}
    for s in network.synapses:
        table = tables.setdefault(s.kind, {"pre": [], "post": [], "sign": [], "delay": []})
        for name, value in zip(table, (s.pre, s.post, network.sign(s.pre), network.delay(s)), strict=True):
            table[name].append(value)
    lattices = {kind: {name: getattr(LATTICES[kind], name) for name in ("start", "event", "top")} for kind in tables}
    return {"neurons": network.neurons, "readings": network.readings.model_dump(), "sensors": sensors.tolist(),
            "synapses": tables, "lattices": lattices}  # fmt: skip


def replay(controller: SpikingController, sensors: np.ndarray) -> np.ndarray:
    """Spikes of every neuron over a row of timesteps."""
    controller.reset()
    counts = np.zeros(controller.network.neurons, dtype=np.int64)
    for values in sensors:
        controller.step(values)
        counts += controller.spike_counts
    return counts


def compare(network: Network, controller: SpikingController, counts: np.ndarray, found: dict[str, Any]) -> str:
    """In one line, whether Brian2 did the same."""
    weights: dict[str, list[float]] = {}
    for synapse, weight in zip(network.synapses, controller.weights.tolist(), strict=True):
        weights.setdefault(synapse.kind, []).append(weight)
    wrong = np.flatnonzero(counts != np.array(found["counts"])).tolist()
    error = max(float(np.max(np.abs(np.array(weights[k]) - found["weights"][k]))) for k in weights)
    told = f"final weights of all {len(network.synapses)} synapses within {error:.1e} (Brian2 reorders arithmetic)"
    if not wrong:
        return f"equal spikes of all {network.neurons} neurons, {int(counts.sum())} together; {told}"
    theirs = [found["counts"][j] for j in wrong]
    return (f"different spikes of neurons {wrong}, ohmloom {counts[wrong].tolist()}, Brian2 {theirs}: one rounding at "
            f"the threshold is enough; {told}")  # fmt: skip


def child_seconds(program: Path) -> float:
    """CPU time of a program."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([str(program)], cwd=program.parent, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def controllers(python: Path, folder: Path, rounds: int) -> None:
    """The first table."""
    network = Network.random(system="HET", rng=np.random.default_rng(1))
    controller, arena = SpikingController(network), Arena.paper()
    sensors = run_trial(controller, arena, trial_key=KEY).sensors
    steps = 21 * len(sensors)
    (folder / "case.json").write_text(json.dumps(case_of(network, sensors)))
    say("building Brian2's program ...")
    found = ask(python, "peer_brian2.py", folder / "case.json", folder / "brian2")
    counts = replay(controller, sensors)
    print(f"HET network, {len(network.synapses)} synapses, {steps} steps, {sum(controller.events)} STDP events")
    print(compare(network, controller, counts, found))
    times: dict[str, list[float]] = {name: [] for name in ("ohmloom, whole trial", "ohmloom, step()", "Brian2")}
    trial_fitness(controller, arena, KEY)
    for k in range(rounds):
        say(f"round {k + 1} of {rounds}")
        marks = [time.process_time()]
        trial_fitness(controller, arena, KEY)
        marks.append(time.process_time())
        controller.reset()
        for values in sensors:
            controller.step(values)
        marks.append(time.process_time())
        spent = (*np.diff(marks).tolist(), child_seconds(folder / "brian2" / "main"))
        for name, value in zip(times, spent, strict=True):
            times[name].append(value / steps * 1e9)
    print(f"{'':24}{'ns per step':>14}{'to ohmloom':>12}{'from':>8}{'to':>8}")
    for name, values in times.items():
        ratios = [a / b for a, b in zip(values, times["ohmloom, whole trial"], strict=True)]
        print(f"{name:24}{statistics.median(values):>14.0f}{statistics.median(ratios):>12.2f}"
              f"{min(ratios):>8.2f}{max(ratios):>8.2f}")  # fmt: skip
    print(f"Brian2 built its program in {found['build']:.0f} s (wall), once for each topology")


def evolutions(python: Path, folder: Path, rounds: int, generations: int) -> None:
    """The second table: evaluations per second of CPU time."""
    network = Network.random(system="HET", rng=np.random.default_rng(1))
    sensors = run_trial(SpikingController(network), Arena.paper(), trial_key=KEY).sensors
    (folder / "rows.json").write_text(json.dumps(sensors.tolist()))
    (folder / "none.json").write_text("[]")
    evolve(EvolutionSettings(system="HET", generations=0, population=3), out=folder / "compile")
    settings = EvolutionSettings(system="HET", generations=generations, seed=1)
    rates: dict[str, list[float]] = {name: [] for name in ("evolve", "neat-python", "neat-python, nothing evaluated")}
    for k in range(rounds):
        say(f"evolution {k + 1} of {rounds}")
        begin = time.process_time()
        evolve(settings, out=folder / f"run{k}")
        trials = settings.population + 2 * settings.generations
        rates["evolve"].append(trials / (time.process_time() - begin))
        for name, rows, count in (("neat-python", "rows", 1), ("neat-python, nothing evaluated", "none", 10)):
            told = ask(python, "peer_neat.py", folder / f"{rows}.json", count)
            rates[name].append(told["evaluations"] / told["seconds"])
    print(f"evolve: trials of up to 4000 timesteps of 21 steps, arena and plasticity; "
          f"neat-python: {len(sensors)} activations of a network without them")  # fmt: skip
    print(f"{'':32}{'evaluations/s':>14}{'ohmloom to it':>15}")
    for name, values in rates.items():
        ratios = [a / b for a, b in zip(rates["evolve"], values, strict=True)]
        print(f"{name:32}{statistics.median(values):>14.1f}{statistics.median(ratios):>15.2f}")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=Path, help="interpreter with " + ", ".join(PEERS))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--generations", type=int, default=100, help="of evolve, in each of 3 rounds")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Not resolved: an environment's interpreter is a link.
        python = options.python.absolute() if options.python else make_environment(folder / "peers")
        evolutions(python, folder, 3, options.generations)
        controllers(python, folder, options.rounds)


if __name__ == "__main__":
    main()
