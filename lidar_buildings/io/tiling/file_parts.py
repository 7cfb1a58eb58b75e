"""Files read in parts by several processes: the points of each go to a store of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.las import CHUNK, Cloud
from lidar_buildings.io.tiling.tile_grid import TileGrid
from lidar_buildings.io.tiling.tile_store import ReadPart, TileStore

#: Points of a part: enough that a process is busy for seconds, and whole chunks.
PART = 10 * CHUNK


class FilePart(NamedTuple):
    """
    A part of a file, and where its points are put.

    Attributes
    ----------
    cloud : Cloud
        The file.
    source : int
        Its place among the inputs.
    first, last : int
        The first point, and the one behind the last.
    grid : TileGrid
        Tiles and spool cells.
    frame : MapFrame
        The map frame of all tiles.
    folder : Path
        One that all processes see.
    """

    cloud: Cloud
    source: int
    first: int
    last: int
    grid: TileGrid
    frame: MapFrame
    folder: Path


#: Calls a function with a part in another process: ``submit(read_part, part)``.
Submit = Callable[[Callable[..., Any], FilePart], "Future[ReadPart | LidarBuildingsError]"]


def parts_of(cloud: Cloud, source: int, grid: TileGrid, frame: MapFrame, folder: Path) -> Iterator[FilePart]:
    """Cut a file into parts."""
    for first in range(0, cloud.point_count, PART):
        yield FilePart(cloud, source, first, min(first + PART, cloud.point_count), grid, frame, folder)


def read_part(part: FilePart, pool: object = None) -> ReadPart | LidarBuildingsError:
    """Read a part, and return where its points are; or why they are not."""
    store = TileStore(part.grid, part.frame, part.folder)
    try:
        first = part.first
        for chunk in part.cloud.chunks(first=first, last=part.last):
            store.add(part.source, first, chunk, part.cloud)
            first += len(chunk)
        return store.part(part.source)
    except LidarBuildingsError as error:
        store.remove()
        return error
