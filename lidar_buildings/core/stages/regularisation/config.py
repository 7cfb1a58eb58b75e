"""Settings of the regularisation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter


@dataclass(frozen=True)
class RegularisationConfig(StageConfig):
    """Settings of the hierarchical least squares adjustment."""

    stage: ClassVar[str] = "regularisation"

    division: str = advanced(
        "optimal",
        "How a ring is divided into walls: the best division of all; or, as published by Sampath & Shan "
        "(2007), where an edge turns from the one before.",
        choices=("optimal", "slope_changes"),
    )
    max_turn_deg: float = advanced(
        40.0,
        "Largest angle between two edges of one wall, with slope_changes; raising it gives fewer walls.",
        unit="deg",
        within=(1.0, 90.0),
    )
    noise: float = parameter(
        0.3,
        "Scatter of bearing points across their wall; raising it gives fewer, longer walls.",
        unit="spacings",
        within=(0.01, 5.0),
    )
    finest_spacing: float = advanced(
        0.25,
        "Spacing that points are worth at best, by their planimetric accuracy; raising it removes detail.",
        unit="m",
        within=(0.0, 100.0),
    )
    bridge_concavities: bool = advanced(
        True, "Whether concavities that are gaps between points are bridged before walls are sought."
    )
    wall_cost: float = advanced(
        20.0,
        "What a wall must save in squared offsets over noise²; raising it gives fewer walls.",
        within=(0.0, None),
    )
    curved_walls: bool = advanced(
        True, "Whether arcs are sought; without them curved walls are drawn with straight ones."
    )
    chord_error: float = advanced(
        0.1,
        "Largest distance of an arc from the chords it is drawn with; raising it saves vertices.",
        unit="spacings",
        within=(0.001, 10.0),
    )
    max_directions: int = advanced(
        8,
        "Most pairs of perpendicular directions that are tried; raising it serves crooked blocks.",
        within=(0, 32),
    )
    angle_tolerance_deg: float = advanced(
        10.0,
        "Largest angle between long walls of one direction; raising it joins more of them.",
        unit="deg",
        within=(0.0, 45.0),
    )
    min_long_wall: float = advanced(
        0.0,
        "Length from which a wall helps to find the directions (10 as published), 0 for 8 spacings; raising "
        "it leaves fewer.",
        unit="m",
        within=(0.0, 1000.0),
    )
    adjustment: str = advanced(
        "robust",
        "How directions are found: long walls that do not fit have none; or, as published, all long walls "
        "take part, and both directions are estimated once more with all walls.",
        choices=("robust", "joint"),
    )
    direction_sigma_deg: float = advanced(
        0.3,
        "How far walls of a building are off its directions, as a standard deviation; raising it lets long "
        "walls turn as their points say.",
        unit="deg",
        within=(0.001, 45.0),
    )
    min_step: float = advanced(
        1.0,
        "Shortest wall and smallest step between parallel ones; raising it removes more detail.",
        unit="spacings",
        within=(0.0, 100.0),
    )
    correct_bias: bool = parameter(
        False, "Whether walls are moved out to the edge that points lie inside of, or go through the points."
    )
    max_wall_gap: float = parameter(
        2.5,
        "Gap up to which buildings that were split from one block get a common wall; raising it closes wider "
        "gaps, 0 leaves all walls apart.",
        unit="spacings",
        within=(0.0, 10.0),
    )
    keep_outlines: bool = parameter(
        False, "Whether all outlines stay as they are: set where footprints are given."
    )

    def stiffness(self, spacing: float) -> float:
        """Return the weight of a direction beside samples, each of which counts 1 [m²]."""
        return (self.noise * spacing / math.radians(self.direction_sigma_deg)) ** 2

    def line_cost(self, spacing: float) -> float:
        """Return what a wall's own line has to save in squared offsets [m²]: none is shared as published."""
        return self.wall_cost * (self.noise * spacing) ** 2 if self.division == "optimal" else 0.0


#: The method as published: two perpendicular directions of the long walls, and all points of the ring.
AS_PUBLISHED = RegularisationConfig(
    division="slope_changes",
    min_long_wall=10.0,
    adjustment="joint",
    direction_sigma_deg=0.05,
    bridge_concavities=False,
    finest_spacing=0.0,
    max_directions=1,
    angle_tolerance_deg=45.0,
    curved_walls=False,
)
