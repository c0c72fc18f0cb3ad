"""Whatever mutation does, the net stays legal, can be saved, and its rates stay in (1e-4, 1]."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmloom.neurocontroller import Adaptation, Network, Readings, SpikingController, mutate

rate = st.floats(1e-4, 1.0)


@settings(max_examples=60, deadline=None)
@given(
    system=st.sampled_from(["HP", "PEO", "LIN", "GA", "HET"]),
    lateral=st.sampled_from(["descending", "ascending", "both"]),
    hidden=st.integers(1, 12),
    seed=st.integers(0, 2**32),
    start=st.builds(Adaptation, mu=rate, psi=rate, omega=rate, tau=rate),
)
def test_mutation_keeps_a_network_legal(system, lateral, hidden, seed, start):
    rng = np.random.default_rng(seed)
    network = Network.random(system=system, rng=rng, hidden=hidden, readings=Readings(lateral=lateral))
    network = network.replace(adaptation=start)
    for _ in range(6):
        parent, before = network, network.to_json()
        network = mutate(parent, rng=rng)
        assert parent.to_json() == before
        assert abs(len(network.hidden) - len(parent.hidden)) <= 1
        assert len(network.hidden) >= 1
        assert {(s.pre, s.post) for s in network.synapses} <= set(network.legal)
        for value in network.adaptation.model_dump().values():
            assert 1e-4 <= value <= 1.0
        # The file's own checks accept it: no duplicates, kinds of the system, 0.5 where plastic.
        again = Network.from_json(network.to_json().encode(), "text")
        assert again.replace(provenance={}) == network
    SpikingController(network).step([0.5] * 6)
