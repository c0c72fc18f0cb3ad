"""Figures of the arrays: wires, what unused devices do, how far an event reaches, thresholds, disturbs, yield."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.devices import Device
from ohmloom.mapping import Hardware, Ledger, Plan, Quantity, plan_yield
from ohmloom.mapping.plan_yield import FAULTS
from ohmloom.neurocontroller.kinds import MEM_LIFETIME, PLASTIC_KINDS
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP
from ohmloom.sim.figures import ASSUMED, DESIGN_SOURCE, NOT_RUN, PASS, Figure, formula_figure
from ohmloom.units import format_quantity

READ_ERROR_LIMIT = 0.01
WAKE_UP_LIMIT = 0.05  # of full scale: half of what one disabled device in ten would add to a column
USEFUL_RANGE = 0.9  # of W, Section V: "90% of the total range of W within 90 STDP steps"
MISFIRES_LIMIT = 1.0  # per trial
DISTURB_LIMIT = 1.0  # events per device and trial
YIELD_LIMIT = 0.8  # of dies: one in five may be thrown away; a margin of 20 % then stands for 0.96
YIELD_STREAM = 101  # beside START_STREAM
YIELD_DIES = 400


def read_error(hardware: Hardware, plan: Plan) -> Figure:
    """Worst share of the read voltage that a device does not see, with all rows driven and every plastic device at
    G_on."""
    found = {tile.name: tile.read_error.built for tile in plan.tiles if tile.read_error is not None}
    worst = max(found, key=lambda name: found[name]) if found else None
    own = hardware.limits.read_error
    limit = Quantity(value=READ_ERROR_LIMIT, source=DESIGN_SOURCE) if own is None else own
    inputs = {f"wires.{name}": q for name in ("r_row", "r_column") if (q := getattr(hardware.wires, name)).value > 0.0}
    nominal = 0.0 if worst is None else found[worst]

    def value(at: Mapping[str, float]) -> float:
        # Of first order the error goes with the resistance, and it never exceeds 1.
        scale = sum(at.values()) / sum(q.value for q in inputs.values()) if inputs else 1.0
        return nominal * scale / (1.0 - nominal + nominal * scale)

    detail = "no device, or no wire resistance, so nothing drops." if nominal == 0.0 else (
        f"IR drop at the worst crosspoint of the tile {worst}, all rows read at once and every plastic device at G_on."
    )  # fmt: skip
    return formula_figure("read_error", value, "1", limit, inputs, detail, low_is_good=True)


def wake_up(hardware: Hardware, disabled_weights: FloatArray) -> Figure:
    """Mean weight that devices at crosspoints without a synapse have at the end of a trial."""
    own = hardware.limits.wake_up
    limit = Quantity(value=WAKE_UP_LIMIT, source=DESIGN_SOURCE) if own is None else own
    value = float(disabled_weights.mean()) if disabled_weights.size else 0.0
    what = hardware.array.disabled
    detail = (f"{disabled_weights.size} disabled devices that are {what} conduct with a mean W of {value:.3g} after "
              "a trial."
              if disabled_weights.size else f"disabled crosspoints are {what}, so none conducts or "
                                            "learns.")  # fmt: skip
    return formula_figure("wake_up", lambda _: value, "1", limit, {}, detail, low_is_good=True)


def useful_events(device: Device, *, is_referenced: bool) -> float:
    """Least number of events that moves W by 0.9.

    A memristive card of ratio 100 has 90.9 of them, the paper's "90 STDP steps" (Section V).
    """
    s = np.linspace(0.0, 1.0, 1_000_001)
    w = np.asarray(device.weight(s), dtype=np.float64)
    if is_referenced:
        w = (w - w[0]) / (w[-1] - w[0])
    if w[-1] - w[0] < USEFUL_RANGE:
        return 0.0
    reached = np.interp(w + USEFUL_RANGE, w, s, right=np.inf)
    return float((reached - s).min() * MEM_LIFETIME)


def useful_event_range(hardware: Hardware, plan: Plan) -> Figure:
    """Smallest useful range among the plastic kinds of the plan."""
    found = {
        tile.kind: useful_events(hardware.devices[tile.kind], is_referenced=tile.has_reference)
        for tile in plan.tiles
        if tile.kind in PLASTIC_KINDS
    }
    limit = hardware.limits.useful_event_range
    if not found:
        return Figure(name="useful_event_range", value=None, unit="events", limit=limit.value if limit else None,
                      margin=None, source=limit.source if limit else "no limit in the spec", status=PASS,
                      detail="no plastic synapse, so no event has to fit.")  # fmt: skip
    kind = min(found, key=lambda k: found[k])
    detail = "events that move W by 0.9: " + ", ".join(f"{k} {v:.1f}" for k, v in found.items()) + "."
    return formula_figure("useful_event_range", lambda _: found[kind], "events", limit, {}, detail, low_is_good=False)


def threshold_margin(hardware: Hardware, ledger: Ledger) -> Figure:
    """Expected events of a trial that are lost, or written where none is asked for, at the spread of thresholds.

    Of an event that is asked for, the chance that its device's threshold lies above the pulse; of a pulse below the
    threshold, that it lies below that pulse. Wires are not in it: what they lose is in `event_fidelity`.
    """
    drive, spread = hardware.drive, hardware.nonidealities.threshold
    event, others = window(hardware)
    half_selects = {"row": ledger.half_selects_row, "column": ledger.half_selects_column,
                    "both": ledger.half_selects_both}  # fmt: skip
    inputs = {"drive.pulse_voltage": drive.pulse_voltage}
    if spread is not None:
        inputs["nonidealities.threshold"] = spread

    def value(at: Mapping[str, float]) -> float:
        scale = at["drive.pulse_voltage"] / drive.pulse_voltage.value
        sigma = at.get("nonidealities.threshold", 0.0) * drive.threshold.value
        lost = ledger.ideal_events * _above(drive.threshold.value, event * scale, sigma)
        return lost + sum(
            n * (1.0 - _above(drive.threshold.value, others[name] * scale, sigma)) for name, n in half_selects.items()
        )

    worst = max(others.values())
    seen = sum(half_selects.values())
    at = 0.0 if spread is None else spread.value
    # Devices that nobody selects see nothing, whatever the waveform's other levels are.
    rest = (f"{seen:,} pulses a trial below it see at most {format_quantity(worst, 'V')}" if seen
            else "no device but the selected one sees any voltage")  # fmt: skip
    detail = (
        f"an event sees {format_quantity(event, 'V')}, the threshold is {format_quantity(drive.threshold.value, 'V')} "
        f"with a spread of {at:.1%}, {ledger.ideal_events:,} events a trial; {rest}; the waveform's window is "
        f"{event / worst if worst else math.inf:.3g} to 1."
    )
    limit = Quantity(value=MISFIRES_LIMIT, source=DESIGN_SOURCE)
    return formula_figure("threshold_margin", value, "events", limit, inputs, detail, low_is_good=True)


def _above(threshold: float, voltage: float, sigma: float) -> float:
    """Chance that a threshold of this mean and spread is above a voltage."""
    if sigma == 0.0:
        return float(threshold > voltage)
    return 0.5 * math.erfc((voltage - threshold) / (math.sqrt(2.0) * sigma))


def window(hardware: Hardware) -> tuple[float, dict[str, float]]:
    """What an event puts on a device, and the largest voltage below the threshold with a level on the row only, the
    column only, or both [V]."""
    waveform, threshold = hardware.drive.volts, hardware.drive.threshold.value
    others = {"row": 0.0, "column": 0.0, "both": 0.0}
    for phase in waveform.phases:
        for row in phase.row:
            for column in phase.column:
                seen = abs(column - row)
                if seen <= threshold:
                    name = "both" if row and column else "row" if row else "column"
                    others[name] = max(others[name], seen)
    return waveform.event, others


def disturb(hardware: Hardware, plan: Plan, ledger: Ledger, spikes: IntArray) -> Figure:
    """Events' worth that half-selects and reads move a device in a trial.

    Reads are those of the busiest sender; half-selects, of which the ledger has the sum, are the mean of all devices.

    Parameters
    ----------
    hardware, plan, ledger
        What is built of what, and what the nominal die spent.
    spikes
        Axes (timestep, neuron), of the trial, or of its beginning if the ledger has more steps.
    """
    half, read = hardware.nonidealities.half_select, hardware.nonidealities.read_disturb
    half_selects = ledger.half_selects_row + ledger.half_selects_column + ledger.half_selects_both
    per_device = half_selects / max(len(plan.crosspoints), 1)
    senders = sorted({s.pre for s in plan.network.synapses if s.kind in PLASTIC_KINDS})
    seen = int(spikes[:, senders].sum(axis=0).max(initial=0)) if senders and len(spikes) else 0
    reads = seen * ledger.steps // max(len(spikes) * STEPS_PER_TIMESTEP, 1)
    given = {"nonidealities.half_select": half, "nonidealities.read_disturb": read}
    inputs = {name: q for name, q in given.items() if q is not None}

    def value(at: Mapping[str, float]) -> float:
        return per_device * at.get("nonidealities.half_select", 0.0) + reads * at.get("nonidealities.read_disturb", 0.0)

    counts = {"nonidealities.half_select": per_device, "nonidealities.read_disturb": float(reads)}
    silent = [name for name, n in counts.items() if n > 0.0 and given[name] is None]
    detail = f"{per_device:,.0f} half-selects of a mean device and {reads:,} reads of the busiest one in a trial."
    limit = Quantity(value=DISTURB_LIMIT, source=DESIGN_SOURCE)
    figure = formula_figure("disturb", value, "events", limit, inputs, detail, low_is_good=True)
    if not silent or not hardware.assumptions():
        return figure
    budget = " and ".join(f"{name} up to {1.0 / counts[name]:.2g} of an event" for name in silent)
    return replace(figure, status=ASSUMED if figure.status == PASS else figure.status,
                   detail=f"{detail} The spec is silent on some, and the limit would stand {budget}.")  # fmt: skip


def yield_(hardware: Hardware, plan: Plan, *, seed: int, dies: int) -> Figure:
    """Share of dies of which every synapse stands on a working device, after repair; a lower bound."""
    own = hardware.limits.yield_
    limit = Quantity(value=YIELD_LIMIT, source=DESIGN_SOURCE) if own is None else own
    given = [q for fault in FAULTS if (q := getattr(hardware.nonidealities, fault)) is not None]
    if not any(q.value > 0.0 for q in given):
        is_silent = not given and bool(hardware.assumptions())
        detail = "no fault is declared, so every device works." + (
            " The curves say what faults would cost." if is_silent else ""
        )
        figure = formula_figure("yield", lambda _: 1.0, "1", limit, {}, detail, low_is_good=False)
        return replace(figure, status=ASSUMED) if is_silent else figure
    if dies == 0:
        return Figure(name="yield", value=None, unit="1", limit=limit.value, margin=None, source=limit.source,
                      status=NOT_RUN, detail="no die was sampled; run with --dies.")  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(YIELD_STREAM,)))
    tiles = plan_yield(plan, dies=YIELD_DIES, rng=rng)
    found = math.prod(tile.repaired for tile in tiles)
    plain = math.prod(tile.plain for tile in tiles)
    detail = f"the product of {len(tiles)} tiles, {YIELD_DIES} samples of each; without repair {plain:.3g}."
    figure = formula_figure("yield", lambda _: found, "1", limit, {}, detail, low_is_good=False)
    # Repair is a heuristic, so more than this may work: what fails or passes by it rests on the declared rates.
    return replace(figure, status=ASSUMED) if any(q.is_assumed for q in given) and figure.status == PASS else figure
