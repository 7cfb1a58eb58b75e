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
#: The same of linearities whose means are compared.
FINE_STEPS = 1 << 32
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
    # Quick, and surely finite where the sum is.
    if not np.isfinite(features.sum()):
        raise ValueError("features: must be finite")
    second = linearity > _start(linearity)
    if second.all() or not second.any():
        second = linearity > 0.5 * (linearity.min() + linearity.max())
    weight = weights(features, distance)
    if weight is None:
        centres, second = _parted_by_medians(features, second)
    else:
        centres, second = _parted(np.ascontiguousarray(features), second, weight)
    if not second.any() or second.all():
        return np.repeat(centres[:1], 2, axis=0)
    low, high = mean_by_part(linearity, second)
    return centres if high >= low else centres[::-1]


def mean_by_part(values: NDArray[np.float64], second: NDArray[np.bool_]) -> tuple[float, float]:
    """
    Return the means of the first and the second part, NaN where it is empty, whatever the order of the rows.

    Values are within 0 to 1.
    """
    sums, counts = np.zeros((2, 2), dtype=np.int64)
    _sum_finely(values, second, sums, counts)
    first, other = np.divide(sums, counts * float(FINE_STEPS), out=np.full(2, np.nan), where=counts > 0)
    return float(first), float(other)


@njit(cache=True, nogil=True)
def _sum_finely(values, second, sums, counts):  # type: ignore[no-untyped-def]
    """Add every value, as a whole number, to the sum of its part."""
    for i in range(len(values)):
        part = 1 if second[i] else 0
        counts[part] += 1
        sums[part] += np.int64(np.rint(values[i] * FINE_STEPS))


def _start(linearity: NDArray[np.float64]) -> float:
    """Return the limit in linearity that the iteration starts from."""
    return float(np.percentile(linearity, START_PERCENTILES).mean())


@njit(cache=True, nogil=True)
def _parted(features, second, weight):  # type: ignore[no-untyped-def]
    """
    Iterate with means for centres; return the last ones, and the rows that are nearer to the second one.

    Sums follow the rows that change sides, which soon are few.
    """
    sums = np.zeros((2, features.shape[1] + 1), dtype=np.int64)
    for i in range(len(features)):
        _add(features, i, sums[1 if second[i] else 0], 1)
    centres = _means(sums)
    for _ in range(MAX_ROUNDS):
        centres = _means(sums)
        across, middle = _middle_plane(centres, weight)
        changed = False
        for i in range(len(features)):
            found = _is_beyond(features, i, across, middle)
            if found != second[i]:
                _add(features, i, sums[1 if second[i] else 0], -1)
                _add(features, i, sums[1 if found else 0], 1)
                second[i] = found
                changed = True
        if not changed:
            break
    return centres, second


@njit(cache=True, nogil=True)
def _add(features, i, total, sign):  # type: ignore[no-untyped-def]
    """
    Add a row to a cluster's sums, of whole numbers, or take it away; how many rows there are comes last.
    """
    for k in range(features.shape[1]):
        total[k] += sign * np.int64(np.rint(features[i, k] * STEPS))
    total[-1] += sign


@njit(cache=True, nogil=True)
def _means(sums):  # type: ignore[no-untyped-def]
    """Return the means of both clusters; that of all points for one that has none."""
    centres = np.empty((2, sums.shape[1] - 1))
    both = sums[0] + sums[1]
    for k in range(2):
        total = both if sums[0, -1] == 0 or sums[1, -1] == 0 else sums[k]
        for axis in range(centres.shape[1]):
            centres[k, axis] = total[axis] / (total[-1] * float(STEPS))
    return centres


@njit(cache=True, nogil=True)
def _middle_plane(centres, weight):  # type: ignore[no-untyped-def]
    """
    Return the direction across the plane between the centres, and how far along it the plane lies.

    Squared distances differ by a linear function: which side of the plane a point is on.
    """
    n = centres.shape[1]
    across = np.zeros(n)
    squares = np.zeros(2)
    for a in range(n):
        for b in range(n):
            across[a] += weight[a, b] * (centres[1, b] - centres[0, b])
            for k in range(2):
                squares[k] += centres[k, a] * weight[a, b] * centres[k, b]
    return across, 0.5 * (squares[1] - squares[0])


@njit(cache=True, nogil=True, forceinline=True)
def _is_beyond(features, i, across, middle):  # type: ignore[no-untyped-def]
    """Tell whether a row lies beyond a plane."""
    along = features[i, 0] * across[0]
    for k in range(1, features.shape[1]):
        along += features[i, k] * across[k]
    return along > middle


@njit(cache=True, nogil=True)
def _beyond(features, centres, weight):  # type: ignore[no-untyped-def]
    """Tell which rows lie beyond the plane between the centres."""
    across, middle = _middle_plane(centres, weight)
    found = np.empty(len(features), dtype=np.bool_)
    for i in range(len(features)):
        found[i] = _is_beyond(features, i, across, middle)
    return found


def _parted_by_medians(
    features: NDArray[np.float64], second: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Iterate with medians for centres and the Manhattan distance."""
    whole = np.rint(features * STEPS).astype(np.int64)
    for _ in range(MAX_ROUNDS):
        centres = _medians(whole, second)
        before, second = second, in_second(features, centres, None)
        if np.array_equal(before, second):
            break
    return centres, second


def weights(features: NDArray[np.float64], distance: str) -> NDArray[np.float64] | None:
    """Return the matrix that squared distances are measured with, None for the Manhattan distance."""
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
    """Tell which points are nearer to the second centre than to the first."""
    if weight is None:
        first, second = (np.abs(features - centre).sum(axis=1) for centre in centres)
        return second < first
    return _beyond(np.ascontiguousarray(features), np.ascontiguousarray(centres), weight)


def _medians(whole: NDArray[np.int64], second: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the medians of both clusters; that of all points for one that has none."""
    parts = (whole[~second], whole[second])
    return np.array([np.median(part if len(part) else whole, axis=0) for part in parts]) / STEPS
