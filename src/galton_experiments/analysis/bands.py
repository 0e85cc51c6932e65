"""Bands around curves of many runs: percentile bootstraps, so that none leaves what runs themselves have reached."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Real, Shaped

from galton_experiments.analysis.statistics import Interval

RESAMPLES = 20_000
"""The number of bootstrap resamples for a number that is printed."""


def mean_band(strata: Sequence[Shaped[np.ndarray, "_ *rest"]], n_resamples: int = 500, seed: int = 0) -> Interval:
    """The mean of the strata's means, and the percentiles of that mean when runs are drawn again within each stratum.

    Args:
        strata: the runs of each setting, along the first axis; NaN ones are left out of theirs.
        n_resamples: how often runs are drawn again, with replacement.
        seed: of these draws.

    Returns:
        Mean, 2.5th and 97.5th percentile, each of the runs' shape; no percentiles where a stratum has fewer than two
        known runs. With three runs the band is about their range.
    """
    rng = np.random.default_rng(seed)
    shape = np.shape(strata[0])[1:]
    flat = [np.reshape(np.asarray(stratum, np.float64), (len(stratum), -1)) for stratum in strata]
    draws = [times_drawn(rng, len(runs), n_resamples) for runs in flat]
    mean = _mean_of_means([np.ones((1, len(runs))) for runs in flat], flat)[0]
    low, high = np.full((2, *mean.shape), np.nan)
    enough = np.min([(~np.isnan(runs)).sum(0) for runs in flat], axis=0) > 1
    ends = _percentiles(_mean_of_means(draws, flat)[:, enough])
    low[enough], high[enough] = np.minimum(ends[0], mean[enough]), np.maximum(ends[1], mean[enough])  # equal runs round
    return Interval(*(end.reshape(shape)[()] for end in (mean, low, high)))


def times_drawn(rng: np.random.Generator, n: int, n_resamples: int) -> Int[np.ndarray, "B n"]:
    """Count how often each of n runs is drawn in n draws with replacement, for each resample."""
    drawn = rng.integers(n, size=(n_resamples, n)) + n * np.arange(n_resamples)[:, None]
    return np.bincount(drawn.ravel(), minlength=n_resamples * n).reshape(n_resamples, n)


def _mean_of_means(
    weights: Sequence[Real[np.ndarray, "B _"]], strata: Sequence[Float[np.ndarray, "_ L"]]
) -> Float[np.ndarray, "B L"]:
    """The mean over strata of the weighted means of runs that are known; NaN where a stratum has none."""
    if not any(np.isnan(runs).any() for runs in strata):
        shares = np.concatenate([weight / len(runs) for weight, runs in zip(weights, strata, strict=True)], axis=1)
        return np.asarray(shares @ np.concatenate(strata) / len(strata))
    total = np.zeros((len(weights[0]), strata[0].shape[1]))
    for weight, runs in zip(weights, strata, strict=True):
        known = ~np.isnan(runs)
        n = weight @ known.astype(np.float64)
        total += np.divide(weight @ np.where(known, runs, 0.0), n, out=np.full(n.shape, np.nan), where=n > 0)
    return total / len(strata)


def _percentiles(resamples: Float[np.ndarray, "B L"]) -> Float[np.ndarray, "2 L"]:
    """Of the resamples that have a mean."""
    of = np.nanquantile if np.isnan(resamples).any() else np.quantile
    return np.asarray(of(resamples, (0.025, 0.975), axis=0))
