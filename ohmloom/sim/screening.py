"""Sensitivity of any function of factors in [0, 1]: Morris' elementary effects, and Sobol' indices after Saltelli.

Morris: Technometrics 33 (1991) 161, with mu* of Campolongo et al., Environ. Model. Softw. 22 (2007) 1509. Sobol': first
order by Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, table 2 (b); total by Jansen (the same table, (f)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ohmloom._arrays import FloatArray, IntArray
from ohmloom.errors import ParameterError, expect_integer

LEVELS = 4  # of Morris' grid, with steps of 2/3
STEP = LEVELS / (2.0 * (LEVELS - 1.0))
RESAMPLES = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class MorrisEffects:
    """Elementary effects.

    Attributes
    ----------
    effects
        Axes (trajectory, factor): change of the output for the whole range of a factor.
    mu_star, sigma
        (factor,) mean of their absolute values; standard deviation, which is large where factors interact.
    interval
        (factor, 2) bootstrap 95 % interval of mu_star over trajectories.
    """

    effects: FloatArray
    mu_star: FloatArray
    sigma: FloatArray
    interval: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SobolIndices:
    """First-order and total indices, each (factor,), with bootstrap 95 % intervals (factor, 2)."""

    first: FloatArray
    first_interval: FloatArray
    total: FloatArray
    total_interval: FloatArray


def morris_sample(factors: int, trajectories: int, *, rng: np.random.Generator) -> FloatArray:
    """Trajectories on a grid of four levels, one factor moved at a time, axes (trajectory, point, factor) in [0, 1].

    >>> morris_sample(2, 3, rng=np.random.default_rng(1)).shape
    (3, 3, 2)
    """
    expect_integer("morris_sample.factors", factors, 1)
    expect_integer("morris_sample.trajectories", trajectories, 2)
    low = np.arange(LEVELS // 2) / (LEVELS - 1.0)
    sample = np.empty((trajectories, factors + 1, factors))
    for t in range(trajectories):
        start, up = rng.choice(low, factors), rng.random(factors) < 0.5
        point = np.where(up, start, start + STEP)
        sample[t, 0] = point
        for k, moved in enumerate(rng.permutation(factors)):
            point = point.copy()
            point[moved] += STEP if up[moved] else -STEP
            sample[t, k + 1] = point
    return sample


def morris_effects(sample: FloatArray, output: FloatArray, *, seed: int = 0) -> MorrisEffects:
    """Effects from the output at every point of `morris_sample`, axes (trajectory, point).

    Raises
    ------
    ParameterError
        If the output has not one value a point.
    """
    if output.shape != sample.shape[:2]:
        raise ParameterError(f"morris_effects.output: expected axes (trajectory, point) = {sample.shape[:2]}, got "
                             f"{output.shape}. Evaluate every point once.")  # fmt: skip
    moved = np.diff(sample, axis=1)
    change = np.diff(output, axis=1)
    which = np.abs(moved).argmax(axis=2)
    effects = np.empty((len(sample), sample.shape[2]))
    np.put_along_axis(effects, which, change / np.take_along_axis(moved, which[:, :, None], axis=2)[:, :, 0], axis=1)
    drawn = _drawn(len(effects), seed)
    resampled = np.abs(effects)[drawn].mean(axis=1)
    return MorrisEffects(
        effects=effects, mu_star=np.abs(effects).mean(axis=0), sigma=effects.std(axis=0, ddof=1),
        interval=np.percentile(resampled, (2.5, 97.5), axis=0).T,
    )  # fmt: skip


def saltelli_sample(factors: int, n: int, *, seed: int = 0) -> FloatArray:
    """Points for Sobol' indices, axes (base, point, factor): A, A with each column of B in turn, B; n * (factors + 2).

    `n` is a power of two, for which Sobol' sequences are balanced.

    Raises
    ------
    ParameterError
        If `n` is no power of two, or there is no factor.

    Examples
    --------
    >>> saltelli_sample(3, 8).shape
    (8, 5, 3)
    """
    from scipy.stats import qmc

    expect_integer("saltelli_sample.factors", factors, 1)
    if expect_integer("saltelli_sample.n", n, 2) & (n - 1):
        raise ParameterError(f"saltelli_sample.n: expected a power of two, got {n}. Take {1 << n.bit_length()}.")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))
    both = qmc.Sobol(2 * factors, scramble=True, rng=rng).random(n)
    a, b = both[:, :factors], both[:, factors:]
    points = np.repeat(a[:, None, :], factors + 2, axis=1)
    for k in range(factors):
        points[:, k + 1, k] = b[:, k]
    points[:, -1] = b
    return points


def sobol_indices(output: FloatArray, *, seed: int = 0) -> SobolIndices:
    """Indices from the output at every point of `saltelli_sample`, axes (base, point); all 0 where nothing varies."""
    drawn = _drawn(len(output), seed)
    first, total = _indices(output)
    many = [_indices(output[rows]) for rows in drawn]
    spread = [np.percentile([one[k] for one in many], (2.5, 97.5), axis=0).T for k in range(2)]
    return SobolIndices(first=first, first_interval=spread[0], total=total, total_interval=spread[1])


def _indices(output: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Centred: the estimator of the first order would else carry the variance of the mean.
    y = output - output.mean()
    a, mixed, b = y[:, :1], y[:, 1:-1], y[:, -1:]
    variance = np.concatenate((a, b)).var()
    if variance == 0.0:
        nothing = np.zeros(mixed.shape[1])
        return nothing, nothing
    return (b * (mixed - a)).mean(axis=0) / variance, 0.5 * ((a - mixed) ** 2).mean(axis=0) / variance


def _drawn(n: int, seed: int) -> IntArray:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(4,)))
    return rng.integers(0, n, (RESAMPLES, n))
