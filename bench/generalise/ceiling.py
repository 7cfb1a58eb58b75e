"""
What wireframes that people drew become if the points have their say: how near to them a model can come.

What was drawn may follow footprints, not eaves. Each drawn face gets the plane of its points; its outer edges
keep their directions and move to where these points end; corners are the least-squares intersections of the
planes and edges that they lie on (Förstner and Wrobel 2016, 10.5). How many there are, and what they join,
stays as drawn.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from bench.generalise.corners import DrawnRoof
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.surfaces.roof_planes import RoofPlane, fitted_planes
from lidar_buildings.evaluation.scores.models import Wireframe

#: What may move: corners amid faces; the others along z alone, too; all.
INNER, HEIGHTS, ALL = MOVES = ("inner corners", "all heights", "all")
#: Standard deviations of a plane along z, an outer edge across, and of what was drawn [m].
_PLANE, _EDGE, _DRAWN = 0.02, 0.05, 0.5
#: Points of a face lie so near what was drawn; beside another face so near its plane [m].
_NEAR, _ON_PLANE = 0.5, 0.15
#: Another face is beside an edge if it is there at this distance [m].
_BESIDE = 0.4
#: Fits, and points that a plane takes at least.
_ROUNDS, _LEAST_POINTS = 6, 10
#: Points are looked for so far outside and inside an edge [m]; it is cut at its ends by this share.
_OUTSIDE, _INSIDE, _ENDS = 1.2, 2.0, 0.15
#: An edge moves only if so many rows of points end at it.
_LEAST_ROWS = 4


def adjusted(roof: DrawnRoof, moves: str = ALL) -> Wireframe:
    """Return what was drawn, adjusted to the roof's points; `moves` is one of `MOVES`."""
    corners = roof.drawn.corners
    faces = list(_faces(roof.drawn))
    areas = np.array([shapely.polygons(corners[face, :2]) for face in faces])
    sides = Counter(frozenset(side) for face in faces for side in _sides(face))
    conditions: list[tuple[int, list[float], float]] = []  # corner, (nx, ny, nz, offset), σ
    is_outer = np.zeros(len(corners), dtype=bool)
    for face in faces:
        plane = _plane(corners[face], roof.points)
        if plane is None:
            continue
        a, b, c = plane.equation
        away = np.abs(roof.points[:, 2] - plane.elevation(roof.points[:, :2]))
        others = areas[[other is not face for other in faces]]
        conditions += [(k, [-a, -b, 1.0, c], _PLANE) for k in face]
        outer = [side for side in _sides(face) if sides[frozenset(side)] == 1]
        is_outer[np.array(outer, dtype=int).reshape(-1)] = True
        for i, j in outer:
            own = away < (_ON_PLANE if _has_beside(corners[[i, j], :2], others) else _NEAR)
            if (line := _moved_edge(corners[[i, j], :2], roof.points[own, :2])) is not None:
                conditions += [(k, line, _EDGE) for k in (i, j)]
    found = corners.copy()
    for k in range(len(corners)):
        own = [(row, sigma) for of, row, sigma in conditions if of == k and (moves == ALL or row[2])]
        loose = np.full(3, _DRAWN)
        if is_outer[k] and moves != ALL:
            loose[: 2 if moves == HEIGHTS else 3] = 1e-6
        information = np.diag(loose**-2)
        right = information @ corners[k]
        for row, sigma in own:
            normal = np.array(row[:3]) / sigma
            information += np.outer(normal, normal)
            right += normal * row[3] / sigma
        found[k] = np.linalg.solve(information, right)
    return replace(roof.drawn, corners=found)


def _faces(drawn: Wireframe) -> Iterator[list[int]]:
    """Yield the rings of corners of faces, seen from above to the left of their edges."""
    group = sets_of_pairs(len(drawn.corners), drawn.edges[:, 0], drawn.edges[:, 1])
    of_edge = group[drawn.edges[:, 0]]
    for number in np.unique(of_edge):
        edges = drawn.edges[of_edge == number]
        name = {tuple(drawn.corners[k, :2]): int(k) for k in np.unique(edges)}
        lines = shapely.linestrings(drawn.corners[edges][:, :, :2])
        for polygon in shapely.polygonize(lines).geoms:
            ring = shapely.get_coordinates(orient(polygon).exterior)[:-1]
            yield [name[tuple(place)] for place in ring]


def _sides(face: list[int]) -> list[tuple[int, int]]:
    return list(itertools.pairwise([*face, face[0]]))


def _has_beside(ends: NDArray[np.float64], others: NDArray[np.object_]) -> bool:
    """Return whether another face lies to the right of an edge."""
    along = ends[1] - ends[0]
    probe = ends.mean(axis=0) + np.array([along[1], -along[0]]) / np.hypot(*along) * _BESIDE
    return bool(shapely.contains_xy(others, *probe).any())


def _plane(ring: NDArray[np.float64], points: NDArray[np.float64]) -> RoofPlane | None:
    """Return the plane of the points within a ring, None if they are too few."""
    inside = points[shapely.contains_xy(shapely.polygons(ring[:, :2]), points[:, :2])]
    (plane,) = fitted_planes(ring, np.ones(len(ring), dtype=np.uint16))
    away, near = inside[:, 2] - plane.elevation(inside[:, :2]), _NEAR
    for _ in range(_ROUNDS):
        own = (np.abs(away) < near).astype(np.uint16)
        if np.count_nonzero(own) < _LEAST_POINTS:
            return None
        (plane,) = fitted_planes(inside, own)
        away = (inside[:, 2] - plane.elevation(inside[:, :2])) * plane.normal[2]
        near = max(3.0 * 1.4826 * float(np.median(np.abs(away[own > 0]))), 0.05)
    return plane


def _moved_edge(ends: NDArray[np.float64], points: NDArray[np.float64]) -> list[float] | None:
    """
    Return the line (nx, ny, 0, offset) parallel to a drawn edge where rows of points end, None if none do.

    Beyond the last points lies, in the median, what lies between any other such line and the points next to
    it: that is what sampling hides.
    """
    along = ends[1] - ends[0]
    length = float(np.hypot(*along))
    inward = np.array([-along[1], along[0]]) / length
    place, depth = (points - ends[0]) @ along / length**2, (points - ends[0]) @ inward
    near = (np.abs(place - 0.5) < 0.5 - _ENDS) & (depth > -_OUTSIDE) & (depth < _INSIDE)
    n_inside = np.count_nonzero(near & (depth > 0.0))
    if not n_inside:
        return None
    spacing = np.sqrt(length * (1.0 - 2.0 * _ENDS) * _INSIDE / n_inside)
    n_rows = int(length * (1.0 - 2.0 * _ENDS) / spacing)
    if n_rows < _LEAST_ROWS:
        return None
    depth, row = depth[near], ((place[near] - _ENDS) / (1.0 - 2.0 * _ENDS) * n_rows).astype(int)
    # Outwards from within, as far as there are points in more than a quarter of the rows.
    step = np.arange(_INSIDE / 2.0, -_OUTSIDE - 2.0 * spacing, -spacing)
    is_seen = [len(np.unique(row[np.abs(depth - k - spacing) < spacing])) > n_rows / 4 for k in step]
    if False not in is_seen[1:] or not is_seen[0]:
        return None
    start = step[is_seen.index(False)]
    last = _gaps(row, depth, n_rows, start)
    end = start + np.median(last)
    hidden = np.concatenate([_gaps(row, depth, n_rows, end + k * spacing) for k in (0.5, 1.0, 1.5, 2.0)])
    offset = end - (np.median(hidden) if len(hidden) else 0.0)
    return [*inward.tolist(), 0.0, float(inward @ ends[0] + offset)]


def _gaps(
    row: NDArray[np.int64], depth: NDArray[np.float64], n_rows: int, start: float
) -> NDArray[np.float64]:
    """Return how far behind `start` the next point of each row lies, of those that have one [m]."""
    gaps = np.full(n_rows, np.inf)
    behind = depth > start
    np.minimum.at(gaps, row[behind], depth[behind] - start)
    return gaps[np.isfinite(gaps)]
