"""The parameters of building models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter

#: Name of an elevation → percentile of the roof points' elevations.
ELEVATIONS = {"min": 0.0, "50p": 50.0, "70p": 70.0, "max": 100.0}
#: Where solids end below.
LEVEL, DRAPED = "level", "draped"


@dataclass(frozen=True)
class BuildingModelConfig(StageConfig):
    """How models are built."""

    stage: ClassVar[str] = "building_model"

    roof_elevation: str = parameter(
        "70p",
        "Which elevation of the roof points the flat tops of LoD1.2 and LoD1.3 take: the lowest, a "
        "percentile or the highest.",
        choices=tuple(ELEVATIONS),
    )
    foot: str = parameter(
        LEVEL,
        "What models stand on: the lowest ground at the building, or the terrain along its walls, to which "
        "volumes then count.",
        choices=(LEVEL, DRAPED),
    )
    finest_lod: str = parameter(
        "2.3",
        "Finest level of detail that is built: blocks of one height, or all that the points tell; blocks "
        "take a fraction of the time.",
        choices=("1.2", "2.3"),
        advanced=True,
    )
    main_roof: bool = parameter(
        False,
        "Build LoD2.0 as well: the planes of the roof without dormers, chimneys and other small parts on it; "
        "files of one level keep the finest.",
    )
    assumed_height: float = parameter(
        3.0,
        "Height of the lowest roof point above the ground where the ground's elevation is unknown; raising "
        "it lowers the foot of such models.",
        unit="m",
        within=(0.0, 100.0),
    )
    min_face_area: float = parameter(
        0.5, "Smallest roof face; raising it drops dormers and chimneys.", unit="m²", within=(0.0, 1000.0)
    )
    min_part_step: float = parameter(
        1.0,
        "Roofs that differ by more along their whole border are parts with heights of their own in LoD1.3; "
        "raising it joins parts.",
        unit="m",
        within=(0.1, 100.0),
    )
