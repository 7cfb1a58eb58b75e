"""
The parameters of plane fitting.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.parameters import StageConfig, parameter


@dataclass(frozen=True)
class PlaneFittingConfig(StageConfig):
    """
    How roof planes are found.

    """

    stage: ClassVar[str] = "plane_fitting"

    max_plane_distance: float = parameter(
        0.15,
        "Largest distance of a point to its plane, about three times the vertical accuracy of the scan; "
        "raising it makes planes swallow small steps.",
        unit="m",
        minimum=0.01,
        maximum=2.0,
    )
    max_normal_angle_deg: float = parameter(
        35.0,
        "Largest angle between a plane and the surface around a point of it; raising it lets planes run "
        "through rough surfaces.",
        unit="deg",
        minimum=5.0,
        maximum=90.0,
    )
    connection_radius: float = parameter(
        3.0,
        "Points of a plane that are closer than this are connected; raising it joins separate parts.",
        unit="spacings",
        minimum=1.5,
        maximum=10.0,
    )
    min_plane_area: float = parameter(
        1.5,
        "Smallest plane, as the area that its points stand for; raising it drops dormers and chimneys.",
        unit="m²",
        minimum=0.0,
        maximum=1000.0,
    )
    min_plane_points: int = parameter(
        6,
        "Fewest points of a plane whatever its area; raising it drops small planes of sparse clouds.",
        minimum=4,
        maximum=100000,
    )
    max_slope_deg: float = parameter(
        80.0,
        "Steepest plane that still counts as roof; raising it lets walls in.",
        unit="deg",
        minimum=10.0,
        maximum=90.0,
    )
    merge_angle_deg: float = parameter(
        8.0,
        "Neighbouring planes that differ by less are joined if one plane fits both; raising it joins more.",
        unit="deg",
        minimum=0.0,
        maximum=45.0,
    )
    smoothness: float = parameter(
        1.0,
        "Weight of a point's neighbours against its distances when two planes claim it; raising it "
        "straightens the seams of planes.",
        minimum=0.0,
        maximum=10.0,
    )
    probability: float = parameter(
        0.95,
        "Probability that the samples hold one free of gross errors; raising it draws more samples.",
        minimum=0.5,
        maximum=0.9999,
    )
    outlier_share: float = parameter(
        0.4,
        "Expected share of points near a roof point that lie on other surfaces; raising it draws more "
        "samples.",
        minimum=0.0,
        maximum=0.95,
    )
    random_state: int = parameter(0, "Seed of the random samples; another value draws others.", minimum=0)
