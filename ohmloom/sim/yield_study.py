"""Yield curves: the share of dies without a synapse on a fault, over the rate of faults, by repair and spare lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ohmloom.errors import expect_integer
from ohmloom.mapping import Plan
from ohmloom.mapping.plan_yield import fault_probabilities, needed_devices
from ohmloom.mapping.repair import repair, unrepaired
from ohmloom.mapping.yield_ import draw_faults, wilson
from ohmloom.sim.work import Batch, Progress, Work, work_here
from ohmloom.sim.workers import Report, Stopped

CURVE_STREAM = 102  # beside YIELD_STREAM
FAULT_RATES = (0.001, 0.01, 0.05, 0.1)
SPARES = ((0, 0), (1, 1), (2, 2), (4, 4))  # rows, columns of every tile
# Where a spec does not say how faults divide: MNSIM 2.0, SimConfig.ini, Device_SAF = 9, 1.
STUCK_ON_SHARE = 0.1
BLOCK = 25  # dies of a unit of work


@dataclass(frozen=True, kw_only=True)
class YieldPoint:
    """Share of dies on which every tile works, with its Wilson 95 % interval.

    Attributes
    ----------
    fault_rate
        Probability that a cell is stuck, in the spec's proportion of on and off (by default 1 to 9).
    repair
        ``none``: lines stay where they were placed; ``permuted``: rows and columns are permuted, onto spare lines too.
    spare_rows, spare_columns
        Of every tile.
    value, interval, n
        Share, interval, sampled dies.
    """

    fault_rate: float
    repair: str
    spare_rows: int
    spare_columns: int
    value: float
    interval: tuple[float, float]
    n: int

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self) | {"interval": list(self.interval)}


def yield_curves(
    plan: Plan,
    *,
    dies: int = 100,
    seed: int = 0,
    rates: tuple[float, ...] = FAULT_RATES,
    spares: tuple[tuple[int, int], ...] = SPARES,
    work: Work | None = None,
    progress: Progress | None = None,
) -> tuple[YieldPoint, ...]:
    """Yield of a plan over the rate of faults, without repair and with it, on so many spare lines.

    The same dies come back at every rate with the same draws, so that a curve falls because of the rate alone. With
    repair a point is a lower bound, since repair is a heuristic. `work` says where blocks of dies are looked at.

    Raises
    ------
    ParameterError
        If `dies` is no integer >= 1, or `seed` is negative.
    """
    dies, seed = expect_integer("yield_curves.dies", dies, 1), expect_integer("yield_curves.seed", seed)
    demands = [needed_devices(plan, t) for t in range(len(plan.tiles))]
    declared = fault_probabilities(plan.hardware)
    on = STUCK_ON_SHARE if declared is None else declared[0] / sum(declared)
    ways = [("none", 0, 0), *(("permuted", *pair) for pair in spares)]
    unit = _BlockUnit(demands=demands, rates=rates, ways=ways, on=on, dies=dies, seed=seed)
    inputs = {"demands": [demand.tolist() for demand in demands], "rates": list(rates), "on": on, "dies": dies,
              "ways": [list(way) for way in ways], "seed": seed}  # fmt: skip
    batch = Batch(name="yield", unit=unit, items=range(-(-dies // BLOCK)), inputs=inputs)
    blocks = [row for rows in (work or work_here()).run(batch, progress).values() for _, row in rows]
    points = []
    for r, rate in enumerate(rates):
        for w, (kind, rows, columns) in enumerate(ways):
            good = sum(block[f"{r} {w}"] for block in blocks)
            points.append(YieldPoint(fault_rate=rate, repair=kind, spare_rows=rows, spare_columns=columns,
                                     value=good / dies, interval=wilson(good, dies), n=dies))  # fmt: skip
    return tuple(points)


@dataclass(frozen=True, kw_only=True, eq=False)
class _BlockUnit:
    """Dies from `item` times `BLOCK` on: how many work at each rate of faults, in each way of repair."""

    demands: Sequence[Any]
    rates: tuple[float, ...]
    ways: Sequence[tuple[str, int, int]]
    on: float
    dies: int
    seed: int

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool:
        block = range(item * BLOCK, min((item + 1) * BLOCK, self.dies))
        row: dict[str, float] = {}
        for r, rate in enumerate(self.rates):
            for w, (kind, rows, columns) in enumerate(self.ways):
                row[f"{r} {w}"] = sum(
                    all(
                        _works(demand, rate, self.on, kind, rows, columns, (self.seed, die, t))
                        for t, demand in enumerate(self.demands)
                    )
                    for die in block
                )
        report(item, row)
        return True


def _works(demand: Any, rate: float, on: float, kind: str, rows: int, columns: int, key: tuple[int, int, int]) -> bool:
    seed, die, tile = key
    shape = (demand.shape[0] + rows, demand.shape[1] + columns)
    stream = np.random.SeedSequence(seed, spawn_key=(CURVE_STREAM, die, tile, rows, columns))
    of_faults, of_starts = (np.random.default_rng(one) for one in stream.spawn(2))
    faults = draw_faults(shape, stuck_on=rate * on, stuck_off=rate * (1.0 - on), rng=of_faults)
    found = unrepaired(faults, demand) if kind == "none" else repair(faults, demand, rng=of_starts)
    return found.is_complete
