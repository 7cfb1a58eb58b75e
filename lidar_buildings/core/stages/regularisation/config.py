"""Settings of the regularisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.core.stages.regularisation.concavities import ConcavityLimits
from lidar_buildings.core.surfaces.ring_division.division import Costs

#: Depth and length of a concavity up to which it is where scan lines happen to end [spacings].
_MAX_DEPTH, _MAX_LENGTH = 1.0, 12.0
#: Area of a gap up to which it is left by chance [spacings²], and its depth [spacings].
_MAX_GAP_AREA = 3.0
#: What a direction of its own and an arc must save in squared offsets over noise² beside the wall's cost.
OWN_DIRECTION_COST, _ARC_COST = 15.0, 60.0


@dataclass(frozen=True)
class RegularisationConfig(StageConfig):
    """Settings of the hierarchical least squares adjustment."""

    stage: ClassVar[str] = "regularisation"

    division: str = parameter(
        "optimal",
        "How a ring is divided into walls: the best division of all; or, as published by Sampath & Shan "
        "(2007), where an edge turns from the one before.",
        choices=("optimal", "slope_changes"),
        advanced=True,
    )
    max_turn_deg: float = parameter(
        40.0,
        "Largest angle between two edges of one wall, with slope_changes; raising it gives fewer walls.",
        unit="deg",
        minimum=1.0,
        maximum=90.0,
        advanced=True,
    )
    noise: float = parameter(
        0.3,
        "Scatter of bearing points across their wall; raising it gives fewer, longer walls.",
        unit="spacings",
        minimum=0.01,
        maximum=5.0,
    )
    finest_spacing: float = parameter(
        0.25,
        "Spacing that points are worth at best, by their planimetric accuracy; raising it removes detail.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    bridge_concavities: bool = parameter(
        True,
        "Whether concavities that are gaps between points are bridged before walls are sought.",
        advanced=True,
    )
    wall_cost: float = parameter(
        20.0,
        "What a wall must save in squared offsets over noise²; raising it gives fewer walls.",
        minimum=0.0,
        advanced=True,
    )
    curved_walls: bool = parameter(
        True,
        "Whether arcs are sought; without them curved walls are drawn with straight ones.",
        advanced=True,
    )
    chord_error: float = parameter(
        0.1,
        "Largest distance of an arc from the chords it is drawn with; raising it saves vertices.",
        unit="spacings",
        minimum=0.001,
        maximum=10.0,
        advanced=True,
    )
    max_directions: int = parameter(
        8,
        "Most pairs of perpendicular directions that are tried; raising it serves crooked blocks.",
        minimum=0,
        maximum=32,
        advanced=True,
    )
    angle_tolerance_deg: float = parameter(
        10.0,
        "Largest angle between long walls of one direction; raising it joins more of them.",
        unit="deg",
        minimum=0.0,
        maximum=45.0,
        advanced=True,
    )
    min_long_wall: float = parameter(
        0.0,
        "Length from which a wall helps to find the directions (10 as published), 0 for 8 spacings; raising "
        "it leaves fewer.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
        advanced=True,
    )
    adjustment: str = parameter(
        "robust",
        "How directions are found: long walls that do not fit have none; or, as published, all long walls "
        "take part, and both directions are estimated once more with all walls.",
        choices=("robust", "joint"),
        advanced=True,
    )
    direction_weight: float = parameter(
        100.0,
        "Weight of the long walls' directions over a wall's own points; raising it makes angles more exact.",
        minimum=0.0,
        advanced=True,
    )
    min_step: float = parameter(
        1.0,
        "Shortest wall and smallest step between parallel ones; raising it removes more detail.",
        unit="spacings",
        minimum=0.0,
        maximum=100.0,
        advanced=True,
    )
    correct_bias: bool = parameter(
        False, "Whether walls are moved out to the edge that points lie inside of, or go through the points."
    )
    max_wall_gap: float = parameter(
        2.5,
        "Gap up to which buildings that were split from one block get a common wall; raising it closes wider "
        "gaps, 0 leaves all walls apart.",
        unit="spacings",
        minimum=0.0,
        maximum=10.0,
    )
    keep_outlines: bool = parameter(
        False, "Whether all outlines stay as they are: set where footprints are given."
    )

    def concavity_limits(self, spacing: float) -> ConcavityLimits | None:
        """Return which concavities are bridged at a point spacing [m]; None if none are."""
        if not self.bridge_concavities:
            return None
        return ConcavityLimits(
            _MAX_DEPTH * spacing, _MAX_LENGTH * spacing, _MAX_GAP_AREA * spacing**2, _MAX_GAP_AREA * spacing
        )

    def costs(self, spacing: float) -> Costs:
        """
        Return what walls cost at a point spacing [m]; the step between two parallel ones costs another wall.
        """
        return Costs(
            noise=self.noise * spacing,
            wall=self.wall_cost,
            own_direction=OWN_DIRECTION_COST,
            step=self.wall_cost,
            arc=_ARC_COST if self.curved_walls else float("inf"),
        )

    def line_cost(self, spacing: float) -> float:
        """Return what a wall's own line has to save in squared offsets [m²]: none is shared as published."""
        return self.wall_cost * (self.noise * spacing) ** 2 if self.division == "optimal" else 0.0


#: The method as published: two perpendicular directions of the long walls, and all points of the ring.
AS_PUBLISHED = RegularisationConfig(
    division="slope_changes",
    min_long_wall=10.0,
    adjustment="joint",
    bridge_concavities=False,
    finest_spacing=0.0,
    max_directions=1,
    angle_tolerance_deg=45.0,
    curved_walls=False,
)
