"""The parameters of plane fitting."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter


@dataclass(frozen=True)
class PlaneFittingConfig(StageConfig):
    """How roof planes are found."""

    stage: ClassVar[str] = "plane_fitting"

    method: str = advanced(
        "connected",
        "How planes are found: connected, each a piece of surface, as many as pay; as published, ransac, one "
        "after the other out of all points, or fuzzy_k_means, clusters of normals; or open3d, that library's "
        "RANSAC.",
        choices=("connected", "ransac", "fuzzy_k_means", "open3d"),
    )
    max_plane_distance: float = parameter(
        0.18,
        "Largest distance of a point to its plane, about three times the vertical accuracy of the scan; "
        "raising it smooths small steps away.",
        unit="m",
        within=(0.01, 2.0),
    )
    max_normal_angle_deg: float = advanced(
        35.0,
        "Largest angle between a plane and the surface around a point of it; raising it lets planes run "
        "through rough surfaces (connected).",
        unit="deg",
        within=(5.0, 90.0),
    )
    min_plane_area: float = parameter(
        1.5,
        "Smallest plane, as the area that its points stand for; raising it drops dormers and chimneys.",
        unit="m²",
        within=(0.0, 1000.0),
    )
    min_plane_points: int = advanced(
        6,
        "Fewest points of a plane whatever its area; raising it drops small planes of sparse clouds.",
        within=(4, 100000),
    )
    max_slope_deg: float = parameter(
        87.0,
        "Steepest plane that still counts as roof; raising it lets walls in.",
        unit="deg",
        within=(10.0, 90.0),
    )
    largest_plane_area: float = advanced(
        0.0,
        "With ransac: area of the largest plane that is likely; a sample with as many points as it has ends "
        "the search for that plane. Raising it draws more samples, 0 draws all.",
        unit="m²",
        within=(0.0, 1_000_000.0),
    )
    outlier_share: float = advanced(
        0.4,
        "Expected share of points that lie on other surfaces: of those near a roof point (connected), or of "
        "all (ransac); raising it draws more samples.",
        within=(0.0, 0.95),
    )
    random_state: int = advanced(
        0, "Seed of the random samples; another value draws others.", within=(0, None)
    )

    def __post_init__(self) -> None:
        """Check what the base checks, and that Open3D is there if it is asked for."""
        super().__post_init__()
        if self.method == "open3d" and importlib.util.find_spec("open3d") is None:
            raise ParameterError(
                "plane_fitting.method = 'open3d': Open3D is not installed: "
                "pip install '.[view]' in the sources, or choose another method"
            )


#: The method of Mancera-Taboada et al. (2012): planes out of all points, one after the other.
AS_PUBLISHED = PlaneFittingConfig(method="ransac", outlier_share=0.8, max_slope_deg=90.0)
