"""Parameters of roof selection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import SMALLEST_BUILDING, StageConfig, advanced, parameter


@dataclass(frozen=True)
class RoofSelectionConfig(StageConfig):
    """Parameters of roof selection; the defaults serve 1 to 60 pts/m²."""

    stage: ClassVar[str] = "roof_selection"

    method: str = parameter(
        "smooth_patches",
        "How roofs are told from all else: by smooth patches that are no foliage, completed to their "
        "edges; by the planar cells of lasclassify (Santos and others); as planes of single returns "
        "(Mancera-Taboada and others, 2012); or all that is high enough (Sampath and Shan, 2007).",
        choices=("smooth_patches", "lasclassify", "single_returns", "all"),
    )
    min_height: float = parameter(
        2.0,
        "Height above ground from which on points can be roof; raising it drops sheds, cars and hedges.",
        unit="m",
        within=(0.1, 50.0),
    )
    max_roughness: float = parameter(
        0.125,
        "Root mean square distance from the plane up to which a level surface is smooth (steep ones may be "
        "rougher); raising it accepts noisier scans and more vegetation.",
        unit="m",
        within=(0.005, 2.0),
    )
    max_plane_distance: float = advanced(
        0.25,
        "Distance from the plane of a nearby roof up to which a point belongs to it; raising it completes "
        "edges and takes in what touches them.",
        unit="m",
        within=(0.01, 5.0),
    )
    max_part_area: float = advanced(
        12.0,
        "Largest chimney, dormer or other part on a roof that need not be smooth; raising it keeps more "
        "vegetation over roofs.",
        unit="m^2",
        within=(0.0, 1000.0),
    )
    min_building_area: float = parameter(
        SMALLEST_BUILDING,
        "Smallest building in plan, with smooth_patches half of it if it is compact, even and opaque; "
        "raising it drops sheds and garages (Mancera-Taboada and others: 40).",
        unit="m^2",
        within=(0.0, 10000.0),
    )
    planarity_cell: float = advanced(
        2.0,
        "With lasclassify: side of the cells that are planar or rugged, at least 2.8 point spacings; raising "
        "it finds roofs in sparser data and loses small ones.",
        unit="m",
        within=(0.5, 20.0),
    )
    max_planar_deviation: float = advanced(
        0.1,
        "With lasclassify: standard deviation from a plane up to which a cell is roof; raising it accepts "
        "noisier scans and more vegetation.",
        unit="m",
        within=(0.005, 2.0),
    )
    min_rugged_deviation: float = advanced(
        0.4,
        "With lasclassify: standard deviation from a plane above which a cell is vegetation; raising it "
        "keeps more of the roof beside trees.",
        unit="m",
        within=(0.005, 10.0),
    )
    min_roof_width: float = advanced(
        2.5,
        "Narrowest part of a roof, three fifths of it if it is flat, with smooth_patches; raising it drops "
        "balconies, carports and more hedges. Not used where it is less than five spacings.",
        unit="m",
        within=(0.0, 20.0),
    )
    min_building_width: float = advanced(
        3.0,
        "Least width of a building at its widest place, with smooth_patches, three fifths of it if it is "
        "compact, even and opaque; raising it drops lorries, hedges and small garages. Not used where it is "
        "less than two spacings.",
        unit="m",
        within=(0.0, 50.0),
    )
    facade_reach: float = advanced(
        0.2,
        "How far in plan from a roof's edge, or a large wall, the points below are façade, of the building's "
        "class; raising it takes in what stands beside walls, and 0 tells neither façades nor walls.",
        unit="m",
        within=(0.0, 5.0),
    )
    roof_returns: str = advanced(
        "single",
        "With single_returns: the returns that can be roof; the paper's single ones lose roof edges, where "
        "pulses are split. Where there are no return numbers, all count.",
        choices=("single", "last", "all"),
    )
    low_vegetation_height: float = advanced(
        0.2, "Height up to which vegetation is low.", unit="m", within=(0.01, 5.0)
    )
    medium_vegetation_height: float = advanced(
        3.0, "Height up to which vegetation is medium, high from there on.", unit="m", within=(0.1, 20.0)
    )
    max_vegetation_height: float = advanced(
        150.0, "Height from which on what is no roof stays unclassified.", unit="m", within=(5.0, 1000.0)
    )
    road_method: str = advanced(
        "automatic",
        "How roads are told from other ground: by the two modes of the ground's brightness, if it has two; "
        "by the intensities given, of areas or, as published, of each point by itself; or not at all.",
        choices=("automatic", "thresholds", "grey_values", "none"),
    )
    min_road_intensity: float = advanced(
        40.0,
        "With thresholds and grey_values: darkest intensity of roads; raising it drops the darkest ground.",
        within=(0.0, 255.0),
    )
    max_road_intensity: float = advanced(
        100.0,
        "With thresholds and grey_values: brightest intensity of roads; raising it takes in more ground.",
        within=(0.0, 255.0),
    )
    min_road_area: float = advanced(
        100.0,
        "Smallest connected road; raising it drops driveways and dark yards.",
        unit="m^2",
        within=(0.0, 100000.0),
    )
