"""Settings of how points come to given footprints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter


@dataclass(frozen=True)
class FootprintConfig(StageConfig):
    """Which points belong to a given footprint, and which footprints to the data."""

    stage: ClassVar[str] = "footprints"

    min_roof_share: float = parameter(
        0.2,
        "Share of the points that stand within a footprint which must be roof points; where fewer are, all "
        "that stand there are taken; raising it takes them at more footprints.",
        minimum=0.0,
        maximum=1.0,
    )
    min_height: float = parameter(
        1.5,
        "Height above ground from which a point stands within a footprint; raising it leaves low buildings "
        "without points.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    min_gap_area: float = parameter(
        2.0,
        "Area without roof points from which on a footprint's points are completed by what stands there; "
        "raising it leaves more parts of buildings without points, and fewer trees to be taken for such.",
        unit="m²",
        minimum=0.0,
        maximum=1_000_000.0,
    )
    search_distance: float = parameter(
        5.0,
        "How near points must lie around a footprint that holds none for it to be inside the data; raising "
        "it reports more footprints without points.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
