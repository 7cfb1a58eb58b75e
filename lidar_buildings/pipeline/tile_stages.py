"""
Each stage applied to a tile: the one place where columns become a stage's arguments and its result columns.

The nodes and the ROS-free pipeline both call these functions, so that they do the same.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.model.classes import ON_TERRAIN, is_of_groups
from lidar_buildings.core.model.ids import anchor_row, rows_by_building
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing import BoundaryTracingConfig, rows_to_trace, trace_boundary
from lidar_buildings.core.stages.edge_labelling import EdgeLabellingConfig, label_edges
from lidar_buildings.core.stages.footprints import FootprintConfig, Footprints, assign_footprints
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig, classify_ground, used_classes
from lidar_buildings.core.stages.plane_fitting import PlaneFittingConfig, number_planes
from lidar_buildings.core.stages.roof_selection import RoofSelectionConfig, select_roofs
from lidar_buildings.core.stages.segmentation import SegmentationConfig, segment_buildings
from lidar_buildings.core.surfaces.surface_patches import own_roofs
from lidar_buildings.pipeline.sharing import Sharing, map_buildings

_log = logging.getLogger(__name__)

#: Half the side of the square that stands for a building whose tracing failed altogether [m].
_MARKER_SIZE = 0.5


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


@dataclass(frozen=True, eq=False)
class TracedTile:
    """A tile's buildings after segmentation and tracing."""

    #: The roof points with `building_id`; 0 for those of no building and of the neighbours' buildings.
    tile: PointTile
    outlines: tuple[BuildingOutline, ...]  #: one per building of this tile, by rising id
    #: On which sides one of these buildings reaches the tile's `bounds`, so that its rest lies outside.
    clipped: Sides


def filter_ground(tile: PointTile, config: GroundFilterConfig) -> FilteredTile:
    """
    Append `classification` (1, 2, 7, 18, and what the source's points keep) and `height_above_ground`.

    What the tile shows too little of to tell whether it is a wide roof counts if the tile's core has part in
    it.
    """
    before, kept = used_classes(tile.points, tile.classification, tile.point_spacing), config.kept_classes
    result = classify_ground(
        tile.points,
        config,
        gps_time=tile.gps_time,
        scan_angle=tile.scan_angle,
        scan_direction_flag=tile.scan_direction_flag,
        point_source_id=tile.point_source_id,
        set_aside=None if before is None else is_of_groups(before, set(kept) - set(ON_TERRAIN)),
    )
    classes = result.classification
    if before is not None:
        classes = np.where(is_of_groups(before, kept), before, classes)
    filtered = tile.with_columns(classification=classes, height_above_ground=result.height_above_ground)
    return FilteredTile(filtered, _sides_of(result.cut_off, tile))


def _sides_of(extents: NDArray[np.float64], tile: PointTile) -> Sides:
    """Return on which sides something passes a tile's limits, if anything of it lies in the core's extent."""
    if not len(extents) or not tile.is_core.any():
        return NONE
    low, high = extent_of(tile.points[tile.is_core, :2])
    near = (extents[:, 0] < high).all(axis=1) & (extents[:, 1] > low).all(axis=1)
    return reduce(or_, (Sides.passed(*one, tile.bounds, 0.0) for one in extents[near]), NONE)


def select_roof_points(tile: PointTile, config: RoofSelectionConfig) -> PointTile:
    """Give every point of a tile its final class, and say which of class 6 are `facade`."""
    result = select_roofs(
        tile.points,
        config,
        height_above_ground=None
        if tile.height_above_ground is None
        else tile.height_above_ground.astype(float),
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
    return tile.with_columns(classification=result.classification, facade=result.is_facade)


def roof_points(tile: PointTile) -> PointTile:
    """Return the roofs of class 6 that the tile's core may be part of, see `own_roofs`."""
    return tile.select(own_roofs(tile))


def label_roof_edges(tile: PointTile, config: EdgeLabellingConfig) -> LabelledTile:
    """Append edge labels, features, normals and the chosen radius to a tile of roof points."""
    result = label_edges(tile.points, config, point_spacing=tile.point_spacing)
    labelled = tile.with_columns(
        linearity=result.linearity,
        planarity=result.planarity,
        normal_x=result.normals[:, 0],
        normal_y=result.normals[:, 1],
        normal_z=result.normals[:, 2],
        neighbourhood_radius=result.neighbourhood_radius,
        edge=result.edge,
    )
    return LabelledTile(labelled, result.n_roofs)


def trace_buildings(
    tile: PointTile,
    segmentation: SegmentationConfig,
    boundary_tracing: BoundaryTracingConfig,
    pool: Sharing | None = None,
) -> TracedTile:
    """
    Segment a tile's roof points into buildings and trace those that belong to the tile.

    A block of touching buildings belongs to the tile that holds its anchor as a core point, so that each
    building comes out once. They are traced in the pool's processes if there is one.
    """
    found = segment_buildings(
        tile.points,
        segmentation,
        scan_angle=tile.scan_angle,
        gps_time=tile.gps_time,
        point_source_id=tile.point_source_id,
        point_spacing=tile.point_spacing,
    )
    is_core = tile.is_core
    blocks = {
        number
        for number, rows in rows_by_building(found.block_id)
        if is_core[rows[anchor_row(tile.points[rows])]]
    }
    owned = [
        (number, rows)
        for number, rows in rows_by_building(found.building_id)
        if int(found.block_id[rows[0]]) in blocks
    ]
    building_id, jobs, spacing = np.zeros(len(tile), dtype=np.uint32), [], tile.point_spacing
    for number, rows in owned:
        building_id[rows] = number
        cloud = tile.points[rows_to_trace(rows, tile.edge, boundary_tracing)]
        jobs.append(_TracingJob(number, cloud, boundary_tracing, found.patterns[number], spacing))
    rings = map_buildings(pool, _traced, jobs, [len(rows) for _, rows in owned], _square)
    outlines = [BuildingOutline(job.building_id, ring) for job, ring in zip(jobs, rings, strict=True)]
    places = (extent_of(tile.points[rows, :2]) for _, rows in owned)
    clipped = reduce(
        or_,
        (Sides.passed(*corners, tile.bounds, max(found.window)) for corners in places),
        NONE,
    )
    return TracedTile(tile.with_columns(building_id=building_id), tuple(outlines), clipped)


def trace_footprints(
    classified: PointTile,
    roofs: PointTile,
    footprints: Footprints,
    config: FootprintConfig,
    edge_labelling: EdgeLabellingConfig,
) -> TracedTile:
    """
    Take given footprints for a tile's outlines, and give their points their ids.

    Parameters
    ----------
    classified : PointTile
        All points of the tile.
    roofs : PointTile
        Its roof points with edge labels, as `label_roof_edges` returns them.
    footprints : Footprints
    config : FootprintConfig
    edge_labelling : EdgeLabellingConfig
        For the points that are taken at footprints next to without roof points.
    """
    found = assign_footprints(classified, footprints, config)
    is_own = own_roofs(classified)
    is_other = (found.building_id > 0) & ~is_own
    tile = _with_others(classified, roofs, is_own, is_other, found.building_id, edge_labelling)
    chosen = np.flatnonzero(is_own | is_other)
    return TracedTile(tile.with_columns(building_id=found.building_id[chosen]), found.outlines, found.clipped)


def fit_planes(tile: PointTile, config: PlaneFittingConfig, pool: Sharing | None = None) -> PointTile:
    """
    Append `plane_id`, numbered within each building, to a tile of building points.

    Buildings are shared out over the pool's processes if there is one.
    """
    plane_id = np.zeros(len(tile), dtype=np.uint16)
    buildings = [] if tile.building_id is None else rows_by_building(tile.building_id)
    jobs = [_PlaneJob(number, tile.points[rows], config, tile.point_spacing) for number, rows in buildings]
    found = map_buildings(pool, _fitted_planes, jobs, [len(rows) for _, rows in buildings], _no_planes)
    for (_, rows), numbers in zip(buildings, found, strict=True):
        plane_id[rows] = numbers
    return tile.with_columns(plane_id=plane_id)


class _PlaneJob(NamedTuple):
    """What one building's planes are fitted to."""

    building_id: int
    points: NDArray[np.float64]
    config: PlaneFittingConfig
    point_spacing: float | None


def _fitted_planes(job: _PlaneJob) -> NDArray[np.uint16]:
    """Number the planes of one building; whatever goes wrong, numbers come back."""
    try:
        return number_planes(job.points, job.config, point_spacing=job.point_spacing)
    except Exception:
        _log.exception("building %d: no planes were fitted", job.building_id)
        return np.zeros(len(job.points), dtype=np.uint16)


def _no_planes(job: _PlaneJob) -> NDArray[np.uint16]:
    _log.error("building %d: no planes were fitted, two processes ended at it", job.building_id)
    return np.zeros(len(job.points), dtype=np.uint16)


def _with_others(
    classified: PointTile,
    roofs: PointTile,
    is_own: NDArray[np.bool_],
    is_other: NDArray[np.bool_],
    building_id: NDArray[np.uint32],
    edge_labelling: EdgeLabellingConfig,
) -> PointTile:
    """Return a tile's roof points with others among them in their places, labelled as well."""
    if not is_other.any():
        return roofs
    # what stands in a footprint is labelled together with the few roof points there
    together = np.flatnonzero(np.isin(building_id, building_id[is_other]))
    labelled = label_roof_edges(classified.select(together), edge_labelling).tile
    others = labelled.select(is_other[together])
    rows = np.concatenate([np.flatnonzero(is_own), np.flatnonzero(is_other)])
    return roofs.joined(others).select(np.argsort(rows, kind="stable"))


class _TracingJob(NamedTuple):
    """What one building is traced from."""

    building_id: int
    points: NDArray[np.float64]
    config: BoundaryTracingConfig
    pattern: ScanPattern
    point_spacing: float | None


def _traced(job: _TracingJob) -> Outline:
    """Trace one building; whatever goes wrong, a ring comes back."""
    try:
        traced = trace_boundary(job.points, job.config, pattern=job.pattern, point_spacing=job.point_spacing)
        return traced.outline.as_carried()
    except Exception:
        _log.exception("building %d: tracing failed, a square marks its anchor", job.building_id)
        return _square(job)


def _square(job: _TracingJob) -> Outline:
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * _MARKER_SIZE
    return Outline(job.points[anchor_row(job.points), :2] + square).as_carried()
