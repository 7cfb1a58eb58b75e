"""
Which points are edges by the clusters of their features: roof by roof, for a whole tile, or by given centres.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.edge_labelling.measures import centres_of, measures_of
from lidar_buildings.core.edge_labelling.status import OK, ONE_CLUSTER, TOO_FEW_POINTS
from lidar_buildings.core.edge_labelling.two_means import in_second, two_means, weights
from lidar_buildings.core.eigenfeatures import EigenFeatures

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


def cluster_edges(
    found: EigenFeatures, roof_id: NDArray[np.int64] | None, config: EdgeLabellingConfig
) -> tuple[NDArray[np.bool_], tuple[Clusters, ...]]:
    """
    Label the points of each roof, or of all together where there is no `roof_id`; return the clusters, too.

    Points that lie where all their neighbours do have no shape: they are no edges and move no centre.

    """
    features = measures_of(found, config.features)
    linearity = found.linearity if config.features == "eigenvalues" else features[:, 0]
    edge = np.zeros(len(features), dtype=np.bool_)
    rows = np.flatnonzero(found.eigenvalues[:, 0] > 0.0)
    clusters = []
    for number, members in _groups(rows, len(features), roof_id):
        clusters.append(_cluster(number, members, features, linearity, config, edge))
    return edge, tuple(clusters)


def _groups(
    rows: NDArray[np.int64], n_points: int, roof_id: NDArray[np.int64] | None
) -> list[tuple[int, NDArray[np.int64]]]:
    """
    Return (number, those of `rows` that are of this roof) by rising number, roofs without any of them, too.

    """
    if roof_id is None:
        return [(ALL_ROOFS, rows)] if n_points else []
    numbers, dense = _numbered(roof_id)
    counts = np.bincount(dense[rows], minlength=len(numbers))
    ends = np.cumsum(counts)
    ordered = np.empty_like(rows)
    _collect(rows, dense, ends - counts, ordered)
    return list(zip(numbers.tolist(), np.split(ordered, ends[:-1]), strict=True)) if len(numbers) else []


def _numbered(roof_id: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the roofs' numbers, rising, and each point's place among them.

    """
    low, high = (int(roof_id.min()), int(roof_id.max())) if len(roof_id) else (0, 0)
    if high - low >= len(roof_id):
        numbers, dense = np.unique(roof_id, return_inverse=True)
        return numbers, dense.reshape(-1)
    numbers = np.flatnonzero(np.bincount(roof_id - low)) + low
    place = np.zeros(high - low + 1, dtype=np.int64)
    place[numbers - low] = np.arange(len(numbers))
    return numbers, place[roof_id - low]


@njit(cache=True, nogil=True)
def _collect(rows, number, place, ordered):  # type: ignore[no-untyped-def]
    """
    Put rows of one number together; place[k], where number k begins, moves on with each of its rows.

    """
    for row in rows:
        k = number[row]
        ordered[place[k]] = row
        place[k] += 1


def _cluster(
    number: int,
    rows: NDArray[np.int64],
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    config: EdgeLabellingConfig,
    edge: NDArray[np.bool_],
) -> Clusters:
    """
    Label some rows in `edge`.

    """
    if len(rows) < 2:
        return Clusters(number, len(rows), TOO_FEW_POINTS, np.full((2, features.shape[1]), np.nan))
    own, lin = features[rows], linearity[rows]
    weight = weights(own, config.distance)
    centres, status = _centres(own, lin, weight, config)
    edge[rows] = in_second(own, centres, weight)
    return Clusters(number, len(rows), status, centres)


def _centres(
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    weight: NDArray[np.float64] | None,
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.float64], str]:
    """
    Return the centres of surfaces and edges, and whether they are the points' own.

    """
    typical = centres_of(config.features, ())
    if config.scope == "given":
        return centres_of(config.features, config.given_centres()), OK
    if len(features) < config.min_roof_points and config.scope == "roof":
        return typical, TOO_FEW_POINTS
    centres = two_means(features, linearity, config.distance)
    second = in_second(features, centres, weight)
    if not second.any() or not linearity[second].mean() - linearity[~second].mean() >= MIN_LINEARITY_GAP:
        return typical, ONE_CLUSTER
    return centres, OK
