"""Which points are edges by two clusters of features, of each roof or of a whole tile."""

from __future__ import annotations

import math
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
#: What k-means parts are halves of one cluster: typical centres stood for its own.
ONE_CLUSTER = "one_cluster"
#: A small roof: typical centres stood for its own. Of fewer than two distinct points none is an edge.
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
#: What stands for all points of a tile in place of a roof's number.
ALL_ROOFS = -1


@dataclass(frozen=True, eq=False)
class Clusters:
    """The two clusters of some points."""

    roof_id: int  #: the roof whose points they are; −1 for all points
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
    roof_id: NDArray[np.int64] | None,
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.bool_], tuple[Clusters, ...]]:
    """
    Label the points of each roof, or of all together where there is no `roof_id`; return the clusters, too.

    Points that lie where all their neighbours do have no shape: they are no edges and move no centre.
    """
    edge = np.zeros(len(linearity), dtype=np.bool_)
    numbers, place = np.full(min(len(edge), 1), ALL_ROOFS), np.zeros(len(edge), dtype=np.int64)
    if roof_id is not None:
        numbers, place = numbered(roof_id)
    features, linearity = _with_exact_sums(features), _with_exact_sums(linearity)
    rows = np.flatnonzero(has_shape)
    place = place[rows].astype(np.min_scalar_type(len(numbers)))  # short numbers sort fastest (radix sort)
    rows = rows[np.argsort(place, kind="stable")]
    ends = np.cumsum(np.bincount(place, minlength=len(numbers)))
    clusters = []
    # For clusters this small one thread is the quickest.
    with threadpool_limits(1):
        for number, own in zip(numbers.tolist(), np.split(rows, ends)[:-1], strict=True):
            edge[own], found = _cluster(number, features.take(own, axis=0), linearity[own], config)
            clusters.append(found)
    return edge, tuple(clusters)


def _with_exact_sums(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers within 0 to 1 so rounded that no order of adding them up changes their sum."""
    return np.round(shares / STEP) * STEP


def _cluster(
    number: int, features: NDArray[np.float64], linearity: NDArray[np.float64], config: EdgeLabellingConfig
) -> tuple[NDArray[np.bool_], Clusters]:
    if len(features) < 2:
        nothing = np.full((2, features.shape[1]), np.nan)
        return np.zeros(len(features), dtype=np.bool_), Clusters(
            number, len(features), TOO_FEW_POINTS, nothing
        )
    metric = metric_of(features, config.distance)
    centres, status = _centres(features, linearity, metric, config)
    return in_second(features, centres, metric), Clusters(number, len(features), status, centres)


def _centres(
    features: NDArray[np.float64],
    linearity: NDArray[np.float64],
    metric: dict[str, Any],
    config: EdgeLabellingConfig,
) -> tuple[NDArray[np.float64], str]:
    """Return the centres of surfaces and edges, and whether they are the points' own."""
    typical = np.array(TYPICAL_CENTRES[config.features])
    if len(features) < MIN_ROOF_POINTS and config.scope == "roof":
        return typical, TOO_FEW_POINTS
    centres = two_means(features, linearity, config.distance)
    second = in_second(features, centres, metric)
    if not second.any() or linearity[second].mean() - linearity[~second].mean() < MIN_LINEARITY_GAP:
        return typical, ONE_CLUSTER
    return centres, OK


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
    """
    Iterate with means for centres, with the Manhattan distance with medians.

    By hand: scikit-learn's takes 1 s to import, and its threads spin as long again on so few features.
    """
    metric = metric_of(features, distance)
    for _ in range(MAX_ROUNDS):
        before, second = second, in_second(features, _part_centres(features, second, distance), metric)
        if _is_one(second) or np.array_equal(before, second):
            break
    return second


def _part_centres(
    features: NDArray[np.float64], second: NDArray[np.bool_], distance: str
) -> NDArray[np.float64]:
    """Return the medians of both parts, or their means."""
    parts = np.array([~second, second])
    if distance == "manhattan":
        return np.array([np.median(features[part], axis=0) for part in parts])
    return parts.astype(np.float64) @ features / parts.sum(axis=1, keepdims=True)


#: Feature set → centres of surfaces and of edges where a roof's own are not to be had: means over the roofs
#: of four areas, of 2 to 26 points/m², at the default radii.
TYPICAL_CENTRES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "eigenvalues": ((0.26, 0.23, 0.005), (0.225, 0.10, 0.01)),
    "linearity_planarity": ((0.11, 0.87), (0.59, 0.36)),
    "linearity": ((0.11,), (0.60,)),
}


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


def set_apart(
    points: NDArray[np.float64], roof_id: NDArray[np.int64] | None, reach: float
) -> NDArray[np.float64]:
    """
    Return the points with roofs lifted so far above one another that none is within reach of another [m].

    The lift is a multiple of a power of two: coordinates that fit a float32 keep their differences exactly.
    """
    if roof_id is None or len(points) == 0:
        return points
    number = numbered(roof_id)[1]
    lift = 2.0 ** math.ceil(math.log2(np.ptp(points[:, 2]) + 2.0 * reach))
    return points + np.outer(number * lift, [0.0, 0.0, 1.0])


def numbered(roof_id: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the roofs' numbers, rising, and each point's place among them."""
    low, high = (int(roof_id.min()), int(roof_id.max())) if len(roof_id) else (0, 0)
    if high - low >= len(roof_id):
        numbers, dense = np.unique(roof_id, return_inverse=True)
        return numbers, dense.reshape(-1)
    numbers = np.flatnonzero(np.bincount(roof_id - low)) + low
    if len(numbers) == high - low + 1:
        return numbers, roof_id if low == 0 else roof_id - low
    place = np.zeros(high - low + 1, dtype=np.int64)
    place[numbers - low] = np.arange(len(numbers))
    return numbers, place[roof_id - low]


def roofs_in_plan(cells: CellGrid) -> NDArray[np.int64]:
    """
    Number roofs from 0, per input row: points in cells that touch, be it at a corner, are of one.

    Cells are those of `build_grid`.
    """
    one, beside = np.nonzero(cells.adjacent >= 0)
    number = union_find.numbered(
        union_find.sets_of_pairs(len(cells.numbers), one, cells.adjacent[one, beside])
    )
    roof = np.empty(len(cells.points), dtype=np.int64)
    roof[cells.rows] = np.repeat(number, np.diff(cells.first))
    return roof
