"""Counter-based random numbers: the same key and counter give the same number, in whatever order they are asked for."""

from __future__ import annotations

import math

import numpy as np

from ohmloom._jit import kernel


@kernel
def philox(key: np.uint64, counter0: int, counter1: int) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Philox4x32-10 (Salmon et al., SC 2011), counter (counter0, counter1, 0, 0); four 32-bit words."""
    low = np.uint64(0xFFFFFFFF)
    shift = np.uint64(32)
    c0, c1, c2, c3 = np.uint64(counter0), np.uint64(counter1), np.uint64(0), np.uint64(0)
    k0, k1 = np.uint64(key) & low, np.uint64(key) >> shift
    for _ in range(10):
        p0 = np.uint64(0xD2511F53) * c0
        p1 = np.uint64(0xCD9E8D57) * c2
        c0, c1, c2, c3 = (p1 >> shift) ^ c1 ^ k0, p1 & low, (p0 >> shift) ^ c3 ^ k1, p0 & low
        k0 = (k0 + np.uint64(0x9E3779B9)) & low
        k1 = (k1 + np.uint64(0xBB67AE85)) & low
    return c0, c1, c2, c3


@kernel
def uniform(word: np.uint64) -> float:
    """A 32-bit word as a number in (0, 1)."""
    return (np.float64(word) + 0.5) * 2.3283064365386963e-10


@kernel
def normal(key: np.uint64, counter0: int, counter1: int) -> float:
    """A standard normal number by the Box-Muller transform."""
    words = philox(key, counter0, counter1)
    return math.sqrt(-2.0 * math.log(uniform(words[0]))) * math.cos(2.0 * math.pi * uniform(words[1]))
