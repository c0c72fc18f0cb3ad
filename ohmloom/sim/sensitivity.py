"""Which declared spread matters: Morris screening of all, Sobol' indices of the leaders, with common random numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.errors import expect_integer
from ohmloom.mapping import EmulatedController, Hardware, Plan
from ohmloom.mapping.hardware import UNITS
from ohmloom.mapping.nonidealities import EFFECTS
from ohmloom.neurocontroller import SpikingController
from ohmloom.sim.arena import Arena
from ohmloom.sim.sampling import start_key, study_inputs
from ohmloom.sim.screening import morris_effects, morris_sample, saltelli_sample, sobol_indices
from ohmloom.sim.trial import run_trial
from ohmloom.sim.work import Batch, Progress, Work, open_work
from ohmloom.sim.workers import Report, Stopped

SCREEN_STREAM = 103  # beside CURVE_STREAM
TRAJECTORIES = 40  # with 12 the intervals are 30 to 80 % of mu*
BASE = 64  # of Sobol' indices
LEADERS = 3
DIES = 2  # of each point, the same at every point
TIMESTEPS = 50
CONVERGENCE = (5, 10, 20, 40)
OUTPUT = "action agreement"


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A spread and the range in which it is varied; where a spec declares none, from 0 to twice the value."""

    name: str
    unit: str
    low: float
    high: float
    source: str


def declared_spreads(hardware: Hardware) -> tuple[Factor, ...]:
    """Every non-ideality that acts or may act, and wires that have a range."""
    found = []
    for name, quantity in hardware.quantities().items():
        section, key = name.split(".", 1)
        if section == "nonidealities" and (quantity.value > 0.0 or (quantity.range or (0.0, 0.0))[1] > 0.0):
            low, high = quantity.range or _around(key, quantity.value)
        elif section == "wires" and quantity.value > 0.0 and quantity.range:
            low, high = quantity.range
        else:
            continue
        source = quantity.source if quantity.range else f"assumed: no range in the spec; {quantity.source}"
        found.append(Factor(name=name, unit=UNITS[name], low=low, high=high, source=source))
    return tuple(found)


def _around(key: str, value: float) -> tuple[float, float]:
    effect = EFFECTS[key]
    if effect.unit == "s":
        return value / 10.0, value * 10.0
    if effect.unit == "bit":
        return max(value - 2.0, 1.0), min(value + 2.0, 32.0)
    return 0.0, min(2.0 * value, 1.0) if key in ("stuck_on", "stuck_off", "forming", "asymmetry") else 2.0 * value


@dataclass(frozen=True, kw_only=True, eq=False)
class Stream:
    """Sensor values of the ideal controller's own trial and its actions, axes (timestep, 6) and (timestep,)."""

    sensors: FloatArray
    actions: tuple[str, ...]

    @classmethod
    def of(cls, plan: Plan, arena: Arena, *, seed: int, timesteps: int = TIMESTEPS) -> Stream:
        """From the first start of a study."""
        controller = SpikingController(plan.network)
        sensors = run_trial(controller, arena, trial_key=start_key(seed, 0)).sensors[:timesteps]
        controller.reset()
        return cls(sensors=sensors, actions=tuple(controller.step(one) for one in sensors))


def action_agreement(plan: Plan, stream: Stream, *, seed: int, dies: int = DIES) -> float:
    """Share of timesteps in which sampled dies act as the ideal controller on the same sensors."""
    equal = 0
    for die in range(dies):
        emulated = EmulatedController(plan.sample(seed=seed, die=die))
        equal += sum(emulated.step(s) == action for s, action in zip(stream.sensors, stream.actions, strict=True))
    return equal / max(dies * len(stream.actions), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _RowUnit:
    """One row of a sample, such as a trajectory: the unit of work."""

    plan: Plan
    factors: tuple[Factor, ...]
    sample: FloatArray
    stream: Stream
    seed: int

    def __call__(self, item: int, stopped: Stopped, report: Report, /) -> bool:
        row = {}
        for k, point in enumerate(self.sample[item]):
            values = {x.name: x.low + u * (x.high - x.low) for x, u in zip(self.factors, point, strict=True)}
            changed = replace(self.plan, hardware=self.plan.hardware.with_values(values))
            row[str(k)] = action_agreement(changed, self.stream, seed=self.seed)
            if stopped():
                return False
        report(item, row)
        return True


def screen(
    plan: Plan,
    arena: Arena,
    *,
    seed: int = 0,
    trajectories: int = TRAJECTORIES,
    base: int = BASE,
    workers: int = 1,
    work: Work | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Screen all declared spreads, then split the variance among the leaders.

    Every point runs the same dies on the same sensors, with the same draws scaled by its values: what changes between
    two points is the factor alone.

    Parameters
    ----------
    plan, arena
        What is placed where; the arena of the sensors.
    seed
        Of dies, start and sampling.
    trajectories
        Of the Morris screening.
    base
        Base samples of the Sobol' indices, a power of two; 0 leaves them out.
    workers
        Processes that share the points, if no `work` says where they are run; they do not change the result.
    work
        Where points are run, and where what they give is kept.
    progress
        Called with points done and points in all.

    Returns
    -------
    dict
        ``output``, ``trajectories``, ``factors`` by falling ``mu_star``, ``sobol`` (None with fewer than two factors
        or where nothing matters), ``n_sobol``, ``convergence``.
    """
    expect_integer("screen.trajectories", trajectories, 2)
    if work is None:
        with open_work(workers=workers) as own:
            return screen(
                plan, arena, seed=seed, trajectories=trajectories, base=base, work=own, progress=progress
            )  # fmt: skip
    factors = declared_spreads(plan.hardware)
    table: dict[str, Any] = {"output": OUTPUT, "trajectories": trajectories, "factors": [], "sobol": None,
                             "n_sobol": 0, "convergence": []}  # fmt: skip
    if not factors:
        return table
    stream = Stream.of(plan, arena, seed=seed)
    leaders = min(LEADERS, len(factors))
    has_sobol = base > 0 and leaders > 1
    whole = trajectories * (len(factors) + 1) + (base * (leaders + 2) if has_sobol else 0)
    before = 0

    def outputs(name: str, points: FloatArray, of: tuple[Factor, ...]) -> FloatArray:
        nonlocal before
        rows, width = points.shape[:2]
        inputs = study_inputs(plan, arena) | {
            "seed": seed, "dies": DIES, "timesteps": TIMESTEPS, "factors": [asdict(x) for x in of],
            "sample": points.tolist(),
        }  # fmt: skip
        unit = _RowUnit(plan=plan, factors=of, sample=points, stream=stream, seed=seed)
        batch = Batch(name=name, unit=unit, items=range(rows), inputs=inputs)
        tell = None if progress is None else lambda done, _: progress(before + done * width, whole)
        found = work.run(batch, tell)
        before += rows * width
        return np.array([[row[str(k)] for k in range(width)] for item in range(rows) for _, row in found[item]])

    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SCREEN_STREAM,)))
    sample = morris_sample(len(factors), trajectories, rng=rng)
    output = outputs("morris", sample, factors)
    effects = morris_effects(sample, output, seed=seed)
    order = np.argsort(-effects.mu_star, kind="stable")
    table["factors"] = [
        asdict(factors[k]) | {"mu_star": float(effects.mu_star[k]), "interval": effects.interval[k].tolist(),
                              "sigma": float(effects.sigma[k])}
        for k in order
    ]  # fmt: skip
    counts = sorted({n for n in CONVERGENCE if n < trajectories} | {trajectories})
    table["convergence"] = [
        {"trajectories": n, "mu_star": {x.name: float(m) for x, m in zip(factors, abs(effects.effects[:n]).mean(axis=0),
                                                                         strict=True)}}
        for n in counts
    ]  # fmt: skip
    if has_sobol and effects.mu_star.max() > 0.0:
        chosen = tuple(factors[k] for k in order[:leaders])
        found = sobol_indices(outputs("sobol", saltelli_sample(leaders, base, seed=seed), chosen), seed=seed)
        table["n_sobol"] = base
        table["sobol"] = [
            {"name": x.name, "first": float(found.first[k]), "first_interval": found.first_interval[k].tolist(),
             "total": float(found.total[k]), "total_interval": found.total_interval[k].tolist()}
            for k, x in enumerate(chosen)
        ]  # fmt: skip
    return table
