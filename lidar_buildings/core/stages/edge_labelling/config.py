"""Parameters of edge labelling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter

#: Feature set → how many numbers a point has in it.
N_FEATURES = {"eigenvalues": 3, "linearity_planarity": 2, "linearity": 1}


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
        choices=tuple(N_FEATURES),
    )
    distance: str = advanced(
        "euclidean",
        "Distance of k-means: Manhattan takes medians for centres, Mahalanobis weighs by the features' "
        "covariance.",
        choices=("euclidean", "manhattan", "mahalanobis"),
    )
    scope: str = advanced(
        "roof",
        "Which points share their clusters: those of a roof, all of a tile, or of all tiles (the "
        "centres then are given).",
        choices=("roof", "tile", "given"),
    )
    centres: str = advanced(
        "",
        "Two centres for scope given, that of surfaces first: numbers parted by blanks, two times as many as "
        "there are features, eigenvalues in units of R²; empty takes typical ones.",
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
    entropy: str = advanced(
        "dimensionality",
        "What is least at the radius chosen: the entropy of line, plane and volume (Demantké and others, "
        "2011), or that of the eigenvalues (Weinmann and others, 2015), which favours lines.",
        choices=("dimensionality", "eigenentropy"),
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

    def __post_init__(self) -> None:
        """Check every value, and the centres against the features."""
        super().__post_init__()
        self.given_centres()

    def given_centres(self) -> tuple[float, ...]:
        """
        Return the numbers of `centres`, none if typical ones are to be taken.

        ParameterError if there are not two centres of finite numbers for the feature set, the second one more
        linear.
        """
        wanted = 2 * N_FEATURES[self.features]
        try:
            numbers = tuple(float(word) for word in self.centres.split())
        except ValueError:
            numbers = (float("nan"),)
        if numbers and not (len(numbers) == wanted and all(0.0 <= number <= 1.0 for number in numbers)):
            raise ParameterError(
                f"{self.stage}.centres = {self.centres!r}: must be empty or {wanted} numbers within 0 to 1 "
                f"for features {self.features}"
            )
        if numbers and not self._linearity(numbers[: wanted // 2]) < self._linearity(numbers[wanted // 2 :]):
            raise ParameterError(
                f"{self.stage}.centres = {self.centres!r}: the second, that of edges, must be more linear"
            )
        return numbers

    def _linearity(self, centre: tuple[float, ...]) -> float:
        if self.features != "eigenvalues":
            return centre[0]
        return (centre[0] - centre[1]) / centre[0] if centre[0] > 0.0 else 0.0


#: The method as published: clusters of a whole tile, the band of edges as it is.
AS_PUBLISHED = EdgeLabellingConfig(scope="tile", max_radius=5.0, n_radii=12, thinning="none")
