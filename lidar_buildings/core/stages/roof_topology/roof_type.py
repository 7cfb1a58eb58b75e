"""The kind of a roof, told from its large faces and the lines between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.stages.roof_topology.result import (
    HIP,
    RIDGE,
    STEP,
    VALLEY,
    IntersectionSegment,
    StepEdge,
)

#: Faces less steep are flat: water runs off, the eye sees none of it [deg].
_FLAT_DEG = 8.0
#: How far directions may differ from what the type asks for [deg].
_TOLERANCE_DEG = 20.0
#: Planes with a smaller share of all planes' points, and of the largest plane's, are details.
_DETAIL_SHARE, _DETAIL_OF_LARGEST = 0.08, 0.3
#: A roof with more of its points on one detail is complex.
_MOST_DETAIL = 0.1
#: Planes are pieces of one face if their gradients differ by less [m/m], and by less than twice the height at
#: the centre; lower steps are none [m].
_SAME_GRADIENT, _SAME_HEIGHT = 0.06, 0.3
#: Lines shorter than this share of the roof's size (√area) do not count.
_LEAST_LINE = 0.08
#: A hip that ends this share of the roof's height above the eaves is a half-hip.
_HALF_HIP = 0.25
#: A wing whose axis is nearer than this share of its width to the end of the other is at the corner.
_AT_CORNER = 0.75


class Faces(NamedTuple):
    """The large faces of a roof."""

    planes: list[list[int]]  #: numbers of the planes that each face consists of
    gradient: list[list[float]]  #: by how much each rises towards x and y [m/m]
    #: Pair of faces (numbered from 0, the lower first) and kind → length of their lines [m].
    lines: dict[tuple[int, int, str], float]
    size: float  #: square root of the roof's area [m]

    @property
    def slope_deg(self) -> list[float]:
        """Slope of each face [deg]."""
        return [math.degrees(math.atan(math.hypot(a, b))) for a, b in self.gradient]

    def pairs(self, kind: str) -> list[tuple[int, int]]:
        """Pairs of faces that meet in a line of this kind, the longest first; short lines do not count."""
        found = [(-v, i, j) for (i, j, k), v in self.lines.items() if k == kind]
        return [(i, j) for v, i, j in sorted(found) if -v >= _LEAST_LINE * self.size]

    def turned(self, i: int, j: int) -> float:
        """Angle between the directions that two faces look in, 0 to 180 [deg]."""
        one, other = (math.degrees(math.atan2(b, a)) for a, b in (self.gradient[i], self.gradient[j]))
        turn = abs(one - other) % 360.0
        return min(turn, 360.0 - turn)


def roof_type(
    points: FloatArray,
    plane_id: NDArray[np.uint16],
    coefficients: FloatArray,
    intersections: Sequence[IntersectionSegment],
    steps: Sequence[StepEdge],
    spacing: float,
) -> str:
    """
    Tell a building's kind of roof: details such as dormers and chimneys do not count.

    It is ``flat`` (at one level or several), ``shed``, ``gable``, ``hip``, ``half-hip`` (hips that end above
    the eaves), ``pyramid`` (all faces meet in one point), ``L`` or ``T`` (two ridges at right angles),
    ``complex`` for anything else, or ``unknown`` where no points lie in planes. Points are (n_points, 3) [m];
    `plane_id` is the number of each one's plane, 0 = none; `coefficients` are a, b, c of the planes z = a x +
    b y + c about the building's centre, (n_planes, 3); `spacing` is [m].
    """
    counts = np.bincount(plane_id, minlength=len(coefficients) + 1)[1:]
    n_planar = int(counts.sum())
    if n_planar == 0:
        return "unknown"
    large = _large_planes(counts, intersections)
    faces = _faces(large, coefficients, intersections, steps, spacing * math.sqrt(n_planar))
    flat = [slope < _FLAT_DEG for slope in faces.slope_deg]
    if all(flat):
        return "flat"
    if len(flat) == 1:
        return "shed"
    if any(flat) or faces.pairs(STEP) or _largest_detail(counts, large, intersections) > _MOST_DETAIL:
        return "complex"
    if faces.pairs(VALLEY):
        return _l_or_t(points, plane_id, faces)
    return _without_valleys(points, plane_id, faces)


def _large_planes(counts: IntArray, intersections: Sequence[IntersectionSegment]) -> list[int]:
    """Return the numbers of planes that are no details; hipped ends count, however small."""
    large = (counts >= _DETAIL_SHARE * counts.sum()) | (counts >= _DETAIL_OF_LARGEST * counts.max())
    hips = np.zeros(len(counts), dtype=np.int64)
    for line in intersections:
        if line.kind == HIP:
            hips[line.first - 1] += large[line.second - 1]
            hips[line.second - 1] += large[line.first - 1]
    return [int(k) + 1 for k in np.flatnonzero(large | (hips >= 2))]


def _largest_detail(
    counts: IntArray, large: list[int], intersections: Sequence[IntersectionSegment]
) -> float:
    """Return the largest share of the points on details that meet, such as the faces of a tower."""
    vertex = [(line.first - 1, line.second - 1) for line in intersections]
    links = [(i, j) for i, j in vertex if not {i + 1, j + 1} & set(large)]
    rows, columns = np.array(links, dtype=np.int64).reshape(-1, 2).T
    group = sets_of_pairs(len(counts), rows, columns)
    small = counts.copy()
    small[np.array(large) - 1] = 0
    return float(np.bincount(group, small).max() / counts.sum())


def _faces(
    large: list[int],
    coefficients: FloatArray,
    intersections: Sequence[IntersectionSegment],
    steps: Sequence[StepEdge],
    size: float,
) -> Faces:
    planes: list[list[int]] = []
    known, firsts = coefficients.tolist(), np.empty((len(large), 3))
    for number in large:
        plane = coefficients[number - 1]
        east, north, up = np.abs(firsts[: len(planes)] - plane).T
        same = np.flatnonzero((np.hypot(east, north) < _SAME_GRADIENT) & (up < 2.0 * _SAME_HEIGHT))
        if len(same):
            planes[same[0]].append(number)
        else:
            firsts[len(planes)] = plane
            planes.append([number])
    face_of = {number: k for k, face in enumerate(planes) for number in face}
    lines: dict[tuple[int, int, str], float] = {}
    borders = [(line.first, line.second, line.kind, line.length) for line in intersections]
    borders += [
        (step.upper, step.lower, STEP, step.length) for step in steps if max(step.height) > _SAME_HEIGHT
    ]
    for first, second, kind, length in borders:
        i, j = sorted((face_of.get(first, -1), face_of.get(second, -1)))
        if i >= 0 and i != j:
            lines[i, j, kind] = lines.get((i, j, kind), 0.0) + length
    return Faces(planes, [known[face[0] - 1][:2] for face in planes], lines, size)


def _without_valleys(points: FloatArray, plane_id: NDArray[np.uint16], faces: Faces) -> str:
    """Tell the kind of a pitched roof whose faces meet in ridges and hips only."""
    n, ridges, hips = len(faces.planes), faces.pairs(RIDGE), faces.pairs(HIP)
    if n == 2:
        opposite = faces.turned(0, 1) >= 180.0 - _TOLERANCE_DEG
        return "gable" if (ridges or hips) and opposite else "complex"
    if not ridges and len(hips) >= n >= 3:
        return "pyramid"
    if len(ridges) != 1 or n not in (3, 4) or len(hips) != 2 * (n - 2):
        return "complex"
    i, j = ridges[0]
    ends = [k for k in range(n) if k not in (i, j)]
    across = all(abs(faces.turned(i, k) - 90.0) <= _TOLERANCE_DEG for k in ends)
    if faces.turned(i, j) < 180.0 - _TOLERANCE_DEG or not across:
        return "complex"
    low, high = _heights(points, plane_id, faces, (i, j))
    lifted = [_heights(points, plane_id, faces, (k,))[0] - low for k in ends]
    return "half-hip" if max(lifted) >= _HALF_HIP * (high - low) else "hip"


def _l_or_t(points: FloatArray, plane_id: NDArray[np.uint16], faces: Faces) -> str:
    """Tell roofs of two wings, ``L`` or ``T``, from one another and from more complex ones."""
    ridges, n_valleys = faces.pairs(RIDGE), len(faces.pairs(VALLEY))
    # Two valleys: where a wing meets the middle of the other; one: where two equal wings meet.
    if len(ridges) != 2 or n_valleys > 2:
        return "complex"
    fall = np.array([np.subtract(faces.gradient[i], faces.gradient[j]) for i, j in ridges])
    across = fall / np.hypot(*fall.T)[:, None]
    if abs(float(across[0] @ across[1])) > math.sin(math.radians(_TOLERANCE_DEG)):
        return "complex"
    if n_valleys == 1:
        return "L"
    wings = [points[_in_faces(plane_id, faces, pair), :2] for pair in ridges]
    for k in range(2):
        # Seen along the ridge of the one, the other is a wing: it is narrower, and its axis is its middle.
        along = across[1 - k]
        (low, high), (left, right) = (np.percentile(wings[m] @ along, (1, 99)) for m in (k, 1 - k))
        axis = 0.5 * (left + right)
        if 0.0 < min(axis - low, high - axis) < _AT_CORNER * (right - left):
            return "L"
    return "T"


def _heights(
    points: FloatArray, plane_id: NDArray[np.uint16], faces: Faces, chosen: Sequence[int]
) -> tuple[float, float]:
    """Return the elevations near the eaves and the ridge [m]: percentiles, as a few points may be off."""
    low, high = np.percentile(points[_in_faces(plane_id, faces, chosen), 2], (2, 98))
    return float(low), float(high)


def _in_faces(plane_id: NDArray[np.uint16], faces: Faces, chosen: Sequence[int]) -> BoolArray:
    return np.isin(plane_id, [number for k in chosen for number in faces.planes[k]])
