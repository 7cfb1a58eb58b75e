"""
Areas whose roof points are known well enough to be labelled: each point with the roof that it belongs to.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.common.clouds import read_tile
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.surface_patches import connected_parts
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.evaluation.scores.edges import (
    NO_ROOF,
    alpha_of_spacing,
    fewest_points,
    roofs_of_points,
    roofs_of_polygons,
)
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points


class RoofArea(NamedTuple):
    """The roof points of an area."""

    points: NDArray[np.float64]  #: in the map frame, rounded to float32 as in a run [m], shape (n_points, 3)
    roof: NDArray[np.int64]  #: which roof each is of, from 0, shape (n_points,)
    spacing: float  #: measured spacing of these points in plan [m]
    n_left_out: int  #: points of the class that are of no roof


def areas_in(data: Path) -> dict[str, RoofArea]:
    """Read the areas that are there, by name."""
    readers: dict[str, Callable[[Path], RoofArea]] = {
        "delft": _blocks_of_a_map,
        "montpellier": _parts_of_class_6,
        "fusa": _parts_of_class_6,
        "toronto": _parts_of_own_selection,
    }
    areas = {name: read(data / name) for name, read in readers.items() if any((data / name).glob("*.laz"))}
    if not areas:
        raise SystemExit(f"{data}: holds none of {', '.join(readers)}: give the data folder with --data")
    return areas


def split(area: RoofArea) -> RoofArea:
    """
    Return the area with roofs split where the surface steps; what is too small stays with its neighbour.
    """
    gap, least = 2.0 * alpha_of_spacing(area.spacing), fewest_points(area.spacing)
    return area._replace(roof=split_at_steps(area.points, area.roof, gap, min_points=least))


def split_at_steps(
    points: NDArray[np.float64], roof: NDArray[np.int64], gap: float, *, min_points: int = 1
) -> NDArray[np.int64]:
    """
    Split each roof into parts between which the surface steps, so that a step is an edge of the upper part.

    Points no further apart than `gap` in space belong together. Smaller parts than `min_points` (chimneys,
    dormers, noise) stay with the nearest larger part of their roof in plan; a roof without a larger one stays
    whole.
    """
    found = np.full(len(points), NO_ROOF, dtype=np.int64)
    n_parts = 0
    for number in np.unique(roof[roof >= 0]):
        rows = np.flatnonzero(roof == number)
        part = _merged_into_large(points[rows], connected_parts(points[rows], gap), min_points)
        found[rows] = n_parts + part
        n_parts += int(part.max()) + 1
    return found


def _merged_into_large(
    points: NDArray[np.float64], part: NDArray[np.int64], min_points: int
) -> NDArray[np.int64]:
    """Give points of small parts to the part of the nearest point in plan that is of a large one."""
    large = np.bincount(part)[part] >= min_points
    if not large.any():
        return np.zeros_like(part)
    if large.all():
        return part
    # Of several as near, the first by x, y, z: the order of the points has no say.
    rows = np.flatnonzero(large)
    rows = rows[np.lexsort(points[rows].T[::-1])]
    nearest = cKDTree(points[rows, :2]).query(points[~large, :2])[1]
    merged = part.copy()
    merged[~large] = part[rows[nearest]]
    return merged


def _blocks_of_a_map(folder: Path) -> RoofArea:
    """Points of class 6 within the blocks of touching buildings of a map, each block one roof."""
    tile, frame = read_tile(folder)
    blocks = read_metric_polygons(folder / "blocks_nw.gpkg").polygons
    blocks = shapely.transform(blocks, lambda xy: xy - np.array(frame.origin[:2]))
    points = _class_6(tile)
    return _area(points, roofs_of_polygons(points, blocks))


def _parts_of_class_6(folder: Path) -> RoofArea:
    """Points of class 6, each part that hangs together in plan one roof."""
    return _parts(_class_6(read_tile(folder)[0]))


def _parts_of_own_selection(folder: Path) -> RoofArea:
    """Points that this package takes for roofs, by its defaults, each part that hangs together one roof."""
    tile = filter_ground(read_tile(folder)[0], GroundFilterConfig()).tile
    return _parts(_class_6(select_roof_points(tile, RoofSelectionConfig())))


def _class_6(tile: PointTile) -> NDArray[np.float64]:
    """Return the tile's building points without those that are known to be façade."""
    return tile.points[tile.is_roof]


def _parts(points: NDArray[np.float64]) -> RoofArea:
    """Take for one roof what no disc of the reference can be moved between, if it is large enough."""
    spacing = measure_spacing(points)
    gap = 2.0 * alpha_of_spacing(spacing)
    return _area(points, roofs_of_points(points, gap, min_points=fewest_points(spacing)))


def _area(points: NDArray[np.float64], roof: NDArray[np.int64]) -> RoofArea:
    """Keep the points of roofs."""
    kept = roof != NO_ROOF
    return RoofArea(points[kept], roof[kept], measure_spacing(points[kept]), int((~kept).sum()))
