"""The elevations of a raster as few enough cells for a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.windows import Window, from_bounds

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.tiling.tile_grid import Rectangle

#: What stands in cells that are not known.
UNKNOWN = -32_768
_STEPS = 65_000


@dataclass(frozen=True, eq=False)
class Relief:
    """Elevations, row by row from north to south."""

    #: Elevations are `middle` + `steps` × `step`; `UNKNOWN` where there are none. Shape (n_rows, n_columns).
    steps: NDArray[np.int16]
    #: Map frame [m].
    middle: float
    step: float
    #: Outer corner of the first cell, map frame [m].
    west: float
    north: float
    cell: tuple[float, float]  #: width and height of a cell [m]


def read_relief(path: Path, frame: MapFrame, box: Rectangle | None, most_cells: int) -> Relief:
    """
    Read a raster of elevations, or what is in a box of it, coarser where it is larger.

    No more than `most_cells` along the longer side; InputError if it cannot be read.
    """
    try:
        with rasterio.open(path) as file:
            window = _window(file, frame, box)
            coarser = max(window.width, window.height, most_cells) / most_cells
            shape = max(round(window.height / coarser), 1), max(round(window.width / coarser), 1)
            resampling = Resampling.average if coarser > 1 else Resampling.nearest
            read = file.read(1, window=window, out_shape=shape, masked=True, resampling=resampling)
            transform = file.window_transform(window)
            cell = tuple(
                size * file.res[axis] * frame.horizontal_unit / shape[1 - axis]
                for axis, size in enumerate((window.width, window.height))
            )
    except (RasterioError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({error}): run it again") from error
    x, y, _ = frame.to_map(np.array([[transform.c, transform.f, 0.0]]))[0].tolist()
    elevations = read.astype(np.float64) * frame.vertical_unit - frame.origin[2]
    return _in_steps(elevations, (x, y), (cell[0], cell[1]))


def _window(file: rasterio.DatasetReader, frame: MapFrame, box: Rectangle | None) -> Window:
    whole = Window(0, 0, file.width, file.height)
    if box is None:
        return whole
    corners = np.insert(np.reshape(box, (2, 2)), 2, 0.0, axis=1)
    (west, south, _), (east, north, _) = frame.to_source(corners)
    wanted = from_bounds(west, south, east, north, file.transform)
    try:
        return wanted.intersection(whole).round_offsets().round_lengths()
    except rasterio.errors.WindowError:
        return whole


def _in_steps(
    elevations: np.ma.MaskedArray[tuple[int, ...], np.dtype[np.float64]],
    corner: tuple[float, float],
    cell: tuple[float, float],
) -> Relief:
    known = elevations.compressed()
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    middle, step = (low + high) / 2, max((high - low) / _STEPS, 0.01)
    steps = np.ma.filled(np.rint((elevations - middle) / step), UNKNOWN).astype(np.int16)
    return Relief(steps, middle, step, *corner, cell)
