"""Which points are edges by two clusters of features, of each roof or of a whole tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from lidar_buildings.core.neighbours import union_find
from lidar_buildings.core.neighbours.cell_grid import CellGrid
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.surfaces.eigenfeatures import EigenFeatures

#: There were two clusters, edges and surfaces.
OK = "ok"
#: K-means found halves of one cluster: typical centres replace its own.
ONE_CLUSTER = "one_cluster"
#: A small roof: typical centres replace its own. Of fewer than two distinct points none is an edge.
TOO_FEW_POINTS = "too_few_points"
#: Two clusters whose mean linearities are nearer than this are halves of one. Theory has 0 for a plane and
#: 0.72 for its edge. Roofs give 0.36 and more; surfaces without edges, split by force, 0.05 to 0.15, and
#: points scattered at random 0.20 to 0.23.
MIN_LINEARITY_GAP = 0.25
#: Roofs of fewer points are labelled by typical centres. Wide margin: with 15 or 60 scores of
#: `bench.edges.run` move by 0.01 %.
MIN_ROOF_POINTS = 30
#: What features are multiples of: sums of up to 8 billion fit a float64 to the last bit.
STEP = 2.0**-20
#: Rounds after which clusters that still change are taken as they are. Wide margin: real roofs take 14.
MAX_ROUNDS = 100
#: The start parts the points half-way between these percentiles of their linearity: among surface and edge.
#: Wide margin: it ends where the best of ten random starts does (`test_k_means.py`).
START_PERCENTILES = (10.0, 90.0)
#: Added to the covariance's diagonal in units of its trace, where features are functions of one another.
#: Wide margin: far above rounding, far below the spread of features.
RIDGE = 1e-6
#: Feature set → centres of surfaces and of edges where a roof's own are not to be had: means over the roofs
#: of four areas, of 2 to 26 points/m², at the default radii.
TYPICAL_CENTRES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "eigenvalues": ((0.26, 0.23, 0.005), (0.225, 0.10, 0.01)),
    "linearity_planarity": ((0.11, 0.87), (0.59, 0.36)),
    "linearity": ((0.11,), (0.60,)),
}


@dataclass(frozen=True, eq=False)
class Clusters:
    """The two clusters of some points."""

    n_points: int  #: points that were clustered
    status: str  #: ``"ok"``, ``"one_cluster"`` or ``"too_few_points"``
    #: Of surfaces and of edges: the points' own if the status is ``"ok"``, else typical ones; NaN where there
    #: was nothing to label, shape (2, n_features).
    centres: NDArray[np.float64]


def overall(clusters: tuple[Clusters, ...]) -> str:
    """Return the best status of several clusters, that of no points if there are none."""
    found = {one.status for one in clusters}
    return next((one for one in (OK, ONE_CLUSTER) if one in found), TOO_FEW_POINTS)


def cluster_edges(
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    has_shape: NDArray[np.bool_],
    roof: NDArray[np.int64] | None,
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.bool_], tuple[Clusters, ...]]:
    """
    Label the points of each roof, numbered from 0, or of all together if there is no `roof`.

    Points that lie where all their neighbours do have no shape: they are no edges and move no centre. Return
    the clusters by rising number, too.
    """
    edge = np.zeros(len(linearity), dtype=np.bool_)
    if roof is None:
        roof = np.zeros(len(edge), dtype=np.int64)
    n_roofs = int(roof.max(initial=-1)) + 1
    features, linearity = _with_exact_sums(features), _with_exact_sums(linearity)
    rows = np.flatnonzero(has_shape)
    place = roof[rows].astype(np.min_scalar_type(n_roofs))  # short numbers sort fastest (radix sort)
    rows = rows[np.argsort(place, kind="stable")]
    ends = np.cumsum(np.bincount(place, minlength=n_roofs))
    clusters = []
    # For clusters this small one thread is the quickest.
    with threadpool_limits(1):
        for own in np.split(rows, ends)[:-1]:
            edge[own], found = _cluster(features.take(own, axis=0), linearity[own], config)
            clusters.append(found)
    return edge, tuple(clusters)


def _with_exact_sums(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round numbers within 0 to 1 so that their sum does not depend on their order."""
    return np.round(shares / STEP) * STEP


def _cluster(
    features: NDArray[np.float64], linearity: NDArray[np.float64], config: EdgeLabellingConfig
) -> tuple[NDArray[np.bool_], Clusters]:
    n = len(features)
    centres, status = np.array(TYPICAL_CENTRES[config.features]), TOO_FEW_POINTS
    if n < 2:
        return np.zeros(n, dtype=np.bool_), Clusters(n, status, np.full_like(centres, np.nan))
    metric = metric_of(features, config.distance)
    if n >= MIN_ROOF_POINTS or config.scope != "roof":
        own = two_means(features, linearity, config.distance)
        second = in_second(features, own, metric)
        status = ONE_CLUSTER
        if second.any() and linearity[second].mean() - linearity[~second].mean() >= MIN_LINEARITY_GAP:
            centres, status = own, OK
    return in_second(features, centres, metric), Clusters(n, status, centres)


def two_means(
    features: NDArray[np.float64], linearity: NDArray[np.float64], distance: str
) -> NDArray[np.float64]:
    """
    Return the centres of two clusters, that of the lower mean linearity first; equal ones if there is one.

    Lloyd's iteration from a start by linearity, repeatable. With the Manhattan distance centres are medians;
    with the Mahalanobis distance features are whitened by their covariance over all the points given.
    """
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
    return _part_centres(features, second, distance)


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
    """Iterate with means for centres, with the Manhattan distance with medians."""
    # By hand: with this start scikit-learn's KMeans (n_init=1) has the same labels for 839,643 points in 123
    # clusterings, but takes 0.23 s in place of 0.06 s, 1 to 4 s to import, and knows no medians.
    metric = metric_of(features, distance)
    for _ in range(MAX_ROUNDS):
        before, second = second, in_second(features, _part_centres(features, second, distance), metric)
        if _is_one(second) or np.array_equal(before, second):
            break
    return second


def _part_centres(
    features: NDArray[np.float64], second: NDArray[np.bool_], distance: str
) -> NDArray[np.float64]:
    parts = np.array([~second, second])
    if distance == "manhattan":
        return np.array([np.median(features[part], axis=0) for part in parts])
    return parts.astype(np.float64) @ features / parts.sum(axis=1, keepdims=True)


def eigenvalues_by_area(found: EigenFeatures) -> NDArray[np.float64]:
    """Return λ in units of the neighbourhood's R², which makes them comparable from radius to radius."""
    return found.eigenvalues / np.square(found.radius)[:, None]


def measures_of(found: EigenFeatures, features: str) -> NDArray[np.float64]:
    """
    Return what points are clustered by, shape (n_points, n_features), within 0 to 1.

    `features` is the feature set (Santos and others, Table 2).
    """
    if features == "eigenvalues":
        return eigenvalues_by_area(found)
    return np.column_stack([getattr(found, name) for name in features.split("_")])


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one."""
    beside = cells.around(cells.size).reshape(-1, 2)
    length = np.diff(beside)[:, 0]
    own = np.repeat(np.repeat(np.arange(len(cells.numbers)), 3), length)
    touched = np.repeat(beside[:, 1] - np.cumsum(length), length) + np.arange(len(own))
    number = union_find.numbered(union_find.sets_of_pairs(len(cells.numbers), own, touched))
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = number[cells.cell]
    return roof
