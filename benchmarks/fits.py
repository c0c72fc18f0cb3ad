"""Fits that a reader can check: errors, success of the search, truth of the intervals, time against SciPy.

    python benchmarks/fits.py errors   [--data FOLDER]     relative RMS of named fits
    python benchmarks/fits.py success  [--data FOLDER]     share of 20 independent searches within 5 % of the best
    python benchmarks/fits.py coverage [--seeds 100]       each true parameter inside its 95 % interval, how often
    python benchmarks/fits.py speed    [--data FOLDER]     a local fit: exact derivatives, or solve_ivp and differences

FOLDER holds measured files that ohmloom may not ship (docs/fitting.md names them); without it their rows are left out,
and the output says so. All else is made here or lies in examples/measurements.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from ohmloom.devices import LAWS, CardValue, Device, Measurement, fit
from ohmloom.devices.fitting._checks import check_names, sizes
from ohmloom.devices.fitting._coordinates import choose
from ohmloom.devices.fitting._features import Features
from ohmloom.devices.fitting.fit import SUBSTEPS, _problem

OWN = Path(__file__).parents[1] / "examples" / "measurements"
SUCCESS = 1.05

# name -> (file, whether it is measured, options of read_csv)
SOURCE = {"time": None, "voltage": "v_source_V", "current": "i_uA", "units": {"i_uA": "uA"}}
DEVICE = {"time": None, "voltage": "v_memristor_V", "current": "i_uA", "units": {"i_uA": "uA"}}
KNOWM = "knowm_w_sdc/knowm_wsdc_{}.csv"
SETS = {
    "own Pickett": ("pickett.csv", False, {"series_resistance": 2400.0}),
    "own Pickett, 10 times faster": ("pickett_fast.csv", False, {"series_resistance": 2400.0}),
    "own redox loop": ("redox.csv", False, {}),
    "Knowm 5k 100 Hz": (KNOWM.format("5k_0p8V_100Hz_M1"), True, {**DEVICE, "frequency": 100.0}),
    "Knowm 5k 10 Hz": (KNOWM.format("5k_0p8V_10Hz_M1"), True, {**DEVICE, "frequency": 10.0}),
    "Knowm 5k 1 Hz": (KNOWM.format("5k_0p8V_1Hz_M1"), True, {**DEVICE, "frequency": 1.0}),
    "Knowm 5k 100 Hz, source": (KNOWM.format("5k_0p8V_100Hz_M1"), True,
                                {**SOURCE, "frequency": 100.0, "series_resistance": 5e3}),
    "Knowm 47k 100 Hz": (KNOWM.format("47k_0p8V_100Hz_M2"), True, {**DEVICE, "frequency": 100.0}),
    "Knowm 47k 100 Hz, source": (KNOWM.format("47k_0p8V_100Hz_M2"), True,
                                 {**SOURCE, "frequency": 100.0, "series_resistance": 47e3}),
    "PANI I-V": ("pani/IV_MLit10_1.txt", True,
                 {"time": None, "voltage": "1", "current": "2", "sample_interval": 1.0, "rows": (182, 364)}),
    "PANI staircase": ("pani/small_mem4.csv", True, {"voltage": "s", "current": "m", "every": 30}),
}  # fmt: skip
# (set, law, what was aimed at)
ERRORS = [
    ("own Pickett", "tio2_threshold", 0.022),
    ("Knowm 5k 100 Hz", "mirror_threshold", 0.055),
    ("Knowm 5k 100 Hz", "peo_pani_redox", 0.055),
    ("Knowm 5k 100 Hz", "tio2_threshold", 0.115),
    ("Knowm 5k 100 Hz, source", "mirror_threshold", None),
    ("Knowm 5k 100 Hz, source", "peo_pani_redox", None),
    ("Knowm 5k 100 Hz, source", "tio2_threshold", None),
    ("PANI I-V", "peo_pani_redox", 0.045),
    ("PANI staircase", "peo_pani_redox", 0.070),
]
JOINT = ("Knowm 5k 1 Hz", "Knowm 5k 10 Hz", "Knowm 5k 100 Hz")
JOINT_LAWS = ("mirror_threshold", "peo_pani_redox", "tio2_threshold")
SUCCESSES = [
    ("Knowm 5k 100 Hz", "mirror_threshold"),
    ("Knowm 5k 100 Hz", "peo_pani_redox"),
    ("Knowm 5k 100 Hz", "tio2_threshold"),
    ("Knowm 47k 100 Hz", "mirror_threshold"),
    ("Knowm 47k 100 Hz", "tio2_threshold"),
    ("PANI I-V", "peo_pani_redox"),
    ("PANI staircase", "peo_pani_redox"),
    ("own Pickett", "tio2_threshold"),
]
SEARCHES = 20
# Without walls, an ideal law's loop holds two numbers only (M0 and dM/dq): these reach both.
# law -> (true parameters that differ from the defaults, amplitude in V, period in s, s0)
TRUTHS: dict[str, tuple[dict[str, float], float, float, float]] = {
    "hp_linear": ({"r_off": 1.6e3, "beta": 1e3}, 1.0, 1.0, 0.3),
    "hp_biolek": ({"r_off": 1.6e3, "beta": 1e3}, 0.4, 1.0, 0.3),
    "linear": ({"r_on": 1e4, "r_off": 1e5, "q_d": 4e-6}, 1.0, 1.0, 0.2),
    "peo_pani_mirror": ({"r_on": 1e4, "r_off": 1e5, "q_d": 1e-5}, 1.0, 1.0, 0.2),
    "tio2_threshold": ({"r_on": 2e3, "r_off": 4e4, "v_set": 0.4, "v_reset": 0.3, "q_set": 3e-5, "q_reset": 2e-5},
                       1.0, 1.0, 0.2),
    "mirror_threshold": ({"r_on": 2e3, "r_off": 2e4, "v_set": 0.3, "v_reset": 0.2, "q_set": 8e-5, "q_reset": 6e-5},
                         1.0, 1.0, 0.05),
    "peo_pani_redox": ({"r_on": 1.147e4, "r_off": 5e5, "e0": 0.2, "slope": 0.2, "k0": 1.0}, 0.8, 4.0, 0.2),
}  # fmt: skip
POINTS, NOISE = 200, 0.01
EVALUATIONS = 5  # of the residual, for either side of the comparison in time


def load(name: str, data: Path | None) -> Measurement | None:
    file, is_measured, options = SETS[name]
    if is_measured and data is None:
        print(f"{name}: left out, no --data")
        return None
    return Measurement.read_csv((data if is_measured else OWN) / file, name=name, **options)


def errors(data: Path | None, seed: int) -> None:
    print(f"{'set':28}{'law':20}{'relative RMS':>13}{'aim':>8}")
    for name, law, aim in ERRORS:
        if (sweep := load(name, data)) is not None:
            found = fit(sweep, law, rng=np.random.default_rng(seed))
            print(f"{name:28}{law:20}{found.relative_rms:13.4f}{'-' if aim is None else f'{aim:.3f}':>8}", flush=True)
    sweeps = [load(name, data) for name in JOINT]
    if None in sweeps:
        return
    print(f"\n{'joint fit':54}{'held out':30}")
    for law in JOINT_LAWS:
        whole = fit([s for s in sweeps if s is not None], law, rng=np.random.default_rng(seed))
        each = ", ".join(f"{s.name[9:]} {s.relative_rms:.3f}" for s in whole.sweeps)
        print(f"{law:20}{each}: {whole.relative_rms:.3f}", flush=True)
        for k in range(len(sweeps)):
            rest = [s for j, s in enumerate(sweeps) if j != k and s is not None]
            left = sweeps[k]
            assert left is not None
            found = fit(rest, law, rng=np.random.default_rng(seed), holdout=[left])
            print(f"{'':20}{found.relative_rms:.3f} on the other two, held out {left.name[9:]}: "
                  f"{found.holdout_rms:.3f}", flush=True)  # fmt: skip


def success(data: Path | None, seed: int) -> None:
    print(f"{'set':28}{'law':20}{'within 5 %':>11}{'best':>9}{'worst':>9}{'s/fit':>7}")
    for name, law in SUCCESSES:
        if (sweep := load(name, data)) is None:
            continue
        start = time.process_time()
        found = [fit(sweep, law, rng=np.random.default_rng([seed, k])).relative_rms for k in range(SEARCHES)]
        each = (time.process_time() - start) / SEARCHES
        reached = sum(rms <= SUCCESS * min(found) for rms in found)
        print(f"{name:28}{law:20}{reached:8}/{SEARCHES}{min(found):9.4f}{max(found):9.4f}{each:7.1f}", flush=True)


def true_device(law: str) -> Device:
    changed = TRUTHS[law][0]
    return Device(name=law, law=law, source="made up", values=tuple(
        CardValue(value=changed.get(p.name, p.default), source="made up") for p in LAWS[law].parameters))  # fmt: skip


def true_sweep(law: str, rng: np.random.Generator) -> Measurement:
    _, amplitude, period, s0 = TRUTHS[law]
    t = np.linspace(0.0, period, POINTS)
    loop = true_device(law).simulate(amplitude * np.sin(2 * np.pi * t / period), t, s0=s0)
    noise = NOISE * np.sqrt(np.mean(loop.i**2)) * rng.standard_normal(POINTS)
    return Measurement(name=law, t=loop.t, v=loop.v, i=loop.i + noise)


def coverage(seeds: int, seed: int, laws: list[str]) -> None:
    for law in laws:
        truth = true_device(law).parameters
        inside: dict[str, int] = {}
        unknown: dict[str, int] = {}
        for k in range(seeds):
            found = fit(true_sweep(law, np.random.default_rng([seed, k])), law, rng=np.random.default_rng(k))
            intervals = {**found.intervals, "s0": found.sweeps[0].s0_interval}
            for name, interval in intervals.items():
                low, high = interval or (np.inf, -np.inf)
                inside[name] = inside.get(name, 0) + bool(low <= {**truth, "s0": TRUTHS[law][3]}[name] <= high)
                unknown[name] = unknown.get(name, 0) + (interval is None)
        counts = ", ".join(
            f"{name} {count}" + (f" ({unknown[name]} not determined)" if unknown[name] else "")
            for name, count in inside.items()
        )
        print(f"{law:18} of {seeds}: {counts}", flush=True)


def speed(data: Path | None) -> None:
    """The same residual, from the same start, to the same tolerance, in this process."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import least_squares

    print(f"{'set':22}{'law':18}{'exact':>9}{'solve_ivp':>11}{'ratio':>7}{'rms exact':>11}{'rms solve_ivp':>14}")
    for name, law in [("own redox loop", "peo_pani_redox"), ("Knowm 5k 100 Hz", "mirror_threshold")]:
        sweep = load(name, data)
        if sweep is None:
            continue
        # Both sides get the device's own voltage: solve_ivp has no series resistor to solve for.
        sweep = Measurement(name=name, t=sweep.t, v=sweep.device_voltage, i=sweep.i)
        coordinates = choose(check_names(law, {}, ()), {}, ())
        problem = _problem(coordinates, (sweep,), sizes((sweep,), "relative"), SUBSTEPS)
        z = problem.inside(np.append(coordinates.of_values(coordinates.nominal(Features.of((sweep,)))), 0.3))
        problem.solve(z, problem.shooting, 2)  # makes the functions, once for all fits of this length
        begin = time.process_time()
        end, _, _ = problem.solve(z, problem.shooting, EVALUATIONS)
        fast = time.process_time() - begin

        def plain(z: np.ndarray, sweep: Measurement = sweep, law: str = law, problem: object = problem,
                  coordinates: object = coordinates) -> np.ndarray:  # fmt: skip
            chosen, p = LAWS[law], tuple(coordinates.values(z).values())
            q_d = chosen.charge_scale(p)

            def rate(t: float, y: np.ndarray) -> list[float]:
                s, v = min(max(y[0], 0.0), 1.0), np.interp(t, sweep.t, sweep.v)
                change = chosen.charge_rate(s, v, chosen.conductance(s, v, p) * v, p) / q_d
                return [0.0 if (s >= 1.0 and change > 0.0) or (s <= 0.0 and change < 0.0) else change]

            solved = solve_ivp(rate, (sweep.t[0], sweep.t[-1]), [z[-1]], t_eval=sweep.t, method="LSODA", rtol=1e-6,
                               atol=1e-8)  # fmt: skip
            s = np.clip(solved.y[0], 0.0, 1.0)
            return (chosen.conductance(s, sweep.v, p) * sweep.v - sweep.i) / problem.shooting.sizes[0]

        begin = time.process_time()
        with np.errstate(all="ignore"):
            other = least_squares(plain, z, bounds=(problem.low, problem.high), max_nfev=EVALUATIONS)
        slow = time.process_time() - begin
        print(f"{name:22}{law:18}{fast:8.3f}s{slow:10.1f}s{slow / fast:6.0f}x{problem.error(end):11.4f}"
              f"{np.sqrt(2 * other.cost):14.4f}", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("errors", "success", "coverage", "speed"))
    parser.add_argument("--data", type=Path, default=None, help="folder of measured files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=100, help="noise seeds of coverage")
    parser.add_argument("--laws", default=",".join(TRUTHS), help="laws of coverage")
    chosen = parser.parse_args()
    if chosen.what == "coverage":
        coverage(chosen.seeds, chosen.seed, chosen.laws.split(","))
    elif chosen.what == "speed":
        speed(chosen.data)
    else:
        {"errors": errors, "success": success}[chosen.what](chosen.data, chosen.seed)


if __name__ == "__main__":
    main()
