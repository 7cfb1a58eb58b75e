"""The roof of each point of a reference: a polygon, or a connected part of the cloud."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.stages.footprints.footprints import last_polygon_around
from lidar_buildings.core.surfaces.surface_patches import connected_parts

#: Smaller parts of a reference's class are noise, not roofs: as small as a run drops them [m²].
MIN_ROOF_AREA = 6.0
#: What a point of no roof has in place of a number.
NO_ROOF = -1


def fewest_points(spacing: float) -> int:
    """Return how many points of this spacing [m] the smallest roof has."""
    return math.ceil(MIN_ROOF_AREA / spacing**2)


def roofs_of_polygons(points: ArrayLike, polygons: ArrayLike) -> NDArray[np.int64]:
    """
    Return the row of the polygon that each point lies in or on, of several the first; −1 for none.

    There is one geometry a roof or block; invalid ones are repaired.
    """
    valid = shapely.make_valid(np.atleast_1d(np.asarray(polygons, dtype=object)))
    # From the last to the first, so that the first one stays.
    found = last_polygon_around(np.asarray(points, dtype=np.float64)[:, :2], valid[::-1])
    return np.where(found >= 0, len(valid) - 1 - found.astype(np.int64), NO_ROOF)


def roofs_of_points(points: ArrayLike, gap: float, *, min_points: int = 1) -> NDArray[np.int64]:
    """
    Number the parts of a cloud that are connected in plan, from west to east; −1 for too small ones.

    Points no further apart than `gap` belong together. Numbers follow the parts' westernmost points, of as
    western ones the southernmost.
    """
    cloud = checked_points(points)
    part = connected_parts(cloud, gap, in_plan=True)
    is_small = np.bincount(part, minlength=1)[part] < min_points if len(part) else np.zeros(0, dtype=bool)
    return _from_the_west(cloud, np.where(is_small, NO_ROOF, part))


def split_at_steps(
    points: ArrayLike, roof: ArrayLike, gap: float, *, min_points: int = 1
) -> NDArray[np.int64]:
    """
    Split each roof into parts between which the surface steps, so that a step is an edge of the upper part.

    Points no further apart than `gap` in space belong together. Smaller parts than `min_points` (chimneys,
    dormers, noise) stay with the nearest larger part of their roof in plan; a roof without a larger one stays
    whole.
    """
    cloud = checked_points(points)
    given = checked_column("roof", roof, len(cloud), np.int64)
    found = np.full(len(cloud), NO_ROOF, dtype=np.int64)
    n_parts = 0
    for rows in roof_rows(given):
        part = _merged_into_large(cloud[rows], connected_parts(cloud[rows], gap), min_points)
        found[rows] = n_parts + part
        n_parts += int(part.max()) + 1
    return _from_the_west(cloud, found)


def roof_rows(roof: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the rows of each roof's points, by rising number; those of negative numbers are left out."""
    order = np.argsort(roof, kind="stable").astype(np.int64)
    order = order[np.searchsorted(roof[order], 0) :]
    starts = np.flatnonzero(np.diff(roof[order])) + 1
    return [rows for rows in np.split(order, starts) if len(rows)]


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


def _from_the_west(points: NDArray[np.float64], label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number labels anew by their westernmost points, then by y, then z; negative ones become −1."""
    order = np.lexsort(points.T[::-1])
    order = order[label[order] >= 0]
    labels, first = np.unique(label[order], return_index=True)
    number = np.full(int(label.max(initial=-1)) + 2, NO_ROOF, dtype=np.int64)
    number[labels] = np.argsort(np.argsort(first))
    # The last entry is that of the negative ones.
    return number[np.maximum(label, -1)]
