"""Births and mutations: each operator alone, made certain or impossible through its rate."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from ohmloom.errors import ParameterError, UnknownNameError
from ohmloom.neurocontroller import SYSTEMS, Adaptation, Network, Readings, Synapse, mutate, variation


class Scripted(np.random.Generator):
    """A generator whose log-normal factors are 1, so that a child has its parent's rates."""

    toggles = False

    def standard_normal(self):
        return 0.0

    def random(self, size=None):
        # Only toggling draws an array, and the floor of tau would let it happen once in 10000 pairs.
        return super().random(size) if size is None or self.toggles else np.ones(size)


class Toggling(Scripted):
    toggles = True


def generator(seed=0, kind=Scripted):
    return kind(np.random.PCG64(seed))


NEVER = variation.RATE_FLOOR


def rates(**changes):
    return Adaptation(**({"mu": NEVER, "psi": NEVER, "omega": NEVER, "tau": NEVER} | changes))


def born(system, seed=0, **options):
    return Network.random(system=system, rng=np.random.default_rng(seed), **options)


def test_at_birth():
    networks = [born("HET", seed) for seed in range(200)]
    assert {len(n.hidden) for n in networks} == {9}
    for name, top in {"mu": 0.25, "psi": 0.5, "omega": 1.0, "tau": 0.25}.items():
        values = [getattr(n.adaptation, name) for n in networks]
        assert 0 < min(values) < 0.1 * top
        assert 0.9 * top < max(values) <= top
    polarities = Counter(p for n in networks for p in n.hidden)
    assert 0.45 < polarities["excitatory"] / 1800 < 0.55
    # 200 * 108 pairs: five standard deviations are 0.017.
    assert 0.483 < np.mean([n.connectivity for n in networks]) < 0.517
    kinds = Counter(s.kind for n in networks for s in n.synapses)
    assert set(kinds) == set(SYSTEMS["HET"])
    assert max(kinds.values()) / min(kinds.values()) < 1.15
    assert {s.weight for n in networks for s in n.synapses} == {0.5}


def test_at_birth_weights_are_random_in_ga_only():
    weights = [s.weight for s in born("GA", enable_probability=1.0).synapses]
    assert len(set(weights)) == 108
    assert 0 <= min(weights) < 0.1
    assert 0.9 < max(weights) <= 1
    for system, kind in {"HP": "hp", "PEO": "peo_pani", "LIN": "linear"}.items():
        assert {(s.kind, s.weight) for s in born(system).synapses} == {(kind, 0.5)}


@pytest.mark.parametrize(("probability", "synapses"), [(0.0, 0), (1.0, 108)])
def test_enable_probability(probability, synapses):
    assert len(born("HP", enable_probability=probability).synapses) == synapses


def test_birth_refuses():
    with pytest.raises(UnknownNameError, match=r"^Network\.random\.system: .* got 'HEX'\. Did you mean 'HET'\?"):
        born("HEX")
    with pytest.raises(ParameterError, match=r"^Network\.random\.hidden: expected an integer from 1 to 1000, got 0"):
        born("HP", hidden=0)
    with pytest.raises(ParameterError, match=r"^Network\.random\.enable_probability: .* got 1\.5"):
        born("HP", enable_probability=1.5)


def test_the_child_takes_new_rates_and_the_parent_keeps_its_own():
    parent = born("HET").replace(adaptation=Adaptation(mu=0.1, psi=0.1, omega=0.1, tau=0.1))
    before = parent.to_json()
    logs = []
    for seed in range(400):
        child = mutate(parent, rng=np.random.default_rng(seed))
        logs.append([np.log(getattr(child.adaptation, name) / 0.1) for name in ("mu", "psi", "omega", "tau")])
    assert parent.to_json() == before
    # Eq. 13: log-normal factors of spread 1, cut at 1 (2.3 standard deviations up).
    np.testing.assert_allclose(np.mean(logs, axis=0), 0.0, atol=0.25)
    np.testing.assert_allclose(np.std(logs, axis=0), 1.0, atol=0.15)
    assert np.max(logs) == pytest.approx(np.log(10))


def test_ga_redraws_weights_with_probability_mu():
    parent = born("GA", enable_probability=1.0)
    child = mutate(parent.replace(adaptation=rates(mu=1.0)), rng=generator())
    assert [s[:3] for s in child.synapses] == [s[:3] for s in parent.synapses]
    assert all(a.weight != b.weight for a, b in zip(child.synapses, parent.synapses, strict=True))
    assert all(0 <= s.weight <= 1 for s in child.synapses)
    half = mutate(parent.replace(adaptation=rates(mu=0.5)), rng=generator())
    changed = sum(a.weight != b.weight for a, b in zip(half.synapses, parent.synapses, strict=True))
    assert 30 < changed < 78  # of 108, five standard deviations
    none = mutate(parent.replace(adaptation=rates()), rng=generator())
    assert none.synapses == parent.synapses


@pytest.mark.parametrize("system", ["HP", "PEO", "LIN"])
def test_mu_does_nothing_where_weights_are_plastic_and_kinds_are_one(system):
    parent = born(system).replace(adaptation=rates(mu=1.0))
    assert mutate(parent, rng=generator()).synapses == parent.synapses


def test_het_switches_to_another_kind_always():
    parent = born("HET", enable_probability=1.0).replace(adaptation=rates(mu=1.0))
    switches = Counter()
    for seed in range(30):
        child = mutate(parent, rng=generator(seed))
        for a, b in zip(parent.synapses, child.synapses, strict=True):
            assert a.kind != b.kind
            assert (a.pre, a.post, b.weight) == (b.pre, b.post, 0.5)
            switches[a.kind, b.kind] += 1
    assert len(switches) == 6
    for kind in SYSTEMS["HET"]:
        one, other = (count for (old, _), count in switches.items() if old == kind)
        assert 0.8 < one / other < 1.25


def test_a_new_neuron_is_the_last_hidden_one():
    parent = born("LIN").replace(adaptation=rates(psi=1.0, omega=1.0))
    polarities = Counter()
    for seed in range(40):
        child = mutate(parent, rng=generator(seed))
        assert child.hidden[:-1] == parent.hidden
        polarities[child.hidden[-1]] += 1
        new = 6 + 9
        old = [s for s in child.synapses if new not in (s.pre, s.post)]
        # The outputs, 15 and 16, have become 16 and 17.
        assert old == [s._replace(post=s.post + (s.post >= new)) for s in parent.synapses]
        fresh = [s for s in child.synapses if new in (s.pre, s.post)]
        assert {s.weight for s in fresh} <= {0.5}
    assert min(polarities.values()) > 5


def test_synapses_of_a_new_neuron_exist_with_one_half():
    parent = born("LIN").replace(adaptation=rates(psi=1.0, omega=1.0))
    counts = [len(mutate(parent, rng=generator(seed)).synapses) - len(parent.synapses) for seed in range(200)]
    # 6 from inputs, 9 to lower hidden neurons, 2 to outputs.
    assert np.mean(counts) == pytest.approx(17 / 2, abs=0.75)


def test_removal_closes_the_indices():
    parent = Network(
        system="GA",
        hidden=("excitatory", "inhibitory", "excitatory"),
        synapses=(Synapse(0, 6, "constant", 0.1), Synapse(8, 6, "constant", 0.2), Synapse(1, 7, "constant", 0.3),
                  Synapse(2, 8, "constant", 0.4), Synapse(7, 9, "constant", 0.5), Synapse(8, 10, "constant", 0.6)),
        adaptation=rates(psi=1.0),
    )  # fmt: skip
    expected = {
        0: (("inhibitory", "excitatory"),
            {(1, 6): 0.3, (2, 7): 0.4, (6, 8): 0.5, (7, 9): 0.6}),
        1: (("excitatory", "excitatory"),
            {(0, 6): 0.1, (7, 6): 0.2, (2, 7): 0.4, (7, 9): 0.6}),
        2: (("excitatory", "inhibitory"),
            {(0, 6): 0.1, (1, 7): 0.3, (7, 8): 0.5}),
    }  # fmt: skip
    found = {}
    for seed in range(40):
        child = mutate(parent, rng=generator(seed))
        weights = {(s.pre, s.post): s.weight for s in child.synapses}
        gone = next(k for k, (hidden, synapses) in expected.items() if synapses == weights and hidden == child.hidden)
        found[gone] = child
    assert set(found) == {0, 1, 2}
    # The lateral synapse 8 -> 6 took two steps; without neuron 7 it takes one.
    lateral = found[1].synapses[1]
    assert (lateral.pre, lateral.post) == (7, 6)
    assert (parent.delay(parent.synapses[1]), found[1].delay(lateral)) == (2, 1)


def test_removal_of_the_only_hidden_neuron_does_nothing():
    parent = born("HP", hidden=1).replace(adaptation=rates(psi=1.0))
    for seed in range(20):
        child = mutate(parent, rng=generator(seed))
        assert (child.hidden, child.synapses) == (parent.hidden, parent.synapses)


def test_toggling_all_synapses():
    parent = born("HET").replace(adaptation=rates(tau=1.0))
    child = mutate(parent, rng=generator(kind=Toggling))
    before, after = ({(s.pre, s.post) for s in n.synapses} for n in (parent, child))
    assert before | after == set(parent.legal)
    assert not before & after
    assert {s.weight for s in child.synapses} == {0.5}
    assert {s.kind for s in child.synapses} == set(SYSTEMS["HET"])


def test_a_synapse_enabled_in_ga_has_a_random_weight():
    parent = born("GA", enable_probability=0.0).replace(adaptation=rates(tau=1.0))
    weights = [s.weight for s in mutate(parent, rng=generator(kind=Toggling)).synapses]
    assert len(set(weights)) == 108


def test_synapses_are_sorted_and_readings_kept():
    readings = Readings(lateral="both", synapse_gain=0.5)
    parent = born("HET", readings=readings).replace(adaptation=rates(tau=0.5, psi=1.0, omega=1.0))
    child = mutate(parent, rng=generator())
    assert child.readings == readings
    assert [(s.post, s.pre) for s in child.synapses] == sorted((s.post, s.pre) for s in child.synapses)


def test_rates_that_a_file_left_out_start_at_their_mean():
    parent = born("HET").replace(adaptation=Adaptation())
    child = mutate(parent, rng=generator())
    assert child.adaptation == Adaptation(mu=0.125, psi=0.25, omega=0.5, tau=0.125)
