"""How well a model agrees with its points, and how much of its outline has points near."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.shell import Solid, cross
from lidar_buildings.core.solids.triangulation import face_arrays
from lidar_buildings.core.stages.building_model.result import RoofFacePatch


def distance_to_surface(points: FloatArray, solid: Solid, at_most: FloatArray) -> FloatArray:
    """
    Return each point's distance to the nearest face of a solid [m]: roof, walls and ground all count.

    `at_most` is known to be no smaller than the one sought, as the distance to a plane; infinite if unknown.
    """
    faces = face_arrays(solid)
    starts = faces.corner_starts
    corners = solid.vertices[faces.corners]
    following = np.arange(1, len(corners) + 1)
    following[faces.ring_starts[1:] - 1] = faces.ring_starts[:-1]
    edges = corners[following] - corners
    normals = np.add.reduceat(cross(corners - corners[0], edges), starts[:-1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    boxes = np.stack([np.minimum.reduceat(corners, starts[:-1]), np.maximum.reduceat(corners, starts[:-1])])
    distance = np.array(at_most, dtype=np.float64)
    _nearest(np.ascontiguousarray(points), corners, edges, starts, normals, boxes, distance)
    return distance


@kernel
def _nearest(points, corners, edges, starts, normals, boxes, distance):  # type: ignore[no-untyped-def]
    """Lower the distances of points to those to the nearest face."""
    foot = np.empty(3)
    for face in range(len(normals)):
        normal, (west, south, bottom), (east, north, top) = normals[face], boxes[0, face], boxes[1, face]
        anchor = corners[starts[face]]
        if not normal.any():
            continue
        # The face is looked at along the axis that it is least inclined to.
        drop = np.argmax(np.abs(normal))
        u, v = (drop + 1) % 3, (drop + 2) % 3
        for i in range(len(points)):
            x, y, z, reach = points[i, 0], points[i, 1], points[i, 2], distance[i]
            if x < west - reach or x > east + reach or y < south - reach or y > north + reach:
                continue
            off = (x - anchor[0]) * normal[0] + (y - anchor[1]) * normal[1] + (z - anchor[2]) * normal[2]
            if z < bottom - reach or z > top + reach or abs(off) >= reach:
                continue
            for axis in range(3):
                foot[axis] = points[i, axis] - off * normal[axis]
            is_odd, least = False, reach * reach
            for k in range(starts[face], starts[face + 1]):
                au, av, eu, ev = corners[k, u], corners[k, v], edges[k, u], edges[k, v]
                if (au > foot[u]) != (au + eu > foot[u]) and foot[v] < av + ev * (foot[u] - au) / eu:
                    is_odd = not is_odd
                along, length, square = 0.0, 0.0, 0.0
                for axis in range(3):
                    along += edges[k, axis] * (points[i, axis] - corners[k, axis])
                    length += edges[k, axis] ** 2
                share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
                for axis in range(3):
                    square += (points[i, axis] - corners[k, axis] - share * edges[k, axis]) ** 2
                least = min(least, square)
            distance[i] = abs(off) if is_odd else math.sqrt(least)


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
    above: FloatArray  #: how far each point lies above the model, NaN over no face [m], shape (n_points,)
    middle: FloatArray  #: the median of that near each spot, 0 where too few are, of the shape of `state` [m]

    def share(self, which: NDArray[np.bool_]) -> float:
        """Return the share of the outline's spots; 0 if there are none."""
        return float(int(np.count_nonzero(which)) / max(int(np.count_nonzero(self.state)), 1))


def outline_support(
    outline: Outline, xy: FloatArray, agrees: BoolArray, above: FloatArray, spacing: float
) -> Support:
    """
    Return what points say of the model over an outline: whether each agrees, and how far it lies above.

    It is probed on a grid of a spacing at least [m]; what lies on its edges does not count. Near is within
    two spacings. Points over no face lie NaN above. They rise by y.
    """
    if len(outline.exterior) < 3 or outline.area <= 0 or not len(xy):
        empty = np.full((1, 1), EMPTY, dtype=np.int8)
        return Support(empty, np.zeros((1, 1), dtype=np.bool_), above, np.zeros((1, 1)))
    low, high = outline.exterior.min(axis=0), outline.exterior.max(axis=0)
    step = max(spacing, float(np.prod(high - low) / _MAX_SPOTS) ** 0.5)
    x, y = (np.arange(a + 0.5 * min(step, b - a), b, step) for a, b in zip(low, high, strict=True))
    polygon = outline.polygon
    shapely.prepare(polygon)
    state = np.where(shapely.contains_xy(polygon, *np.meshgrid(x, y)), EMPTY, BESIDE).astype(np.int8)
    is_covered, middle = np.zeros(state.shape, dtype=np.bool_), np.zeros(state.shape)
    reach = _EMPTY_DISTANCE * spacing
    _probe(x, y, np.ascontiguousarray(xy), agrees, above, reach, state, is_covered, middle)
    if not state.any():
        state[:] = EMPTY
    return Support(state, is_covered, above, middle)


@kernel
def _probe(x, y, xy, agrees, above, reach, state, is_covered, middle):  # type: ignore[no-untyped-def]
    """Write what the points near the spots inside say."""
    near = np.empty(_MOST_NEAR)
    for row in range(len(y)):
        first, last = np.searchsorted(xy[:, 1], y[row] - reach), np.searchsorted(xy[:, 1], y[row] + reach)
        for column in range(len(x)):
            if state[row, column] == BESIDE:
                continue
            n_all = 0
            for i in range(first, last):
                square = (xy[i, 0] - x[column]) ** 2 + (xy[i, 1] - y[row]) ** 2
                if square >= reach * reach:
                    continue
                state[row, column] = SEEN
                is_covered[row, column] |= agrees[i]
                if square < (_DECIDES * reach) ** 2 and n_all < _MOST_NEAR and not np.isnan(above[i]):
                    near[n_all] = above[i]
                    n_all += 1
            if n_all < 2:
                continue
            near[:n_all].sort()
            here = 0.5 * (near[n_all // 2] + near[(n_all - 1) // 2])
            middle[row, column] = here
            spread = 0.5 * (near[(3 * n_all) // 4] - near[n_all // 4])
            if abs(here) > OFF_HEIGHT and spread >= _COHERENT * abs(here):
                state[row, column] = ROUGH
