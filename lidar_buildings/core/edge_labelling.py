"""
Edge labelling: which roof points lie on edges.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.eigenfeatures import EigenFeatures, eigen_features
from lidar_buildings.core.parameters import StageConfig, parameter
from lidar_buildings.core.point_array import checked_points
from lidar_buildings.core.point_spacing import quantised_spacing

#: Points that the clusters are found from; twice as many move the centres by less than 0.01.
MAX_FITTED = 50_000
#: Centres are rounded to this part of the features' range (1 for L and P, 1/3 for λ/R²), so that neighbouring
#: tiles mostly get the same ones and their labels agree along the seam.
CENTRE_STEP = 0.05
#: Starts of k-means, the best of which is taken.
N_STARTS = 4
#: Two clusters whose mean linearities are nearer than this are halves of one. Theory has 0 for a plane and
#: 0.72 for its edge; a noisy plane without edges, split by force, gives 0.05 to 0.13.
MIN_LINEARITY_GAP = 0.2
#: Mean linearity from which on a single cluster is one of edges: a quarter plane, the least linear edge.
SINGLE_CLUSTER_EDGE = 0.46

OK = "ok"
ONE_CLUSTER = "one_cluster"
TOO_FEW_POINTS = "too_few_points"


@dataclass(frozen=True)
class EdgeLabellingConfig(StageConfig):
    """
    Parameters of edge labelling.

    """

    stage: ClassVar[str] = "edge_labelling"

    features: str = parameter(
        "linearity_planarity",
        "What the points are clustered by; eigenvalues find more edges, of which fewer are right.",
        choices=("eigenvalues", "linearity_planarity", "linearity"),
    )
    min_radius: float = parameter(
        1.6,
        "Smallest radius that the entropy can choose; raising it makes edges broader and steadier.",
        unit="spacings",
        minimum=1.0,
        maximum=20.0,
    )
    max_radius: float = parameter(
        5.0,
        "Largest radius that the entropy can choose; raising it helps on noisy surfaces and takes longer.",
        unit="spacings",
        minimum=1.0,
        maximum=50.0,
    )
    n_radii: int = parameter(
        12,
        "Number of radii between these two, closer together at the small end; raising it takes longer.",
        minimum=1,
        maximum=50,
    )
    min_neighbours: int = parameter(
        9,
        "Points that a radius has to hold to be chosen; raising it suppresses edges seen by chance.",
        minimum=3,
        maximum=100,
    )


@dataclass(frozen=True, eq=False)
class EdgeLabels:
    """
    Labels and features of the points' neighbourhoods.

    Attributes
    ----------
    edge : ndarray of uint8, shape (n_points,)
        1 = edge, 0 = none.
    linearity, planarity : ndarray of shape (n_points,)
        (λ1 − λ2)/λ1 and (λ2 − λ3)/λ1.
    normals : ndarray of shape (n_points, 3)
        Unit normals, z ≥ 0.
    neighbourhood_radius : ndarray of shape (n_points,)
        The radius chosen [m].
    status : str
        ``"ok"``; ``"one_cluster"``: the points cannot be told apart, all are edges or none is;
        ``"too_few_points"``: fewer than two distinct ones, none is an edge.

    """

    edge: NDArray[np.uint8]
    linearity: NDArray[np.float64]
    planarity: NDArray[np.float64]
    normals: NDArray[np.float64]
    neighbourhood_radius: NDArray[np.float64]
    status: str


def label_edges(
    points: ArrayLike, config: EdgeLabellingConfig | None = None, *, point_spacing: float | None = None
) -> EdgeLabels:
    """
    Tell roof points on edges from those on surfaces.

    Principal components of each point's sphere, its radius chosen by least entropy, are clustered in two by
    k-means; the cluster of higher linearity holds the edges (Santos, Galo and others). No threshold has to be
    known beforehand.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        Roof points of any number of buildings, in any order [m].
    config : EdgeLabellingConfig, optional
        The stage's parameters; radii are multiples of the point spacing.
    point_spacing : float, optional
        Spacing of the pulses [m]; measured if not given.

    Returns
    -------
    EdgeLabels
        Rows as in the input.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite.

    Notes
    -----
    Edges are bands: nearly all points within half a spacing of an outline, half of those at one spacing, none
    beyond two. Ridges bend the surface too little to be told apart: at slopes of 35 degrees a quarter of a
    gable's ridge is labelled, and none of a hip roof's. The order of the points does not matter. The clusters
    are those of the points given, so neighbouring tiles can label up to some 6 % of their points differently.

    """
    config = config or EdgeLabellingConfig()
    points = checked_points(points)
    spacing = point_spacing or quantised_spacing(points)
    largest = max(config.max_radius, config.min_radius)
    steps = np.unique(np.geomspace(config.min_radius, largest, config.n_radii))
    found = eigen_features(points, list(steps * spacing), min_neighbours=config.min_neighbours)
    edge, status = _edges(points, found, config)
    return EdgeLabels(edge, found.linearity, found.planarity, found.normals, found.radius, status)


def _edges(
    points: NDArray[np.float64], found: EigenFeatures, config: EdgeLabellingConfig
) -> tuple[NDArray[np.uint8], str]:
    """
    Cluster the points; return the labels and the status.

    """
    n = len(points)
    if n < 2 or not found.eigenvalues.any():
        return np.zeros(n, dtype=np.uint8), TOO_FEW_POINTS
    features = _features(found, config.features)
    fitted = _fitted_rows(points)
    centres = _two_centres(features[fitted])
    nearest = np.argmin(((features[:, None] - centres) ** 2).sum(axis=2), axis=1)
    linearity = np.array([_mean(found.linearity[fitted][nearest[fitted] == k]) for k in (0, 1)])
    if not abs(linearity[1] - linearity[0]) >= MIN_LINEARITY_GAP:
        all_edges = _mean(found.linearity[fitted]) >= SINGLE_CLUSTER_EDGE
        return np.full(n, all_edges, dtype=np.uint8), ONE_CLUSTER
    return (nearest == np.argmax(linearity)).astype(np.uint8), OK


def _features(found: EigenFeatures, names: str) -> NDArray[np.float64]:
    """
    Return what is clustered, one row per point, in units of its range.

    """
    if names == "eigenvalues":
        return 3.0 * found.eigenvalues / found.radius[:, None] ** 2
    if names == "linearity":
        return found.linearity[:, None]
    return np.column_stack([found.linearity, found.planarity])


def _fitted_rows(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """
    Return evenly spaced rows of the points sorted by x, y, z: the same points whatever their order.

    """
    order = np.lexsort(points.T[::-1])
    return order[:: -(-len(order) // MAX_FITTED)]


def _two_centres(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the rounded centres of two clusters, which may be the same.

    """
    if len(np.unique(features, axis=0)) < 2:
        centres = np.repeat(features[:1], 2, axis=0)
    else:
        # Imported here: it takes half a second, which nodes that label no edges need not spend.
        from sklearn.cluster import KMeans

        centres = KMeans(n_clusters=2, n_init=N_STARTS, random_state=0).fit(features).cluster_centers_
    return np.round(centres / CENTRE_STEP) * CENTRE_STEP


def _mean(values: NDArray[np.float64]) -> float:
    """
    Return the mean, NaN of nothing.

    """
    return float(values.mean()) if len(values) else np.nan
