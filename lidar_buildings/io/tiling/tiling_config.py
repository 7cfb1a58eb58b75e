"""How clouds and feeds are cut into tiles: what nodes' parameters and the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.errors import MessageError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.parameters import StageConfig, fixed
from lidar_buildings.core.scans.config import ScanConfig

#: What the parameter `view` calls views.
VIEWS = {"above": View.ABOVE, "street": View.STREET}
#: The smallest side of a tile that may be asked for [m].
_SMALLEST = 10.0


@dataclass(frozen=True)
class TilingConfig(StageConfig):
    """How clouds are cut into tiles."""

    stage: ClassVar[str] = "tile_player"

    tile_size: float = fixed(
        0.0,
        "Side of a tile, 0 for one that suits max_tile_points; a larger one needs fewer seams and more "
        "memory.",
        unit="m",
        within=(0.0, 10_000.0),
    )
    buffer: float = fixed(
        75.0,
        "Width of the strip of neighbours east of a tile; those north and south are two thirds as wide, that "
        "west a third. A larger one lets larger buildings cross its edge, and the ground filter see more of "
        "the terrain. Half of it where tile_size is 0 and points are dense.",
        unit="m",
        within=(0.0, 1_000.0),
    )
    max_tile_points: int = fixed(
        3_300_000,
        "Most points of a tile with its buffer where tile_size is 0; raising it lets stages see fewer points "
        "twice, and takes about 0.2 GB of memory a million points, for each tile that is worked on.",
        within=(1_000, 1_000_000_000),
        advanced=True,
    )
    max_buffer: float = fixed(
        200.0,
        "How far the buffer may grow on each side for a building that reaches across it; a larger one keeps "
        "halls whole.",
        unit="m",
        within=(0.0, 2_000.0),
        advanced=True,
    )
    view: str = fixed(
        "auto",
        "From where points were seen: above, or from the street; auto finds it out for each strip, by the "
        "poses of its scanner or the pattern of its points. Where a place was seen from above, points from "
        "the street tell no roofs.",
        choices=("auto", *VIEWS),
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Check every value."""
        super().__post_init__()
        if 0.0 < self.tile_size < _SMALLEST:
            raise ParameterError(
                f"{self.stage}.tile_size = {self.tile_size!r}: must be 0 or within 10 to 10000 [m]"
            )

    @property
    def given_view(self) -> View:
        """From where all points were seen, unknown if strips tell."""
        return VIEWS.get(self.view, View.UNKNOWN)


@dataclass(frozen=True)
class LiveTilingConfig(TilingConfig):
    """How a feed is cut into tiles, and when one is sent."""

    stage: ClassVar[str] = ScanConfig.stage

    tile_size: float = fixed(
        0.0,
        "Side of a tile, 0 for one that suits how densely the scanner covers the ground; a larger one is "
        "waited for longer, and costs less, as tiles overlap.",
        unit="m",
        within=(0.0, 10_000.0),
    )
    buffer: float = fixed(
        35.0,
        "Width of the strip of neighbours east of a tile; those north and south are two thirds as wide, that "
        "west a third.",
        unit="m",
        within=(0.0, 1_000.0),
        advanced=True,
    )
    max_tile_points: int = fixed(
        5_000_000,
        "Most points kept of a tile without its buffer, as a sensor that stands still goes on for ever; from "
        "half of it on points near others are left out, and all beyond it.",
        within=(1_000, 1_000_000_000),
        advanced=True,
    )
    street_voxel: float = fixed(
        0.1,
        "Of the points seen from the street one is kept in each voxel of this side, as a scanner there "
        "measures the same places for seconds; 0 keeps all.",
        unit="m",
        within=(0.0, 1.0),
        advanced=True,
    )
    road_place: float = fixed(
        16.0,
        "Side of the squares whose façades are published as soon as a vehicle has passed them, or sees "
        "nothing new there, before their tiles; a larger one costs less and is later; 0: with their tiles "
        "alone.",
        unit="m",
        within=(0.0, 100.0),
        advanced=True,
    )
    leave_after: float = fixed(
        0.5,
        "A tile is sent when so long no point has fallen into it or its buffer; again, with the points that "
        "have come, when as long no more have, or longer where fewer than one in a hundred are new. Raising "
        "it sends later, and less often.",
        unit="s",
        within=(0.0, 86_400.0),
    )
    spool: str = fixed(
        "",
        "Folder in which points wait for their turn; with one a feed goes on where it was cut off. Empty: a "
        "temporary one.",
    )


@dataclass(frozen=True)
class FeedConfig(LiveTilingConfig, ScanConfig):
    """How the scans of a feed become tiles, and where they lie."""

    stage: ClassVar[str] = ScanConfig.stage

    map_crs: str = fixed(
        "", "Reference system of the map, such as EPSG:28992, if map_position is given.", advanced=True
    )
    map_position: str = fixed(
        "",
        "Where the map's origin lies in it: x, y, z [m], with commas between them. Empty: as `map_origin` or "
        "`fix` tells, else nowhere.",
        advanced=True,
    )

    def __post_init__(self) -> None:
        """Check every value."""
        super().__post_init__()
        self.given_frame()

    def given_frame(self) -> MapFrame | None:
        """Return where the map lies, None if that is not given."""
        if not self.map_position.strip():
            if self.map_crs:
                raise ParameterError(f"{self.stage}.map_crs = {self.map_crs!r}: give map_position, too")
            return None
        x, y, z = self._numbers("map_position", "x, y, z [m]")
        frame = MapFrame(self.map_crs, (x, y, z))
        from lidar_buildings.io.files.reference_systems import check_place  # loads slowly

        try:
            check_place(frame)
        except MessageError as error:
            raise ParameterError(f"{self.stage}.map_crs, map_position: {error}") from None
        return frame
