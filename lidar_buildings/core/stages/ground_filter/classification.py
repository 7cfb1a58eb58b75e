"""The stage: noise, terrain, and every point judged against it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.point_array import checked_column, checked_columns, checked_points, extent_of
from lidar_buildings.core.neighbours.cell_grid import CellGrid, in_rows_order, lowest_of_cells, sort_by_cell
from lidar_buildings.core.neighbours.point_spacing import given_or_measured, quantised_spacing
from lidar_buildings.core.stages.ground_filter.bidirectional_slope import profile_ground, slope_pair_ground
from lidar_buildings.core.stages.ground_filter.config import (
    CANDIDATE_SPACING,
    HEIGHT_WITHOUT_GROUND,
    GroundFilterConfig,
)
from lidar_buildings.core.stages.ground_filter.consensus import NO_EXTENTS, agreed_ground, opened_ground
from lidar_buildings.core.stages.ground_filter.gross_errors import find_noise
from lidar_buildings.core.stages.ground_filter.progressive_tin import (
    grown_ground,
    histogram_ground,
    near_terrain,
)
from lidar_buildings.core.stages.ground_filter.scan_profiles import find_scan_lines
from lidar_buildings.core.stages.ground_filter.street_ground import street_ground, street_terrain
from lidar_buildings.core.surfaces.triangulation import build_tin


@dataclass(frozen=True, eq=False)
class GroundResult:
    """What `classify_ground` found, one value per point in the order given."""

    #: 2 = ground, 7 = low noise, 18 = high noise, 1 = everything else, shape (n_points,).
    classification: NDArray[np.uint8]
    #: Height above the terrain [m]; finite for every point, negative below the terrain, shape (n_points,).
    height_above_ground: NDArray[np.float64]
    #: Least and greatest x and y of what was taken for ground and may be wide roofs, too little of which lies
    #: within the points to tell [m]; only ``consensus`` looks for them, shape (n, 2, 2).
    cut_off: NDArray[np.float64] = field(default_factory=NO_EXTENTS.copy)


def classify_ground(
    points: ArrayLike,
    config: GroundFilterConfig | None = None,
    *,
    gps_time: ArrayLike | None = None,
    scan_angle: ArrayLike | None = None,
    scan_direction_flag: ArrayLike | None = None,
    point_source_id: ArrayLike | None = None,
    set_aside: ArrayLike | None = None,
    from_street: ArrayLike | None = None,
    point_spacing: float | None = None,
) -> GroundResult:
    """
    Tell ground from everything else, and measure how high each point lies above it.

    Gross errors are set aside; then the method that `config.method` names finds the ground among the lowest
    points of small cells, and points close to the TIN of that ground are ground:

    - ``consensus``: ground is what two of the three methods below say is.
    - ``progressive_tin`` (Axelsson 2000): the lowest points of large cells form a first, coarse TIN; points
      that lie near its facets join it, round by round, until none is left.
    - ``bidirectional_slope`` (Shan & Sampath 2005): points are labelled along scan lines, forth and back, by
      slope and elevation difference.
    - ``morphological`` (Zhang et al. 2003; Pingel et al. 2013): openings of the lowest surface with growing
      windows.
    - ``histogram_tin`` (Mancera-Taboada et al. 2012), and ``slope_pairs`` (Sampath & Shan 2007), which labels
      all points itself: as published.
    - ``none``: no point is; every one stands `HEIGHT_WITHOUT_GROUND` above the ground.

    Heights are measured from the TIN of the ground. The lowest surface is ground by definition. Where no
    ground was recorded (a tile that shows one roof only), that is the roof, and heights are measured from it;
    there is no result without a terrain.

    - `points`, shape (n_points, 3): Last or all returns [m]; in any order, but for ``bidirectional_slope``,
      which uses the scan's where there is one.
    - `config`, optional: Thresholds; the defaults serve town and country.
    - `gps_time`, `scan_angle`, `scan_direction_flag`, `point_source_id`, shape (n_points,), optional: What
      tells scan lines apart [s], [deg]; only ``bidirectional_slope`` looks at them.
    - `set_aside`, shape (n_points,), optional: Points that are known not to be of the terrain; class 1 or
      noise, unless nothing else is left.
    - `from_street`, shape (n_points,), optional: Points that a scanner on the street has seen; their ground
      is found by `street_terrain`, whatever the method, and closes the terrain of the others.
    - `point_spacing`, optional: Spacing of the pulses [m]; measured if not given. Tiles of a survey agree if
      all are given the same.

    ValueError if `points` has another shape or is not finite, or another array has not one number per point,
    or the spacing is no length.

    >>> import numpy as np
    >>> x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    >>> roof = (abs(x - 10) < 4) & (abs(y - 10) < 4)
    >>> result = classify_ground(np.column_stack((x.ravel(), y.ravel(), 5.0 * roof.ravel())))
    >>> bool((result.classification[~roof.ravel()] == 2).all())
    True
    >>> float(result.height_above_ground.max())
    5.0
    """
    config = config or GroundFilterConfig()
    points = checked_points(points)
    lines = {"scan_direction_flag": scan_direction_flag, "point_source_id": point_source_id}
    scan = checked_columns(len(points), gps_time=gps_time, scan_angle=scan_angle, **lines)
    aside = None if set_aside is None else checked_column("set_aside", set_aside, len(points), bool)
    if len(points) == 0:
        return GroundResult(np.zeros(0, dtype=np.uint8), np.zeros(0))
    cloud = sort_by_cell(points, CANDIDATE_SPACING)
    classes = find_noise(cloud)
    if config.method == "none":
        classes[classes == 0] = PointClass.UNCLASSIFIED
        height = np.full(len(points), HEIGHT_WITHOUT_GROUND)
        return GroundResult(in_rows_order(cloud, classes), height)
    free = classes == 0
    if aside is not None and (free & ~aside[cloud.rows]).any():  # unless nothing else is left
        free &= ~aside[cloud.rows]
    street = np.zeros(len(points), dtype=bool)
    if from_street is not None:
        street = checked_column("from_street", from_street, len(points), bool)[cloud.rows]
    labels = None
    if config.method == "slope_pairs":
        labels = slope_pair_ground(points, in_rows_order(cloud, free), config, **scan)[cloud.rows]
    if point_spacing is not None:
        point_spacing = max(given_or_measured(points, point_spacing), CANDIDATE_SPACING)
    may_be_ground = free if labels is None else labels
    seen, vertices, cut_off = free & street, np.empty((0, 3)), NO_EXTENTS
    if not seen.any() or (free & ~street).any():
        above = may_be_ground & ~street
        vertices, cut_off = _ground_of_cells(points, cloud, above, point_spacing, config, scan)
    if seen.any():
        vertices = np.concatenate((vertices, street_terrain(cloud, seen)))
    terrain = build_tin(vertices, extent_of(cloud.points)[:, :2])
    elevation, slope = terrain.elevation_and_slope(cloud.points)
    height = np.subtract(cloud.points[:, 2], elevation, out=elevation)
    ground = near_terrain(height, slope, config) if labels is None else labels
    if seen.any():
        ground = np.where(seen, street_ground(cloud, seen, height, config.ground_distance), ground)
    classes[classes == 0] = PointClass.UNCLASSIFIED
    classes[ground & free] = PointClass.GROUND
    return GroundResult(in_rows_order(cloud, classes), in_rows_order(cloud, height), cut_off)


def _ground_of_cells(
    points: NDArray[np.float64],
    cloud: CellGrid,
    free: NDArray[np.bool_],
    spacing: float | None,
    config: GroundFilterConfig,
    scan: dict[str, NDArray[Any] | None],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the cells' lowest free points that are ground, all where none is; the extents of wide roofs."""
    # The points of the cloud are given in the scan's order, too; `spacing` is that of the lowest, if known.
    extent = extent_of(cloud.points)[:, :2]
    rows = lowest_of_cells(cloud, free if free.any() else ~free)
    candidates, cut_off = cloud.points[rows], NO_EXTENTS
    if config.method == "slope_pairs":
        return candidates, cut_off
    if config.method == "histogram_tin":
        ground = histogram_ground(candidates, extent, config)
    elif config.method == "morphological":
        ground = opened_ground(candidates, config)
    else:
        spacing = quantised_spacing(candidates) if spacing is None else spacing
        if config.method == "progressive_tin":
            ground, _ = grown_ground(candidates, extent, spacing, config)
        elif config.method == "bidirectional_slope":
            lines = find_scan_lines(points, spacing, **scan)
            scanned = [] if lines is None else [lines.profiles(points, cloud.rows[rows])]
            ground = profile_ground(candidates, spacing, config, scanned)
        else:
            ground, cut_off = agreed_ground(candidates, extent, spacing, config)
    return candidates[ground] if ground.any() else candidates, cut_off


#: A place is covered if a point lies within so many spacings; by chance 1 in 10⁵ places has none.
_REACH = 2.0


def used_classes(
    points: NDArray[np.float64], classification: NDArray[np.uint8] | None, point_spacing: float | None = None
) -> NDArray[np.uint8] | None:
    """
    Return the source's classes, 0 for points of class 12 where no other point but noise covers the place.

    So they are classified as any other point; those beside them are, too, up to where others begin.
    """
    if classification is None or PointClass.OVERLAP not in classification:
        return classification
    used = classification == PointClass.OVERLAP
    reach = _REACH * given_or_measured(points, point_spacing)
    covers = ~used & ~np.isin(classification, (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    overlap = points[used, :2]
    lone = overlap[~_has_near(overlap, points[covers, :2], reach)]
    used[used] = _has_near(overlap, lone, reach)
    return np.where(used, np.uint8(PointClass.NEVER_CLASSIFIED), classification)


def _has_near(places: NDArray[np.float64], others: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
    if not len(others):
        return np.zeros(len(places), dtype=bool)
    return np.asarray(np.isfinite(cKDTree(others).query(places, distance_upper_bound=reach)[0]))
