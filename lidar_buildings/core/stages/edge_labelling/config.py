"""Parameters of edge labelling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter


@dataclass(frozen=True)
class EdgeLabellingConfig(StageConfig):
    """Parameters of edge labelling; the defaults serve 1 to 60 pts/m²."""

    stage: ClassVar[str] = "edge_labelling"

    method: str = parameter(
        "k_means",
        "How edges are told from surfaces: by two clusters of the points' features (Santos and others), or "
        "by the nearest of eight theoretical shapes (Gross and Thoennessen, 2006).",
        choices=("k_means", "discriminant_analysis"),
    )
    features: str = parameter(
        "linearity_planarity",
        "What k-means clusters the points by; eigenvalues find more edges, of which fewer are right.",
        choices=("eigenvalues", "linearity_planarity", "linearity"),
    )
    distance: str = advanced(
        "euclidean",
        "Distance of k-means: Manhattan takes medians for centres, Mahalanobis weighs by the features' "
        "covariance.",
        choices=("euclidean", "manhattan", "mahalanobis"),
    )
    scope: str = advanced(
        "roof",
        "Which points share their clusters: those of a roof, or all of a tile.",
        choices=("roof", "tile"),
    )
    max_radius: float = advanced(
        4.0,
        "Largest radius that the entropy can choose; raising it helps on noisy surfaces and takes longer.",
        unit="spacings",
        within=(1.0, 50.0),
    )
    n_radii: int = advanced(
        10,
        "Number of radii between these two, closer together at the small end; raising it takes longer.",
        within=(1, 50),
    )
    thinning: str = parameter(
        "outline",
        "What stays of the band of edge points: the rims of roofs in plan; the rims of surfaces, steps "
        "between roofs among them; or, as published, all.",
        choices=("outline", "surface", "none"),
    )
    rim_radius: float = parameter(
        1.25,
        "A point is on a rim if an empty disc of this radius touches it; raising it bridges larger gaps and "
        "rounds notches off.",
        unit="spacings",
        within=(0.5, 20.0),
    )
    band_reach: float = advanced(
        1.5,
        "A rim point is an edge if the band comes this near in plan; raising it closes gaps in edges and "
        "lets holes in roofs be edges.",
        unit="spacings",
        within=(0.0, 20.0),
    )


#: The method as published: clusters of a whole tile, the band of edges as it is.
AS_PUBLISHED = EdgeLabellingConfig(scope="tile", max_radius=5.0, n_radii=12, thinning="none")
