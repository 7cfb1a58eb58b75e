"""Roofs of two wings at right angles: L or T."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import BoolArray, FloatArray
from lidar_buildings.core.stages.roof_topology.result import RIDGE, IntersectionSegment
from lidar_buildings.core.surfaces.percentiles import middle_of

#: Ridges within this of a right angle, or parallel to within it, are so [deg].
_TOLERANCE_DEG = 20.0
#: A wing whose axis is nearer than this share of its width to the end of the other is at the corner.
_AT_CORNER = 0.75
#: Two valleys: where a wing meets the middle of the other; one: where two equal wings meet.
_MOST_VALLEYS = 2


def l_or_t(
    points: FloatArray,
    plane_id: NDArray[np.uint16],
    faces: list[list[int]],
    valleys: list[tuple[int, int]],
    intersections: Sequence[IntersectionSegment],
) -> str:
    """
    Tell roofs of two wings, ``L`` or ``T``, from one another and from more complex ones.

    Faces are lists of planes' numbers, valleys pairs of faces, numbered from 0, that meet in one.
    """
    face_of = {number: k for k, face in enumerate(faces) for number in face}
    ridges = _ridges(intersections, face_of)
    if len(ridges) != 2 or len(valleys) > _MOST_VALLEYS or len(faces) > 6:
        return "complex"
    directions = [ridge[0] for ridge in ridges]
    if abs(float(directions[0] @ directions[1])) > np.sin(np.radians(_TOLERANCE_DEG)):
        return "complex"
    if len(valleys) == 1:
        return "L"
    spans = [
        _span(points, plane_id, [number for k in pair for number in faces[k]], directions)
        for _, _, pair in ridges
    ]
    # Seen along the ridge of the one, the other is a wing: it is narrower, and its axis is its middle.
    return "L" if any(_at_corner(spans[k][k], spans[1 - k][k]) for k in range(2)) else "T"


def _ridges(
    intersections: Sequence[IntersectionSegment], face_of: dict[int, int]
) -> list[tuple[FloatArray, float, set[int]]]:
    """Return direction, length and faces of each ridge between large faces, pieces of one ridge joined."""
    pieces: dict[tuple[int, int], IntersectionSegment] = {}
    for line in intersections:
        pair = face_of.get(line.first, -1), face_of.get(line.second, -1)
        if line.kind == RIDGE and min(pair) >= 0 and pair[0] != pair[1]:
            key = min(pair), max(pair)
            if key not in pieces or line.length > pieces[key].length:
                pieces[key] = line
    ridges: list[tuple[FloatArray, float, set[int]]] = []
    for pair, line in sorted(pieces.items(), key=lambda item: -item[1].length):
        along = line.segment[1, :2] - line.segment[0, :2]
        ridges.append((along / max(float(np.hypot(*along)), 1e-9), line.length, set(pair)))
    return ridges


def _span(
    points: FloatArray, plane_id: NDArray[np.uint16], planes: list[int], directions: list[FloatArray]
) -> list[tuple[float, float]]:
    """Return from where to where planes reach in each direction [m]."""
    xy = points[in_planes(plane_id, planes), :2]
    return [middle_of(np.sort(xy @ d), 0.01) for d in directions]


def in_planes(plane_id: NDArray[np.uint16], planes: list[int]) -> BoolArray:
    """Whether each point is in one of some planes."""
    chosen = np.zeros(int(plane_id.max()) + 1, dtype=np.bool_)
    chosen[planes] = True
    return chosen[plane_id]


def _at_corner(main: tuple[float, float], wing: tuple[float, float]) -> bool:
    """Whether a wing stands at an end of the main part, neither in its middle nor beyond."""
    axis, width = 0.5 * (wing[0] + wing[1]), wing[1] - wing[0]
    return 0.0 < min(axis - main[0], main[1] - axis) < _AT_CORNER * width
