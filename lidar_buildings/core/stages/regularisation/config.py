"""Settings of the regularisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter
from lidar_buildings.core.stages.regularisation.concavities import ConcavityLimits
from lidar_buildings.core.stages.regularisation.division import Costs

#: Smallest radius and length of an arc that points can tell from a corner [spacings].
_MIN_RADIUS, _MIN_ARC = 6.0, 10.0


@dataclass(frozen=True)
class RegularisationConfig(StageConfig):
    """Settings of the hierarchical least squares adjustment."""

    stage: ClassVar[str] = "regularisation"

    division: str = parameter(
        "optimal",
        "How a ring is divided into walls: the best division of all, or where its edges turn, as published "
        "by Sampath & Shan (2007).",
        choices=("optimal", "turns"),
    )
    max_turn_deg: float = parameter(
        40.0,
        "Largest angle between an edge and its wall if the ring is divided at turns; raising it gives fewer "
        "walls.",
        unit="deg",
        minimum=1.0,
        maximum=90.0,
    )
    noise: float = parameter(
        0.3,
        "Scatter of bearing points across their wall; raising it gives fewer, longer walls.",
        unit="spacings",
        minimum=0.01,
        maximum=5.0,
    )
    finest_spacing: float = parameter(
        0.2,
        "Spacing that points are worth at best, by their planimetric accuracy; raising it removes detail.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    max_dent_depth: float = parameter(
        1.0,
        "Depth up to which a concavity is where scan lines happen to end; raising it straightens walls.",
        unit="spacings",
        minimum=0.0,
        maximum=10.0,
    )
    max_dent_length: float = parameter(
        12.0,
        "Length up to which a concavity is where scan lines happen to end; raising it straightens walls.",
        unit="spacings",
        minimum=0.0,
        maximum=100.0,
    )
    max_gap_area: float = parameter(
        3.0,
        "Area up to which a gap is left by chance; raising it fills narrow notches.",
        unit="spacings²",
        minimum=0.0,
        maximum=100.0,
    )
    wall_cost: float = parameter(
        10.0,
        "What a wall must save in squared offsets over noise²; raising it gives fewer walls.",
        minimum=0.0,
    )
    own_direction_cost: float = parameter(
        15.0,
        "What a direction of its own must save; raising it turns more walls into the building's directions.",
        minimum=0.0,
    )
    direction_cost: float = parameter(
        10.0,
        "What a further pair of directions must save; raising it gives a building fewer of them.",
        minimum=0.0,
    )
    arc_cost: float = parameter(
        32.0,
        "What an arc must save over a wall along a direction; raising it draws more curves straight.",
        minimum=0.0,
    )
    curved_walls: bool = parameter(
        True,
        "Whether arcs are sought; without them curved walls are drawn with straight ones.",
    )
    chord_error: float = parameter(
        0.1,
        "Largest distance of an arc from the chords it is drawn with; raising it saves vertices.",
        unit="spacings",
        minimum=0.001,
        maximum=10.0,
    )
    long_wall: float = parameter(
        8.0,
        "Length from which a wall helps to find the directions; raising it leaves that to fewer walls.",
        unit="spacings",
        minimum=1.0,
        maximum=1000.0,
    )
    max_directions: int = parameter(
        8,
        "Most pairs of perpendicular directions that are tried; raising it serves crooked blocks.",
        minimum=0,
        maximum=32,
    )
    angle_tolerance_deg: float = parameter(
        10.0,
        "Largest angle between long walls of one direction; raising it joins more of them.",
        unit="deg",
        minimum=0.0,
        maximum=45.0,
    )
    direction_weight: float = parameter(
        100.0,
        "Weight of the long walls' directions over a wall's own points; raising it makes angles more exact.",
        minimum=0.0,
    )
    min_step: float = parameter(
        1.0,
        "Shortest wall and smallest step between parallel ones; raising it removes more detail.",
        unit="spacings",
        minimum=0.0,
        maximum=100.0,
    )
    correct_bias: bool = parameter(
        False,
        "Whether walls are moved out to the edge that points lie inside of, or go through the points.",
    )
    max_wall_gap: float = parameter(
        2.5,
        "Gap up to which buildings that were split from one block get a common wall; raising it closes wider "
        "gaps, 0 leaves all walls apart.",
        unit="spacings",
        minimum=0.0,
        maximum=10.0,
    )
    min_overlap: float = parameter(
        0.85,
        "Smallest intersection over union with the traced outline; raising it keeps more outlines as traced.",
        minimum=0.0,
        maximum=1.0,
    )
    keep_outlines: bool = parameter(
        False,
        "Whether all outlines stay as they are: set where footprints are given.",
    )

    def concavity_limits(self, spacing: float) -> ConcavityLimits | None:
        """Return what a concavity may measure at a point spacing [m]; None if there are no concavities."""
        if not (self.max_dent_depth or self.max_gap_area):
            return None
        return ConcavityLimits(
            self.max_dent_depth * spacing,
            self.max_dent_length * spacing,
            self.max_gap_area * spacing**2,
            self.max_gap_area * spacing,
        )

    def costs(self, spacing: float) -> Costs:
        """
        Return what walls cost at a point spacing [m]; the step between two parallel ones costs another wall.
        """
        return Costs(
            noise=self.noise * spacing,
            wall=self.wall_cost,
            own_direction=self.own_direction_cost,
            step=self.wall_cost,
            arc=self.arc_cost if self.curved_walls else float("inf"),
            min_radius=_MIN_RADIUS * spacing,
            min_arc=_MIN_ARC * spacing,
        )


#: The method as published: two perpendicular directions of the long walls, and all points of the ring.
AS_PUBLISHED = RegularisationConfig(
    division="turns",
    max_dent_depth=0.0,
    max_gap_area=0.0,
    finest_spacing=0.0,
    max_directions=1,
    angle_tolerance_deg=45.0,
    curved_walls=False,
    min_overlap=0.0,
)
