"""Which points are edges by clusters of features: of each roof, or of a whole tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.k_means import in_second, metric_of, two_means
from lidar_buildings.core.stages.edge_labelling.measures import TYPICAL_CENTRES
from lidar_buildings.core.stages.edge_labelling.roofs import numbered

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
