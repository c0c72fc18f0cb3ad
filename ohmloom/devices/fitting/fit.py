"""Fitting a law to measured sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from ohmloom._arrays import FloatArray
from ohmloom.devices.card import Card, CardValue, DataFile, write_card
from ohmloom.devices.fitting._checks import Weights, check_inputs, check_names, check_text, sizes
from ohmloom.devices.fitting._coordinates import Coordinates, choose
from ohmloom.devices.fitting._features import Features
from ohmloom.devices.fitting._interrupt import deferred_interrupts
from ohmloom.devices.fitting._search import Problem, Start, resolved, search
from ohmloom.devices.fitting._shooting import Shooting
from ohmloom.devices.fitting._statistics import Uncertainty, assess, lag_one
from ohmloom.devices.fitting._words import warnings_for
from ohmloom.devices.fitting.profiles import needed_profiles, profile_of
from ohmloom.devices.fitting.result import Fit, ProfileResult, StartResult, SweepResult, limits_in_words, root_mean
from ohmloom.devices.measurement import Measurement
from ohmloom.devices.revisit import charge_revisit
from ohmloom.errors import OperationError, ParameterError

SUBSTEPS, MOST_SUBSTEPS = 2, 32
# Times that the fit may start again from a better point that a profile met.
RESTARTS = 3
# The integrator's own error may be this share of the residual.
INTEGRATION_SHARE = 0.02
SMALLEST_ERROR = 1e-6
WALL = 1e-9
# A hold-out sweep's start state is looked for from each of these.
STATES = (0.02, 0.25, 0.5, 0.75, 0.98)


def fit(measurements: Measurement | Sequence[Measurement], law: str, *, rng: np.random.Generator,
        holdout: Sequence[Measurement] = (), fixed: Mapping[str, float] | None = None, free: Sequence[str] = (),
        weights: Weights = "relative", screen: int = 300, starts: int = 3, profile: bool = False,
        name: str | None = None, report: Callable[[int, int, float], None] | None = None) -> Fit:  # fmt: skip
    """Fit `law` to one sweep or jointly to several: shared parameters, a start state for each sweep.

    Single shooting with exact derivatives; least squares from several starts: the best of many random ones, one from
    sizes in the data, one by charge regression. The state at a wall stays there (`clip`).

    Parameters
    ----------
    measurements
        Sweeps to fit.
    law
        A key of `LAWS`.
    rng
        Draws the random starts; the same generator state gives the same fit.
    holdout
        Sweeps that are only predicted with the fitted parameters; their start state alone is fitted.
    fixed
        Values to hold, SI, by name.
    free
        Names of parameters to fit that the law leaves at their default (`Parameter.fitted`).
    weights
        "relative": each sweep's residual over the rms of its current, so that all sweeps count the same; "absolute":
        over that of all sweeps; ``(a, b)``: each sample's over ``a + b |i|``, a in A.
    screen, starts
        Random starts that are tried with one residual each, within two decades about the data's sizes; how many of them
        are solved.
    profile
        Also find every parameter's interval by profile likelihood, which takes several fits each.
    name
        Name of the fitted device; by default the law's and the first sweep's.
    report
        Called once all is checked with (0, 1, infinity), and after each start with (solved, number of starts, best
        relative RMS so far).

    Raises
    ------
    ParameterError
        If an argument breaks a rule, or there are fewer points than unknowns; before any fit starts.
    UnknownNameError
        If a law or parameter is unknown.
    OperationError
        If the law gives no finite current from any start.

    Examples
    --------
    >>> import numpy as np
    >>> from ohmloom.devices import Device
    >>> t = np.linspace(0.0, 1.0, 60)
    >>> loop = Device.load("hp_tio2").simulate(np.sin(2 * np.pi * t), t, s0=0.3)
    >>> sweep = Measurement(name="loop", t=loop.t, v=loop.v, i=loop.i)
    >>> found = fit(sweep, "hp_linear", rng=np.random.default_rng(0), screen=20)
    >>> found.relative_rms < 0.001
    True
    """
    sweeps, held_out = check_inputs(measurements, holdout, screen, starts, rng)
    fixed = {} if fixed is None else fixed
    chosen = check_names(law, fixed, free)
    if name is not None:
        check_text("fit.name", name)
    coordinates = choose(chosen, fixed, free)
    scale = sizes(sweeps, weights)
    for sweep in held_out:
        sizes((sweep,), "relative")
    check_count(coordinates, sweeps)
    # Plain numbers: numpy's own have no form in JSON.
    settings = {"law": law, "fixed": {key: float(value) for key, value in fixed.items()}, "free": list(free),
                "screen": int(screen), "starts": int(starts),
                "weights": weights if isinstance(weights, str) else [float(weight) for weight in weights]}  # fmt: skip

    if report is not None:
        report(0, 1, math.inf)
    with deferred_interrupts():
        return _fit(coordinates, sweeps, scale, held_out, settings, rng, profile, name, report)


def _fit(coordinates: Coordinates, sweeps: tuple[Measurement, ...], scale: tuple[FloatArray, ...],
         held_out: tuple[Measurement, ...], settings: dict[str, Any], rng: np.random.Generator, profile: bool,
         name: str | None, report: Callable[[int, int, float], None] | None) -> Fit:  # fmt: skip
    """Search, refine, profile: the fit itself, all being checked."""
    law, screen, starts = coordinates.law.name, settings["screen"], settings["starts"]
    problem = _problem(coordinates, sweeps, scale, SUBSTEPS)
    tried = search(problem, screen=screen, starts=starts, rng=rng, report=report)
    if not tried:
        raise OperationError(
            f"fit: expected {law} to give a finite current from at least one start, got none. Check units and time of "
            "the sweeps, or fix parameters that are known."
        )
    problem, z, tried, integration_error = _refine(problem, tried)
    names = (*coordinates.names, *start_names(sweeps))
    for left in reversed(range(RESTARTS + 1)):
        uncertainty = assess(problem, z)
        wanted = range(len(names)) if profile else needed_profiles(problem, z, uncertainty)
        profiles, better = _profiles(problem, z, uncertainty, {names[k]: k for k in wanted}, must_end=left == 0)
        if better is None:
            break
        # A profile went lower than the optimum: that was none.
        before = problem.error(better)
        z = problem.polish(better)
        tried += (Start(origin="profile", before=before, after=problem.error(z), evaluations=0, has_converged=True,
                        coordinates=tuple(z.tolist())),)  # fmt: skip
    return _result(problem, z, tried, uncertainty, names, profiles, held_out, settings, integration_error, name)


def _profiles(
    problem: Problem, z: FloatArray, uncertainty: Uncertainty, wanted: Mapping[str, int], *, must_end: bool
) -> tuple[dict[str, ProfileResult], FloatArray | None]:
    """Profiles by name, or a point that is better than `z`, unless they must end here."""
    profiles = {}
    for name, k in wanted.items():
        profiles[name], better = profile_of(problem, z, k, uncertainty)
        if better is not None and not must_end:
            return {}, better
    return profiles, None


def start_names(sweeps: Sequence[Measurement]) -> tuple[str, ...]:
    """What the start state of each sweep is called."""
    return ("s0",) if len(sweeps) == 1 else tuple(f"s0 of {sweep.name}" for sweep in sweeps)


def check_count(coordinates: Coordinates, sweeps: tuple[Measurement, ...]) -> None:
    """Refuse sweeps with no more points than there are unknowns."""
    unknowns, points = len(coordinates.free) + len(sweeps), sum(len(sweep.t) for sweep in sweeps)
    if points <= unknowns:
        listed = ", ".join((*coordinates.names, *start_names(sweeps)))
        raise ParameterError(
            f"fit.measurements: expected more points than the {unknowns} unknowns of {coordinates.law.name} "
            f"({listed}), got {points}. Measure more points, or fix parameters."
        )


def _problem(coordinates: Coordinates, sweeps: tuple[Measurement, ...], scale: tuple[FloatArray, ...],
             substeps: int) -> Problem:  # fmt: skip
    features = Features.of(sweeps)
    low, high = coordinates.bounds(features)
    ends = np.zeros(len(sweeps)), np.ones(len(sweeps))
    shooting = Shooting(coordinates, sweeps, scale, substeps=substeps)
    regression = Shooting(coordinates, sweeps, scale, substeps=substeps, follow=True)
    return Problem(
        coordinates=coordinates, features=features, shooting=shooting,
        regression=regression if shooting.follows_current else None,
        low=np.concatenate([low, ends[0]]), high=np.concatenate([high, ends[1]]),
    )  # fmt: skip


def _refine(problem: Problem, tried: tuple[Start, ...]) -> tuple[Problem, FloatArray, tuple[Start, ...], float]:
    """The best of the starts; all are solved again with twice the substeps until the integrator's error is small."""
    while True:
        best = min(tried, key=lambda start: start.after)
        z = problem.polish(np.array(best.coordinates))
        substeps = problem.shooting.substeps
        finer = _problem(problem.coordinates, problem.shooting.sweeps, problem.shooting.sizes, 2 * substeps)
        change = finer.shooting.residual(z) - problem.shooting.residual(z)
        own = float(np.sqrt(change @ change))
        if own <= max(INTEGRATION_SHARE * problem.error(z), SMALLEST_ERROR) or substeps >= MOST_SUBSTEPS:
            return problem, z, tried, own
        problem, tried = finer, tuple(resolved(finer, start) for start in tried)


def _result(problem: Problem, z: FloatArray, tried: tuple[Start, ...], uncertainty: Uncertainty,
            names: tuple[str, ...], profiles: dict[str, ProfileResult], held_out: tuple[Measurement, ...],
            settings: dict[str, Any], integration_error: float, name: str | None) -> Fit:  # fmt: skip
    coordinates, sweeps = problem.coordinates, problem.shooting.sweeps
    values = coordinates.values(z)
    intervals = _intervals(coordinates, z, uncertainty, names, profiles)
    fitted = tuple(_sweep(problem.shooting, z, k, interval=intervals[names[len(coordinates.free) + k]],
                          uncertainty=uncertainty) for k in range(len(sweeps)))  # fmt: skip
    predicted = tuple(_predict(problem, z, sweep) for sweep in held_out)
    unknowns, n_eff = len(names), sum(uncertainty.n_eff)
    # Information criteria of a Gaussian residual with unknown variance, on the effective number of points.
    likelihood = n_eff * math.log(max(problem.error(z) ** 2, 1e-300))
    data = tuple(DataFile(file=sweep.file, sha256=sweep.sha256) for sweep in sweeps if sweep.sha256)
    card = _card(problem, values, intervals, profiles, data, settings, name)
    found = Fit(
        card=write_card(card), law=coordinates.law.name, fitted=coordinates.names, held=dict(coordinates.held),
        relative_rms=root_mean([sweep.relative_rms for sweep in fitted]),
        intervals={key: intervals[key] for key in coordinates.names},
        at_bound=tuple(key for key, stuck in zip(names, uncertainty.is_at_bound, strict=True) if stuck),
        condition=uncertainty.condition if math.isfinite(uncertainty.condition) else None,
        weakest={key: float(share) for key, share in zip(names, uncertainty.weakest, strict=True)},
        correlation=_correlation(coordinates, uncertainty), n_eff=n_eff, aic=likelihood + 2 * unknowns,
        bic=likelihood + unknowns * math.log(max(n_eff, 1.0)), sweeps=fitted, holdout=predicted,
        starts=tuple(StartResult(origin=s.origin, before=s.before, after=s.after, evaluations=s.evaluations,
                                 has_converged=s.has_converged, parameters=coordinates.values(s.coordinates))
                     for s in tried),
        profiles=profiles, substeps=problem.shooting.substeps, integration_error=integration_error, warnings=(),
        provenance={"ohmloom": version("ohmloom"), **settings,
                    "data": [{"name": s.name, "file": s.file, "sha256": s.sha256, "points": len(s.t)}
                             for s in (*sweeps, *held_out)]},
    )  # fmt: skip
    return found.model_copy(update={"warnings": tuple(warnings_for(found))})


def _intervals(coordinates: Coordinates, z: FloatArray, uncertainty: Uncertainty, names: tuple[str, ...],
               profiles: dict[str, ProfileResult]) -> dict[str, tuple[float, float] | None]:  # fmt: skip
    """95 % interval by name: from the profile where there is one, else from the covariance."""
    n = len(coordinates.free)
    transform = np.eye(len(z))
    transform[:n, :n] = coordinates.transform()
    found: dict[str, tuple[float, float] | None] = {}
    values = coordinates.values(z)
    for k, key in enumerate(names):
        if key in profiles:
            found[key] = None if all(profiles[key].is_open) else profiles[key].interval
            continue
        row = transform[k]
        with np.errstate(invalid="ignore"):
            variance = float(row @ uncertainty.covariance @ row)
        if uncertainty.is_at_bound[k] or not math.isfinite(variance):
            found[key] = None
            continue
        half = uncertainty.quantile * math.sqrt(variance)
        if k >= n:
            found[key] = (max(float(z[k] - half), 0.0), min(float(z[k] + half), 1.0))
            continue
        parameter, value = coordinates.free[k], values[key]
        low, high = (value * math.exp(-half), value * math.exp(min(half, 700.0))) if parameter.scale == "log" else (
            value - half, value + half)  # fmt: skip
        found[key] = (float(max(low, parameter.lower)), float(min(high, parameter.upper)))
    return found


def _correlation(coordinates: Coordinates, uncertainty: Uncertainty) -> tuple[tuple[float, ...], ...]:
    n, transform = len(coordinates.free), coordinates.transform()
    covariance = transform @ np.nan_to_num(uncertainty.covariance[:n, :n], posinf=0.0) @ transform.T
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    outer = np.outer(deviation, deviation)
    matrix = np.divide(covariance, outer, out=np.zeros_like(covariance), where=outer > 0.0)
    return tuple(tuple(row) for row in matrix.tolist())


def _sweep(shooting: Shooting, z: FloatArray, k: int, *, interval: tuple[float, float] | None,
           uncertainty: Uncertainty | None) -> SweepResult:  # fmt: skip

    sweep, current, states = shooting.sweeps[k], shooting.current(z, k), shooting.state(z, k)
    residual = (current - sweep.i) / shooting.sizes[k]
    lag1 = lag_one(residual) if uncertainty is None else uncertainty.lag1[k]
    return SweepResult(
        name=sweep.name, file=sweep.file, sha256=sweep.sha256, frequency=sweep.frequency,
        series_resistance=sweep.series_resistance,
        relative_rms=float(np.sqrt(np.mean((current - sweep.i) ** 2) / np.mean(sweep.i**2))),
        s0=float(z[shooting.parameters + k]), s0_interval=interval, lag1=lag1,
        n_eff=len(sweep.t) * (1.0 - lag1) / (1.0 + lag1), at_lower_wall=float(np.mean(states <= WALL)),
        at_upper_wall=float(np.mean(states >= 1.0 - WALL)), zero_offset=sweep.zero_offset(),
        revisit=charge_revisit(sweep).verdict, t=tuple(sweep.t.tolist()), v=tuple(sweep.device_voltage.tolist()),
        i=tuple(sweep.i.tolist()), i_fit=tuple(current.tolist()), s=tuple(states.tolist()),
    )  # fmt: skip


def _predict(problem: Problem, z: FloatArray, sweep: Measurement) -> SweepResult:
    """A hold-out sweep: the parameters as fitted, the start state alone free."""
    n = len(problem.coordinates.free)
    one = _problem(problem.coordinates, (sweep,), sizes((sweep,), "relative"), problem.shooting.substeps)

    def error(s0: float) -> float:
        return one.error(np.concatenate([z[:n], [s0]]))

    from scipy.optimize import minimize_scalar

    grid = sorted(STATES, key=error)
    k = STATES.index(grid[0])
    low_state = 0.0 if k == 0 else STATES[k - 1]
    high_state = 1.0 if k == len(STATES) - 1 else STATES[k + 1]
    found = minimize_scalar(error, bounds=(low_state, high_state), method="bounded", options={"xatol": 1e-6})
    s0 = min((float(found.x), 0.0, 1.0), key=error)
    return _sweep(one.shooting, np.concatenate([z[:n], [s0]]), 0, interval=None, uncertainty=None)


def _card(problem: Problem, values: Mapping[str, float], intervals: Mapping[str, tuple[float, float] | None],
          profiles: Mapping[str, ProfileResult], data: tuple[DataFile, ...], settings: dict[str, Any],
          name: str | None) -> Card:  # fmt: skip
    coordinates, sweeps = problem.coordinates, problem.shooting.sweeps
    listed = ", ".join(sweep.file or sweep.name for sweep in sweeps)
    entries, units = [], {p.name: p.unit for p in coordinates.law.parameters}
    for key, value in values.items():
        if key in coordinates.names:
            interval, profile = intervals[key], profiles.get(key)
            is_open = profile is not None and any(profile.is_open)
            inside = None if interval is None or is_open else (min(interval[0], value), max(interval[1], value))
            known = f"; {limits_in_words(profile, units[key])}" if profile is not None and is_open else ""
            entries.append(CardValue(value=float(value), source=f"fitted to {listed}{known}", interval=inside))
        else:
            how = "fixed in the fit" if key in settings["fixed"] else "the law's default, held in the fit"
            entries.append(CardValue(value=float(value), source=how))
    law = coordinates.law.name
    return Card(name=name or f"{law}_{sweeps[0].name}", law=law, source=f"{law} fitted to {listed}",
                values=tuple(entries), data=data)  # fmt: skip
