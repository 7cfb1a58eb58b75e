"""The terrain of a survey as triangles, square by square, from the rasters of all tiles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.terrain import RasterWindow
from lidar_buildings.core.stages.terrain.relief import relief
from lidar_buildings.io.models.survey_building import TerrainMesh
from lidar_buildings.io.results.terrain_files import merged, reached_squares
from lidar_buildings.io.results.tile_products import load_raster_window

#: Side of a square in cells: a power of two, so that nodes of all squares lie on one lattice.
_SIDE = 512
#: Nodes are about so far apart, or as far as cells [m].
_STEP = 1.0


def terrain_meshes(fragments: Sequence[Path], frame: MapFrame, tolerance: float) -> Iterator[TerrainMesh]:
    """
    Yield the terrain of saved tiles, row by row of squares, whose sides are multiples of 512 cells.

    Squares depend on the cells alone, not on tiles, and meet: what two have in common along a side is
    simplified in both alike.

    Parameters
    ----------
    fragments : sequence of Path
        Saved tiles, sorted by stamp.
    frame : MapFrame
        Of the tiles.
    tolerance : float
        Greatest distance in height of the cells' elevations from the triangles [m]; 0 for no terrain.
    """
    windows = {path: window for path in fragments if (window := load_raster_window(path)) is not None}
    if not windows or tolerance == 0.0:
        return
    resolution = next(iter(windows.values())).resolution
    step = 2 ** max(int(math.log2(_STEP / resolution)), 0)
    # the last row and column of a square are the first of the next
    for row, column, tiles in reached_squares(windows, _SIDE, shared=1):
        square = RasterWindow(resolution, column * _SIDE, row * _SIDE, _SIDE + 1, _SIDE + 1)
        dtm = merged(square, tiles).dtm[::step, ::step].astype(np.float64)
        rows, columns, triangles = relief(dtm, tolerance)
        if not len(triangles):
            continue
        places = square.centres(rows * step, columns * step, (frame.origin[0], frame.origin[1]))
        vertices = np.column_stack([places, dtm[rows, columns]])
        yield TerrainMesh(
            _name(square, frame),
            np.rint(vertices / GRID) * GRID,
            triangles,
        )


def _name(square: RasterWindow, frame: MapFrame) -> str:
    x, y = (edge / frame.horizontal_unit for edge in square.corner)
    return f"terrain-{x:.1f}-{y:.1f}"
