"""The outline as an alpha shape whose radius follows the local spacing of the points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError, cKDTree

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, signed_area
from lidar_buildings.core.neighbours.point_spacing import NEIGHBOURS
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.rings import characteristic_ring

#: By how much radii grow where the shape falls apart, and rounds of growth before another method takes over:
#: wide margin, radii may grow 7000 times.
_GROWTH, _MAX_ROUNDS = 1.25, 40
NO_SHAPE = "the alpha shape does not hold together: the ring comes from a triangulation"
FILLED = "empty places smaller than min_courtyard_area are taken for roof"


def alpha_rings(positions: FloatArray, config: BoundaryTracingConfig) -> tuple[Outline, str]:
    """
    Return the ring and the courtyards of distinct positions, not all on a line, and what was out of the way.

    Triangles of the Delaunay triangulation stay whose circumscribed circle is no larger than `alpha` times
    the spacing of the points about them (dos Santos, Galo & Carrilho 2019, after Edelsbrunner et al. 1983).
    All points have to be on one ring or inside: where points are left out, parts hang apart, or together by
    one point only, the radius grows round about until they do not.
    """
    positions = positions[np.lexsort(positions.T[::-1])]
    try:
        mesh = Delaunay(positions - positions.mean(axis=0))
    except QhullError:  # points too close to be told apart
        mesh = None
    kept = None if mesh is None else _kept_triangles(mesh, config.alpha * local_spacings(positions))
    if mesh is None or kept is None:
        return Outline(positions[characteristic_ring(positions, np.inf)]).oriented(), NO_SHAPE
    rings = [positions[rows] for rows in _rings_round(mesh, kept)]
    areas = np.array([signed_area(ring) for ring in rings])
    is_yard = (areas < 0.0) & (areas <= -config.min_courtyard_area) & config.courtyards
    exterior, *holes = (
        np.roll(ring, -np.lexsort(ring.T[::-1])[0], axis=0)
        for ring in (rings[int(areas.argmax())], *(rings[i] for i in np.flatnonzero(is_yard)))
    )
    return Outline(exterior, tuple(holes)), FILLED if (areas < 0.0).sum() > len(holes) else ""


def local_spacings(positions: FloatArray) -> FloatArray:
    """Return the spacing about each position [m]: 1/√density of the disc to its 16th neighbour."""
    k = min(NEIGHBOURS, len(positions) - 1)
    distance = cKDTree(positions).query(positions, [k + 1])[0].ravel()
    return np.asarray(distance * np.sqrt(np.pi / (k + 1 / 3)))


def circumradii(corners: FloatArray) -> FloatArray:
    """Return the radii of the circles through triangles' corners, shape (n_triangles, 3, 2)."""
    a, b, c = (np.hypot(*(corners[:, i] - corners[:, j]).T) for i, j in ((1, 2), (2, 0), (0, 1)))
    (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    with np.errstate(divide="ignore"):
        return np.asarray(a * b * c / (2.0 * np.abs(ux * vy - uy * vx)))


def _kept_triangles(mesh: Delaunay, alpha: FloatArray) -> BoolArray | None:
    """Return the triangles of the shape; None if no radius makes it one."""
    corners = mesh.simplices
    radius, base = circumradii(mesh.points[corners]), alpha[corners].mean(axis=1)
    growth = np.ones(len(alpha))
    for _ in range(_MAX_ROUNDS):
        kept = radius <= base * growth[corners].max(axis=1)
        loose = _loose_points(mesh, kept)
        if not loose.any():
            return kept
        growth[loose] *= _GROWTH
    return None


def _loose_points(mesh: Delaunay, kept: BoolArray) -> BoolArray:
    """Return which points are in no triangle, apart from the largest part, or where two parts only touch."""
    n = len(mesh.points)
    if not kept.any():
        return np.ones(n, dtype=np.bool_)
    is_inner = (mesh.neighbors >= 0) & kept[mesh.neighbors] & kept[:, None]
    one = np.nonzero(is_inner)[0]
    links = coo_array((np.ones(len(one)), (one, mesh.neighbors[is_inner])), shape=(len(kept), len(kept)))
    part = connected_components(links, directed=False)[1]
    main = kept & (part == np.bincount(part[kept]).argmax())
    is_loose = np.ones(n, dtype=np.bool_)
    is_loose[mesh.simplices[main]] = False
    is_loose[mesh.coplanar[:, 0]] = False  # so near another one that it is no corner
    starts = _boundary(mesh, kept)[0]
    return np.asarray(is_loose | (np.bincount(starts, minlength=n) > 1))


def _boundary(mesh: Delaunay, kept: BoolArray) -> tuple[IntArray, IntArray]:
    """Return start and end of each edge between the shape, on its left, and what is outside."""
    triangle, corner = np.nonzero(kept[:, None] & ~((mesh.neighbors >= 0) & kept[mesh.neighbors]))
    corners = mesh.simplices[triangle]
    rows = np.arange(len(corners))
    return corners[rows, (corner + 1) % 3].astype(np.int64), corners[rows, (corner + 2) % 3].astype(np.int64)


def _rings_round(mesh: Delaunay, kept: BoolArray) -> list[NDArray[np.int64]]:
    """Return the rings of the boundary, none of which meets another: the outer one runs counter-clockwise."""
    follower = dict(zip(*(ends.tolist() for ends in _boundary(mesh, kept)), strict=True))
    rings = []
    while follower:
        start, following = follower.popitem()
        ring = [start]
        while following != start:
            ring.append(following)
            following = follower.pop(following)
        rings.append(np.array(ring))
    return rings
