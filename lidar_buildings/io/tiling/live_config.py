"""How a feed is cut into tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import parameter
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.tiling.tiling_config import TilingConfig


@dataclass(frozen=True)
class LiveTilingConfig(TilingConfig):
    """How a feed is cut into tiles, and when one is sent."""

    stage: ClassVar[str] = ScanConfig.stage

    tile_size: float = parameter(
        0.0,
        "Side of a tile, 0 for one that suits how densely the scanner covers the ground; a larger one is "
        "waited for longer, and costs less, as tiles overlap.",
        unit="m",
        minimum=0.0,
        maximum=10_000.0,
        read_only=True,
    )
    buffer: float = parameter(
        75.0,
        "Width of the strip of neighbours east of a tile; those on its other sides are two thirds as wide.",
        unit="m",
        minimum=0.0,
        maximum=1_000.0,
        read_only=True,
        advanced=True,
    )
    max_tile_points: int = parameter(
        5_000_000,
        "Most points kept of a tile without its buffer, as a sensor that stands still goes on for ever; from "
        "half of it on points near others are left out, and all beyond it.",
        minimum=1_000,
        maximum=1_000_000_000,
        read_only=True,
        advanced=True,
    )
    leave_after: float = parameter(
        0.5,
        "A tile is sent when so long no point has fallen into it or its buffer; again, with the points that "
        "have come, after as many times as long as it has more points than new ones. Raising it sends later, "
        "and less often.",
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        read_only=True,
    )
    leave_distance: float = parameter(
        0.0,
        "A tile is sent, too, when the sensor is so far from it and its buffer, though single points still "
        "fall into it; 0: only time tells.",
        unit="m",
        minimum=0.0,
        maximum=100_000.0,
        read_only=True,
        advanced=True,
    )
    spool: str = parameter(
        "",
        "Folder in which points wait for their turn; with one a feed goes on where it was cut off. Empty: a "
        "temporary one.",
        read_only=True,
    )
