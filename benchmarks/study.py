"""How long a feasibility study takes: wall time and CPU time of this process and its workers, kernels compiled before.

    python benchmarks/study.py [WORKERS] [wires | figures | default | no-wires ...]

- `no-wires`: 200 dies x 10 starts of a champion on `ideal` with the spreads of `het_mixed`, without wires.
- `wires`: 50 dies x 1 start on `hp_1t1r`, through its wires.
- `figures`: `--dies 0` on `hp_1t1r`.
- `default`: the whole default study on `hp_1t1r`, 200 dies x 1 start.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable

from ohmloom.mapping import Hardware, place
from ohmloom.neurocontroller import champion
from ohmloom.sim import Arena, feasibility
from ohmloom.sim.sampling import sample_dies

ARENA = Arena.paper(task="static")
WIRED = Hardware.load("hp_1t1r")


def without_wires() -> Hardware:
    """The devices of the paper with spreads."""
    ideal, spread = Hardware.load("ideal"), Hardware.load("het_mixed").nonidealities
    return ideal.model_copy(update={"nonidealities": spread})


def no_wires(workers: int) -> None:
    """The first target of the study."""
    sample_dies(place(champion("HET"), without_wires()), ARENA, dies=200, starts=10, seed=0, workers=workers)


def wires(workers: int) -> None:
    """The second one."""
    sample_dies(place(champion("HP"), WIRED), ARENA, dies=50, seed=0, workers=workers)


def figures(_: int) -> None:
    """What needs no sampling."""
    feasibility(champion("HP"), WIRED, dies=0)


def default(workers: int) -> None:
    """The whole default study."""
    feasibility(champion("HP"), WIRED, workers=workers)


CASES: dict[str, tuple[Callable[[int], None], float]] = {
    "no-wires": (no_wires, 120.0), "wires": (wires, 300.0), "figures": (figures, 5.0), "default": (default, 120.0),
}  # fmt: skip


def cpu() -> float:
    """CPU time of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def main(workers: int, names: list[str]) -> None:
    """Print a line per case."""
    # Compiles, or loads from the cache, what the cases run.
    feasibility(champion("HP"), WIRED, dies=1, arena=Arena(max_timesteps=5))
    sample_dies(place(champion("HET"), without_wires()), Arena(max_timesteps=5), dies=1, seed=0)
    print(f"{'case':<10}{'workers':>8}{'wall s':>9}{'CPU s':>9}{'target s':>10}")
    for name in names:
        run, target = CASES[name]
        begin, used = time.monotonic(), cpu()
        run(workers)
        print(f"{name:<10}{workers:>8}{time.monotonic() - begin:>9.1f}{cpu() - used:>9.1f}{target:>10.0f}", flush=True)


if __name__ == "__main__":
    words = sys.argv[1:]
    count = int(words.pop(0)) if words and words[0].isdigit() else 2
    main(count, words or list(CASES))
