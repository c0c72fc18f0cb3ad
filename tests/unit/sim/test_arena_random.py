"""The counter-based generator of a trial against an independent Philox4x32-10 in Python integers."""

from __future__ import annotations

import random

import numpy as np
import pytest

from ohmloom.sim._arena_kernels import philox, uniform

ONES = 0xFFFFFFFF


def reference(counter, key):
    """Ten rounds as Salmon et al. define them; words are Python integers."""
    counter, key = list(counter), list(key)
    for _ in range(10):
        high0, low0 = divmod(0xD2511F53 * counter[0], 2**32)
        high1, low1 = divmod(0xCD9E8D57 * counter[2], 2**32)
        counter = [high1 ^ counter[1] ^ key[0], low1, high0 ^ counter[3] ^ key[1], low0]
        key = [(key[0] + 0x9E3779B9) % 2**32, (key[1] + 0xBB67AE85) % 2**32]
    return counter


@pytest.mark.parametrize(("word", "expected"), [
    (0, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]), (ONES, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
])  # fmt: skip
def test_the_reference_gives_the_published_answers(word, expected):
    assert reference([word] * 4, [word] * 2) == expected


def test_known_answer_for_zero():
    words = philox(np.uint64(0), 0, 0)
    assert [int(w) for w in words] == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]


def test_the_kernel_equals_the_reference():
    draw = random.Random(1)
    cases = [(draw.getrandbits(64), draw.getrandbits(32), draw.getrandbits(32)) for _ in range(300)]
    for key, c0, c1 in [*cases, (2**64 - 1, ONES, ONES), (2**63, 0, 0), (1, 4000, 3)]:
        words = philox(np.uint64(key), c0, c1)
        assert [int(w) for w in words] == reference([c0, c1, 0, 0], [key % 2**32, key >> 32])


def test_numbers_lie_strictly_between_0_and_1():
    assert 0 < uniform(np.uint64(0)) < 1e-9
    assert 1 - 1e-9 < uniform(np.uint64(ONES)) < 1
    assert uniform(np.uint64(2**31)) == pytest.approx(0.5, abs=1e-9)
