"""
The ground filter's parameters.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.kept_classes import CLASS_GROUPS
from lidar_buildings.core.parameters import StageConfig, parameter


@dataclass(frozen=True)
class GroundFilterConfig(StageConfig):
    """
    Parameters of `classify_ground`.

    """

    stage: ClassVar[str] = "ground_filter"

    method: str = parameter(
        "progressive_tin",
        "How ground is told from the rest: progressive TIN densification (Axelsson 2000).",
        choices=("progressive_tin",),
    )
    seed_cell: float = parameter(
        50.0,
        "Side of the cells whose lowest points start the TIN, about that of the largest building: raising it "
        "copes with larger buildings, and may lose steep hills.",
        unit="m",
        minimum=1.0,
        maximum=1000.0,
    )
    max_seed_rise: float = parameter(
        0.06,
        "How far a seed may stand above its neighbours' plane, in parts of seed_cell: raising it keeps more "
        "hilltops, and more of the roofs that fill a cell.",
        minimum=0.0,
        maximum=10.0,
    )
    candidate_spacing: float = parameter(
        1.0,
        "Only the lowest point per cell of this side may enter the TIN: raising it makes the terrain "
        "coarser and the filter faster.",
        unit="m",
        minimum=0.1,
        maximum=20.0,
    )
    iteration_angle: float = parameter(
        10.0,
        "Largest angle at which a point may be seen from the corners of a level facet and join the TIN: "
        "raising it climbs steeper terrain, and low objects.",
        unit="deg",
        minimum=0.1,
        maximum=89.0,
    )
    slope_gain: float = parameter(
        0.6,
        "By how much of a facet's own slope the iteration angle grows: raising it follows rough and steep "
        "terrain better, and climbs objects on it.",
        minimum=0.0,
        maximum=2.0,
    )
    iteration_distance: float = parameter(
        1.0,
        "Largest distance above its facet at which a point may join the TIN: raising it climbs steps and low "
        "objects.",
        unit="m",
        minimum=0.01,
        maximum=20.0,
    )
    min_facet_side: float = parameter(
        2.0,
        "Facets whose longest side is shorter are left as they are: raising it makes the terrain smoother.",
        unit="m",
        minimum=0.0,
        maximum=50.0,
    )
    ground_distance: float = parameter(
        0.3,
        "Points within this height of the finished TIN are ground: raising it takes in grass, kerbs and low "
        "walls.",
        unit="m",
        minimum=0.01,
        maximum=5.0,
    )
    ground_distance_slope: float = parameter(
        0.6,
        "By how much ground_distance grows per unit of slope of the facet: raising it takes in more on "
        "steep terrain.",
        unit="m",
        minimum=0.0,
        maximum=5.0,
    )
    noise_radius: float = parameter(
        6.0,
        "Radius within which a gross error stands apart, in multiples of the candidates' spacing: raising it "
        "finds fewer.",
        unit="spacings",
        minimum=1.0,
        maximum=50.0,
    )
    noise_group: int = parameter(
        6,
        "Largest number of gross errors that may lie together: raising it finds more, and takes small pits "
        "for errors.",
        minimum=1,
        maximum=100,
    )
    low_point_gap: float = parameter(
        1.0,
        "A low gross error lies further than this below all points around it: raising it finds fewer.",
        unit="m",
        minimum=0.1,
        maximum=100.0,
    )
    high_point_gap: float = parameter(
        25.0,
        "A high gross error lies further than this above all points around it: lowering it finds lower "
        "birds, and takes lone tree tops for errors.",
        unit="m",
        minimum=1.0,
        maximum=1000.0,
    )
    kept_classes: tuple[str, ...] = parameter(
        tuple(CLASS_GROUPS),
        "Classes of the source that its points keep, since nothing here would find them better; what is left "
        "out is classified anew. Noise, wires, bridges and other things have no part in the terrain.",
        choices=tuple(CLASS_GROUPS),
    )
