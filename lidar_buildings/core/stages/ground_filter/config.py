"""The ground filter's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.classes import CLASS_GROUPS
from lidar_buildings.core.model.parameters import StageConfig, parameter


@dataclass(frozen=True)
class GroundFilterConfig(StageConfig):
    """Parameters of `classify_ground`."""

    stage: ClassVar[str] = "ground_filter"

    method: str = parameter(
        "progressive_tin",
        "How ground is told from the rest: by a TIN that grows (Axelsson 2000), along scan lines (Shan and "
        "Sampath 2005), or by openings (Zhang et al. 2003).",
        choices=("progressive_tin", "bidirectional_slope", "morphological"),
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
        0.1,
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
        9.0,
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
        0.8,
        "Largest distance above its facet at which a point may join the TIN: raising it climbs steps and low "
        "objects.",
        unit="m",
        minimum=0.01,
        maximum=20.0,
    )
    landform_distance: float = parameter(
        3.5,
        "Largest distance above its facet at which a point of a bank, mound or terrace may join: raising it "
        "finds higher ones, and more objects to choose between. No landforms are looked for if it is not "
        "above iteration_distance.",
        unit="m",
        minimum=0.0,
        maximum=50.0,
    )
    landform_angle: float = parameter(
        20.0,
        "The iteration angle for landforms: raising it finds steeper ones, and more objects to choose "
        "between.",
        unit="deg",
        minimum=0.1,
        maximum=89.0,
    )
    landform_slope_gain: float = parameter(
        0.8,
        "The slope gain for landforms: raising it finds rougher ones, and more objects to choose between.",
        minimum=0.0,
        maximum=2.0,
    )
    max_steep_share: float = parameter(
        0.15,
        "Largest share of steep links between a landform and the terrain around, among objects: raising it "
        "keeps more terraces, and more low buildings and bushes.",
        minimum=0.0,
        maximum=1.0,
    )
    max_bare_steep_share: float = parameter(
        0.7,
        "The same in bare land, where hardly anything rises above the terrain.",
        minimum=0.0,
        maximum=1.0,
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
        0.9,
        "By how much ground_distance grows per unit of slope of the facet: raising it takes in more on "
        "steep terrain.",
        unit="m",
        minimum=0.0,
        maximum=5.0,
    )
    noise_radius: float = parameter(
        20.0,
        "How far around a low gross error hardly anything else lies as low, in multiples of the points' "
        "spacing: raising it finds fewer.",
        unit="spacings",
        minimum=3.0,
        maximum=50.0,
    )
    noise_group: int = parameter(
        60,
        "Largest number of gross errors that may lie together, those on top of one another counted once: "
        "raising it finds larger groups, and takes small pits for errors.",
        minimum=1,
        maximum=1000,
    )
    low_point_gap: float = parameter(
        1.0,
        "A low gross error lies further than this below what surrounds it: raising it finds fewer.",
        unit="m",
        minimum=0.1,
        maximum=100.0,
    )
    high_point_gap: float = parameter(
        10.0,
        "A high gross error lies further than this from everything else: lowering it finds birds nearer to "
        "the ground, and takes lone tree tops and masts for errors.",
        unit="m",
        minimum=1.0,
        maximum=1000.0,
    )
    profile_directions: int = parameter(
        4,
        "Number of directions in which bidirectional_slope cuts profiles beside the scan lines, 0 for scan "
        "lines alone: raising it makes labels surer, and slower.",
        minimum=0,
        maximum=16,
    )
    profile_width: float = parameter(
        1.7,
        "Width of the strips that are cut as profiles: raising it finds more points on each, less alike.",
        unit="spacings",
        minimum=0.5,
        maximum=10.0,
    )
    profile_max_slope: float = parameter(
        0.6,
        "A profile that rises more steeply, rise over run, leaves the ground: raising it climbs steeper "
        "terrain, and low objects.",
        minimum=0.01,
        maximum=10.0,
    )
    profile_step: float = parameter(
        0.35,
        "A profile leaves the ground where it rises by more, and is back within so much of the ground it "
        "left: raising it takes in higher kerbs and shrubs.",
        unit="m",
        minimum=0.01,
        maximum=5.0,
    )
    profile_fall: float = parameter(
        1.5,
        "Where a profile's beginning falls by more, it began on an object: raising it trusts them more.",
        unit="m",
        minimum=0.1,
        maximum=20.0,
    )
    profile_reentry_slope: float = parameter(
        0.05,
        "How steeply the ground behind an object may lie above the ground before it, rise over run: raising "
        "it finds more ground on rough slopes, and more low roofs.",
        minimum=0.0,
        maximum=2.0,
    )
    profile_max_object: float = parameter(
        80.0,
        "Nothing longer along a profile is an object: raising it copes with larger buildings, and may lose "
        "terraces.",
        unit="m",
        minimum=1.0,
        maximum=1000.0,
    )
    profile_window: float = parameter(
        1.0,
        "How far back along a profile a rise is looked for: raising it finds sloping edges in dense clouds.",
        unit="m",
        minimum=0.0,
        maximum=20.0,
    )
    profile_agreement: float = parameter(
        0.1,
        "By how much more passes have to call a point ground than object, as a share of all: raising it "
        "starts from surer ground, and less of it.",
        minimum=-1.0,
        maximum=0.99,
    )
    profile_trend_radius: float = parameter(
        20.0,
        "Distance over which the terrain is smoothed before its slope is taken off for the second labelling, "
        "0 for no second: raising it keeps more of the terrain's own shape in the profiles.",
        unit="m",
        minimum=0.0,
        maximum=500.0,
    )
    profile_rounds: int = parameter(
        25,
        "How often points next to the ground are tried again by regression, 0 for never: raising it lets the "
        "ground spread further from where the passes found it.",
        minimum=0,
        maximum=1000,
    )
    profile_reach: float = parameter(
        6.0,
        "How far away a line through ground points may begin to take back a point: raising it crosses wider "
        "gaps.",
        unit="spacings",
        minimum=1.0,
        maximum=100.0,
    )
    profile_support: int = parameter(
        2,
        "By how many lines ground has to lead to a point, more than half of those that lie well below it: "
        "raising it takes back less.",
        minimum=1,
        maximum=20,
    )
    profile_tolerance: float = parameter(
        0.2,
        "A point no further above the ground's lines is ground: raising it takes in grass and low objects.",
        unit="m",
        minimum=0.01,
        maximum=5.0,
    )
    profile_tolerance_slope: float = parameter(
        0.3,
        "By how much profile_tolerance grows per unit of slope: raising it takes in more on steep terrain.",
        unit="m",
        minimum=0.0,
        maximum=5.0,
    )
    profile_roughness: float = parameter(
        1.0,
        "By how many standard deviations of the ground from its lines profile_tolerance grows: raising it "
        "takes in more on rough terrain.",
        minimum=0.0,
        maximum=10.0,
    )
    kept_classes: tuple[str, ...] = parameter(
        tuple(CLASS_GROUPS),
        "Classes of the source that its points keep, since nothing here would find them better; what is left "
        "out is classified anew. Noise, wires, bridges and other things have no part in the terrain.",
        choices=tuple(CLASS_GROUPS),
    )
    profile_rejection: float = parameter(
        2.0,
        "Ground that stands so many standard deviations above a line through its neighbours on every profile "
        "is rejected: raising it keeps more, of rough terrain and of shrubs.",
        minimum=0.5,
        maximum=20.0,
    )
    profile_gap_tolerance: float = parameter(
        0.5,
        "A point no further above the ground that lies on both sides of it is ground, 0 for none: raising it "
        "takes in more low objects.",
        unit="m",
        minimum=0.0,
        maximum=5.0,
    )
    opening_cell: float = parameter(
        1.0,
        "Side of the cells whose lowest points the morphological filter opens, doubled where most would be "
        "empty: raising it makes the filter faster and coarser.",
        unit="m",
        minimum=0.1,
        maximum=100.0,
    )
    opening_radius: float = parameter(
        18.0,
        "Radius of the largest disc that cuts off whatever rises above it: raising it removes wider objects, "
        "and hilltops.",
        unit="m",
        minimum=1.0,
        maximum=200.0,
    )
    opening_slope: float = parameter(
        0.15,
        "Steepest rise over the radius of a disc that is terrain, rise over run: raising it keeps steeper "
        "terrain, and lower objects.",
        minimum=0.0,
        maximum=5.0,
    )
    opening_step: float = parameter(
        0.2,
        "Rise that is terrain whatever the radius: raising it keeps rougher terrain, and lower objects.",
        unit="m",
        minimum=0.0,
        maximum=5.0,
    )
    opening_distance: float = parameter(
        0.3,
        "Points within this distance of the terrain that the openings leave are ground: raising it takes in "
        "grass, kerbs and low walls.",
        unit="m",
        minimum=0.01,
        maximum=5.0,
    )
    opening_distance_slope: float = parameter(
        1.25,
        "By how much opening_distance grows per unit of slope of that terrain: raising it takes in more on "
        "steep terrain.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    opening_hall_radius: float = parameter(
        50.0,
        "Radius of the largest disc that still removes buildings, told from hills by the step in which they "
        "end; none beyond opening_radius if smaller: raising it copes with larger halls, and is slower.",
        unit="m",
        minimum=0.0,
        maximum=500.0,
    )
