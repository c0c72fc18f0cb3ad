"""The public names, so that a change of surface shows in the diff; and what importing them costs."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

SURFACE = {
    "ohmloom.circuits": [
        "VCCS", "VCVS", "Capacitor", "Conduction", "Constant", "Crossbar", "CrossbarTrace", "CurrentSource",
        "Memristor", "MemristorCrossbar", "Netlist", "NetlistTrace", "OperatingPoint", "PiecewiseLinear",
        "Pulse", "PulseTrain", "Read", "Resistor", "SelectorConduction", "Sine", "SinhConduction",
        "Subcircuit", "TwoPartSpike", "VoltageSource", "crossbar_netlist", "memristor_netlist", "plot_crossbar",
        "plot_schematic", "run_ngspice",
    ],
    "ohmloom.devices": [
        "LAWS", "CardValue", "Comparison", "DataFile", "Device", "Fit", "Law", "Measurement", "Parameter", "Revisit",
        "Trace", "charge_revisit", "compare", "fit",
    ],
    "ohmloom.fmu": [
        "Check", "CheckRow", "Export", "FmuTrace", "Host", "HostedArena", "HostedController", "HostedDevice",
        "check", "export_arena", "export_controller", "export_crossbar", "export_device",
        "export_hardware_controller", "export_system", "reference_errors", "run", "run_ssp", "simulate_hosted",
    ],
    "ohmloom.mapping": [
        "WAVEFORMS", "Cost", "CostLine", "Crosspoint", "Die", "EmulatedController", "Grid", "Hardware",
        "Ledger", "Plan", "Quantity", "ReadErrors", "ResetPlan", "Schedule", "Slot", "Tile", "Waveform",
        "event_table", "place", "plan_cost", "plan_reset", "plan_yield", "pulse_schedule", "tile_crossbar",
        "tile_deck", "tile_grid", "tile_netlist",
    ],
    "ohmloom.neurocontroller": [
        "ACTIONS", "KINDS", "LATTICES", "SYSTEMS", "Adaptation", "Lattice", "Network", "Readings",
        "SpikingController", "Synapse", "champion", "mutate",
    ],
    "ohmloom.sim": [
        "Agreement", "Arena", "Check", "Controller", "DieRuns", "Divergence", "Evolution", "EvolutionSettings",
        "Feasibility", "Figure", "OpenSettings", "Scheme", "Score", "Trial", "TrialArena", "agreement", "check",
        "evolve", "feasibility", "run_dies", "run_trial",
    ],
}  # fmt: skip


@pytest.mark.parametrize("room", SURFACE)
def test_public_names(room):
    module = importlib.import_module(room)
    assert module.__all__ == SURFACE[room]
    for name in module.__all__:
        assert getattr(module, name) is not None
    assert module.__doc__


def heavy_modules_after(statement):
    code = f"import sys\n{statement}\nprint(*{{m.split('.')[0] for m in sys.modules}})"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split()) & {"numba", "llvmlite", "matplotlib", "scipy", "PIL"}


@pytest.mark.parametrize("statement", ["import ohmloom", "import ohmloom.errors"])
def test_importing_the_base_is_light(statement):
    assert heavy_modules_after(statement) == set()


def test_importing_the_neurocontroller_neither_compiles_nor_draws():
    assert heavy_modules_after("import ohmloom.neurocontroller") == set()


def test_the_check_sees_what_is_imported():
    assert "numba" in heavy_modules_after("import ohmloom._jit")


def test_importing_configures_no_logging():
    code = ("import logging, ohmloom, ohmloom.sim\nprint(len(logging.getLogger().handlers), "
            "[type(h).__name__ for h in logging.getLogger('ohmloom').handlers])")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 ['NullHandler']"
