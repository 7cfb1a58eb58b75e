"""What is taken of bags among the inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, fixed

#: Why there is nothing of a bag.
NO_SCAN = "no scan lies in the part that start and duration take: lidar-buildings inspect says how long it is"


@dataclass(frozen=True)
class BagConfig(StageConfig):
    """What is taken of bags among the inputs."""

    stage: ClassVar[str] = "tile_player"

    topic: str = fixed("", "Topic of the scans of a bag; empty: its only one of clouds.", advanced=True)
    odometry: str = fixed(
        "", "Topic of the poses of a bag; empty: its only one of odometry, else `/tf`.", advanced=True
    )
    start: float = fixed(
        0.0, "A bag is read from so long after its beginning on.", unit="s", within=(0.0, None), advanced=True
    )
    duration: float = fixed(
        0.0, "So much of a bag is read; 0: to its end.", unit="s", within=(0.0, None), advanced=True
    )
