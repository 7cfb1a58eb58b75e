"""The terrain of a run, from the cells of all tiles: rasters (dtm.tif, dsm.tif, ndsm.tif) and triangles."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from itertools import product
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import RasterioError
from rasterio.shutil import copy
from rasterio.windows import Window

from lidar_buildings import __version__
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters
from lidar_buildings.core.stages.terrain.relief import relief
from lidar_buildings.core.stages.terrain.window import RasterWindow, enclosing
from lidar_buildings.io.files.atomic_files import atomic_file, write_error
from lidar_buildings.io.files.failures import captured_stderr
from lidar_buildings.io.files.reference_systems import unit_name
from lidar_buildings.io.models.survey_building import TerrainMesh
from lidar_buildings.io.results.run_folder import DSM, DTM, DTM_VARIANCE, NDSM
from lidar_buildings.io.results.tile_products import has_variance, load_raster_window, load_rasters

#: Side of a block in cells.
BLOCK = 512
#: What stands in cells that are not known.
NODATA = -9999.0
#: A raster of more blocks than this is refused: their index alone would be 16 MB.
MOST_BLOCKS = 1_000_000
#: Overviews are left out where fewer than one block in so many holds anything: GDAL visits all the others.
_OVERVIEW_SPARSITY = 16
_PACKED = {"compress": "deflate", "predictor": 3, "SPARSE_OK": True, "BIGTIFF": "IF_SAFER"}
_FORMAT = {
    "driver": "GTiff", "count": 1, "dtype": "float32", "nodata": NODATA,
    "tiled": True, "blockxsize": BLOCK, "blockysize": BLOCK, **_PACKED,
}  # fmt: skip
#: GDAL's driver for cloud-optimised files copies what is whole: overviews first, then rows of blocks.
_CLOUD_OPTIMISED = {
    "driver": "COG", "BLOCKSIZE": BLOCK, "LEVEL": 6, "OVERVIEW_RESAMPLING": "average", **_PACKED
}  # fmt: skip
#: Effort of deflate: for what stays, and for what is to be copied.
_LEVEL, _LEVEL_OF_COPIED = 6, 1
#: GDAL would take a twentieth of the memory; an integer cache size is in bytes.
_GDAL = {"GDAL_CACHEMAX": 64_000_000}
_FAILURES = (RasterioError, OSError, RuntimeError)

# what GDAL logs of a file that cannot be written is said in the one line of the OutputError
logging.getLogger("rasterio").addFilter(lambda record: record.levelno < logging.ERROR)
logging.getLogger("rasterio._env").addFilter(lambda record: record.levelno < logging.ERROR)


class RasterLayout(NamedTuple):
    """What a file of elevations says of itself; its outer corner and cells in source coordinates."""

    width: int
    height: int
    west: float
    north: float
    cell: float
    crs: str  #: ``"EPSG:28992"``, a WKT text, or empty if unknown
    unit: str

    @property
    def n_blocks(self) -> int:
        """Number of blocks, empty ones too."""
        return -(-self.width // BLOCK) * -(-self.height // BLOCK)


class GeotiffWriter:
    """
    Writes one file block by block; a context, at whose end the file is complete and read back.

    An existing file is replaced. Blocks that were not written hold no data and take no room. Equal content
    gives equal bytes if blocks come in the same order. `n_known` counts the cells that are known. OutputError
    if the file cannot be written.
    """

    def __init__(self, path: Path, layout: RasterLayout, meaning: str) -> None:
        self._path, self._layout = path, layout
        self._blocks: list[Window] = []
        self.n_known = 0
        with self._reported():
            self._file = rasterio.open(
                path,
                "w",
                width=layout.width,
                height=layout.height,
                crs=layout.crs or None,
                transform=rasterio.Affine(layout.cell, 0.0, layout.west, 0.0, -layout.cell, layout.north),
                zlevel=_LEVEL if layout.n_blocks == 1 else _LEVEL_OF_COPIED,
                **_FORMAT,
            )
            self._file.set_band_description(1, meaning)
            self._file.units = (layout.unit,)
            self._file.update_tags(TIFFTAG_SOFTWARE=f"lidar_buildings {__version__}")

    def write(self, row: int, column: int, values: NDArray[np.float32]) -> None:
        """Write the block, or what of it is in the raster, at multiples of `BLOCK`; NaN becomes nodata."""
        known = ~np.isnan(values)
        n_known = int(np.count_nonzero(known))
        if not n_known:
            return
        window = Window(column, row, values.shape[1], values.shape[0])
        with self._reported():
            self._file.write(np.where(known, values, np.float32(NODATA)), 1, window=window)
        self._blocks.append(window)
        self.n_known += n_known

    def __enter__(self) -> GeotiffWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file; without an error optimise and read it back."""
        with self._reported(quiet=error is not None):
            self._file.close()
        if error is None:
            with self._reported():
                self._optimise()
                self._check_complete()

    def _optimise(self) -> None:
        """Put coarser copies before the cells, each half as wide, until one block holds all."""
        if self._layout.n_blocks == 1 or self._layout.n_blocks > _OVERVIEW_SPARSITY * len(self._blocks):
            return  # without overviews any file in blocks is optimised
        optimised = self._path.with_suffix(f".cog{self._path.suffix}")
        try:
            copy(self._path, optimised, **_CLOUD_OPTIMISED)
            os.replace(optimised, self._path)
        finally:
            for left in self._path.parent.glob(f"{optimised.name}*"):
                left.unlink()

    def _check_complete(self) -> None:
        """Count the known cells again: a full disk may show no sooner."""
        with rasterio.open(self._path) as file:
            n_known = sum(
                int(np.count_nonzero(file.read(1, window=window) != np.float32(NODATA)))
                for window in self._blocks
            )
        if n_known != self.n_known:
            raise OSError(f"it holds {n_known} of {self.n_known} known cells")

    @contextmanager
    def _reported(self, *, quiet: bool = False) -> Iterator[None]:
        """Turn what fails within into one OutputError, or into nothing where there is an error already."""
        try:
            # libtiff prints what the operating system refused
            with rasterio.Env(**_GDAL), captured_stderr(lambda error: isinstance(error, _FAILURES)):
                yield
        except _FAILURES as error:
            if not quiet:
                code = getattr(error, "errno", None)
                raise write_error(self._path, OSError(code, os.strerror(code)) if code else error) from error


#: File name → what its values are.
RASTERS = {
    DTM: "elevation of the ground",
    DSM: "elevation of the surface",
    NDSM: "height of the surface above the ground",
}
#: What is written beside them where the ground is kriged.
VARIANCE = {DTM_VARIANCE: "variance of the ground's elevation"}
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
            f"{whole.resolution:g} m are too many: raise model_writer.raster_resolution, or split the "
            "survey"
        )
        return {}, [too_many]
    writers = {}
    kriged = any(map(has_variance, windows))
    with ExitStack() as stack:
        for name, meaning in (RASTERS | VARIANCE if kriged else RASTERS).items():
            temporary = stack.enter_context(atomic_file(folder / name))
            own = layout._replace(unit=f"{layout.unit}^2") if name in VARIANCE else layout
            writers[name] = stack.enter_context(GeotiffWriter(temporary, own, meaning))
        for number, next_to, tiles in reached_squares(windows, BLOCK, (whole.row, whole.column)):
            row, column = number * BLOCK, next_to * BLOCK
            rows = slice(row, min(row + BLOCK, whole.height))
            columns = slice(column, min(column + BLOCK, whole.width))
            block = merged(whole.part(columns, rows), tiles)
            dtm, dsm = (
                np.rint((raster.astype(np.float64) + frame.origin[2]) / frame.vertical_unit * _STEPS) / _STEPS
                for raster in (block.dtm, block.dsm)
            )
            for name, values in ((DTM, dtm), (DSM, dsm), (NDSM, dsm - dtm)):
                writers[name].write(row, column, values.astype(np.float32))
            if block.dtm_variance is not None:
                writers[DTM_VARIANCE].write(row, column, block.dtm_variance / frame.vertical_unit**2)
    size = {"width": layout.width, "height": layout.height, "cell": layout.cell}
    return {name: {**size, "known_cells": writer.n_known} for name, writer in writers.items()}, []


def _layout(window: RasterWindow, frame: MapFrame, crs: str) -> RasterLayout:
    west, north = (edge / frame.horizontal_unit for edge in window.corner)
    cell = window.resolution / frame.horizontal_unit
    return RasterLayout(window.width, window.height, west, north, cell, crs, unit_name(frame.vertical_unit))


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
    variance = None
    for tile in tiles:
        here, there = window.shared(tile.window), tile.window.shared(window)
        known = ~np.isnan(tile.dtm[there]) | ~np.isnan(tile.dsm[there])
        nearer = known & (tile.distance[there] < distance[here])
        for target, source in ((dtm, tile.dtm), (dsm, tile.dsm), (distance, tile.distance)):
            target[here][nearer] = source[there][nearer]
        if tile.dtm_variance is not None:
            variance = np.full(window.shape, np.float32(np.nan)) if variance is None else variance
            variance[here][nearer] = tile.dtm_variance[there][nearer]
    return TerrainRasters(window, dtm, dsm, distance, variance)


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
        x, y = (edge / frame.horizontal_unit for edge in square.corner)
        yield TerrainMesh(f"terrain-{x:.1f}-{y:.1f}", np.rint(vertices / GRID) * GRID, triangles)
