"""Rasters of a tile: the one place where its columns become the arguments of `make_rasters`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.terrain import RasterConfig, TerrainRasters, make_rasters

#: Cells that are not cut off beyond twice the reach;
#: wide margin: distances count from cells' middles.
_MARGIN_CELLS = 4.0


def rasterise_tile(tile: PointTile, config: RasterConfig, frame: MapFrame) -> TerrainRasters | None:
    """
    Make the rasters of a classified tile; None where none are wanted, or points have no class.

    Parameters
    ----------
    tile : PointTile
        Core and buffer points with their classes.
    config : RasterConfig
        Resolution and reach.
    frame : MapFrame
        Cells are aligned in its source's coordinates. A tile that came as a message does not know it.
    """
    if config.raster_resolution == 0.0 or tile.classification is None:
        return None
    x, y, _ = frame.origin
    rows = _that_matter(tile, config)
    return make_rasters(
        tile.points.take(rows, axis=0),
        tile.classification[rows],
        config,
        return_number=None if tile.return_number is None else tile.return_number[rows],
        is_core=np.asarray(tile.is_core[rows]),
        point_spacing=tile.point_spacing,
        origin=(x, y),
    )


def _that_matter(tile: PointTile, config: RasterConfig) -> NDArray[np.intp]:
    """Return the points that the rasters of a tile's core depend on: those within twice the reach of it."""
    if tile.buffer is None or not tile.is_core.any():
        return np.arange(len(tile))
    margin = 2.0 * config.raster_reach + _MARGIN_CELLS * config.raster_resolution
    matters = np.ones(len(tile), dtype=bool)
    for along in tile.points[:, :2].T:
        core = along[tile.is_core]
        matters &= (along >= core.min() - margin) & (along <= core.max() + margin)
    return np.flatnonzero(matters)
