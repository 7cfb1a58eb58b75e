"""
Which points are edges by the clusters of their features: roof by roof, for a whole tile, or by given centres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.measures import centres_of
from lidar_buildings.core.stages.edge_labelling.roofs import numbered
from lidar_buildings.core.stages.edge_labelling.status import OK, ONE_CLUSTER, TOO_FEW_POINTS
from lidar_buildings.core.stages.edge_labelling.two_means import in_second, mean_by_part, two_means, weights

#: Two clusters whose mean linearities are nearer than this are halves of one. Theory has 0 for a plane and
#: 0.72 for its edge. Roofs give 0.36 and more; surfaces without edges, split by force, 0.05 to 0.15, and
#: points scattered at random 0.20 to 0.23.
MIN_LINEARITY_GAP = 0.25


@dataclass(frozen=True, eq=False)
class Clusters:
    """
    The two clusters of some points.

    Attributes
    ----------
    roof_id : int
        The roof whose points they are; −1 for all points.
    n_points : int
        Points that were told apart.
    status : str
        ``"ok"``, ``"one_cluster"`` or ``"too_few_points"``.
    centres : ndarray of shape (2, n_features)
        Of surfaces and of edges: the points' own if the status is ``"ok"``, else typical ones; NaN where
        there was nothing to label.
    """

    roof_id: int
    n_points: int
    status: str
    centres: NDArray[np.float64]


#: What stands for all points of a tile in place of a roof's number.
ALL_ROOFS = -1
#: Roofs a block of work.
ROOFS_A_BLOCK = 8


def cluster_edges(
    measures: tuple[NDArray[np.float64], ...],
    linearity: NDArray[np.float64],
    has_shape: NDArray[np.bool_],
    roof_id: NDArray[np.int64] | None,
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.bool_], tuple[Clusters, ...]]:
    """
    Label the points of each roof, or of all together where there is no `roof_id`; return the clusters, too.

    Points that lie where all their neighbours do have no shape: they are no edges and move no centre.
    """
    edge = np.zeros(len(linearity), dtype=np.bool_)
    numbers, rows, first = _groups(has_shape, roof_id)
    own = np.empty((len(rows), len(measures)))
    lin, ordered = np.empty(len(rows)), np.empty(len(rows), dtype=np.bool_)
    for_row_blocks(lambda a, b: _gather(measures, linearity, rows, own, lin, a, b), len(rows))
    clusters: list[Clusters | None] = [None] * len(numbers)

    def cluster(begin: int, end: int) -> None:
        for k in range(begin, end):
            part = slice(first[k], first[k + 1])
            clusters[k] = _cluster(int(numbers[k]), own[part], lin[part], config, ordered[part])

    for_row_blocks(cluster, len(numbers), ROOFS_A_BLOCK)
    for_row_blocks(lambda a, b: _scatter(ordered, rows, edge, a, b), len(rows))
    return edge, tuple(one for one in clusters if one is not None)


def _groups(
    has_shape: NDArray[np.bool_], roof_id: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the roofs' numbers, rising, the rows with a shape roof by roof, and where those of each begin.
    """
    if roof_id is None:
        rows = np.flatnonzero(has_shape)
        numbers = np.full(min(len(has_shape), 1), ALL_ROOFS)
        return numbers, rows, np.array([0, len(rows)])
    numbers, dense = numbered(roof_id)
    first = np.zeros(len(numbers) + 1, dtype=np.int64)
    rows = _collect(has_shape, dense, first) if len(numbers) else np.zeros(0, dtype=np.int64)
    return numbers, rows, first


@njit(cache=True, nogil=True)
def _collect(kept, number, first):  # type: ignore[no-untyped-def]
    """Return the rows kept, those of one number together, and write to `first` where each begins."""
    for i in range(len(kept)):
        first[number[i] + 1] += kept[i]
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    place = first.copy()
    rows = np.empty(first[-1], dtype=np.int64)
    for i in range(len(kept)):
        if kept[i]:
            rows[place[number[i]]] = i
            place[number[i]] += 1
    return rows


@njit(cache=True, nogil=True)
def _gather(measures, linearity, rows, own, lin, begin, end):  # type: ignore[no-untyped-def]
    """Fill the rows begin to end with features and linearity of the points collected."""
    for k in range(len(measures)):
        for i in range(begin, end):
            own[i, k] = measures[k][rows[i]]
    for i in range(begin, end):
        lin[i] = linearity[rows[i]]


@njit(cache=True, nogil=True)
def _scatter(ordered, rows, edge, begin, end):  # type: ignore[no-untyped-def]
    """Write labels begin to end of the points collected to their rows."""
    for i in range(begin, end):
        edge[rows[i]] = ordered[i]


def _cluster(
    number: int,
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    config: EdgeLabellingConfig,
    edge: NDArray[np.bool_],
) -> Clusters:
    """Label a roof's points in `edge`."""
    edge[:] = False
    if len(features) < 2:
        nothing = np.full((2, features.shape[1]), np.nan)
        return Clusters(number, len(features), TOO_FEW_POINTS, nothing)
    weight = weights(features, config.distance)
    centres, status = _centres(features, linearity, weight, config)
    edge[:] = in_second(features, centres, weight)
    return Clusters(number, len(features), status, centres)


def _centres(
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    weight: NDArray[np.float64] | None,
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.float64], str]:
    """Return the centres of surfaces and edges, and whether they are the points' own."""
    typical = centres_of(config.features, ())
    if config.scope == "given":
        return centres_of(config.features, config.given_centres()), OK
    if len(features) < config.min_roof_points and config.scope == "roof":
        return typical, TOO_FEW_POINTS
    centres = two_means(features, linearity, config.distance)
    first, second = mean_by_part(linearity, in_second(features, centres, weight))
    if not second - first >= MIN_LINEARITY_GAP:
        return typical, ONE_CLUSTER
    return centres, OK
