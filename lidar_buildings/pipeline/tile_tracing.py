"""A tile's buildings: segmented and traced, closed behind their walls, or on given footprints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial, reduce
from operator import or_

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.ids import anchor_row, building_id, rows_by_building
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.open_ground import GROUND_REACH
from lidar_buildings.core.stages.boundary_tracing.tracing import rows_to_trace, trace_boundary
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.footprints.footprints import Footprints, assign_footprints
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings
from lidar_buildings.pipeline.building_pool import BuildingPool, map_buildings
from lidar_buildings.pipeline.tile_stages import label_roof_edges
from lidar_buildings.pipeline.tile_walls import roofs_and_walls, walled_buildings

#: Half the side of the square that stands for a building whose tracing failed altogether [m].
_MARKER_SIZE = 0.5


@dataclass(frozen=True, eq=False)
class TracedTile:
    """A tile's buildings after segmentation and tracing."""

    #: The roof points, and the tops of walls that were closed, with `building_id`; 0 for those of no building
    #: and of the neighbours' buildings.
    tile: PointTile
    outlines: tuple[BuildingOutline, ...]  #: one per building of this tile, by rising id
    #: On which sides one of these buildings reaches the tile's `bounds`, so that its rest lies outside.
    clipped: Sides


def trace_buildings(
    tile: PointTile,
    segmentation: SegmentationConfig,
    boundary_tracing: BoundaryTracingConfig,
    pool: BuildingPool | None = None,
    ground: NDArray[np.float64] | None = None,
) -> TracedTile:
    """
    Segment roof points with edge labels into buildings and trace those that belong to the tile.

    A block of touching buildings belongs to the tile that holds its anchor as a core point, so that each
    building comes out once. They are traced in the pool's processes if there is one. `ground` is that about
    the roofs, (n_ground, 3) [m].
    """
    found = segment_buildings(
        tile.points,
        segmentation,
        gps_time=tile.gps_time,
        point_source_id=tile.point_source_id,
        point_spacing=tile.point_spacing,
    )
    is_core = tile.is_core
    blocks = {
        number
        for number, rows in rows_by_building(found.block_id)
        if is_core[rows[anchor_row(tile.points.take(rows, axis=0))]]
    }
    owned = [
        (number, rows)
        for number, rows in rows_by_building(found.building_id)
        if int(found.block_id[rows[0]]) in blocks
    ]
    number_of, jobs, spacing = np.zeros(len(tile), dtype=np.uint32), [], tile.point_spacing
    ground = None if ground is None else ground[np.argsort(ground[:, 0], kind="stable"), :2]
    for number, rows in owned:
        number_of[rows] = number
        cloud = tile.points.take(rows_to_trace(rows, tile.edge, boundary_tracing), axis=0)
        pattern = found.patterns[number]
        near = None if ground is None else _about(ground, cloud, GROUND_REACH * (spacing or pattern.spacing))
        jobs.append((number, partial(_traced, cloud, boundary_tracing, pattern, spacing, near)))
    sizes = [len(rows) for _, rows in owned]

    def marker(k: int, reason: str) -> Outline:
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * _MARKER_SIZE
        points = jobs[k][1].args[0]
        return Outline(points[anchor_row(points), :2] + square).as_carried()

    rings = map_buildings(pool, jobs, sizes, marker, "tracing failed, a square marks its anchor")
    outlines = [BuildingOutline(number, ring) for (number, _), ring in zip(jobs, rings, strict=True)]
    places = (extent_of(tile.points.take(rows, axis=0)[:, :2]) for _, rows in owned)
    clipped = reduce(
        or_, (Sides.passed(*corners, tile.bounds, max(found.window)) for corners in places), NONE
    )
    return TracedTile(tile.with_columns(building_id=number_of), tuple(outlines), clipped)


def _about(ground: NDArray[np.float64], points: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Return the ground, which comes by rising x, within the extent of some points and a reach about it."""
    low, high = extent_of(points[:, :2])
    rows = slice(*np.searchsorted(ground[:, 0], (low[0] - reach, high[0] + reach)))
    return ground[rows][
        np.abs(ground[rows, 1] - 0.5 * (low[1] + high[1])) <= 0.5 * (high[1] - low[1]) + reach
    ]


def trace_or_close(
    tile: PointTile,
    segmentation: SegmentationConfig,
    boundary_tracing: BoundaryTracingConfig,
    pool: BuildingPool | None = None,
) -> TracedTile:
    """
    Trace a tile's roofs, and close behind its walls what encloses more than was seen of a roof.

    The tile is what `roof_points` returns, its roofs with edge labels.
    """
    is_roof = tile.is_roof
    if is_roof.all():
        return trace_buildings(tile, segmentation, boundary_tracing, pool)
    ground = tile.points[tile.classification != PointClass.BUILDING]
    if not tile.has_bare_walls:
        return trace_buildings(tile.select(is_roof), segmentation, boundary_tracing, pool, ground)
    walled, clipped = walled_buildings(tile, segmentation.min_area)
    number, outlines, is_alone, is_core = np.zeros(len(tile), dtype=np.uint32), [], is_roof, tile.is_core
    for rows, outline in walled:
        is_alone[rows] = False
        anchor = rows[anchor_row(tile.points[rows])]
        if is_core[anchor]:
            number[rows] = building_id(tile.points[anchor])
            outlines.append(BuildingOutline(int(number[anchor]), outline.as_carried()))
    alone = trace_buildings(tile.select(is_alone), segmentation, boundary_tracing, pool, ground)
    number[is_alone] = alone.tile.building_id
    chosen = tile.is_roof | (number > 0)
    outlines = sorted([*alone.outlines, *outlines], key=lambda one: one.building_id)
    return TracedTile(
        tile.with_columns(building_id=number).select(chosen), tuple(outlines), clipped | alone.clipped
    )


def trace_footprints(
    classified: PointTile,
    roofs: PointTile,
    footprints: Footprints,
    config: FootprintConfig,
    edge_labelling: EdgeLabellingConfig,
) -> TracedTile:
    """
    Take given footprints for a tile's outlines, and give their points their ids.

    `classified` are all points of the tile, `roofs` what `roof_points` returns of them, with edge labels;
    those that are taken at footprints next to without roof points are labelled by `edge_labelling`. Where the
    ground was seen within footprints it is kept, without an id: no roof is there. Covered points, which tell
    no roofs, are none of a footprint's.
    """
    is_own, kept = roofs_and_walls(classified) & classified.is_roof, ~classified.is_covered
    if not kept.all():
        classified, is_own = classified.select(kept), is_own[kept]
    found = assign_footprints(classified, footprints, config)
    is_other = (found.building_id > 0) & ~is_own
    roofs = roofs.select(roofs.is_roof)
    is_added = is_other | (found.is_ground & ~is_own)
    tile = _with_others(classified, roofs, is_own, is_added, found.building_id, edge_labelling)
    chosen = np.flatnonzero(is_own | is_added)
    return TracedTile(tile.with_columns(building_id=found.building_id[chosen]), found.outlines, found.clipped)


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
    numbers = building_id[is_other & (building_id > 0)]
    together = np.flatnonzero(np.isin(building_id, numbers) | is_other)
    stands = building_id[together] > 0
    labelled = label_roof_edges(classified.select(together), edge_labelling, is_roof=stands).tile
    others = labelled.select(is_other[together])
    rows = np.concatenate([np.flatnonzero(is_own), np.flatnonzero(is_other)])
    return roofs.joined(others).select(np.argsort(rows, kind="stable"))


def _traced(
    points: NDArray[np.float64],
    config: BoundaryTracingConfig,
    pattern: ScanPattern,
    point_spacing: float | None,
    ground: NDArray[np.float64] | None,
) -> Outline:
    traced = trace_boundary(points, config, pattern=pattern, point_spacing=point_spacing, ground=ground)
    return traced.outline.as_carried()
