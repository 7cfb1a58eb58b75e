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

from bench.common.clouds import read_tile
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.evaluation.readers.metric_polygons import read_metric_polygons
from lidar_buildings.evaluation.scores.edges import (
    NO_ROOF,
    alpha_of_spacing,
    fewest_points,
    roofs_of_points,
    roofs_of_polygons,
    split_at_steps,
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
