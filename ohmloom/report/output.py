"""What the command line writes: the files of a study and of a replay."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ohmloom._files import write_atomic
from ohmloom.errors import ParameterError
from ohmloom.mapping import EmulatedController, Hardware, place
from ohmloom.neurocontroller import Network, SpikingController
from ohmloom.report.replay import FORMATS, Recording, replay
from ohmloom.sim import Arena, Check, Feasibility, Trial, run_trial
from ohmloom.sim.sampling import start_key
from ohmloom.sim.trial import draw_trial_key

if TYPE_CHECKING:
    from ohmloom.report._page_run import DieRun

CHECK_FILES = ("check.json", "divergence.png")
STUDY_FILES = ("report.html", "report.json", "plan.json")


def save_study(
    study: Feasibility, out: Path, *, command: str, has_figures: bool = True, run: DieRun | None = None
) -> list[Path]:
    """Write ``report.html``, ``report.json``, ``plan.json`` and the pictures in ``figures/`` to a folder; their paths.

    Parameters
    ----------
    study
        From `feasibility`, not loaded.
    out
        The folder.
    command
        The command line that makes the study again.
    has_figures
        Whether to write the pictures as files for papers too, as SVG and PDF.
    run
        The recorded trial of the study's first die, if it is at hand; else it is run again.
    """
    from ohmloom.report._page_run import die_run, ideal_run
    from ohmloom.report.page import report_page
    from ohmloom.report.study_figures import save_figures

    paths = [out / name for name in STUDY_FILES]
    assert study.plan is not None
    ideal, die = ideal_run(study), die_run(study) if run is None else run
    study.plan.save(paths[2])
    study.save(paths[1])
    write_atomic(paths[0], report_page(study, command=command, runs=(ideal, die)))
    return paths + (save_figures(study, out / "figures", ideal=ideal, die=die) if has_figures else [])


def save_check(check: Check, out: Path) -> list[Path]:
    """Write ``check.json`` and ``divergence.png`` to a folder; their paths."""
    from ohmloom.report.check_plot import save_check_picture

    paths = [out / name for name in CHECK_FILES]
    check.save(paths[0])
    save_check_picture(check, paths[1])
    return paths


def check_suffix(path: Path) -> None:
    """Refuse a replay file of an unknown kind before anything is run.

    Raises
    ------
    ParameterError
        Names the file and the known endings.
    """
    if path.suffix.lower() not in FORMATS:
        raise ParameterError(f"--out: expected a file that ends in {', '.join(FORMATS)}, got {path}. Rename it.")


def replay_network(
    network: Network,
    path: Path,
    *,
    hardware: Hardware | None = None,
    seed: int = 0,
    task: str | None = None,
    die: int | None = None,
) -> Trial:
    """Run one trial, of the ideal controller or of a sampled die, and draw it to `path` (.html, .gif or .png).

    With `die`, start and die are those of that number in `feasibility` with the same seed.

    Raises
    ------
    ParameterError
        If the file has another ending, or `die` is given without hardware.
    MappingError
        If the network cannot be placed on `hardware`.
    """
    check_suffix(path)
    trial, recording, arena = record_trial(network, hardware=hardware, seed=seed, task=task, die=die)
    replay(recording, arena, path)
    return trial


def record_trial(
    network: Network,
    *,
    hardware: Hardware | None = None,
    seed: int = 0,
    task: str | None = None,
    die: int | None = None,
) -> tuple[Trial, Recording, Arena]:
    """Run one trial as `replay_network` does; the trial, what `replay` draws of it, and where it took place.

    Raises
    ------
    ParameterError
        If `die` is given without hardware.
    MappingError
        If the network cannot be placed on `hardware`.
    """
    if die is not None and hardware is None:
        raise ParameterError(f"--die: expected --hardware with it, got die {die} alone. Name the hardware.")
    if hardware is None:
        controller: SpikingController | EmulatedController = SpikingController(network)
    else:
        controller = EmulatedController(place(network, hardware).sample(seed=seed, die=die or 0))
    chosen = task if task is not None else str(network.provenance.get("task", "static"))
    arena = Arena(task="dynamic" if chosen == "dynamic" else "static")
    weights, spikes = [], []

    def record(_: int) -> None:
        weights.append(controller.weights)
        spikes.append(controller.spike_counts)

    key = draw_trial_key(np.random.default_rng(seed)) if die is None else start_key(seed, die)
    trial = run_trial(controller, arena, trial_key=key, on_timestep=record)
    labels = network.labels()
    recording = Recording(
        trial=trial, weights=np.array(weights), spikes=np.array(spikes),
        network_name=network.name if hardware is None else f"{network.name} on {hardware.name}",
        neuron_labels=tuple(labels),
        synapse_labels=tuple(f"{labels[s.pre]} → {labels[s.post]}" for s in network.synapses),
        synapse_kinds=tuple(s.kind for s in network.synapses),
    )  # fmt: skip
    return trial, recording, arena
