"""The terrain of a run, from the cells of all tiles: rasters (dtm.tif, dsm.tif, ndsm.tif) and triangles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.core.stages.terrain.relief import relief
from lidar_buildings.core.stages.terrain.window import RasterWindow, enclosing
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import FOOT, US_SURVEY_FOOT, is_same_unit
from lidar_buildings.io.models.survey_building import TerrainMesh
from lidar_buildings.io.results.geotiff import BLOCK, MOST_BLOCKS, GeotiffWriter, RasterLayout
from lidar_buildings.io.results.run_folder import DSM, DTM, NDSM
from lidar_buildings.io.results.tile_products import load_raster_window, load_rasters

#: File name → what its values are.
RASTERS = {
    DTM: "elevation of the ground",
    DSM: "elevation of the surface",
    NDSM: "height of the surface above the ground",
}
#: Metres per unit → its name in the files.
_UNITS = {1.0: "metre", FOOT: "foot", US_SURVEY_FOOT: "US survey foot"}
#: Values are rounded to this part of a unit, about a millimetre: what is finer is noise, and large.
_STEPS = 1024.0
#: Saved tiles that are kept in memory: a row of blocks visits each several times.
TILES_IN_MEMORY = 32
#: Side of a square in cells: a power of two, so that nodes of all squares lie on one lattice.
_SIDE = 512
#: Nodes are about so far apart, or as far as cells [m].
_STEP = 1.0


def write_rasters(
    folder: Path, fragments: Sequence[Path], frame: MapFrame, crs: str
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """
    Write the rasters of saved tiles, sorted by stamp; a block at a time: memory holds some tiles only.

    Of several tiles with a cell the one whose core is nearest counts, then the first. Values and places are
    turned back into the source's units, whose reference system is `crs`. Returned is file name → columns,
    rows, side of a cell, known cells, empty if no tile has a raster; and what is wrong, if the tiles lie too
    far apart for one raster of this resolution. OutputError if a file cannot be written.
    """
    windows = {path: window for path in fragments if (window := load_raster_window(path)) is not None}
    whole = enclosing(windows.values())
    if whole is None:
        return {}, []
    layout = _layout(whole, frame, crs)
    if layout.n_blocks > MOST_BLOCKS:
        too_many = (
            f"{folder}: no rasters were made: {layout.width:,} × {layout.height:,} cells of "
            f"{whole.resolution:g} m are too many: raise model_writer.raster_resolution, or run the parts "
            "apart"
        )
        return {}, [too_many]
    writers = {}
    with ExitStack() as stack:
        for name, meaning in RASTERS.items():
            temporary = stack.enter_context(atomic_file(folder / name))
            writers[name] = stack.enter_context(GeotiffWriter(temporary, layout, meaning))
        for number, next_to, tiles in reached_squares(windows, BLOCK, (whole.row, whole.column)):
            row, column = number * BLOCK, next_to * BLOCK
            rows, columns = (
                slice(row, min(row + BLOCK, whole.height)),
                slice(column, min(column + BLOCK, whole.width)),
            )
            block = merged(whole.part(columns, rows), tiles)
            for name, values in _in_source_units(block, frame).items():
                writers[name].write(row, column, values)
    size = {"width": layout.width, "height": layout.height, "cell": layout.cell}
    return {name: {**size, "known_cells": writer.n_known} for name, writer in writers.items()}, []


def _layout(window: RasterWindow, frame: MapFrame, crs: str) -> RasterLayout:
    west, north = (edge / frame.horizontal_unit for edge in window.corner)
    unit = next(
        (name for metres, name in _UNITS.items() if is_same_unit(metres, frame.vertical_unit)),
        f"{frame.vertical_unit:g} m",
    )
    cell = window.resolution / frame.horizontal_unit
    return RasterLayout(window.width, window.height, west, north, cell, crs, unit)


def _in_source_units(block: TerrainRasters, frame: MapFrame) -> dict[str, NDArray[np.float32]]:
    dtm, dsm = (
        np.rint((raster.astype(np.float64) + frame.origin[2]) / frame.vertical_unit * _STEPS) / _STEPS
        for raster in (block.dtm, block.dsm)
    )
    rasters = {DTM: dtm, DSM: dsm, NDSM: dsm - dtm}
    return {name: values.astype(np.float32) for name, values in rasters.items()}


def reached_squares(
    windows: Mapping[Path, RasterWindow], side: int, corner: tuple[int, int] = (0, 0), shared: int = 0
) -> Iterator[tuple[int, int, Iterator[TerrainRasters]]]:
    """
    Yield row and column of each square of cells that a saved tile reaches into, and these tiles.

    Squares are counted from the corner's row and column; `shared` cells beyond its side one has in common
    with the next.
    """
    load = lru_cache(TILES_IN_MEMORY)(load_rasters)
    reaching: dict[tuple[int, int], list[Path]] = {}
    for path, window in windows.items():
        spans = (window.row - corner[0], window.height), (window.column - corner[1], window.width)
        rows, columns = (range((a - shared) // side, (a + size - 1) // side + 1) for a, size in spans)
        for place in product(rows, columns):
            reaching.setdefault(place, []).append(path)
    for (row, column), paths in sorted(reaching.items()):
        yield row, column, map(load, paths)


def merged(window: RasterWindow, tiles: Iterator[TerrainRasters]) -> TerrainRasters:
    """Put what tiles know of a window together."""
    dtm, dsm = (np.full(window.shape, np.nan, dtype=np.float32) for _ in range(2))
    distance = np.full(window.shape, np.iinfo(np.int32).max, dtype=np.int32)
    for tile in tiles:
        here, there = window.shared(tile.window), tile.window.shared(window)
        known = ~np.isnan(tile.dtm[there]) | ~np.isnan(tile.dsm[there])
        nearer = known & (tile.distance[there] < distance[here])
        for target, source in ((dtm, tile.dtm), (dsm, tile.dsm), (distance, tile.distance)):
            target[here][nearer] = source[there][nearer]
    return TerrainRasters(window, dtm, dsm, distance)


def terrain_meshes(fragments: Sequence[Path], frame: MapFrame, tolerance: float) -> Iterator[TerrainMesh]:
    """
    Yield the terrain of saved tiles, row by row of squares, whose sides are multiples of 512 cells.

    Squares depend on the cells alone, not on tiles, and meet: what two have in common along a side is
    simplified in both alike. `tolerance` is the greatest distance in height of the cells' elevations from the
    triangles [m]; 0 for no terrain.
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
