"""What a fit found: parameters, how sure they are, how well each sweep is met, and what a reader must be told."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pydantic

from ohmloom._files import StrictModel, advise, check_format, parse_json, read_bytes, validate, write_atomic
from ohmloom.devices.card import parse_card
from ohmloom.devices.device import Device
from ohmloom.devices.fitting._search import Origin
from ohmloom.devices.laws import LAWS
from ohmloom.errors import FileFormatError, expect_integer
from ohmloom.units import axis_unit, format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMAT, VERSION = "ohmloom.fit", 1
LARGEST_FILE = 1_000_000_000  # bytes: a fit holds its curves

# JSON has lists only; in memory they are tuples, so that a frozen model is frozen.
Numbers = Annotated[tuple[float, ...], pydantic.Strict(False)]
Words = Annotated[tuple[str, ...], pydantic.Strict(False)]
Pair = Annotated[tuple[float, float], pydantic.Strict(False)]


class StartResult(StrictModel):
    """One start of the search, and where its local solution ended.

    ``origin``: "screened" (a random start that did well at once), "nominal" (sizes read from the data), "regression"
    (solved first with the measured current moving the state) or "profile" (met on the way of a profile, which went
    lower than the fit that it began from). ``before``, ``after``: relative RMS. ``parameters``: where it ended, SI.
    """

    origin: Origin
    before: float
    after: float
    evaluations: int
    has_converged: bool
    parameters: dict[str, float]


class SweepResult(StrictModel):
    """One sweep beside its fit, axes (time,), SI.

    Attributes
    ----------
    name, file, sha256
        As in the `Measurement`.
    relative_rms
        ``rms(i_fit - i)/rms(i)``.
    s0, s0_interval
        State at the sweep's start, fitted for each sweep; its 95 % interval, or None for a hold-out sweep.
    lag1, n_eff
        Lag-1 autocorrelation of the residual, and what the samples count as: ``N (1 - rho)/(1 + rho)``.
    at_lower_wall, at_upper_wall
        Share of the samples whose state rests on a wall.
    zero_offset
        Measured current at v = 0 over the largest current, or None if the voltage is never zero; no law has one.
    revisit
        The charge-revisit test's verdict on this sweep, in words.
    t, v, i, i_fit, s
        Time, device voltage and current as measured; current and state of the fit.
    """

    name: str
    file: str
    sha256: str
    frequency: float | None
    series_resistance: float
    relative_rms: float
    s0: float
    s0_interval: Pair | None
    lag1: float
    n_eff: float
    at_lower_wall: float
    at_upper_wall: float
    zero_offset: float | None
    revisit: str
    t: Numbers
    v: Numbers
    i: Numbers
    i_fit: Numbers
    s: Numbers


class ProfileResult(StrictModel):
    """Profile likelihood of one parameter: the smallest relative RMS for each of its values.

    ``is_open``: whether no 95 % limit was found below, above, within the range that was searched; ``limit`` is the
    relative RMS at the 95 % limit.
    """

    values: Numbers
    relative_rms: Numbers
    limit: float
    interval: Pair
    is_open: Annotated[tuple[bool, bool], pydantic.Strict(False)]


class Fit(StrictModel):
    """A law fitted to one or more sweeps; made by `fit`.

    Attributes
    ----------
    card
        Text of the fitted device's card; `device` is the device itself.
    law
        Name of the law.
    fitted, held
        Names of the fitted parameters; values of the others, SI.
    relative_rms
        Root of the mean over the sweeps of the squared relative RMS.
    intervals
        95 % interval of each fitted parameter, SI; corrected for autocorrelated residuals. None where the parameter
        is at a bound, or where the data say nothing of it.
    at_bound
        Names of parameters (and of start states, as "s0" or "s0 of <sweep>") that ended at a bound of the search.
    condition
        Condition number of the Jacobian in logarithms (or values, on a linear scale); None if it is not finite.
    weakest
        Direction of the smallest singular value: share by name, in logarithms (or values).
    correlation
        Of the fitted parameters, axes (parameter, parameter); zeros where a parameter is at a bound.
    n_eff
        Sum over the sweeps.
    aic, bic
        On n_eff, with a term for each fitted parameter and each start state.
    sweeps, holdout
        What was fitted, and what was only predicted: there the start state alone is fitted.
    starts
        Every start of the search, in order.
    profiles
        By name; those asked for, and those that were needed to tell how far a parameter is determined.
    substeps, integration_error
        Steps of the integrator per sample, and the relative RMS by which twice as many would change the current.
    warnings
        What a reader must know, as sentences.
    provenance
        Versions, settings and data digests that made this fit.
    """

    card: str
    law: str
    fitted: Words
    held: dict[str, float]
    relative_rms: float
    intervals: dict[str, Pair | None]
    at_bound: Words
    condition: float | None
    weakest: dict[str, float]
    correlation: Annotated[tuple[Numbers, ...], pydantic.Strict(False)]
    n_eff: float
    aic: float
    bic: float
    sweeps: Annotated[tuple[SweepResult, ...], pydantic.Strict(False)]
    holdout: Annotated[tuple[SweepResult, ...], pydantic.Strict(False)]
    starts: Annotated[tuple[StartResult, ...], pydantic.Strict(False)]
    profiles: dict[str, ProfileResult]
    substeps: int
    integration_error: float
    warnings: Words
    provenance: dict[str, Any]

    @property
    def device(self) -> Device:
        """The fitted device: values with intervals, sources and the data's digests."""
        card = parse_card(self.card.encode(), "fit.json: card")
        return Device(name=card.name, law=card.law, source=card.source, values=card.values, data=card.data)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the fitted parameters, SI, by name."""
        values = self.device.parameters
        return {name: values[name] for name in self.fitted}

    @property
    def holdout_rms(self) -> float | None:
        """Root of the mean over the hold-out sweeps of the squared relative RMS; None without any."""
        return root_mean([sweep.relative_rms for sweep in self.holdout]) if self.holdout else None

    def plot(self, ax: Axes | None = None, sweep: int = 0) -> Axes:
        """Draw one sweep's loop as measured and as fitted: current over device voltage; returns the axes."""
        if ax is None:
            from matplotlib.figure import Figure

            ax = Figure(layout="constrained").subplots()
        curves = (*self.sweeps, *self.holdout)
        curve = curves[expect_integer("Fit.plot: sweep", sweep, 0, len(curves) - 1)]
        measured, fitted = np.array(curve.i), np.array(curve.i_fit)
        # The fit has a device voltage of its own, behind the resistor: without the measured current's noise.
        own = np.array(curve.v) + curve.series_resistance * (measured - fitted)
        factor, unit = axis_unit(float(np.abs(measured).max()), "A")
        ax.plot(curve.v, measured / factor, ".", markersize=3, label="measured")
        ax.plot(own, fitted / factor, label=f"{self.law}, {curve.relative_rms:.1%}")
        ax.set_xlabel("device voltage [V]")
        ax.set_ylabel(f"current [{unit}]")
        ax.legend()
        return ax

    def save(self, path: str | Path) -> None:
        """Write everything as JSON; the same fit always gives the same bytes."""
        table = {"format": FORMAT, "version": VERSION, **self.model_dump(mode="json")}
        write_atomic(path, json.dumps(table, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Fit:
        """Read what `save` wrote.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FileFormatError
            If it is damaged or no fit.
        """
        where = str(path)
        table = check_format(parse_json(read_bytes(path, "fit", limit=LARGEST_FILE), where), where, FORMAT, VERSION)
        try:
            loaded = validate(cls, table, where)
            parse_card(loaded.card.encode(), f"{where}: card")
        except FileFormatError as error:
            raise FileFormatError(*advise(error.problems, "Fit again.")) from error
        return loaded

    def summary(self) -> str:
        """The fit in words and numbers, for a terminal."""
        units = {p.name: p.unit for p in LAWS[self.law].parameters}
        lines = [f"{self.law}: relative RMS {self.relative_rms:.4f} ({len(self.sweeps)} sweeps)"
                 if len(self.sweeps) > 1 else f"{self.law}: relative RMS {self.relative_rms:.4f}"]  # fmt: skip
        for name, value in self.parameters.items():
            mark = "  at a bound" if name in self.at_bound else ""
            shown = _interval(self.intervals[name], self.profiles.get(name), units[name])
            lines.append(f"  {name:10} {format_quantity(value, units[name], 4):>14}  {shown}{mark}")
        for name, value in self.held.items():
            lines.append(f"  {name:10} {format_quantity(value, units[name], 4):>14}  held")
        for sweep in self.sweeps:
            interval = "" if sweep.s0_interval is None else f" [{sweep.s0_interval[0]:.3g}, {sweep.s0_interval[1]:.3g}]"
            lines.append(f"  {sweep.name}: relative RMS {sweep.relative_rms:.4f}, "
                         f"s0 = {round(sweep.s0, 9):.3g}{interval}, "
                         f"N_eff = {sweep.n_eff:.3g} of {len(sweep.t)}")  # fmt: skip
        for sweep in self.holdout:
            lines.append(f"  {sweep.name} (held out): relative RMS {sweep.relative_rms:.4f}, s0 = {sweep.s0:.3g}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        lines = [*self.summary().splitlines(), *(f"warning: {text}" for text in self.warnings)]
        return "<pre>" + "\n".join(html.escape(line) for line in lines) + "</pre>"


def root_mean(errors: list[float]) -> float:
    """Root of the mean of squares."""
    return float(np.sqrt(np.mean(np.square(errors))))


def limits_in_words(profile: ProfileResult, unit: str) -> str:
    """The 95 % limits of a profile: both, one, or none."""
    low, high = (format_quantity(end, unit, 4) for end in profile.interval)
    below, above = profile.is_open
    if below and above:
        return "not determined"
    if below:
        return f"95 % below {high}"
    return f"95 % above {low}" if above else f"95 % [{low}, {high}] by profile"


def _interval(interval: Pair | None, profile: ProfileResult | None, unit: str) -> str:
    if profile is not None:
        return limits_in_words(profile, unit)
    if interval is None:
        return "not determined"
    low, high = (format_quantity(end, unit, 4) for end in interval)
    return f"95 % [{low}, {high}]"
