"""The ground filter's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.classes import CLASS_GROUPS
from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter

#: Side of the cells of which only the lowest point may enter the terrain [m]; from `bench.ground.isprs`.
CANDIDATE_SPACING = 1.0
#: Height of every point above the ground that no point shows: a storey, more than the lowest roof's [m].
HEIGHT_WITHOUT_GROUND = 3.0


@dataclass(frozen=True)
class GroundFilterConfig(StageConfig):
    """Parameters of `classify_ground`."""

    stage: ClassVar[str] = "ground_filter"

    method: str = parameter(
        "consensus",
        "How ground is told from the rest: by a TIN that grows (Axelsson 2000), along profiles (Shan and "
        "Sampath 2005), by openings (Zhang et al. 2003), or by the majority of the three; as published, by a "
        "TIN with thresholds from histograms (Mancera-Taboada et al. 2012), or between slopes up and down "
        "(Sampath and Shan 2007); none is for clouds of roofs alone, below which the ground is taken to lie "
        "3 m.",
        choices=(
            "consensus",
            "progressive_tin",
            "bidirectional_slope",
            "morphological",
            "histogram_tin",
            "slope_pairs",
            "none",
        ),
    )
    seed_cell: float = parameter(
        50.0,
        "Side of the cells whose lowest points start the TIN, about that of the largest building: raising it "
        "copes with larger buildings, and may lose steep hills.",
        unit="m",
        within=(1.0, 1000.0),
    )
    iteration_angle: float = parameter(
        9.0,
        "Largest angle at which a point may be seen from the corners of a level facet and join the TIN: "
        "raising it climbs steeper terrain, and low objects.",
        unit="deg",
        within=(0.1, 89.0),
    )
    ground_distance: float = parameter(
        0.25,
        "Points within this height of the finished TIN are ground: raising it takes in grass, kerbs and low "
        "walls.",
        unit="m",
        within=(0.01, 5.0),
    )
    kept_classes: tuple[str, ...] = parameter(
        tuple(name for name in CLASS_GROUPS if name != "other"),
        "Classes of the source that its points keep, since nothing here would find them better; what is left "
        "out is classified anew, as are vendors' own classes (19 and up) unless `other` is named. Noise, "
        "wires and bridges have no part in the terrain.",
        choices=tuple(CLASS_GROUPS),
    )
    slope_gain: float = advanced(
        0.6,
        "By how much of a facet's own slope the iteration angle grows: raising it follows rough and steep "
        "terrain better, and climbs objects on it.",
        within=(0.0, 2.0),
    )
    iteration_distance: float = advanced(
        0.8,
        "Largest distance above its facet at which a point may join the TIN: raising it climbs steps and low "
        "objects.",
        unit="m",
        within=(0.01, 20.0),
    )
    landform_distance: float = advanced(
        3.5,
        "Largest distance above its facet at which a point of a bank, mound or terrace may join: raising it "
        "finds higher ones, and more objects to choose between. No landforms are looked for if it is not "
        "above iteration_distance.",
        unit="m",
        within=(0.0, 50.0),
    )
    max_steep_share: float = advanced(
        0.15,
        "Largest share of steep links between a landform and the terrain around, among objects: raising it "
        "keeps more terraces, and more low buildings and bushes.",
        within=(0.0, 1.0),
    )
    max_open_steep_share: float = advanced(
        0.7, "The same in open terrain, where hardly any object stands.", within=(0.0, 1.0)
    )
    profile_directions: int = advanced(
        4,
        "Number of directions in which bidirectional_slope cuts profiles beside the scan lines: raising it "
        "makes labels surer, and slower.",
        within=(1, 16),
    )
    profile_max_slope: float = advanced(
        0.6,
        "A profile that rises more steeply, rise over run, leaves the ground: raising it climbs steeper "
        "terrain, and low objects.",
        within=(0.01, 10.0),
    )
    profile_step: float = advanced(
        0.35,
        "A profile leaves the ground where it rises by more, and is back within so much of the ground it "
        "left: raising it takes in higher kerbs and shrubs.",
        unit="m",
        within=(0.01, 5.0),
    )
    profile_max_object: float = advanced(
        80.0,
        "Nothing longer along a profile is an object: raising it copes with larger buildings, and may lose "
        "terraces.",
        unit="m",
        within=(1.0, 1000.0),
    )
    opening_radius: float = advanced(
        18.0,
        "Radius of the largest disc that cuts off whatever rises above it: raising it removes wider objects, "
        "and hilltops.",
        unit="m",
        within=(1.0, 200.0),
    )
    opening_slope: float = advanced(
        0.15,
        "Steepest rise over the radius of a disc that is terrain, rise over run: raising it keeps steeper "
        "terrain, and lower objects.",
        within=(0.0, 5.0),
    )
