"""What a reader of a fit must be told, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

from ohmloom.devices.fitting.result import Fit
from ohmloom.devices.laws import LAWS
from ohmloom.units import format_quantity

ILL_CONDITIONED = 1e4
FEW_POINTS = 10.0  # effective points for each unknown
USELESS = 0.5
LARGE_OFFSET = 0.01
POOR_HOLDOUT = 2.0
SAME = 1.05  # a start within 5 % of the best reached it
SHARE = 0.2  # smallest share of a direction that is worth naming


def warnings_for(fit: Fit) -> Iterator[str]:
    """Warnings, the gravest first."""
    if fit.relative_rms > USELESS:
        yield (f"{fit.law} does not describe {_sweeps(fit)}: its error is {fit.relative_rms:.0%} of the current. "
               "Compare other laws, and check units, times and the sign of the current.")  # fmt: skip
    yield from _undetermined(fit)
    yield from _at_bounds(fit)
    yield from _trade_off(fit)
    yield from _residual(fit)
    yield from _starts(fit)
    yield from _data(fit)


def _value(fit: Fit, name: str, value: float) -> str:
    units = {p.name: p.unit for p in LAWS[fit.law].parameters}
    return f"{value:.3g}" if name not in units else format_quantity(value, units[name], 3)


def _sweeps(fit: Fit) -> str:
    return "this sweep" if len(fit.sweeps) == 1 else "these sweeps"


def _undetermined(fit: Fit) -> Iterator[str]:
    for name, profile in fit.profiles.items():
        low, high = (_value(fit, name, end) for end in profile.interval)
        below, above = profile.is_open
        if below and above:
            yield f"{name} is not determined by {_sweeps(fit)}: any value from {low} to {high} fits as well."
        elif below:
            yield f"{name} has no lower limit in {_sweeps(fit)}: any value below {high} fits as well."
        elif above:
            yield f"{name} has no upper limit in {_sweeps(fit)}: any value above {low} fits as well."


def _at_bounds(fit: Fit) -> Iterator[str]:
    for name in fit.at_bound:
        if name in fit.profiles and any(fit.profiles[name].is_open):
            continue
        yield (f"{name} ended at a bound of the search: the law may be the wrong one, or a unit. "
               "Its value is not an estimate.")  # fmt: skip


def _trade_off(fit: Fit) -> Iterator[str]:
    if fit.condition is not None and fit.condition < ILL_CONDITIONED:
        return
    parts = sorted(((abs(share), name, share) for name, share in fit.weakest.items()), reverse=True)
    shown = " ".join(f"{share:+.2f} {name}" for size, name, share in parts if size >= SHARE)
    size = "infinite" if fit.condition is None else f"{fit.condition:.1e}"
    yield (f"The data hardly see one combination of the unknowns, {shown} (logarithms; condition number {size}): "
           "along it they may all be wrong together.")  # fmt: skip


def _residual(fit: Fit) -> Iterator[str]:
    unknowns, points = len(fit.fitted) + len(fit.sweeps), sum(len(sweep.t) for sweep in fit.sweeps)
    largest = max(sweep.lag1 for sweep in fit.sweeps)
    worth = "Intervals are wide for that" if fit.n_eff >= unknowns else "Intervals from so few mean little"
    if fit.n_eff < FEW_POINTS * unknowns and largest > 0.5:
        yield (f"The residual is mostly error of the law, not noise: it is correlated from sample to sample (lag-1 "
               f"{largest:.2f}), so that {points} points count as {fit.n_eff:.3g} for {unknowns} unknowns. {worth}; "
               "choose between laws by hold-out sweeps.")  # fmt: skip
    if fit.integration_error > 0.1 * fit.relative_rms > 0.0:
        yield (f"The integrator's own error is {fit.integration_error / fit.relative_rms:.0%} of the residual at "
               f"{fit.substeps} steps per sample: give the sweep finer time steps.")  # fmt: skip


def _starts(fit: Fit) -> Iterator[str]:
    best = min(start.after for start in fit.starts)
    reached = sum(start.after <= SAME * best for start in fit.starts)
    if reached == 1 and len(fit.starts) > 1:
        yield (f"Only 1 of {len(fit.starts)} starts reached this fit, so a better one may exist: "
               "raise starts and screen.")  # fmt: skip
    if not any(start.has_converged and start.after <= SAME * best for start in fit.starts):
        yield "The search stopped before it converged: raise starts and screen, or fix parameters that are known."


def _data(fit: Fit) -> Iterator[str]:
    for sweep in (*fit.sweeps, *fit.holdout):
        if sweep.zero_offset is not None and abs(sweep.zero_offset) > LARGE_OFFSET:
            yield (f"{sweep.name} is not pinched: at v = 0 its current is {sweep.zero_offset:+.1%} of the largest "
                   "(capacitance, an electrochemical voltage, or an instrument's offset), which no "
                   "law has.")  # fmt: skip
    if not fit.holdout and len(fit.sweeps) == 1:
        yield ("Fitted to one sweep, and nothing held out: at another frequency or amplitude the error can be ten "
               "times larger. Hold out a second sweep.")  # fmt: skip
    for sweep in fit.holdout:
        if sweep.relative_rms > POOR_HOLDOUT * fit.relative_rms > 0.0:
            yield (f"{sweep.name}, held out, is predicted {sweep.relative_rms / fit.relative_rms:.1f} times worse than "
                   f"the fit ({sweep.relative_rms:.3f} against {fit.relative_rms:.3f}): it does not "
                   "carry over.")  # fmt: skip
