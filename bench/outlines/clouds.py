"""The roof points of real clouds, each with the spacing of its pulses."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import read_files
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.io.clouds.point_columns import last_returns
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points


class RoofCloud(NamedTuple):
    """The roofs of a cloud."""

    name: str  #: folder, or folder and file
    roofs: PointTile  #: roof points in the map frame, with the spacing of all pulses
    extent: NDArray[np.float64]  #: lowest and highest x and y of the whole cloud [m], shape (2, 2)
    #: What to add to get coordinates of the file's reference system [m], shape (2,).
    origin: NDArray[np.float64]
    classes: str  #: whose classes these are: ``"provider"`` or ``"own"``


def read_roofs(name: str, files: list[Path]) -> RoofCloud:
    """Read one cloud: the provider's class 6 where there is one, else this package's choice."""
    tile, frame = read_files(files)
    spacing = steady_spacing(last_returns(tile.points, tile.return_number, tile.number_of_returns), None)
    tile = tile.with_columns(point_spacing=spacing)
    extent = np.array([tile.points[:, :2].min(axis=0), tile.points[:, :2].max(axis=0)])
    if (tile.classification == PointClass.BUILDING).any():
        roofs, classes = tile.select(tile.is_roof), "provider"
    else:
        selected = select_roof_points(filter_ground(tile, GroundFilterConfig()).tile, RoofSelectionConfig())
        roofs, classes = selected.select(selected.is_roof), "own"
    return RoofCloud(name, roofs, extent, np.array(frame.origin[:2]), classes)
