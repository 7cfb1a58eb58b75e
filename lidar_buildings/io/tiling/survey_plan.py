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
from lidar_buildings.io.tiling.tile_size import bounds_of, expected_points, spread_of, tiles_for
from lidar_buildings.io.tiling.tiling_config import TilingConfig


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """A survey and its tiles."""

    n_files: int
    n_points: int
    n_bytes: int
    system: str  #: reference system, empty if no file says
    bounds: tuple[float, float, float, float]  #: least x and y, greatest x and y [m]
    area: float  #: what the bounds of the files cover [m²]
    tile_size: float  #: side of the tiles [m]
    #: Expected points of each tile, and what it covers [m²], buffer included, shape (n_tiles,).
    tile_points: NDArray[np.float64]
    tile_areas: NDArray[np.float64]

    @property
    def n_tiles(self) -> int:
        """Number of tiles."""
        return len(self.tile_points)


def plan_survey(
    clouds: Sequence[CloudExtent], config: TilingConfig, within: Sequence[float] | None = None
) -> SurveyPlan:
    """
    Cut a survey, or what of it is within bounds, into tiles as a run does.

    The points of a file are taken to lie evenly in its bounds, those of COPC in the squares of its octree.
    InputError if a run would not take these files together.
    """
    system = agreed_system(clouds)
    shared_origin(clouds)
    filled = [cloud for cloud in clouds if cloud.point_count]
    files = bounds_of([area for cloud in filled if (area := Rectangle.of_cloud(cloud)) is not None])
    sizes = np.array([cloud.state[0] for cloud in filled], dtype=np.float64)
    places, counts = spread_of(filled)
    if within is not None:
        limits = np.array(within).reshape(2, 2) * system.crs.horizontal_unit
        (files, sizes), (places, counts) = _cut(files, sizes, limits), _cut(places, counts, limits)
    size, start, buffer = tiles_for(config, places, counts)
    extents = np.prod(files[:, 1] - files[:, 0], axis=1)
    covered = float(shapely.union_all(shapely.box(*files[:, 0].T, *files[:, 1].T)).area)
    around = [files[:, 0].min(axis=0), files[:, 1].max(axis=0)] if len(files) else np.zeros((2, 2))
    west, south, east, north = np.ravel(around).tolist()
    return SurveyPlan(
        len(clouds) if within is None else len(files),
        round(counts.sum()),
        round(sizes.sum()),
        system.crs.name,
        (west, south, east, north),
        covered,
        size,
        expected_points(places - start, counts, buffer, size),
        expected_points(files - start, extents, buffer, size) * covered / max(extents.sum(), 1e-9),
    )


def _cut(
    bounds: NDArray[np.float64], counts: NDArray[np.float64], limits: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what of places is within limits, and of what lies evenly in each its share."""
    cut = np.clip(bounds, *limits)
    share = np.prod((cut[:, 1] - cut[:, 0]) / (bounds[:, 1] - bounds[:, 0]), axis=1)
    return cut[share > 0.0], (counts * share)[share > 0.0]
