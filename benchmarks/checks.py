"""The exact box for champions and random networks of every system on every shipped spec that has cards for their kinds.

    python benchmarks/checks.py [NETS] [SPEC ...] > docs/examples/checks.txt

A line is a spec and a system: the champion and NETS random networks (20 by default) of nine hidden neurons, each on a
trial of 100 timesteps, every device following its own differential equation. `exact` counts networks of which every
entry that applies holds; `entries` how many apply to the first. `ties` and `dW` are the sum of ties and the largest
difference of a weight in both network entries. `diverges` is the worst rms difference of W between the spec and
the paper's rule, the mean over networks.
"""

from __future__ import annotations

import sys

import numpy as np

from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import SYSTEMS, Network, champion
from ohmloom.sim import Arena, agreement
from ohmloom.sim.exact_case import Case
from ohmloom.sim.exactness import exact_box

ARENA = Arena(task="static", max_timesteps=100)


def main(count: int, names: list[str]) -> None:
    """Print the table."""
    print(f"{'spec':<15}{'system':<8}{'nets':>4}{'exact':>7}{'entries':>9}{'ties':>6}{'dW':>10}{'diverges':>10}")
    for name in names or Hardware.names():
        hardware = Hardware.load(name)
        for system, kinds in SYSTEMS.items():
            if not set(kinds) <= set(hardware.cards):
                continue
            networks = [champion(system)]
            networks += [Network.random(system=system, rng=np.random.default_rng(1000 + k)) for k in range(count)]
            print(f"{name:<15}{system:<8}{line(networks, hardware)}", flush=True)


def line(networks: list[Network], hardware: Hardware) -> str:
    """One row, without its names."""
    exact, entries, ties, error, rms = 0, 0, 0, 0.0, []
    for key, network in enumerate(networks):
        case = Case(plan=place(network, hardware), trial_key=key, arena=ARENA, integrate=True)
        holds, _ = exact_box(case)
        entries = entries or len(holds)
        exact += all(holds.values())
        for one, entry in ((case.charge, "network_charge"), (case.flux, "network_flux")) if not case.not_ideal else ():
            if entry in holds:
                ties += one.ties
                error = max(error, one.worst_weight_error)
        rms.append(agreement(network, hardware, arena=ARENA, die=case.plan.nominal(), trial_key=key).worst_rms)
    return f"{len(networks):>4}{exact:>7}{entries:>9}{ties:>6}{error:>10.1e}{np.mean(rms):>10.2g}"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2:])
