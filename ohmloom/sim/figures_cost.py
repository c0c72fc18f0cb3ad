"""Figures of time, energy and wear: formulas of what trials spent and of the spec's quantities."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ohmloom.mapping import Hardware, Ledger, Quantity
from ohmloom.neurocontroller.readings import STEPS_PER_TIMESTEP
from ohmloom.sim.figures import PASS, Figure, formula_figure
from ohmloom.units import format_quantity

TIMESTEP = 0.032  # Section VIII-A
STEP_BUDGET = TIMESTEP / STEPS_PER_TIMESTEP
PARALLELISM = {
    "cell": "one cell at a time",
    "column": "one cell of every column at a time",
    "array": "all cells at once, first up and then down",
}


def time_per_step(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Reading and programming time of the worst step of all dies, against 32 ms / 21."""
    where = max(ledgers, key=lambda name: ledgers[name].worst_programming_time)
    ledger = ledgers[where]
    drive, read = hardware.drive, hardware.read
    columns = ledger.reading_time / read.duration.value
    inputs = {"read.duration": read.duration}
    if drive.mode == "charge_metered":
        inputs["drive.pulse_voltage"] = drive.pulse_voltage

    def value(at: Mapping[str, float]) -> float:
        # A metered pulse is as long as its charge takes, so its time goes with 1/V.
        voltage = at.get("drive.pulse_voltage", drive.pulse_voltage.value)
        return columns * at["read.duration"] + ledger.worst_programming_time * drive.pulse_voltage.value / voltage

    limit = Quantity(value=STEP_BUDGET, source="Howard et al. 2012, Sections IV-A and VIII-A: 32 ms / 21 steps")
    detail = (
        f"the worst step, on {where}, reads for {format_quantity(ledger.reading_time, 's')} and programs for "
        f"{format_quantity(ledger.worst_programming_time, 's')} "
        f"(mean {format_quantity(ledger.mean_programming_time, 's')}), {PARALLELISM[drive.parallelism]}."
    )
    return formula_figure("time_per_step", value, "s", limit, inputs, detail, low_is_good=True)


def _timesteps(ledger: Ledger) -> float:
    return max(ledger.steps / STEPS_PER_TIMESTEP, 1.0)


def _energy(hardware: Hardware, ledger: Ledger) -> tuple[Callable[[Mapping[str, float]], float], dict[str, Quantity]]:
    """Energy per timestep as a formula of the spec's quantities."""
    drive, read, neuron = hardware.drive, hardware.read, hardware.neuron
    inputs = {"read.voltage": read.voltage, "read.duration": read.duration}
    inputs["neuron.energy_per_spike"] = neuron.energy_per_spike
    if drive.mode == "charge_metered":
        inputs["drive.pulse_voltage"] = drive.pulse_voltage

    def value(at: Mapping[str, float]) -> float:
        voltage = at.get("drive.pulse_voltage", drive.pulse_voltage.value)
        programming = ledger.programming_energy * voltage / drive.pulse_voltage.value
        squared = (at["read.voltage"] / read.voltage.value) ** 2 * at["read.duration"] / read.duration.value
        spikes = ledger.spikes * at["neuron.energy_per_spike"]
        return (programming + ledger.read_energy * squared + spikes) / _timesteps(ledger)

    return value, inputs


def _hungriest(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> str:
    def per_timestep(name: str) -> float:
        energy, inputs = _energy(hardware, ledgers[name])
        return energy({key: quantity.value for key, quantity in inputs.items()})

    return max(ledgers, key=per_timestep)


def programming_power(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Mean power of devices and neurons over a trial, of the die that draws most, if every timestep takes 32 ms."""
    where = _hungriest(hardware, ledgers)
    ledger = ledgers[where]
    energy, inputs = _energy(hardware, ledger)
    per = {
        "programming": ledger.programming_energy,
        "reading": ledger.read_energy,
        "spikes": ledger.spikes * hardware.neuron.energy_per_spike.value,
    }
    shares = ", ".join(f"{name} {format_quantity(e / _timesteps(ledger), 'J')}" for name, e in per.items())
    detail = f"per timestep on {where}: {shares}; if it takes 32 ms; drivers and meters are not in it."
    limit = hardware.limits.programming_power
    return formula_figure(
        "programming_power", lambda at: energy(at) / TIMESTEP, "W", limit, inputs, detail, low_is_good=True
    )


def energy_per_timestep(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Energy of devices and neurons per timestep, of the die that draws most; its limit is that of the power."""
    where = _hungriest(hardware, ledgers)
    ledger = ledgers[where]
    energy, inputs = _energy(hardware, ledger)
    power = hardware.limits.programming_power
    limit = None
    if power is not None:
        spread = None if power.range is None else (power.range[0] * TIMESTEP, power.range[1] * TIMESTEP)
        limit = Quantity(value=power.value * TIMESTEP, source=power.source, range=spread)
    pulses = ledger.pulses / _timesteps(ledger)
    detail = f"{pulses:.0f} pulses per timestep on {where}; the limit is that of the power times 32 ms."
    return formula_figure("energy_per_timestep", energy, "J", limit, inputs, detail, low_is_good=True)


def _busiest(ledgers: Mapping[str, Ledger]) -> str:
    return max(ledgers, key=lambda name: ledgers[name].most_pulses)


def pulses_per_device(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Pulses that the busiest device of all dies gets in a trial."""
    where = _busiest(ledgers)
    ledger = ledgers[where]
    limit = None
    if hardware.limits.endurance is not None:
        pulses, trials = hardware.endurance.pulses, hardware.limits.endurance
        ends = [p / t for p in pulses.extremes for t in trials.extremes]
        sources = f"endurance.pulses ({pulses.source}) / limits.endurance ({trials.source})"
        is_assumed = pulses.is_assumed or trials.is_assumed
        limit = Quantity(
            value=pulses.value / trials.value, source=f"assumed: {sources}" if is_assumed else sources,
            range=(min(ends), max(ends)) if is_assumed else None,
        )  # fmt: skip
    detail = f"the busiest device, on {where}, in a trial of {_timesteps(ledger):.0f} executed timesteps."
    most = float(ledger.most_pulses)
    return formula_figure("pulses_per_device", lambda _: most, "pulses", limit, {}, detail, low_is_good=True)


def endurance(hardware: Hardware, ledgers: Mapping[str, Ledger]) -> Figure:
    """Trials until the busiest device has had the pulses it survives."""
    where = _busiest(ledgers)
    ledger = ledgers[where]
    if ledger.most_pulses == 0:
        limit = hardware.limits.endurance
        return Figure(name="endurance", value=None, unit="trials", limit=limit.value if limit else None, margin=None,
                      source=limit.source if limit else "no limit in the spec", status=PASS,
                      detail="no device is pulsed, so none wears out.")  # fmt: skip
    inputs = {"endurance.pulses": hardware.endurance.pulses}
    survives = hardware.endurance.pulses.value
    detail = f"the busiest device, on {where}, gets {ledger.most_pulses:,} pulses a trial and survives {survives:g}."
    return formula_figure(
        "endurance", lambda at: at["endurance.pulses"] / max(ledger.most_pulses, 1), "trials",
        hardware.limits.endurance, inputs, detail, low_is_good=False,
    )  # fmt: skip
