"""How well a model agrees with its points, and how much of its outline has points near."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.neighbours.few_rows import rows_by_group, rows_by_number
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.triangulation import face_arrays
from lidar_buildings.core.stages.building_model.result import RoofFacePatch

#: Points a block, the strips that they are sorted in, and how far those of one class reach at most [m].
_BLOCK, _STRIP = 32, 4.0
_REACHES = np.array([0.1, 0.3, 1.0, 3.0, 10.0, 1e300])


def distance_to_surface(points: FloatArray, solid: Solid, at_most: FloatArray) -> FloatArray:
    """
    Return each point's distance to the nearest face of a solid [m]: roof, walls and ground all count.

    `at_most` is known to be no smaller than the one sought, as the distance to a plane; infinite if unknown.
    """
    faces = face_arrays(solid)
    starts = faces.ring_starts
    first_corner, first_ring = starts + np.arange(len(starts)), faces.face_starts
    # Rings are closed: the first corner comes once more.
    rows = np.empty(first_corner[-1], dtype=np.int64)
    is_last = np.zeros(len(rows), dtype=np.bool_)
    is_last[first_corner[1:] - 1] = True
    rows[is_last], rows[~is_last] = faces.corners[starts[:-1]], faces.corners
    corners = solid.vertices[rows]
    # Points that lie together and reach as far, side by side: faces pass over whole blocks of them.
    strip = np.floor(points[:, 0] / _STRIP)
    strip -= strip.min(initial=0.0)
    n_strips = strip.max(initial=0.0) + 1.0
    place = _REACHES.searchsorted(at_most, side="right") * n_strips + strip
    order = np.argsort(points[:, 1])
    order = order[rows_by_number(place[order].astype(np.int64), len(_REACHES) * int(n_strips))]
    found = np.array(at_most[order], dtype=np.float64)
    _nearest(np.ascontiguousarray(points[order]), corners, first_corner, first_ring, found)
    distance = np.empty_like(found)
    distance[order] = found
    return distance


@kernel
def _nearest(points, corners, first_corner, first_ring, distance):  # type: ignore[no-untyped-def]
    low, high = np.empty(3), np.empty(3)
    n_blocks = (len(points) + _BLOCK - 1) // _BLOCK
    lowest, highest, reaches = np.empty((n_blocks, 3)), np.empty((n_blocks, 3)), np.full(n_blocks, np.inf)
    for block in range(n_blocks):
        first, last = block * _BLOCK, min(block * _BLOCK + _BLOCK, len(points))
        for axis in range(3):
            lowest[block, axis] = highest[block, axis] = points[first, axis]
            for i in range(first + 1, last):
                lowest[block, axis] = min(lowest[block, axis], points[i, axis])
                highest[block, axis] = max(highest[block, axis], points[i, axis])
    for face in range(len(first_ring) - 1):
        start, stop = first_corner[first_ring[face]], first_corner[first_ring[face + 1]]
        outer = first_corner[first_ring[face] + 1]
        # the ring's area vector, doubled (Newell)
        nx, ny, nz = 0.0, 0.0, 0.0
        x0, y0, z0 = corners[start, 0], corners[start, 1], corners[start, 2]
        for k in range(start, outer - 1):
            ax, ay, az = corners[k, 0] - x0, corners[k, 1] - y0, corners[k, 2] - z0
            bx, by, bz = corners[k + 1, 0] - x0, corners[k + 1, 1] - y0, corners[k + 1, 2] - z0
            nx += ay * bz - az * by
            ny += az * bx - ax * bz
            nz += ax * by - ay * bx
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        nx, ny, nz = nx / size, ny / size, nz / size
        drop = 2
        if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
            drop = 0
        elif abs(ny) >= abs(nz):
            drop = 1
        u, v = (drop + 1) % 3, (drop + 2) % 3
        for axis in range(3):
            low[axis], high[axis] = corners[start, axis], corners[start, axis]
            for k in range(start + 1, stop):
                low[axis] = min(low[axis], corners[k, axis])
                high[axis] = max(high[axis], corners[k, axis])
        for block in range(n_blocks):
            is_beyond = False
            for axis in range(3):
                is_beyond |= highest[block, axis] < low[axis] - reaches[block]
                is_beyond |= lowest[block, axis] > high[axis] + reaches[block]
            if is_beyond:
                continue
            first, last = block * _BLOCK, min(block * _BLOCK + _BLOCK, len(points))
            for i in range(first, last):
                reach, is_beyond = distance[i], False
                for axis in range(3):
                    is_beyond |= points[i, axis] < low[axis] - reach
                    is_beyond |= points[i, axis] > high[axis] + reach
                if is_beyond:
                    continue
                x, y, z = points[i, 0], points[i, 1], points[i, 2]
                off = (x - x0) * nx + (y - y0) * ny + (z - z0) * nz
                if abs(off) >= reach:
                    continue
                fx, fy, fz = x - off * nx, y - off * ny, z - off * nz
                fu, fv = (fy, fz) if drop == 0 else (fz, fx) if drop == 1 else (fx, fy)
                is_odd, least = False, reach * reach
                for ring in range(first_ring[face], first_ring[face + 1]):
                    for k in range(first_corner[ring], first_corner[ring + 1] - 1):
                        au, av, bu, bv = corners[k, u], corners[k, v], corners[k + 1, u], corners[k + 1, v]
                        if (au > fu) != (bu > fu) and fv < av + (bv - av) * (fu - au) / (bu - au):
                            is_odd = not is_odd
                if is_odd:
                    distance[i] = abs(off)
                    continue
                for ring in range(first_ring[face], first_ring[face + 1]):
                    for k in range(first_corner[ring], first_corner[ring + 1] - 1):
                        ax, ay, az = corners[k, 0], corners[k, 1], corners[k, 2]
                        ex, ey, ez = corners[k + 1, 0] - ax, corners[k + 1, 1] - ay, corners[k + 1, 2] - az
                        px, py, pz = x - ax, y - ay, z - az
                        square, share = ex**2 + ey**2 + ez**2, 0.0
                        if square > 0.0:
                            share = min(max((ex * px + ey * py + ez * pz) / square, 0.0), 1.0)
                        dx, dy, dz = px - share * ex, py - share * ey, pz - share * ez
                        least = min(least, dx**2 + dy**2 + dz**2)
                distance[i] = np.sqrt(least)
            reaches[block] = distance[first]
            for i in range(first + 1, last):
                reaches[block] = max(reaches[block], distance[i])


#: Spots farther than this from any point are without data [spacings].
_EMPTY_DISTANCE = 2.0
#: A point agrees with the model if it is nearer than this [m].
_AGREES = 0.3
#: A point so near to the plane of its face is measured against that only [m].
_NEAR = 0.05
#: Where the median of the points near a spot is farther off in height, the model is off there [m]; those
#: count that lie within this share of the distance above, and at most so many.
OFF_HEIGHT, _DECIDES, _MOST_NEAR = 0.5, 0.75, 64
#: Points whose heights spread by a smaller share of that (half of the range between the quartiles) are one
#: surface.
_COHERENT = 0.35
#: Most spots at which an outline is probed.
_MAX_SPOTS = 10_000
#: Most cells along each side in which points are sorted.
_MAX_CELLS = 500


@dataclass(frozen=True, eq=False)
class ModelQuality:
    """Agreement of one level of detail with the points."""

    #: Root mean square of the points' distances to the surface of the solid, walls included [m].
    rmse: float | None
    support: Support

    @property
    def coverage(self) -> float:
        """Share of the outline's area with a point near that agrees with the model."""
        return self.support.share(self.support.is_covered)

    @property
    def no_data_share(self) -> float:
        """Share of the outline's area without any point near."""
        return self.support.share(self.support.state == EMPTY)


def measure_model(
    faces: list[RoofFacePatch], solid: Solid, points: FloatArray, outline: Outline, spacing: float
) -> ModelQuality:
    """
    Measure how well one level's faces and solid agree with the building's points.

    Points over none of the faces are measured against the nearest one.
    """
    rows, planes = np.concatenate([face.rows for face in faces]), np.array([face.plane for face in faces])
    misfit, above = _off_planes(points, rows, np.cumsum([len(face.rows) for face in faces]), planes)
    far = np.flatnonzero(misfit > _NEAR)
    misfit[far] = distance_to_surface(points[far], solid, misfit[far])
    rmse = math.sqrt((misfit * misfit).sum() / len(misfit)) if len(points) else None
    return ModelQuality(rmse, outline_support(outline, points[:, :2], misfit <= _AGREES, above, spacing))


@kernel
def _off_planes(points, rows, ends, planes):  # type: ignore[no-untyped-def]
    """Return points' distances to planes, and heights above; the points over plane k end at ``ends[k]``."""
    # The plane goes on beside the outline, the roof does not.
    distance, above, first = np.full(len(points), np.inf), np.full(len(points), np.nan), 0
    for k in range(len(planes)):
        a, b, c = planes[k]
        length = math.sqrt(1.0 + a * a + b * b)
        for i in rows[first : ends[k]]:
            above[i] = points[i, 2] - (a * points[i, 0] + b * points[i, 1]) - c
            distance[i] = abs(above[i]) / length
        first = ends[k]
    return distance, above


#: What the points near a spot of an outline say of the model: it is no spot of the outline; there are none;
#: there are some; they lie off it, scattered, as those of branches do.
BESIDE, EMPTY, SEEN, ROUGH = range(4)


@dataclass(frozen=True, eq=False)
class Support:
    """What the points say of the model on a grid of spots over the outline."""

    state: NDArray[np.int8]  #: one of the four above, shape (n_rows, n_columns)
    is_covered: NDArray[np.bool_]  #: whether a point near agrees, of the same shape
    x: FloatArray  #: of the columns [m]
    y: FloatArray  #: of the rows [m]
    above: FloatArray  #: how far each point lies above the model, NaN over no face [m], shape (n_points,)
    middle: FloatArray  #: the median of that near each spot, 0 where too few are, of the shape of `state` [m]

    @property
    def spots(self) -> FloatArray:
        """The places of the outline's spots, shape (n_spots, 2) [m]."""
        row, column = np.nonzero(self.state)
        return np.column_stack([self.x[column], self.y[row]])

    def share(self, which: NDArray[np.bool_]) -> float:
        """Return the share of the outline's spots; 0 if there are none."""
        return float(int(np.count_nonzero(which)) / max(int(np.count_nonzero(self.state)), 1))


def outline_support(
    outline: Outline, xy: FloatArray, agrees: BoolArray, above: FloatArray, spacing: float
) -> Support:
    """
    Return what points say of the model over an outline: whether each agrees, and how far it lies above.

    It is probed on a grid of a spacing at least [m]; what lies on its edges does not count. Near is within
    two spacings. Points over no face lie NaN above.
    """
    if len(outline.exterior) < 3 or outline.area <= 0 or not len(xy):
        none = np.zeros(1)
        return Support(
            np.full((1, 1), EMPTY, dtype=np.int8),
            np.zeros((1, 1), dtype=np.bool_),
            none,
            none,
            above,
            none[None],
        )
    low, high = outline.exterior.min(axis=0), outline.exterior.max(axis=0)
    step = max(spacing, float(np.prod(high - low) / _MAX_SPOTS) ** 0.5)
    x, y = (np.arange(a + 0.5 * min(step, b - a), b, step) for a, b in zip(low, high, strict=True))
    rings = [ring for ring in outline.rings if len(ring) >= 3]
    edges = ring_walls(rings).reshape(-1, 4)
    state, is_covered = np.zeros((len(y), len(x)), dtype=np.int8), np.zeros((len(y), len(x)), dtype=np.bool_)
    reach = _EMPTY_DISTANCE * spacing
    middle = np.zeros(state.shape)
    _probe(edges, x, y, np.ascontiguousarray(xy), agrees, above, reach, state, is_covered, middle)
    if not state.any():
        state[:] = EMPTY
    return Support(state, is_covered, x, y, above, middle)


@kernel
def _probe(edges, x, y, xy, agrees, above, reach, state, is_covered, middle):  # type: ignore[no-untyped-def]
    """Write what the points near the spots inside say."""
    west, south = x[0] - reach, y[0] - reach
    extent = max(x[-1] - west, y[-1] - south) + reach
    size = max(reach, extent / _MAX_CELLS)
    n_columns, n_rows = int((x[-1] + reach - west) / size) + 1, int((y[-1] + reach - south) / size) + 1
    cell = np.full(len(xy), n_columns * n_rows)
    for i in range(len(xy)):
        u, v = (xy[i, 0] - west) / size, (xy[i, 1] - south) / size
        if 0.0 <= u < n_columns and 0.0 <= v < n_rows:
            cell[i] = int(v) * n_columns + int(u)
    order, first = rows_by_group(cell, n_columns * n_rows + 1)
    crossed, near = np.empty(len(edges), dtype=np.int64), np.empty(_MOST_NEAR)
    for row in range(len(y)):
        n = 0
        for e in range(len(edges)):
            if min(edges[e, 1], edges[e, 3]) <= y[row] <= max(edges[e, 1], edges[e, 3]):
                crossed[n] = e
                n += 1
        for column in range(len(x)):
            if not is_inside(edges, crossed, n, x[column], y[row]):
                continue
            at_u, at_v = int((x[column] - west) / size), int((y[row] - south) / size)
            n_near, n_all, covered = 0, 0, False
            for v in range(max(at_v - 1, 0), min(at_v + 2, n_rows)):
                # The cells of a row lie one after the other.
                west_most, east_most = max(at_u - 1, 0), min(at_u + 1, n_columns - 1)
                for j in range(first[v * n_columns + west_most], first[v * n_columns + east_most + 1]):
                    i = order[j]
                    square = (xy[i, 0] - x[column]) ** 2 + (xy[i, 1] - y[row]) ** 2
                    if square >= reach * reach:
                        continue
                    n_near += 1
                    covered |= agrees[i]
                    if square < (_DECIDES * reach) ** 2 and n_all < _MOST_NEAR and not np.isnan(above[i]):
                        near[n_all] = above[i]
                        n_all += 1
            is_covered[row, column] = covered
            state[row, column] = SEEN if n_near else EMPTY
            if n_all < 2:
                continue
            near[:n_all].sort()
            here = 0.5 * (near[n_all // 2] + near[(n_all - 1) // 2])
            middle[row, column] = here
            spread = 0.5 * (near[(3 * n_all) // 4] - near[n_all // 4])
            if abs(here) > OFF_HEIGHT and spread >= _COHERENT * abs(here):
                state[row, column] = ROUGH


@inner_kernel
def is_inside(edges: FloatArray, crossed: IntArray, n: int, x: float, y: float) -> bool:
    """Whether a place lies within rings (even-odd rule) and on no edge; only the edges at its y are given."""
    is_odd = False
    for k in range(n):
        e = crossed[k]
        ax, ay, bx, by = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        if side == 0.0 and min(ax, bx) <= x <= max(ax, bx):
            return False
        if (ay > y) != (by > y) and (side > 0.0) == (by > ay):
            is_odd = not is_odd
    return is_odd
