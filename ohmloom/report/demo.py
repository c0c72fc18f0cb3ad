"""Every piece once, on shipped inputs, computed in this run."""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.devices import Device, Measurement, fit
from ohmloom.errors import Interrupted
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import SpikingController, champion
from ohmloom.neurocontroller.rules import INPUTS
from ohmloom.report._page_run import die_run
from ohmloom.report.fit_output import save_fit
from ohmloom.report.map_output import save_map, study_map
from ohmloom.report.output import save_study
from ohmloom.report.replay import replay
from ohmloom.sim import EvolutionSettings, evolve, feasibility
from ohmloom.units import format_quantity

CHAMPION, HARDWARE, DIES, SEED = "HET", "het_mixed", 2, 1
# Of 0 to 399 one of those whose two starts lie nearest to the goal, for whole trials in little time, and one in which
# the wires' read error changes no spike: with others it does, as the report then says (with 85 from timestep 657 on).
STUDY_SEED = 182
EVOLUTION = EvolutionSettings(system="HET", repeats=1, population=12, generations=12, seed=SEED)
FIT = ("peo_pani_redox", "redox", "redox_staircase")
# Start and end of the state where each law is far from a plain resistor.
LOOPS = {"hp_tio2_10k": (0.1, 0.9), "peo_pani": (0.001, 0.1), "linear": (0.1, 0.9)}
PERIOD = 1.0


def run_demo(out: Path, *, say: Callable[[str], None]) -> None:
    """Run the whole road once and write its files to `out`; `say` gets a line per step."""
    started = time.monotonic()
    say("ohmloom demo: nothing is downloaded and nothing is opened. The first run also compiles, for a minute or so.")
    with _compiling() as compiled:
        _run_steps(out, say=say, compiled=compiled)
    say(f"done in {time.monotonic() - started:.0f} s; open {out / 'report.html'}")


@contextmanager
def _compiling() -> Iterator[Callable[[], None]]:
    """Compile the emulation in processes beside this one, into the cache; gives a function that waits for them."""
    # Without them the demo still works, and compiles when it gets there.
    children = [
        subprocess.Popen(
            [sys.executable, "-c", f"from ohmloom.report.demo import {job}; {job}()"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        for job in ("warm_emulation", "warm_models")
    ]  # fmt: skip

    def wait() -> None:
        for child in children:
            child.wait()

    try:
        yield wait
    finally:
        for child in children:
            child.kill()
            child.wait()


def warm_emulation() -> None:
    """One step of a die."""
    EmulatedController(place(champion(CHAMPION), Hardware.load(HARDWARE)).nominal()).spikes(np.zeros(INPUTS))


def warm_models() -> None:
    """One step of each discrete model that a die is compared with."""
    network, cards = champion(CHAMPION), Hardware.load(HARDWARE).devices
    for model in (
        SpikingController(network),
        SpikingController(network, cards=cards),
        SpikingController(network, cards=cards, plasticity="flux"),
    ):
        model.spikes(np.zeros(INPUTS))


def _run_steps(out: Path, *, say: Callable[[str], None], compiled: Callable[[], None]) -> None:
    say("1  devices: current and voltage of three cards")
    say(f"   {_loops(out / 'loops.png')}")

    law, sweep, held_out = FIT
    say(f"2  fit: {law} to the synthetic sweep {sweep}, {held_out} held out")
    fitted = fit(
        Measurement.read_csv(sweep), law, holdout=[Measurement.read_csv(held_out)], rng=np.random.default_rng(SEED)
    )
    card = save_fit(fitted, out / "fit")[0]
    say(f"   relative RMS {fitted.relative_rms:.3f}, held out {fitted.holdout_rms:.3f}; {card}, fit.png")
    for warning in fitted.warnings:
        say(f"   - {warning}")

    size = f"{EVOLUTION.population} {EVOLUTION.system} networks, {EVOLUTION.generations} generations"
    say(f"3  evolution: {size} (compiling)")
    with tempfile.TemporaryDirectory() as folder:
        try:
            outcome = evolve(EVOLUTION, out=Path(folder) / "run").repeats[0]
        except Interrupted as stop:
            # The folder that it could resume from goes with this block.
            raise KeyboardInterrupt from stop
        write_atomic(out / "evolved.net.json", outcome.network.read_bytes())
    say(f"   best fitness {outcome.best_fitness:.0f}; {out / 'evolved.net.json'}")

    network, hardware = champion(CHAMPION), Hardware.load(HARDWARE)
    say(f"4  mapping: the {CHAMPION} champion, {len(network.synapses)} synapses, on {HARDWARE}")
    paths = save_map(study_map(place(network, hardware)), out / "map")
    say(f"   {', '.join(str(path) for path in paths)}")

    say(f"5  evaluation: discrete beside emulated, every step of a trial, and {DIES} dies (compiling)")
    compiled()
    study = feasibility(network, hardware, dies=DIES, seed=STUDY_SEED)
    check = study.agreement
    assert check is not None
    found = "every spike is equal" if check.exact else f"first difference: {check.first_divergence}"
    say(f"   {check.ledger.steps} steps, {check.ledger.events} events: {found}, {check.ties} ties, "
        f"weights within {check.worst_weight_error:.1e}")  # fmt: skip
    network.save(out / f"{CHAMPION}.net.json")
    command = f"ohmloom evaluate {out / CHAMPION}.net.json --hardware {HARDWARE} --dies {DIES} --seed {STUDY_SEED}"
    run = die_run(study)
    save_study(study, out, command=command, has_figures=False, run=run)
    say(f"   verdict {study.verdict}")
    for reason in study.reasons:
        say(f"   - {reason}")

    say("6  replay: the emulated hardware drives the robot")
    trial = study.hardware_trial
    assert run is not None
    assert trial is not None
    for name in ("replay.html", "replay.png", "replay.gif"):
        replay(run.recording, run.arena, out / name)
    say(f"   {'goal reached' if trial.solved else 'goal not reached'} in {trial.timesteps} timesteps; "
        f"{out / 'replay.html'}, .png, .gif")  # fmt: skip


def _loops(path: Path) -> str:
    """Pinched loops under a sine that moves each device from s0 to s1 and back; what was drawn, in words."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), layout="constrained")
    spans = []
    for axes, (name, (s0, s1)) in zip(figure.subplots(1, len(LOOPS)), LOOPS.items(), strict=True):
        device = Device.load(name)
        # Half a sine of period T and amplitude V carries the flux V T / pi.
        amplitude = np.pi * (device.flux(s1) - device.flux(s0)) / PERIOD
        t = np.linspace(0.0, PERIOD, 401)
        trace = device.simulate(amplitude * np.sin(2 * np.pi * t / PERIOD), t, s0=s0)
        trace.plot(axes)
        axes.set_title(name)
        axes.locator_params(nbins=5)
        spans.append(f"{name} s = {s0:g} to {trace.s.max():.2g} at {format_quantity(amplitude, 'V')}")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Software": None})
    write_atomic(path, buffer.getvalue())
    return "; ".join(spans) + f"; {path}"
