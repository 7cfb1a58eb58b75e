"""How clouds are cut into tiles: what the tile player's parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig, parameter

#: The smallest side of a tile that may be asked for [m].
_SMALLEST = 10.0


@dataclass(frozen=True)
class TilingConfig(StageConfig):
    """How clouds are cut into tiles."""

    stage: ClassVar[str] = "tile_player"

    tile_size: float = parameter(
        0.0,
        "Side of a tile, 0 for one that suits max_tile_points; a larger one needs fewer seams and more "
        "memory.",
        unit="m",
        minimum=0.0,
        maximum=10_000.0,
        read_only=True,
    )
    buffer: float = parameter(
        75.0,
        "Width of the strip of neighbours east of a tile; those on its other sides are two thirds as wide. A "
        "larger one lets larger buildings cross its edge, and the ground filter see more of the terrain.",
        unit="m",
        minimum=0.0,
        maximum=1_000.0,
        read_only=True,
    )
    max_tile_points: int = parameter(
        2_500_000,
        "Most points of a tile with its buffer where tile_size is 0; raising it lets stages see fewer points "
        "twice, and takes about 0.3 GB of memory a million points, for each tile that is worked on.",
        minimum=1_000,
        maximum=1_000_000_000,
        read_only=True,
        advanced=True,
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

    def __post_init__(self) -> None:
        """Check every value."""
        super().__post_init__()
        if 0.0 < self.tile_size < _SMALLEST:
            raise ParameterError(
                f"{self.stage}.tile_size = {self.tile_size!r}: must be 0 or within 10 to 10000 [m]"
            )
