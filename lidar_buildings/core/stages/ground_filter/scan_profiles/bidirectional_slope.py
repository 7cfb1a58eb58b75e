"""
Ground by slopes along profiles, forth and back (Shan & Sampath 2005), with profiles across where wanted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.ground_filter.config import CANDIDATE_SPACING, GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_labelling import net_votes
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_refinement import reject_outliers
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_regression import (
    TOLERANCE_SLOPE,
    grow_ground,
)
from lidar_buildings.core.stages.ground_filter.scan_profiles.profile_trend import Trend, fit_trend
from lidar_buildings.core.stages.ground_filter.scan_profiles.profiles import Profiles, cut_profiles
from lidar_buildings.core.stages.ground_filter.scan_profiles.scan_lines import find_scan_lines

# Chosen with `bench.ground.isprs`.
#: Width of the strips that are cut as profiles [multiples of the spacing].
WIDTH = 1.7
#: By how much more passes have to call a point ground than object, as a share of all.
AGREEMENT = 0.1
#: Cells with no more points keep all of them; of the others the lowest is looked at first.
SPARSE = 3
#: Distance over which the terrain is smoothed before its slope is taken off [m]; passes err less on what is
#: left: so much less agreement is asked of them.
TREND_RADIUS, LESS_ON_TREND = 20.0, 0.1
#: Where the trend of all points is steeper than this share of `profile_max_slope`, the first passes look at
#: heights above it: uphill every one leaves the ground otherwise.
STEEP_SHARE = 0.5
#: Radius of the planes that say how the terrain runs within a cell [multiples of the spacing].
LOCAL_RADIUS = 3.0


def label_ground(
    points: NDArray[np.float64], config: GroundFilterConfig, **scan: NDArray[Any] | None
) -> NDArray[np.bool_]:
    """
    Tell which points are ground by walking along profiles in both directions.

    Where a profile rises by a step it leaves the ground, and is back on it where it has come down to the
    elevation it left (Shan & Sampath 2005). Profiles are the scan lines, where the cloud has any, and strips
    cut in `profile_directions` directions; passes in all directions vote. Ground is then grown along the
    profiles by local regression, the slope of the terrain taken off, and all repeated.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Without gross errors [m].
    config : GroundFilterConfig
        The members that begin with `profile_`.
    **scan : ndarray of shape (n_points,), optional
        What tells scan lines apart, see `find_scan_lines`.

    Returns
    -------
    ndarray of shape (n_points,), bool

    Notes
    -----
    O(n log n): some 3 M points/s on two cores in dense clouds, where only the lowest points of cells are
    walked over; 0.5 M points/s where all are.
    """
    if len(points) == 0:
        return np.zeros(0, dtype=np.bool_)
    cells = sort_by_cell(points, CANDIDATE_SPACING)
    kept = _kept_of_cells(cells.first)
    chosen = cells.rows[kept]
    spacing = quantised_spacing(points[chosen])
    lines = find_scan_lines(points, spacing, **scan)
    candidates = cells.points[kept]
    profiles = _strips(candidates, spacing, config.profile_directions)
    if lines is not None:
        profiles.append(lines.profiles(points, chosen))
    ground = _label_candidates(candidates, profiles, spacing, config)
    planes = fit_trend(candidates, ground, LOCAL_RADIUS * spacing, cells_per_radius=2.0, far=False)
    return _label_all(cells, kept[ground], planes, config)


def label_candidates(
    candidates: NDArray[np.float64], spacing: float, config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """Tell which points, at most one a cell and without gross errors, are ground, by strips alone."""
    profiles = _strips(candidates, spacing, config.profile_directions)
    return _label_candidates(candidates, profiles, spacing, config)


def _strips(candidates: NDArray[np.float64], spacing: float, n_directions: int) -> list[Profiles]:
    return [cut_profiles(candidates, WIDTH * spacing, 180.0 * k / n_directions) for k in range(n_directions)]


def _label_candidates(
    points: NDArray[np.float64], profiles: list[Profiles], spacing: float, config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """Vote and grow; once more on heights above the trend that was found; then reject."""
    z = points[:, 2]
    net = net_votes(profiles, z, config)
    trend = fit_trend(points, np.ones(len(z), dtype=bool), TREND_RADIUS)
    is_steep = np.hypot(*trend.gradient_at(points).T) > STEEP_SHARE * config.profile_max_slope
    if is_steep.any():
        net[is_steep] = net_votes(profiles, z - trend.elevation_at(points), config)[is_steep]
    ground = grow_ground(profiles, z, net > AGREEMENT, spacing)
    if ground.any():
        height = z - fit_trend(points, ground, TREND_RADIUS).elevation_at(points)
        ground = net_votes(profiles, height, config) > AGREEMENT - LESS_ON_TREND
        ground = grow_ground(profiles, z, ground, spacing)
    return reject_outliers(profiles, z, ground, spacing, config)


def _label_all(
    cells: CellGrid, chosen: NDArray[np.intp], planes: Trend, config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """
    Label the points of crowded cells: those no further above their lowest, if ground, than the terrain rises.

    `chosen` are the candidates that are ground, among the sorted points; labels are by input row.
    """
    ground = np.zeros(len(cells.rows), dtype=np.bool_)
    ground[chosen] = True
    lowest = cells.points[cells.first[:-1]]
    gradient = planes.gradient_at(lowest)
    limits = (config.profile_step, TOLERANCE_SLOPE)
    for_row_blocks(
        lambda a, b: _near_lowest(cells.points, cells.first, gradient, limits, ground, a, b), len(lowest)
    )
    labels = np.empty(len(ground), dtype=np.bool_)
    labels[cells.rows] = ground
    return labels


@kernel
def _kept_of_cells(first):  # type: ignore[no-untyped-def]
    kept = np.empty(first[-1], dtype=np.intp)
    n = 0
    for k in range(len(first) - 1):
        last = first[k + 1] if first[k + 1] - first[k] <= SPARSE else first[k] + 1
        for i in range(first[k], last):
            kept[n] = i
            n += 1
    return kept[:n].copy()


@kernel
def _near_lowest(points, first, gradient, limits, ground, begin, end):  # type: ignore[no-untyped-def]
    """Compare the points of crowded cells with their lowest, carried on along the terrain's gradient."""
    for k in range(begin, end):
        low = first[k]
        if first[k + 1] - low <= SPARSE or not ground[low]:
            continue
        gx, gy = gradient[k, 0], gradient[k, 1]
        margin = limits[0] + limits[1] * (abs(gx) + abs(gy))
        for i in range(low + 1, first[k + 1]):
            slope = gx * (points[i, 0] - points[low, 0]) + gy * (points[i, 1] - points[low, 1])
            ground[i] = points[i, 2] - points[low, 2] - slope <= margin
