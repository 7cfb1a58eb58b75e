"""How clouds are cut into tiles: what the tile player's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, parameter


@dataclass(frozen=True)
class TilingConfig(StageConfig):
    """How clouds are cut into tiles."""

    stage: ClassVar[str] = "tile_player"

    tile_size: float = parameter(
        250.0,
        "Side of a tile; a larger one needs fewer seams and more memory.",
        unit="m",
        minimum=10.0,
        maximum=10_000.0,
        read_only=True,
    )
    buffer: float = parameter(
        75.0,
        "Width of the strip of neighbours round a tile; a larger one lets larger buildings cross its edge, "
        "and the ground filter see more of the terrain around (its reach is 1.5 seed_cell).",
        unit="m",
        minimum=0.0,
        maximum=1_000.0,
        read_only=True,
    )
    max_buffer: float = parameter(
        200.0,
        "How far the buffer may grow for a building that reaches across it; a larger one keeps halls whole.",
        unit="m",
        minimum=0.0,
        maximum=2_000.0,
        read_only=True,
        advanced=True,
    )
