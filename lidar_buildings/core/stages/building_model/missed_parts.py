"""Parts of a roof that got the plane of their neighbour because no line parted them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.surfaces.percentiles import middle_of

#: A point so far off the face it lies in was missed [m].
_MISSED = 0.2
#: A point without plane so far above its face belongs to something that stands on the roof [m], and the
#: middle part of its points spreads over no more than this [m].
_STANDS_OUT, _MAX_SPREAD = 0.3, 0.6
#: Missed points of one plane nearer than this belong together [spacings].
_TOGETHER = 2.0
#: Points lie inside their part by about so much, and a part is a border in the wrong place where they spread
#: less than that across [spacings].
_MARGIN, _NARROWEST = 0.4, 1.5


@dataclass(frozen=True, eq=False)
class MissedParts:
    """
    What a second look at a roof adds.

    Attributes
    ----------
    sides : ndarray of shape (n_sides, 2, 2)
        Sides of rectangles round the missed parts, their ends in plan [m].
    planes : ndarray of shape (n_planes, 3)
        z = a·x + b·y + c of the tops of those that had no plane: chimneys and the like.
    """

    sides: FloatArray
    planes: FloatArray


def find_missed_parts(
    points: FloatArray,
    plane_id: NDArray[np.uint16],
    above: FloatArray,
    outline: Outline,
    spacing: float,
    min_area: float,
) -> MissedParts:
    """
    Find the parts of a roof that a partition missed.

    Points of a plane that lie in the face of another one make a part; so do points without plane that
    stand above their face at one level, such as those of a chimney. Points at all levels, as of a tree, do
    not, nor does a single row along a border, which lies a little beside its place.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    above : ndarray of shape (n_points,)
        Height of each point above the face it lies in [m].
    outline : Outline
        Its longest walls give the rectangles' directions.
    spacing : float
        Point spacing [m].
    min_area : float
        Smallest part, as the area that its points stand for [m²].
    """
    fewest = max(3, int(np.ceil(min_area / spacing**2)))
    planar = np.flatnonzero((np.abs(above) > _MISSED) & (plane_id > 0))
    unassigned = np.flatnonzero((above > _STANDS_OUT) & (plane_id == 0))
    parts = [
        planar[rows] for rows in _parts(points[planar, :2], plane_id[planar], _TOGETHER * spacing, fewest)
    ]
    level = np.zeros(len(unassigned), dtype=np.uint16)
    tops = [unassigned[rows] for rows in _parts(points[unassigned, :2], level, _TOGETHER * spacing, fewest)]
    heights = [np.sort(points[rows, 2]) for rows in tops]
    level_tops = [(rows, z) for rows, z in zip(tops, heights, strict=True) if _is_level(z)]
    tops = [rows for rows, _ in level_tops]
    if not parts and not tops:
        return MissedParts(np.zeros((0, 2, 2)), np.zeros((0, 3)))
    planes = np.zeros((len(tops), 3))
    planes[:, 2] = [0.5 * (z[(len(z) - 1) // 2] + z[len(z) // 2]) for _, z in level_tops]
    sides, width = _rectangles(parts + tops, points, _directions(outline), _MARGIN * spacing)
    is_wide = width >= _NARROWEST * spacing
    return MissedParts(sides[is_wide].reshape(-1, 2, 2), planes[is_wide[len(parts) :]])


def _is_level(z: FloatArray) -> bool:
    """Whether most points of a part, sorted, are at one level."""
    low, high = middle_of(z, 0.2)
    return high - low <= _MAX_SPREAD


def _parts(xy: FloatArray, plane_id: NDArray[np.uint16], reach: float, fewest: int) -> list[IntArray]:
    """Return the rows of connected groups of at least so many points of one plane."""
    if len(xy) < fewest:
        return []
    one, other = (
        cKDTree(xy, balanced_tree=False, compact_nodes=False).query_pairs(reach, output_type="ndarray").T
    )
    same = plane_id[one] == plane_id[other]
    part = sets_of_pairs(len(xy), one[same], other[same])
    order, count = np.argsort(part, kind="stable"), np.bincount(part)
    ends = np.cumsum(count)
    return [order[ends[k] - count[k] : ends[k]] for k in np.flatnonzero(count >= fewest)]


def _directions(outline: Outline) -> FloatArray:
    """
    Return unit vectors along the longest walls, at most three that differ by more than 10 degrees mod 90.
    """
    ends = ring_walls(outline.rings)
    walls = ends[:, 1] - ends[:, 0]
    length = np.hypot(*walls.T)
    angles = np.arctan2(walls[:, 1], walls[:, 0]) % (np.pi / 2)
    angles = angles[np.argsort(-length, kind="stable")]
    chosen: list[float] = []
    while len(angles) and len(chosen) < 3:
        chosen.append(angles[0])
        angles = angles[np.abs((angles - angles[0] + np.pi / 4) % (np.pi / 2) - np.pi / 4) > np.pi / 18]
    return np.column_stack([np.cos(chosen), np.sin(chosen)])


def _rectangles(
    parts: list[IntArray], points: FloatArray, directions: FloatArray, margin: float
) -> tuple[FloatArray, FloatArray]:
    """
    Return the smallest rectangle round each part in one of the directions, and how far points spread across.

    The rectangles have four sides each, shape (n_parts, 4, 2, 2) [m].
    """
    rows, begin = np.concatenate(parts), np.cumsum([0, *map(len, parts)])[:-1]
    # Along each direction and across it.
    axes = np.stack([directions, directions[:, ::-1] * [-1.0, 1.0]], axis=1)
    along = np.einsum("nx,dax->nda", points[rows, :2], axes)
    low = np.minimum.reduceat(along, begin) - margin
    high = np.maximum.reduceat(along, begin) + margin
    best = np.argmin(np.prod(high - low, axis=2), axis=1)
    each = np.arange(len(parts))
    low, high, frame = low[each, best], high[each, best], axes[best]
    corners = np.stack([low, np.column_stack([high[:, 0], low[:, 1]]), high], axis=1)
    corners = np.concatenate([corners, np.column_stack([low[:, 0], high[:, 1]])[:, None]], axis=1) @ frame
    width = np.min(high - low, axis=1) - 2.0 * margin
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), width
