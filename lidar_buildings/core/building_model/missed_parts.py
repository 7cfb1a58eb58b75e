"""
Parts of a roof that got the plane of their neighbour because no line parted them.

"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lidar_buildings.core.outline import Outline

#: A point so far off the face it lies in was missed [m].
_MISSED = 0.2
#: Missed points of one plane nearer than this belong together [spacings].
_TOGETHER = 2.0
#: Points lie inside their part by about so much [spacings].
_MARGIN = 0.4


def borders_of_missed_parts(
    points: NDArray[np.float64],
    plane_id: NDArray[np.uint16],
    misfit: NDArray[np.float64],
    outline: Outline,
    spacing: float,
    min_area: float,
) -> NDArray[np.float64]:
    """
    Return the sides of rectangles round the parts that a partition missed.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Roof points [m].
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.
    misfit : ndarray of shape (n_points,)
        Distance from each point to the face it lies in [m].
    outline : Outline
        Its longest walls give the rectangles' directions.
    spacing : float
        Point spacing [m].
    min_area : float
        Smallest part, as the area that its points stand for [m²].

    Returns
    -------
    ndarray of shape (n_sides, 2, 2)
        Ends in plan [m].

    """
    missed = np.flatnonzero((misfit > _MISSED) & (plane_id > 0))
    fewest = max(3, int(np.ceil(min_area / spacing**2)))
    if len(missed) < fewest:
        return np.zeros((0, 2, 2))
    part = _parts(points[missed, :2], plane_id[missed], _TOGETHER * spacing)
    directions = _directions(outline)
    sides = [
        _rectangle(points[missed[part == number], :2], directions, _MARGIN * spacing)
        for number in np.flatnonzero(np.bincount(part) >= fewest)
    ]
    return np.concatenate([np.zeros((0, 2, 2)), *sides])


def _parts(xy: NDArray[np.float64], plane_id: NDArray[np.uint16], reach: float) -> NDArray[np.int64]:
    """
    Number the connected groups of points of one plane from 0.

    """
    one, other = cKDTree(xy).query_pairs(reach, output_type="ndarray").T
    same = plane_id[one] == plane_id[other]
    links = coo_matrix((np.ones(same.sum()), (one[same], other[same])), shape=(len(xy), len(xy)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _directions(outline: Outline) -> NDArray[np.float64]:
    """
    Return unit vectors along the longest walls, at most three that differ by more than 10 degrees mod 90.

    """
    walls = np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in outline.rings])
    length = np.hypot(*walls.T)
    chosen: list[float] = []
    for row in np.argsort(-length, kind="stable"):
        angle = float(np.arctan2(walls[row, 1], walls[row, 0]) % (np.pi / 2))
        if all(abs((angle - other + np.pi / 4) % (np.pi / 2) - np.pi / 4) > np.pi / 18 for other in chosen):
            chosen.append(angle)
        if len(chosen) == 3:
            break
    return np.column_stack([np.cos(chosen), np.sin(chosen)])


def _rectangle(
    xy: NDArray[np.float64], directions: NDArray[np.float64], margin: float
) -> NDArray[np.float64]:
    """
    Return the four sides, shape (4, 2, 2), of the smallest rectangle in one of the directions.

    """
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(xy)))
    best = None
    for u in directions:
        v = np.array([-u[1], u[0]])
        a, b = hull @ u, hull @ v
        low, high = np.array([a.min(), b.min()]) - margin, np.array([a.max(), b.max()]) + margin
        area = float(np.prod(high - low))
        if best is None or area < best[0]:
            frame = np.array([u, v])
            corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]]) @ frame
            best = area, np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return np.zeros((0, 2, 2)) if best is None else best[1]
