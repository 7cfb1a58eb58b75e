"""
Each stage applied to a tile: the one place where columns become a stage's arguments and its result columns.

The nodes and the ROS-free pipeline both call these functions, so that they do the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial, reduce
from operator import or_

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.classes import ON_TERRAIN, FacadeClass, PointClass, is_of_groups
from lidar_buildings.core.model.ids import rows_by_building
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges
from lidar_buildings.core.stages.ground_filter.beside import judge_beside
from lidar_buildings.core.stages.ground_filter.classification import classify_ground, used_classes
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.fitting import number_planes
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import classify_beside, select_roofs
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import TerrainRasters, make_rasters
from lidar_buildings.pipeline.building_pool import BuildingPool, map_buildings
from lidar_buildings.pipeline.tile_walls import roofs_and_walls


@dataclass(frozen=True, eq=False)
class FilteredTile:
    """A tile after the ground filter."""

    tile: PointTile  #: every point, with its class and height above ground
    #: Beyond which sides what was taken for ground has to be seen to tell whether it is a wide roof.
    clipped: Sides


@dataclass(frozen=True, eq=False)
class LabelledTile:
    """A tile's roof points after edge labelling."""

    tile: PointTile  #: with `edge` and the features
    #: Status of the clusters → how many roofs, or how many tiles where the tile is clustered as one.
    n_roofs: dict[str, int]


def filter_ground(tile: PointTile, config: GroundFilterConfig) -> FilteredTile:
    """
    Append `classification` (1, 2, 7, 18, and what the source's points keep) and `height_above_ground`.

    What the tile shows too little of to tell whether it is a wide roof counts if the tile's core has part in
    it. Covered points are judged against the terrain that the others tell.
    """
    if tile.is_covered.any():
        return _filter_beside(tile, config)
    before, kept = used_classes(tile.points, tile.classification, tile.point_spacing), config.kept_classes
    result = classify_ground(
        tile.points,
        config,
        gps_time=tile.gps_time,
        scan_angle=tile.scan_angle,
        scan_direction_flag=tile.scan_direction_flag,
        point_source_id=tile.point_source_id,
        set_aside=None if before is None else is_of_groups(before, set(kept) - set(ON_TERRAIN)),
        from_street=None if tile.view is None else tile.is_from_street,
        point_spacing=tile.point_spacing,
    )
    classes = result.classification
    if before is not None:
        classes = np.where(is_of_groups(before, kept), before, classes)
    filtered = tile.with_columns(classification=classes, height_above_ground=result.height_above_ground)
    return FilteredTile(filtered, _sides_of(result.cut_off, tile))


def _filter_beside(tile: PointTile, config: GroundFilterConfig) -> FilteredTile:
    covered = np.flatnonzero(tile.is_covered)
    own = np.flatnonzero(~tile.is_covered)
    filtered = filter_ground(tile.select(own), config)
    found = filtered.tile
    ground = found.classification == PointClass.GROUND
    vertices = found.points[ground] if ground.any() else found.points
    classes, heights = np.empty(len(tile), np.uint8), np.empty(len(tile))
    classes[own], heights[own] = found.classification, found.height_above_ground
    classes[covered], heights[covered] = judge_beside(tile.points.take(covered, axis=0), vertices, config)
    if tile.classification is not None:
        is_kept = tile.is_covered & is_of_groups(tile.classification, config.kept_classes)
        classes[is_kept] = tile.classification[is_kept]
    return FilteredTile(
        tile.with_columns(classification=classes, height_above_ground=heights), filtered.clipped
    )


def _sides_of(extents: NDArray[np.float64], tile: PointTile) -> Sides:
    """Return on which sides something passes a tile's limits, if anything of it lies in the core's extent."""
    if not len(extents) or not tile.is_core.any():
        return NONE
    low, high = extent_of(tile.points[tile.is_core, :2])
    near = (extents[:, 0] < high).all(axis=1) & (extents[:, 1] > low).all(axis=1)
    return reduce(or_, (Sides.passed(*one, tile.bounds, 0.0) for one in extents[near]), NONE)


def select_roof_points(tile: PointTile, config: RoofSelectionConfig) -> PointTile:
    """
    Give every point of a tile its final class, and say what of class 6 is `facade`.

    Covered points are no roofs; they are classified by the roofs that the others tell.
    """
    if tile.is_covered.any():
        return _select_beside(tile, config)
    result = select_roofs(
        tile.points,
        config,
        height_above_ground=tile.height_above_ground,
        classification=tile.classification,
        return_number=tile.return_number,
        number_of_returns=tile.number_of_returns,
        intensity=tile.intensity,
        normalised_intensity=tile.normalised_intensity,
        point_source_id=tile.point_source_id,
        dark_limit=tile.dark_limit,
        point_spacing=tile.point_spacing,
    )
    give_memory_back()  # of all stages this one takes most, half of which would stay
    return tile.with_columns(classification=result.classification, facade=result.facade)


def _select_beside(tile: PointTile, config: RoofSelectionConfig) -> PointTile:
    covered = np.flatnonzero(tile.is_covered)
    own = np.flatnonzero(~tile.is_covered)
    found = select_roof_points(tile.select(own), config)
    classes, facade = np.empty((2, len(tile)), np.uint8)
    classes[own], facade[own] = found.classification, found.facade
    classes[covered], facade[covered] = classify_beside(
        tile.points.take(covered, axis=0),
        tile.height_above_ground[covered],
        tile.classification[covered],
        found.points[found.is_roof],
        config,
        found.point_spacing,
    )
    return tile.with_columns(classification=classes, facade=facade)


def roof_points(tile: PointTile) -> PointTile:
    """Return the roofs that the tile's core may be part of, and bare walls; see `roofs_and_walls`."""
    return tile.select(roofs_and_walls(tile))


def label_roof_edges(
    tile: PointTile, config: EdgeLabellingConfig, *, is_roof: NDArray[np.bool_] | None = None
) -> LabelledTile:
    """
    Append edge labels, features, normals and the chosen radius to what `roof_points` returns.

    `is_roof` says what is labelled, the tile's roofs if not given; of other points all is 0.
    """
    rows = np.flatnonzero(tile.is_roof if is_roof is None else is_roof)
    result = label_edges(tile.points.take(rows, axis=0), config, point_spacing=tile.point_spacing)
    found = {
        "linearity": result.linearity,
        "planarity": result.planarity,
        "normal_x": result.normals[:, 0],
        "normal_y": result.normals[:, 1],
        "normal_z": result.normals[:, 2],
        "neighbourhood_radius": result.neighbourhood_radius,
        "edge": result.edge,
    }
    if len(rows) < len(tile):
        for name, values in found.items():
            found[name] = np.zeros(len(tile), dtype=values.dtype)
            found[name][rows] = values
    return LabelledTile(tile.with_columns(**found), result.n_roofs)


def fit_planes(tile: PointTile, config: PlaneFittingConfig, pool: BuildingPool | None = None) -> PointTile:
    """
    Append `plane_id`, numbered within each building, to a tile of building points.

    What was seen of a roof that is closed behind walls tells no planes of the rest: its points have none.
    Buildings are shared out over the pool's processes if there is one.
    """
    plane_id = np.zeros(len(tile), dtype=np.uint16)
    buildings = [] if tile.building_id is None else rows_by_building(tile.building_id)
    if tile.has_bare_walls:
        buildings = [one for one in buildings if not (tile.facade[one[1]] == FacadeClass.BARE).any()]
    fit = partial(number_planes, config=config, point_spacing=tile.point_spacing)
    jobs = [(number, partial(fit, tile.points[rows])) for number, rows in buildings]
    sizes = [len(rows) for _, rows in buildings]

    def no_planes(k: int, reason: str) -> NDArray[np.uint16]:
        return np.zeros(sizes[k], dtype=np.uint16)

    found = map_buildings(pool, jobs, sizes, no_planes, "no planes were fitted")
    for (_, rows), numbers in zip(buildings, found, strict=True):
        plane_id[rows] = numbers
    return tile.with_columns(plane_id=plane_id)


def rasterise_tile(tile: PointTile, config: RasterConfig, frame: MapFrame) -> TerrainRasters | None:
    """
    Make the rasters of a classified tile; None where none are wanted, or points have no class.

    Cells are aligned in the source's coordinates of the frame, which a tile that came as a message does not
    know.
    """
    if config.raster_resolution == 0.0 or tile.classification is None:
        return None
    x, y, _ = frame.origin
    return make_rasters(
        tile.points,
        tile.classification,
        config,
        return_number=tile.return_number,
        is_core=tile.is_core,
        point_spacing=tile.point_spacing,
        origin=(x, y),
    )
