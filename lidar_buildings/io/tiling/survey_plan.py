"""How a survey will be cut into tiles, from the headers of its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.clouds.agreement import agreed_system, shared_origin
from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tile_size import bounds_of, expected_points, tiles_for
from lidar_buildings.io.tiling.tiling_config import TilingConfig


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """
    A survey and its tiles.

    Attributes
    ----------
    n_files, n_points, n_bytes : int
        Of the files.
    system : str
        Reference system, empty if no file says.
    bounds : tuple of float
        Least x and y, greatest x and y [m].
    area : float
        What the bounds of the files cover [m²].
    tile_size : float
        Side of the tiles [m].
    tile_points, tile_areas : ndarray of shape (n_tiles,)
        Expected points of each tile, and what it covers [m²], buffer included.
    """

    n_files: int
    n_points: int
    n_bytes: int
    system: str
    bounds: tuple[float, float, float, float]
    area: float
    tile_size: float
    tile_points: NDArray[np.float64]
    tile_areas: NDArray[np.float64]

    @property
    def n_tiles(self) -> int:
        """Number of tiles."""
        return len(self.tile_points)


def plan_survey(clouds: Sequence[CloudExtent], config: TilingConfig) -> SurveyPlan:
    """
    Cut a survey into tiles as a run does, taking the points of a file to lie evenly in its bounds.

    Raises
    ------
    InputError
        If a run would not take these files together.
    """
    system = agreed_system(clouds).crs.name
    shared_origin(clouds)
    filled = [cloud for cloud in clouds if cloud.point_count]
    areas = [area for cloud in filled if (area := Rectangle.of_cloud(cloud)) is not None]
    counts = [cloud.point_count for cloud in filled]
    size, start = tiles_for(config, areas, counts)
    bounds = bounds_of(areas) - start
    extents = np.prod(bounds[:, 1] - bounds[:, 0], axis=1)
    covered = float(shapely.union_all(shapely.box(*bounds[:, 0].T, *bounds[:, 1].T)).area)
    around = Rectangle.around(areas) if areas else Rectangle(0.0, 0.0, 0.0, 0.0)
    return SurveyPlan(
        len(clouds),
        sum(counts),
        sum(cloud.state[0] for cloud in clouds),
        system,
        (around.x_min, around.y_min, around.x_max, around.y_max),
        covered,
        size,
        expected_points(bounds, np.array(counts, dtype=np.float64), config.buffer, size),
        expected_points(bounds, extents, config.buffer, size) * covered / max(extents.sum(), 1e-9),
    )
