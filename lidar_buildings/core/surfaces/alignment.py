"""Clouds of one place brought together: what was seen from the street, moved to what was seen from above."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell

_Floats = NDArray[np.float64]

#: Side of the cells in which heights of the ground are compared, and the fewest that tell them [m].
GROUND_CELL, MIN_GROUND = 1.0, 100
#: Side of the voxels of which one point each is kept [m]; they grow until so many are left.
_VOXEL, _GROWTH, _MOST_POINTS = 0.15, 1.3, 120_000
#: Neighbours that a plane goes through, how far they lie from it at most (RMS) [m], and the least part of the
#: greater of their other two variances that the lesser is.
N_NEAR, _MAX_ROUGH, _MIN_WIDE = 12, 0.05, 0.05
#: Vertical part of the normals of walls at most, and of ground and roofs at least.
_WALL, _LEVEL = 0.2, 0.8
#: So far from the top and the foot of what a place holds points are of its walls [m].
_FREE = 0.7
#: Points of either kind that are compared at most.
_MOST_COMPARED = 20_000
#: Distances within which points are compared with planes, round by round [m].
_REACHES = (3.0, 3.0, 2.0, 2.0, 1.5, 1.0, 1.0, 0.7, 0.5, 0.5, 0.35, 0.35, 0.3, 0.3)
#: Residuals beyond so many robust standard deviations do not count (Tukey's biweight), and the least one [m].
_TUKEY, _LEAST_SIGMA = 4.7, 0.02
#: Standard error up to which the plan counts as told [m], and the fewest points on walls that tell it.
_MAX_ERROR, _MIN_WALLS = 0.1, 60


class Alignment(NamedTuple):
    """How a cloud is moved: turned about the vertical through its pivot, then shifted."""

    pivot: _Floats  #: [m], shape (2,)
    yaw: float  #: counter-clockwise [rad]
    shift: _Floats  #: [m], shape (3,)
    #: Standard error of the shift in plan [m]; infinite where nothing tells it, which then is 0, as is `yaw`.
    plan_error: float
    #: Points that count and the RMS of their distances from the planes of the other cloud [m]: on ground and
    #: roofs, on walls.
    n_ground: int
    rms_ground: float
    n_walls: int
    rms_walls: float

    def moved(self, points: _Floats) -> _Floats:
        """Return points, shape (n, 3), where they are after that [m]."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        plan = (points[:, :2] - self.pivot) @ turn + self.pivot
        return np.column_stack([plan, points[:, 2]]) + self.shift


def height_offset(street: _Floats, above: _Floats) -> tuple[float, float, int]:
    """
    Return by how much the ground from above lies higher, how that scatters [m], and in how many cells.

    Clouds have shape (n, 3) [m]. Both numbers are medians: of the differences of the lowest points of cells,
    and of how far these are from it.
    """
    lows = []
    for points in (street, above):
        low = points.take(lowest_per_cell(points, GROUND_CELL), axis=0)
        lows.append((np.floor(low[:, :2] / GROUND_CELL).astype(np.int64) @ np.array([2**31, 1]), low[:, 2]))
    (one, z_one), (other, z_other) = lows
    _, own, others = np.intersect1d(one, other, return_indices=True)
    if not len(own):
        return 0.0, math.inf, 0
    difference = z_other[others] - z_one[own]
    middle = float(np.median(difference))
    return middle, float(np.median(np.abs(difference - middle))), len(own)


def align(street: _Floats, above: _Floats) -> Alignment | None:
    """
    Move a cloud from the street, shape (n, 3), to one from above, (m, 3) [m]; None if they share no ground.

    First their grounds are laid on each other; then the distances of points from above to the planes that the
    street shows are made small (point to plane, Chen & Medioni 1992; residuals weighed by Tukey's biweight):
    ground and roofs tell the height, points between the tops and the feet of walls the plan. Where these are
    too few the plan stays as it is.
    """
    rise, _, n_cells = height_offset(street, above)
    if n_cells < MIN_GROUND:
        return None
    places, normals = planes_at(thinned(street))
    pivot = np.median(places[:, :2], axis=0)
    steepness = np.abs(normals[:, 2])
    walls, level = (_few(np.flatnonzero(rows)) for rows in (steepness <= _WALL, steepness >= _LEVEL))
    within = _within(above, places, _REACHES[0])
    on_wall = _on_walls(within)
    known = (
        (places[level], normals[level], within[~on_wall][_few(np.arange(np.count_nonzero(~on_wall)))]),
        (places[walls], normals[walls], within[on_wall][_few(np.arange(np.count_nonzero(on_wall)))]),
    )
    first = Alignment(pivot, 0.0, np.array([0.0, 0.0, rise]), math.inf, 0, math.inf, 0, math.inf)
    found = _refined(first, known, tells_plan=True)
    if found.n_walls >= _MIN_WALLS and found.plan_error <= _MAX_ERROR:
        return found
    return _refined(first, known, tells_plan=False)._replace(plan_error=math.inf)


def _refined(
    start: Alignment, known: tuple[tuple[_Floats, _Floats, _Floats], ...], *, tells_plan: bool
) -> Alignment:
    found = start
    for reach in _REACHES:
        parts = [_compared(found, *one, reach) for one in known]
        jacobian, residual, weight = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        used = slice(0, 4) if tells_plan else slice(2, 3)
        normal = (jacobian[:, used] * weight[:, None]).T @ jacobian[:, used]
        change, rank = np.zeros(4), np.linalg.matrix_rank(normal)
        if rank < len(normal):
            break
        change[used] = np.linalg.solve(normal, (jacobian[:, used] * weight[:, None]).T @ residual)
        found = found._replace(yaw=found.yaw + change[3], shift=found.shift + change[:3])
        error = math.inf
        if tells_plan:
            of_walls = parts[1]
            variance = (
                float(np.average(of_walls[1] ** 2, weights=of_walls[2])) if of_walls[2].any() else math.inf
            )
            error = math.sqrt(variance * float(np.linalg.eigvalsh(np.linalg.inv(normal)[:2, :2]).max()))
        figures = [_figures(residual, weight) for _, residual, weight in parts]
        found = found._replace(
            plan_error=error,
            n_ground=figures[0][0],
            rms_ground=figures[0][1],
            n_walls=figures[1][0],
            rms_walls=figures[1][1],
        )
    return found


def _compared(
    found: Alignment, places: _Floats, normals: _Floats, points: _Floats, reach: float
) -> tuple[_Floats, _Floats, _Floats]:
    """Return derivatives by x, y, z and yaw, residuals [m] and weights of points near planes."""
    if not len(places) or not len(points):
        return np.empty((0, 4)), np.empty(0), np.empty(0)
    now = found.moved(places)
    cosine, sine = math.cos(found.yaw), math.sin(found.yaw)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    distance, near = cKDTree(now).query(points, distance_upper_bound=reach)
    rows = np.flatnonzero(np.isfinite(distance))
    near = near[rows]
    normal, arm = normals[near] @ turn, now[near, :2] - found.pivot - found.shift[:2]
    residual = ((points[rows] - now[near]) * normal).sum(axis=1)
    turning = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    return np.column_stack([normal, turning]), residual, tukey_weights(residual)


def tukey_weights(residual: _Floats) -> _Floats:
    """Return weights that fall from 1 to 0 beyond `_TUKEY` robust standard deviations (the biweight)."""
    sigma = max(1.4826 * float(np.median(np.abs(residual))), _LEAST_SIGMA) if len(residual) else 1.0
    return np.square(np.clip(1.0 - np.square(residual / (_TUKEY * sigma)), 0.0, None))


def _figures(residual: _Floats, weight: _Floats) -> tuple[int, float]:
    used = residual[weight > 0.0]
    return len(used), float(np.sqrt(np.mean(used**2))) if len(used) else math.inf


def thinned(points: _Floats) -> _Floats:
    """Return one point of each voxel of `_VOXEL`, or of wider ones until `_MOST_POINTS` are left."""
    voxel = _VOXEL
    while True:
        places = np.floor(points / voxel).astype(np.int64) @ np.array([2**42, 2**21, 1])
        points = points[np.sort(np.unique(places, return_index=True)[1])]
        if len(points) <= _MOST_POINTS:
            return points
        voxel *= _GROWTH


def planes_at(points: _Floats) -> tuple[_Floats, _Floats]:
    """Return points, of some of shape (n, 3), about which others lie on a plane, and its unit normal [m]."""
    near = cKDTree(points).query(points, min(N_NEAR, len(points)))[1].reshape(len(points), -1)
    around = points[near]
    around -= around.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / near.shape[1])
    is_plane = (values[:, 0] <= _MAX_ROUGH**2) & (values[:, 1] >= _MIN_WIDE * values[:, 2])
    is_plane &= values[:, 0] <= 0.2 * values[:, 1]
    return points[is_plane], vectors[is_plane, :, 0]


def _few(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    return rows[:: math.ceil(len(rows) / _MOST_COMPARED) or 1]


def _within(points: _Floats, places: _Floats, reach: float) -> _Floats:
    if not len(places):
        return points[:0]
    low, high = places[:, :2].min(axis=0) - reach, places[:, :2].max(axis=0) + reach
    return points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)]


def _on_walls(points: _Floats) -> NDArray[np.bool_]:
    """Tell which points lie between the top and the foot of what stands within a metre."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    at = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / GROUND_CELL).astype(np.int64) + 1
    shape = at.max(axis=0) + 2
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    np.minimum.at(low, tuple(at.T), points[:, 2])
    np.maximum.at(high, tuple(at.T), points[:, 2])
    for axis in (0, 1):
        low = np.minimum(np.minimum(np.roll(low, 1, axis), low), np.roll(low, -1, axis))
        high = np.maximum(np.maximum(np.roll(high, 1, axis), high), np.roll(high, -1, axis))
    z = points[:, 2]
    return np.asarray((z >= low[tuple(at.T)] + _FREE) & (z <= high[tuple(at.T)] - _FREE))
