"""Two clusters by k-means, repeatable: from a fixed start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

#: Rounds after which clusters that still change are taken as they are. Wide margin: real roofs take 14.
MAX_ROUNDS = 100
#: The start parts the points half-way between these percentiles of their linearity: among surface and edge.
#: Wide margin: it ends where the best of ten random starts does (`test_k_means.py`).
START_PERCENTILES = (10.0, 90.0)


def two_means(features: NDArray[np.float64], linearity: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the centres of two clusters, that of the lower mean linearity first; equal ones if there is one.

    Lloyd's iteration from a start by linearity. The last bits of means depend on the order of the points,
    unless their sums are exact. ValueError if a feature is not finite.
    """
    if not np.isfinite(features).all():
        raise ValueError("features: must be finite")
    second = linearity > np.percentile(linearity, START_PERCENTILES).mean()
    if _is_one(second):
        second = linearity > 0.5 * (linearity.min() + linearity.max())
    if not _is_one(second):
        second = _k_means(features, second)
    if _is_one(second):
        return np.repeat(features.mean(axis=0)[None], 2, axis=0)
    if linearity[second].mean() < linearity[~second].mean():
        second = ~second
    return _centres(features, second)


def in_second(features: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points are nearer to the second centre than to the first."""
    first, second = cdist(centres, features, "sqeuclidean")
    return second < first


def _is_one(second: NDArray[np.bool_]) -> bool:
    return bool(second.all() or not second.any())


def _k_means(features: NDArray[np.float64], second: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """By hand: scikit-learn's takes 1 s to import, and its threads spin as long again on so few features."""
    for _ in range(MAX_ROUNDS):
        before, second = second, in_second(features, _centres(features, second))
        if _is_one(second) or np.array_equal(before, second):
            break
    return second


def _centres(features: NDArray[np.float64], second: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the means of both parts."""
    parts = np.array([~second, second])
    return parts.astype(np.float64) @ features / parts.sum(axis=1, keepdims=True)
