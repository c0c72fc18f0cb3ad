"""The champions that come with ohmloom: the same in both places, retraceable, and exact on emulated hardware."""

import csv
from pathlib import Path

import numpy as np
import pytest

from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import SYSTEMS, Network, SpikingController, champion
from ohmloom.sim import Arena, agreement, run_trial
from ohmloom.sim.exact_case import exact_variant

EXACT = exact_variant(Hardware.load("het_mixed"), "charge_metered")
EXAMPLES = Path(__file__).parents[2] / "examples" / "champions"


@pytest.mark.parametrize("system", SYSTEMS)
def test_examples_and_package_hold_the_same(system):
    assert Network.load(EXAMPLES / f"{system}.net.json").to_json() == champion(system).to_json()


@pytest.mark.parametrize("system", SYSTEMS)
def test_provenance_names_the_command_and_reproduces_the_fitness(system):
    network = champion(system)
    provenance = network.provenance
    assert provenance["command"].startswith(f"ohmloom evolve --system {system} ")
    assert f"--seed {provenance['seed']} " in provenance["command"]
    trial = run_trial(SpikingController(network), Arena.paper(), trial_key=provenance["trial_key"])
    assert trial.fitness == provenance["fitness"]


@pytest.mark.parametrize("system", SYSTEMS)
def test_table_agrees_with_the_files(system):
    with (EXAMPLES / "champions.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if row["system"] == system)
    provenance = champion(system).provenance
    assert float(row["test_success"]) == provenance["fresh_starts_solved"] / provenance["fresh_starts"]
    assert int(row["synapses"]) == len(champion(system).synapses)


@pytest.mark.parametrize("system", SYSTEMS)
def test_success_on_fresh_starts_is_as_reported(system):
    """30 more starts, which the choice did not see either, within four standard errors."""
    network = champion(system)
    p = network.provenance["fresh_starts_solved"] / network.provenance["fresh_starts"]
    controller, n = SpikingController(network), 30
    solved = sum(run_trial(controller, Arena.paper(), rng=np.random.default_rng([99, k])).solved for k in range(n))
    assert abs(solved / n - p) <= 4 * np.sqrt(max(p * (1 - p), 0.01) / n)


@pytest.mark.parametrize("system", SYSTEMS)
def test_emulated_champion_is_exact_for_a_whole_trial(system):
    """Spike for spike, ties excepted, on the cards of the spec that has one for every kind, without its wires."""
    result = agreement(champion(system), EXACT, seed=1)
    assert result.exact, result.first_divergence
    assert result.spike_agreement == 1.0
    assert system in ("LIN", "HET") or result.ties <= 5
    assert result.worst_weight_error <= 1e-6


@pytest.mark.parametrize("system", [s for s in SYSTEMS if s != "GA"])
def test_a_thousandth_more_charge_breaks_a_champion(system):
    """Constant weights have no event whose charge could be wrong, so GA is not among these."""
    result = agreement(champion(system), EXACT, seed=1, perturb=0.001)
    assert not result.exact
