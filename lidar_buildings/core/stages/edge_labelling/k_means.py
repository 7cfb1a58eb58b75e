"""Two clusters by k-means, repeatable: from a fixed start."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

#: Rounds after which clusters that still change are taken as they are. Wide margin: real roofs take 14.
MAX_ROUNDS = 100
#: The start parts the points half-way between these percentiles of their linearity: among surface and edge.
#: Wide margin: it ends where the best of ten random starts does (`test_k_means.py`).
START_PERCENTILES = (10.0, 90.0)
#: Added to the covariance's diagonal in units of its trace, where features are functions of one another.
#: Wide margin: far above rounding, far below the spread of features.
RIDGE = 1e-6


def two_means(
    features: NDArray[np.float64], linearity: NDArray[np.float64], distance: str
) -> NDArray[np.float64]:
    """
    Return the centres of two clusters, that of the lower mean linearity first; equal ones if there is one.

    Lloyd's iteration from a start by linearity. With the Manhattan distance centres are medians; with the
    Mahalanobis distance features are whitened by their covariance over all the points given. The last bits of
    means depend on the order of the points, unless their sums are exact. ValueError if a feature is not
    finite.
    """
    if not np.isfinite(features).all():
        raise ValueError("features: must be finite")
    second = linearity > np.percentile(linearity, START_PERCENTILES).mean()
    if _is_one(second):
        second = linearity > 0.5 * (linearity.min() + linearity.max())
    if not _is_one(second):
        second = _k_means(features, second, distance)
    if _is_one(second):
        centre = np.median if distance == "manhattan" else np.mean
        return np.repeat(centre(features, axis=0)[None], 2, axis=0)
    if linearity[second].mean() < linearity[~second].mean():
        second = ~second
    return _centres(features, second, distance)


def metric_of(features: NDArray[np.float64], distance: str) -> dict[str, Any]:
    """Return what `cdist` measures distances by; that of Mahalanobis is the features' own."""
    if distance != "mahalanobis":
        return {"metric": {"euclidean": "sqeuclidean", "manhattan": "cityblock"}[distance]}
    n_features = features.shape[1]
    ordered = features[np.lexsort(features.T)]  # no rounding depends on the order of the input
    covariance = np.cov(ordered.T, bias=True).reshape(n_features, n_features)
    trace = np.trace(covariance)
    if not trace > 0:
        return {"metric": "sqeuclidean"}
    return {"metric": "mahalanobis", "VI": np.linalg.inv(covariance / trace + RIDGE * np.eye(n_features))}


def in_second(
    features: NDArray[np.float64], centres: NDArray[np.float64], metric: dict[str, Any]
) -> NDArray[np.bool_]:
    """Tell which points are nearer to the second centre than to the first."""
    first, second = cdist(centres, features, **metric)
    return second < first


def _is_one(second: NDArray[np.bool_]) -> bool:
    return bool(second.all() or not second.any())


def _k_means(features: NDArray[np.float64], second: NDArray[np.bool_], distance: str) -> NDArray[np.bool_]:
    """
    Iterate with means for centres, with the Manhattan distance with medians.

    By hand: scikit-learn's takes 1 s to import, and its threads spin as long again on so few features.
    """
    metric = metric_of(features, distance)
    for _ in range(MAX_ROUNDS):
        before, second = second, in_second(features, _centres(features, second, distance), metric)
        if _is_one(second) or np.array_equal(before, second):
            break
    return second


def _centres(features: NDArray[np.float64], second: NDArray[np.bool_], distance: str) -> NDArray[np.float64]:
    """Return the medians of both parts, or their means."""
    parts = np.array([~second, second])
    if distance == "manhattan":
        return np.array([np.median(features[part], axis=0) for part in parts])
    return parts.astype(np.float64) @ features / parts.sum(axis=1, keepdims=True)
