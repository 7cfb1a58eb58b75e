"""Rasters of a tile: the one place where its columns become the arguments of `make_rasters`."""

from __future__ import annotations

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters, make_rasters


def rasterise_tile(tile: PointTile, config: RasterConfig, frame: MapFrame) -> TerrainRasters | None:
    """
    Make the rasters of a classified tile; None where none are wanted, or points have no class.

    Cells are aligned in the source's coordinates of the frame, which a tile that came as a message does not
    know.
    """
    if config.raster_resolution == 0.0 or tile.classification is None:
        return None
    x, y, _ = frame.origin
    return make_rasters(
        tile.points,
        tile.classification,
        config,
        return_number=tile.return_number,
        is_core=tile.is_core,
        point_spacing=tile.point_spacing,
        origin=(x, y),
    )
