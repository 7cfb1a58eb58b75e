"""The stage: noise, terrain, and every point judged against it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.point_array import checked_column, checked_columns, checked_points, extent_of
from lidar_buildings.core.neighbours.cell_grid import CellGrid, in_rows_order, lowest_of_cells, sort_by_cell
from lidar_buildings.core.neighbours.point_spacing import given_or_measured
from lidar_buildings.core.stages.ground_filter.config import (
    CANDIDATE_SPACING,
    HEIGHT_WITHOUT_GROUND,
    GroundFilterConfig,
)
from lidar_buildings.core.stages.ground_filter.consensus import agreed_ground
from lidar_buildings.core.stages.ground_filter.gross_errors.noise import find_noise
from lidar_buildings.core.stages.ground_filter.growing_tin import histogram_tin
from lidar_buildings.core.stages.ground_filter.growing_tin.progressive_tin import densify, near_terrain
from lidar_buildings.core.stages.ground_filter.openings import morphological
from lidar_buildings.core.stages.ground_filter.plates import NO_EXTENTS
from lidar_buildings.core.stages.ground_filter.scan_profiles import bidirectional_slope, slope_pairs
from lidar_buildings.core.surfaces.tin import Tin
from lidar_buildings.core.surfaces.triangulation import build_tin

#: Methods that make a terrain of the lowest points, instead of labels.
DENSIFIED = ("progressive_tin", "histogram_tin")


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
    point_spacing: float | None = None,
) -> GroundResult:
    """
    Tell ground from everything else, and measure how high each point lies above it.

    Gross errors are set aside; then the method that `config.method` names finds the ground:

    - ``consensus``: the lowest points of small cells are ground if two of the three methods below say so;
      points close to the TIN of those are ground.
    - ``progressive_tin`` (Axelsson 2000): the lowest points of large cells form a first, coarse TIN; points
      that lie near its facets join it, round by round, until none is left; points close to the finished TIN
      are ground.
    - ``bidirectional_slope`` (Shan & Sampath 2005): points are labelled along scan lines, forth and back, by
      slope and elevation difference.
    - ``morphological`` (Zhang et al. 2003; Pingel et al. 2013): openings of the lowest surface with growing
      windows.
    - ``histogram_tin`` (Mancera-Taboada et al. 2012), ``slope_pairs`` (Sampath & Shan 2007): as published.
    - ``none``: no point is; every one stands `HEIGHT_WITHOUT_GROUND` above the ground.

    Heights are measured from the TIN of the ground. The lowest surface is ground by definition. Where no
    ground was recorded (a tile that shows one roof only), that is the roof, and heights are measured from it;
    there is no result without a terrain.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        Last or all returns [m]; in any order, but for ``bidirectional_slope``, which uses the scan's where
        there is one.
    config : GroundFilterConfig, optional
        Thresholds; the defaults serve town and country.
    gps_time, scan_angle, scan_direction_flag, point_source_id : array_like of shape (n_points,), optional
        What tells scan lines apart [s], [deg]; only ``bidirectional_slope`` looks at them.
    set_aside : array_like of bool, shape (n_points,), optional
        Points that are known not to be of the terrain; class 1 or noise, unless nothing else is left.
    point_spacing : float, optional
        Spacing of the pulses [m]; measured if not given. Tiles of a survey agree if all are given the same.

    Returns
    -------
    GroundResult

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite, or another array has not one number per point, or the
        spacing is no length.

    Examples
    --------
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
    scan = checked_columns(
        len(points),
        gps_time=gps_time,
        scan_angle=scan_angle,
        scan_direction_flag=scan_direction_flag,
        point_source_id=point_source_id,
    )
    aside = None if set_aside is None else checked_column("set_aside", set_aside, len(points), bool)
    if len(points) == 0:
        return GroundResult(np.zeros(0, dtype=np.uint8), np.zeros(0))
    cloud = sort_by_cell(points, CANDIDATE_SPACING)
    classes = find_noise(cloud)
    if config.method == "none":
        classes[classes == 0] = PointClass.UNCLASSIFIED
        height = np.full(len(points), HEIGHT_WITHOUT_GROUND)
        return GroundResult(in_rows_order(cloud, classes), height)
    free = _free(classes, None if aside is None else aside[cloud.rows])
    labels = _labelled_ground(points, cloud, free, config, scan)
    spacing = None
    if point_spacing is not None:
        spacing = max(given_or_measured(points, point_spacing), CANDIDATE_SPACING)
    terrain, cut_off = _terrain(cloud, free if labels is None else labels, spacing, config)
    elevation, slope = terrain.elevation_and_slope(cloud.points)
    height = np.subtract(cloud.points[:, 2], elevation, out=elevation)
    ground = near_terrain(height, slope, config) if labels is None else labels
    classes[classes == 0] = PointClass.UNCLASSIFIED
    classes[ground & free] = PointClass.GROUND
    return GroundResult(in_rows_order(cloud, classes), in_rows_order(cloud, height), cut_off)


def _free(noise: NDArray[np.uint8], aside: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Return which points may be ground: no gross errors, nor set aside unless nothing else is left."""
    free = noise == 0
    if aside is not None and (free & ~aside).any():
        free &= ~aside
    return free


def _labelled_ground(
    points: NDArray[np.float64],
    cloud: CellGrid,
    free: NDArray[np.bool_],
    config: GroundFilterConfig,
    scan: dict[str, NDArray[Any] | None],
) -> NDArray[np.bool_] | None:
    """
    Return which of the sorted points are ground; None where the method has a terrain instead of labels.

    The method sees the free points in the order given.
    """
    if config.method in ("consensus", *DENSIFIED):
        return None
    in_order = in_rows_order(cloud, free)
    rows = np.flatnonzero(in_order)
    if config.method == "morphological":
        found = morphological.label_ground(points[rows], config)
    else:
        known = {name: None if column is None else column[rows] for name, column in scan.items()}
        along_scan = slope_pairs if config.method == "slope_pairs" else bidirectional_slope
        found = along_scan.label_ground(points[rows], config, **known)
    in_order[rows] = found
    return in_order[cloud.rows]


def _terrain(
    cloud: CellGrid, ground: NDArray[np.bool_], spacing: float | None, config: GroundFilterConfig
) -> tuple[Tin, NDArray[np.float64]]:
    """
    Return the terrain over the extent of all points, and the extents of wide roofs that it may hold.

    It is densified, or the TIN of what a method found ground. Only the lowest point a cell takes part, which
    are `spacing` apart if that is known. Where a method found no ground at all, it is the lowest surface.
    """
    extent = extent_of(cloud.points)[:, :2]
    candidates = cloud.points[lowest_of_cells(cloud, ground if ground.any() else np.ones_like(ground))]
    spacing = given_or_measured(candidates, spacing)
    if config.method == "histogram_tin":
        return histogram_tin.densify(candidates, extent, config), NO_EXTENTS
    if config.method == "progressive_tin":
        return densify(candidates, extent, spacing, config), NO_EXTENTS
    if config.method != "consensus":
        return build_tin(candidates, extent), NO_EXTENTS
    agreed, cut_off = agreed_ground(candidates, extent, spacing, config)
    return build_tin(candidates[agreed], extent), cut_off
