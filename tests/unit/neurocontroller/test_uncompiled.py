"""The kernels run without the compiler, warnings as errors, and give the same bits."""

from __future__ import annotations

import os
import subprocess
import sys

SCRIPT = """
import hashlib
import numpy as np
from ohmloom import _jit
from ohmloom.devices import Device
from ohmloom.neurocontroller import Network, Readings, SpikingController
from ohmloom.sim import Arena, run_trial

print(_jit.COMPILED)
digest = hashlib.sha256()
for readings in (Readings(), Readings(lateral="both", weight_at="emission")):
    network = Network.random(system="HET", rng=np.random.default_rng(2), readings=readings)
    controller = SpikingController(network)
    rng = np.random.default_rng(3)
    for _ in range(12):
        sensors = rng.random(6)
        controller.step(sensors)
        for values in (controller.spike_counts, controller.weights, controller.membranes):
            digest.update(values.tobytes())
    for task in ("static", "dynamic"):
        trial = run_trial(controller, Arena.paper(task=task).replace(max_timesteps=40), trial_key=2**64 - 7)
        for values in (trial.path, trial.sensors, trial.actions, trial.output_spikes):
            digest.update(values.tobytes())
cards = {"hp": Device.load("hp_tio2_10k"), "peo_pani": Device.load("peo_pani"), "linear": Device.load("linear")}
# Of the fluxes, that of HP alone needs no logarithm, in which NumPy and the compiler differ by a bit.
for system, options in (("HET", {"cards": cards}), ("HP", {"plasticity": "flux"})):
    controller = SpikingController(Network.random(system=system, rng=np.random.default_rng(2)), **options)
    for sensors in np.random.default_rng(3).random((12, 6)):
        controller.step(sensors)
        digest.update(controller.weights.tobytes())
print(sum(controller.events) > 100, digest.hexdigest())
"""


def run(**environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT],
        env={k: v for k, v in os.environ.items() if k != "NUMBA_DISABLE_JIT"} | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_kernels_without_the_compiler_give_the_same_bits():
    compiled, plain = run(), run(NUMBA_DISABLE_JIT="1")
    assert (compiled[0], plain[0]) == ("True", "False")
    assert compiled[1:] == plain[1:]
    assert compiled[1] == "True"
