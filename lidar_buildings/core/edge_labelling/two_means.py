"""
Two clusters by k-means, the same whatever the order of the points.

Sums are of whole numbers, so that no rounding depends on the order, and the start follows from the points'
linearity instead of from chance.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: Features are rounded to this part of their range, and summed as whole numbers.
STEPS = 1 << 16
#: Rounds after which clusters that still change are taken as they are; some ten are usual.
MAX_ROUNDS = 100
#: The start parts the points half-way between these percentiles of their linearity: among surface and edge.
START_PERCENTILES = (10.0, 90.0)
#: Added to the covariance's diagonal in units of its trace, where features are functions of one another.
RIDGE = 1e-6


def two_means(
    features: NDArray[np.float64], linearity: NDArray[np.float64], distance: str
) -> NDArray[np.float64]:
    """
    Return the centres of two clusters, that of the lower mean linearity first; equal ones if there is one.

    Lloyd's iteration from a start by linearity. With the Manhattan distance centres are medians; with the
    Mahalanobis distance features are weighed by the inverse of their covariance over all the points given.

    Parameters
    ----------
    features : ndarray of shape (n_points, n_features)
        Within 0 to 1, at least one row.
    linearity : ndarray of shape (n_points,)
        Decides the start, and which cluster is which.
    distance : str
        ``"euclidean"``, ``"manhattan"`` or ``"mahalanobis"``.

    Raises
    ------
    ValueError
        If a feature is not finite.

    """
    if not np.isfinite(features).all():
        raise ValueError("features: must be finite")
    whole = np.rint(features * STEPS).astype(np.int64)
    second = linearity > np.percentile(linearity, START_PERCENTILES).mean()
    if second.all() or not second.any():
        second = linearity > 0.5 * (linearity.min() + linearity.max())
    weight = weights(features, distance)
    for _ in range(MAX_ROUNDS):
        centres = _medians(whole, second) if distance == "manhattan" else _means(whole, second)
        before, second = second, in_second(features, centres, weight)
        if np.array_equal(before, second):
            break
    if not second.any() or second.all():
        return np.repeat(centres[:1], 2, axis=0)
    return centres if linearity[second].mean() >= linearity[~second].mean() else centres[::-1]


def weights(features: NDArray[np.float64], distance: str) -> NDArray[np.float64] | None:
    """
    Return the matrix that squared distances are measured with, None for the Manhattan distance.

    """
    n_features = features.shape[1]
    if distance == "manhattan":
        return None
    if distance == "euclidean":
        return np.eye(n_features)
    whole = np.rint(features * STEPS).astype(np.int64)
    mean = whole.sum(axis=0) / len(whole)
    covariance = (whole.T @ whole) / len(whole) - np.outer(mean, mean)
    trace = np.trace(covariance)
    if not trace > 0:
        return np.eye(n_features)
    return np.linalg.inv(covariance / trace + RIDGE * np.eye(n_features))


def in_second(
    features: NDArray[np.float64], centres: NDArray[np.float64], weight: NDArray[np.float64] | None
) -> NDArray[np.bool_]:
    """
    Tell which points are nearer to the second centre than to the first.

    """
    if weight is None:
        first, second = (np.abs(features - centre).sum(axis=1) for centre in centres)
        return second < first
    # Squared distances differ by a linear function: which side of a plane between the centres a point is on.
    across = weight @ (centres[1] - centres[0])
    middle = 0.5 * float(centres[1] @ weight @ centres[1] - centres[0] @ weight @ centres[0])
    found = np.empty(len(features), dtype=np.bool_)
    _beyond(features, across, middle, found)
    return found


def _means(whole: NDArray[np.int64], second: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the means of both clusters; that of all points for one that has none.

    """
    sums, counts = np.zeros((2, whole.shape[1]), dtype=np.int64), np.zeros(2, dtype=np.int64)
    _add_up(whole, second, sums, counts)
    if not counts.all():
        sums[:], counts[:] = sums.sum(axis=0), counts.sum()
    return sums / (counts[:, None] * float(STEPS))


def _medians(whole: NDArray[np.int64], second: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the medians of both clusters; that of all points for one that has none.

    """
    parts = (whole[~second], whole[second])
    return np.array([np.median(part if len(part) else whole, axis=0) for part in parts]) / STEPS


@njit(cache=True, nogil=True)
def _add_up(whole, second, sums, counts):  # type: ignore[no-untyped-def]
    """
    Add every row to the sums of its cluster.

    """
    for i in range(len(whole)):
        part = 1 if second[i] else 0
        counts[part] += 1
        for k in range(whole.shape[1]):
            sums[part, k] += whole[i, k]


@njit(cache=True, nogil=True)
def _beyond(features, across, middle, found):  # type: ignore[no-untyped-def]
    """
    Tell which rows lie beyond the middle in the direction across.

    """
    for i in range(len(features)):
        along = 0.0
        for k in range(features.shape[1]):
            along += features[i, k] * across[k]
        found[i] = along > middle
