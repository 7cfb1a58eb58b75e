"""
Two clusters by k-means, the same whatever the order of the points.

Sums are of whole numbers, so that no rounding depends on the order, and the start follows from the points'
linearity instead of from chance.

"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.row_blocks import for_row_blocks

#: Features are rounded to this part of their range, and summed as whole numbers.
STEPS = 1 << 16
#: The same of linearities whose means are compared.
FINE_STEPS = 1 << 32
#: Rows a block of work.
ROWS_A_BLOCK = 65_536
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
        centres, second = _parted(features, second, weight)
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
    """
    Add every value, as a whole number, to the sum of its part.

    """
    for i in range(len(values)):
        part = 1 if second[i] else 0
        counts[part] += 1
        sums[part] += np.int64(np.rint(values[i] * FINE_STEPS))


def _start(linearity: NDArray[np.float64]) -> float:
    """
    Return the limit in linearity that the iteration starts from.

    """
    return float(np.percentile(linearity, START_PERCENTILES).mean())


def _parted(
    features: NDArray[np.float64], second: NDArray[np.bool_], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Iterate with means for centres; return the last ones, and the rows that are nearer to the second one.

    Parting and summing up are one pass, on all cores where there are many points.

    """
    n_blocks = max(1, -(-len(features) // ROWS_A_BLOCK))
    sums = np.empty((n_blocks, 2, features.shape[1] + 1), dtype=np.int64)
    changed = np.ones(n_blocks, dtype=np.bool_)
    for_row_blocks(lambda a, b: _add_up(features, second, sums, a, b), len(features), ROWS_A_BLOCK)
    for _ in range(MAX_ROUNDS):
        centres = _means(sums.sum(axis=0))
        plane = _middle_plane(centres, weight)
        for_row_blocks(
            lambda a, b, plane=plane: _part_again(features, plane, second, sums, changed, a, b),  # type: ignore[misc]
            len(features),
            ROWS_A_BLOCK,
        )
        if not changed.any():
            break
    return centres, second


def _parted_by_medians(
    features: NDArray[np.float64], second: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """
    Iterate with medians for centres and the Manhattan distance.

    """
    whole = np.rint(features * STEPS).astype(np.int64)
    for _ in range(MAX_ROUNDS):
        centres = _medians(whole, second)
        before, second = second, in_second(features, centres, None)
        if np.array_equal(before, second):
            break
    return centres, second


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
    found = np.empty(len(features), dtype=np.bool_)
    plane = _middle_plane(centres, weight)
    for_row_blocks(lambda a, b: _beyond(features, plane, found, a, b), len(features), ROWS_A_BLOCK)
    return found


def _middle_plane(
    centres: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """
    Return the direction across the plane between the centres, and how far along it the plane lies.

    Squared distances differ by a linear function: which side of the plane a point is on.

    """
    across = weight @ (centres[1] - centres[0])
    return across, 0.5 * float(centres[1] @ weight @ centres[1] - centres[0] @ weight @ centres[0])


def _means(sums: NDArray[np.int64]) -> NDArray[np.float64]:
    """
    Return the means of both clusters from what `_add_up` found; that of all points for one that has none.

    """
    if not sums[:, -1].all():
        sums = np.repeat(sums.sum(axis=0)[None], 2, axis=0)
    return sums[:, :-1] / (sums[:, -1:] * float(STEPS))


def _medians(whole: NDArray[np.int64], second: NDArray[np.bool_]) -> NDArray[np.float64]:
    """
    Return the medians of both clusters; that of all points for one that has none.

    """
    parts = (whole[~second], whole[second])
    return np.array([np.median(part if len(part) else whole, axis=0) for part in parts]) / STEPS


@njit(cache=True, nogil=True)
def _add_up(features, second, sums, begin, end):  # type: ignore[no-untyped-def]
    """
    Sum the rows begin to end, a block, of each cluster as whole numbers; their count comes last.

    """
    block = sums[begin // ROWS_A_BLOCK]
    block[:] = 0
    for i in range(begin, end):
        part = block[1 if second[i] else 0]
        for k in range(features.shape[1]):
            part[k] += np.int64(np.rint(features[i, k] * STEPS))
        part[-1] += 1


@njit(cache=True, nogil=True)
def _beyond(features, plane, found, begin, end):  # type: ignore[no-untyped-def]
    """
    Tell which of the rows begin to end lie beyond a plane.

    """
    across, middle = plane
    for i in range(begin, end):
        along = 0.0
        for k in range(features.shape[1]):
            along += features[i, k] * across[k]
        found[i] = along > middle


@njit(cache=True, nogil=True)
def _part_again(features, plane, second, sums, changed, begin, end):  # type: ignore[no-untyped-def]
    """
    Do both for one block of rows, and note whether any changed sides.

    """
    before = second[begin:end].copy()
    _beyond(features, plane, second, begin, end)
    different = False
    for i in range(begin, end):
        different |= before[i - begin] != second[i]
    changed[begin // ROWS_A_BLOCK] = different
    if different:
        _add_up(features, second, sums, begin, end)
