"""Figures of what the hardware does: events, weights, success, and what they are sensitive to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmloom.mapping import Hardware
from ohmloom.sim.agreement import Agreement
from ohmloom.sim.figures import (
    ASSUMED,
    DESIGN_SOURCE,
    FAIL,
    NON_INFERIORITY,
    NOT_RUN,
    PASS,
    Figure,
    margin_of,
    sampled_status,
    status_of,
)
from ohmloom.sim.statistics import Success, dies_needed, pairs_needed
from ohmloom.sim.writing import Writing

EVENT_FIDELITY_LIMIT = 0.001
DIVERGENCE_LIMIT = 0.02  # of W
PRECISION = 0.03  # of the success rate, for which the detail names a number of dies


def event_fidelity(hardware: Hardware, lost: int, spurious: int, ideal: int, dies: int) -> Figure:
    """Lost and spurious events as a fraction of those that eqs. 10 and 11 ask for."""
    if ideal == 0 and lost + spurious == 0:
        return Figure(name="event_fidelity", value=0.0, unit="1", limit=EVENT_FIDELITY_LIMIT, margin=1.0,
                      source=DESIGN_SOURCE, status=PASS,
                      detail="no STDP event was asked for, and none was written.")  # fmt: skip
    value = (lost + spurious) / max(ideal, 1)
    margin = margin_of(value, EVENT_FIDELITY_LIMIT, low_is_good=True)
    where = f"{dies} sampled dies" if dies else "the nominal die"
    detail = f"{lost} lost and {spurious} spurious of {ideal} events on {where}."
    return Figure(name="event_fidelity", value=value, unit="1", limit=EVENT_FIDELITY_LIMIT, margin=margin,
                  source=DESIGN_SOURCE, status=sampled_status(margin, hardware),
                  detail=detail)  # fmt: skip


def weight_divergence(check: Agreement, writing: Writing) -> Figure:
    """Worst root mean square difference of the weights from what the paper's rule makes of the same spikes, on the
    nominal die."""
    margin = margin_of(writing.worst, DIVERGENCE_LIMIT, low_is_good=True)
    of_kind = ", ".join(f"{kind} {value:.2g}" for kind, value in writing.worst_of.items())
    detail = (
        f"worst of {writing.timesteps} timesteps of the nominal die beside the paper's rule on the same spikes; by "
        f"kind: {of_kind or 'none is plastic'}. Each on its own spikes, the two end {check.final_rms:.2g} apart."
    )
    return Figure(name="weight_divergence", value=writing.worst, unit="1", limit=DIVERGENCE_LIMIT, margin=margin,
                  source=DESIGN_SOURCE, status=status_of(margin), detail=detail)  # fmt: skip


def sensitivity(found: Mapping[str, Any] | None) -> Figure:
    """Largest normalised mu* of the declared spreads; it has no limit and never binds."""
    name, unit, source = "sensitivity", "1", "no limit: a ranking binds nothing"
    if not found or not found["factors"]:
        detail = "not screened; run with --study full." if found is None else "no spread is declared, so none matters."
        return Figure(name=name, value=None if found is None else 0.0, unit=unit, limit=None, margin=None,
                      source=source, status=NOT_RUN if found is None else PASS, detail=detail)  # fmt: skip
    factors = found["factors"]
    total = sum(factor["mu_star"] for factor in factors)
    leaders = ", ".join(f"{factor['name']} {factor['mu_star']:.2g}" for factor in factors[:3])
    is_assumed = any(factor["source"].startswith("assumed") for factor in factors)
    return Figure(
        name=name, value=factors[0]["mu_star"] / total if total > 0.0 else 0.0, unit=unit, limit=None, margin=None,
        source=source, status=ASSUMED if is_assumed else PASS,
        detail=f"share of {factors[0]['name']} in all mu* of {found['output']}; mu* of the first three: {leaders}.",
    )  # fmt: skip


def closed_loop_success(hardware: Hardware, success: Success | None) -> Figure:
    """Lower 95 % bound of success on hardware minus success of the ideal controller."""
    name, unit, source = "closed_loop_success", "1", f"{DESIGN_SOURCE}: non-inferiority margin of 5 points"
    if success is None:
        return Figure(name=name, value=None, unit=unit, limit=NON_INFERIORITY, margin=None, source=source,
                      status=NOT_RUN, detail="no die was sampled; run with --dies.")  # fmt: skip
    low, high = success.interval
    margin = margin_of(low, NON_INFERIORITY, low_is_good=False)
    counts = (
        f"{round(success.hardware * success.n)} of {success.n} on hardware, {round(success.ideal * success.n)} ideal, "
        f"95 % interval of the difference {low:+.3f} to {high:+.3f}, p = {success.p:.3g} ({success.method})"
    )
    if success.ideal == 0.0:
        status, more = FAIL, "the ideal controller never reached the goal, so there is nothing that hardware could keep"
    elif margin >= 0.0:
        status, more = "", ""
    elif high < NON_INFERIORITY:
        status, more = FAIL, "the difference is beyond the margin"
    else:
        # Neither shown to be good enough nor shown not to be: more dies are needed, not another verdict.
        status = NOT_RUN
        needed = pairs_needed(success.only_hardware, success.only_ideal, success.n, NON_INFERIORITY)
        what = "dies" if success.dies == success.n else f"trials of {success.dies} dies"
        more = f"{success.n} {what} do not decide" + (f"; about {needed} would, at this rate" if needed else "")
    if 0.0 < success.hardware < 1.0:
        enough = dies_needed(success.hardware, PRECISION)
        low_rate, high_rate = success.hardware_interval
        counts += (f"; the rate on hardware is known to within {50 * (high_rate - low_rate):.0f} points, {enough} dies "
                   f"would give it to within {100 * PRECISION:.0f}")  # fmt: skip
    if status:
        margin_shown = margin if status == FAIL else None
        return Figure(name=name, value=low, unit=unit, limit=NON_INFERIORITY, margin=margin_shown, source=source,
                      status=status, detail=f"{counts}; {more}.")  # fmt: skip
    return Figure(name=name, value=low, unit=unit, limit=NON_INFERIORITY, margin=margin, source=source,
                  status=sampled_status(margin, hardware), detail=f"{counts}.")  # fmt: skip
