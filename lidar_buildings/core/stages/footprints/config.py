"""Settings of how points come to given footprints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter


@dataclass(frozen=True)
class FootprintConfig(StageConfig):
    """Which points belong to a given footprint, and which footprints to the data."""

    stage: ClassVar[str] = "footprints"

    min_height: float = parameter(
        1.5,
        "Height above ground from which a point stands within a footprint; raising it leaves low buildings "
        "without points.",
        unit="m",
        within=(0.0, 100.0),
    )
    min_gap_area: float = parameter(
        2.0,
        "Area without roof points from which on a footprint's points are completed by what stands there; "
        "raising it leaves more parts of buildings without points, and fewer trees to be taken for such.",
        unit="m²",
        within=(0.0, 1_000_000.0),
    )
