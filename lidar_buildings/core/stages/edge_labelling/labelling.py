"""The stage: features, clusters, thinning."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.point_spacing import given_or_measured
from lidar_buildings.core.stages.edge_labelling.clusters import (
    OK,
    TOO_FEW_POINTS,
    Clusters,
    cluster_edges,
    eigenvalues_by_area,
    measures_of,
    overall,
    roofs_in_plan,
)
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.rims import on_rims
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features

#: Smallest radius that the entropy can choose [spacings]: eight points on an even surface.
#: Wide margin: edge F of `bench.edges.run` is 97.1 with 1.4, 96.9 with 1.6, 97.0 with 1.8.
MIN_RADIUS = 1.6
#: Points that a radius has to hold to be chosen. Edge F of `bench.edges.run`: 95.9 with 7, 96.9 with 9, 97.3
#: with 12.
MIN_NEIGHBOURS = 9
#: The outlines of surfaces look past points farther up or down than this, so over lower steps [spacings].
MAX_STEP = 3.0


@dataclass(frozen=True, eq=False)
class EdgeLabels:
    """Labels and features of the points' neighbourhoods."""

    edge: NDArray[np.uint8]  #: 1 = edge, 0 = none, shape (n_points,)
    #: (λ1 − λ2)/λ1 and (λ2 − λ3)/λ1, shape (n_points,).
    linearity: NDArray[np.float64]
    planarity: NDArray[np.float64]
    normals: NDArray[np.float64]  #: unit normals, z ≥ 0, shape (n_points, 3)
    neighbourhood_radius: NDArray[np.float64]  #: the radius chosen [m], shape (n_points,)
    #: The best that a roof came to: ``"ok"``; ``"one_cluster"``: its points are all alike, and were held to
    #: typical centres instead of being split in halves; ``"too_few_points"``: so were too few points for
    #: clusters of their own; of fewer than two distinct ones none is an edge.
    status: str
    #: Each roof's status and centres by rising number, or those of all points; empty for discriminant
    #: analysis.
    clusters: tuple[Clusters, ...] = ()

    @property
    def n_roofs(self) -> dict[str, int]:
        """How many roofs came to each status."""
        return dict(Counter(one.status for one in self.clusters))


def label_edges(
    points: ArrayLike, config: EdgeLabellingConfig | None = None, *, point_spacing: float | None = None
) -> EdgeLabels:
    """
    Tell roof points on edges from those on surfaces.

    Principal components of each point's sphere, its radius chosen by least entropy, are clustered in two by
    k-means; the cluster of higher linearity is a band along edges (Santos, Galo and others). No threshold has
    to be known beforehand. Of the band those points stay, and points close to it become edges, that an empty
    disc touches in plan: the rims of roofs.

    - `points`, shape (n_points, 3): Roof points of any number of buildings, in any order [m].
    - `config`, optional: The stage's parameters; lengths are multiples of the point spacing. `AS_PUBLISHED`
      is the method without what was added to it.
    - `point_spacing`, optional: Spacing of the pulses [m]; measured if not given.

    Returned: rows as in the input. ValueError if `points` has another shape or is not finite, or
    `point_spacing` is not positive. Neither the order of the points nor the number of threads changes a
    label. A roof that lies whole in two tiles is labelled alike in both, given the same spacing. Steps
    between roofs are labelled with thinning "surface"; ridges only with "none", and few: they bend the
    surface too little to be told apart.
    """
    config = config or EdgeLabellingConfig()
    points = checked_points(points)
    spacing = given_or_measured(points, point_spacing)
    radii = np.unique(np.geomspace(MIN_RADIUS, max(config.max_radius, MIN_RADIUS), config.n_radii)) * spacing
    found = eigen_features(points, list(radii), min_neighbours=MIN_NEIGHBOURS)
    cells = sort_by_cell(points, max(2.0 * config.rim_radius, config.band_reach) * spacing)
    has_shape = found.eigenvalues[:, 0] > 0.0
    clusters: tuple[Clusters, ...] = ()
    if config.method == "discriminant_analysis":
        edge, status = (
            discriminant_edges(eigenvalues_by_area(found)),
            OK if has_shape.any() else TOO_FEW_POINTS,
        )
    else:
        roof = roofs_in_plan(cells) if config.scope == "roof" else None
        measures = measures_of(found, config.features)
        edge, clusters = cluster_edges(measures, found.linearity, has_shape, roof, config)
        status = overall(clusters)
    if config.thinning != "none":
        max_step = MAX_STEP * spacing if config.thinning == "surface" else np.inf
        radius, reach = config.rim_radius * spacing, config.band_reach * spacing
        edge = on_rims(cells, edge, None, radius=radius, reach=reach, max_step=max_step)
    return EdgeLabels(
        edge.astype(np.uint8), found.linearity, found.planarity, found.normals, found.radius, status, clusters
    )


class Shape(NamedTuple):
    """What a sphere of radius 1 about a point cuts out of an ideal structure."""

    name: str  #: in the words of the paper
    eigenvalues: tuple[float, float, float]  #: λ1 ≥ λ2 ≥ λ3 of the covariance about the mean, in units of R²
    is_edge: bool  #: the group that Santos and others put it in


# Moments over discs and sectors of radius 1: a half disc's centre lies 4/3π off, a quarter's on both axes.
_OFF = 4.0 / (3.0 * math.pi)
# A quarter disc's covariance has this diagonal and this beside it.
_QUARTER, _BESIDE = 1 / 4 - _OFF**2, 1 / (2 * math.pi) - _OFF**2
# The same of three quarter discs, one in each plane of coordinates.
_CORNER, _BESIDE_CORNER = 1 / 6 - (2 * _OFF / 3) ** 2, 1 / (6 * math.pi) - (2 * _OFF / 3) ** 2

#: The eight shapes. Of two planes at a right angle each is a half disc off the other by its own 4/3π.
SHAPES = (
    Shape("isolated point", (0.0, 0.0, 0.0), False),
    Shape("end of a line", (1 / 12, 0.0, 0.0), False),
    Shape("line", (1 / 3, 0.0, 0.0), True),
    Shape("half plane", (1 / 4, 1 / 4 - _OFF**2, 0.0), True),
    Shape("quarter plane", (_QUARTER - _BESIDE, _QUARTER + _BESIDE, 0.0), True),
    Shape("plane", (1 / 4, 1 / 4, 0.0), False),
    Shape("two planes", (1 / 4, 1 / 8, 1 / 8 - _OFF**2 / 2), True),
    Shape(
        "three planes",
        (_CORNER - _BESIDE_CORNER, _CORNER - _BESIDE_CORNER, _CORNER + 2 * _BESIDE_CORNER),
        False,
    ),
)


def nearest_shapes(eigenvalues: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the row in `SHAPES` nearest to each λ1 ≥ λ2 ≥ λ3, in units of R²; of two as near the first."""
    if not len(eigenvalues):
        return np.zeros(0, dtype=np.int64)
    # Imported here: scikit-learn takes seconds to import, and the default, k-means, does without it.
    from sklearn.neighbors import KNeighborsClassifier

    nearest = KNeighborsClassifier(n_neighbors=1, algorithm="brute")
    nearest.fit([shape.eigenvalues for shape in SHAPES], np.arange(len(SHAPES)))
    return np.asarray(nearest.predict(eigenvalues), dtype=np.int64)


def discriminant_edges(eigenvalues: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points' nearest shape is an edge: line, half plane, quarter plane or two planes."""
    return np.array([shape.is_edge for shape in SHAPES])[nearest_shapes(eigenvalues)]
