"""Place champions and random networks of every system on every shipped spec that has cards for their kinds.

    python benchmarks/maps.py [NETS] > docs/examples/maps.txt

A line is a spec and a system: the champion and NETS random networks (20 by default) of nine hidden neurons. Errors
are the worst read error of the plan's worst tile, averaged over the networks, with lines in ascending order, sorted,
and swapped; `worst` is the largest of a plan as built. `used` is synapses per crosspoint, `reset` the longest.
"""

from __future__ import annotations

import sys

import numpy as np

from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import SYSTEMS, Network, champion
from ohmloom.report.map_output import MapStudy, study_map


def main(count: int) -> None:
    print(f"{'spec':<15}{'system':<8}{'nets':>4}{'tiles':>7}{'given':>9}{'sorted':>9}{'swapped':>9}{'worst':>9}"
          f"{'used':>7}{'reset':>10}")  # fmt: skip
    for name in Hardware.names():
        hardware = Hardware.load(name)
        for system, kinds in SYSTEMS.items():
            if not set(kinds) <= set(hardware.cards):
                continue
            networks = [champion(system)]
            networks += [Network.random(system=system, rng=np.random.default_rng(1000 + k)) for k in range(count)]
            studies = [study_map(place(network, hardware)) for network in networks]
            print(f"{name:<15}{system:<8}{line(studies)}", flush=True)


def line(studies: list[MapStudy]) -> str:
    tiles = [len(study.plan.tiles) for study in studies]
    errors = np.array([
        max((e.given, e.sorted, e.refined, e.built) for t in study.plan.tiles if (e := t.read_error) is not None)
        for study in studies
    ])  # fmt: skip
    span = f"{min(tiles)}" if min(tiles) == max(tiles) else f"{min(tiles)}-{max(tiles)}"
    shown = "".join(f"{x:>9.2%}" for x in (*errors[:, :3].mean(axis=0), errors[:, 3].max()))
    used = float(np.mean([study.utilisation for study in studies]))
    return f"{len(studies):>4}{span:>7}{shown}{used:>7.0%}{max(study.reset.duration for study in studies):>8.2g} s"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
