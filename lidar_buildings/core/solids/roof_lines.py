"""The lines of a roof, told from the faces of its solid: ridges, hips, valleys, eaves, verges and steps."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.face_shape import area_vector
from lidar_buildings.core.solids.shell import ROOF_SURFACE, WALL_SURFACE, Solid, ring_edges

RIDGE, HIP, VALLEY, EAVE, VERGE, STEP = KINDS = ("ridge", "hip", "valley", "eave", "verge", "step")

#: Faces that meet at a smaller angle fold along no line: the sine of a degree.
_LEAST_FOLD = 0.0175
#: A line is level if it is less steep than this share of the steeper face, as in `roof_topology`.
_LEVEL_SHARE = 0.3
#: What is less steep is level beside flat roofs, too: 5° [m/m].
_FLAT = 0.0875
#: Pieces shorter than this are rounding [m].
_SHORTEST = 0.01


class RoofLine(NamedTuple):
    """
    A straight line in which a roof's face ends.

    Attributes
    ----------
    kind : str
        ``ridge`` (two faces fall away from it, and it is nearly level), ``hip`` (the same, inclined),
        ``valley`` (two faces rise from it), ``eave`` (level, above an outer wall), ``verge`` (inclined, above
        an outer wall), ``step`` (above a wall that ends on a lower roof).
    ends : ndarray of shape (2, 3)
        [m]
    faces : tuple of int
        The roof's faces on it, numbered from 1 as they come in the solid; one or two.
    """

    kind: str
    ends: FloatArray
    faces: tuple[int, ...]


class _Edge(NamedTuple):
    """An edge of a face: its two vertices, and the face on its left."""

    start: int
    end: int
    face: int


def roof_lines(solid: Solid) -> list[RoofLine]:
    """
    Return the lines of a solid's roof, each once, face by face.

    What parts one plane into several faces is no line. Where a wall ends partly on a lower roof and partly on
    the ground, the line above it is parted there. Edges that go on straight are one.
    """
    edges = [
        _Edge(start, end, number)
        for number, face in enumerate(solid.faces)
        for ring in face
        for start, end in ring_edges(ring)
    ]
    opposite = {(edge.end, edge.start): edge.face for edge in edges}
    roofs = [number for number, kind in enumerate(solid.semantics) if kind == ROOF_SURFACE]
    number_of = {face: k for k, face in enumerate(roofs, start=1)}
    normals = [_unit(area_vector(solid.face_rings(face))) for face in solid.faces]
    found: dict[tuple[str, tuple[int, ...]], list[FloatArray]] = defaultdict(list)
    lower = _lower_edges(solid, edges, opposite, normals)
    for edge in edges:
        other = opposite.get((edge.start, edge.end))
        if edge.face not in number_of or other is None:
            continue
        ends = solid.vertices[[edge.start, edge.end]]
        one, across = normals[edge.face], normals[other]
        if other in number_of:
            kind = _fold(ends, one, across) if edge.face < other else ""
            if kind:
                found[kind, (number_of[edge.face], number_of[other])].append(ends)
        elif solid.semantics[other] == WALL_SURFACE and _falls_behind(ends, across):
            level = EAVE if _is_level(ends, one) else VERGE
            for kind, piece in _parted(ends, lower[other], level):
                found[kind, (number_of[edge.face],)].append(piece)
    return [
        RoofLine(kind, ends, faces)
        for (kind, faces), pieces in sorted(found.items(), key=lambda item: item[0][1])
        for ends in _joined(pieces)
    ]


def _lower_edges(
    solid: Solid, edges: Iterable[_Edge], opposite: dict[tuple[int, int], int], normals: list[FloatArray]
) -> dict[int, list[FloatArray]]:
    """Return the edges of roofs at which each wall's foot stands."""
    found: dict[int, list[FloatArray]] = defaultdict(list)
    for edge in edges:
        wall = opposite.get((edge.start, edge.end))
        if solid.semantics[edge.face] == ROOF_SURFACE and wall is not None:
            ends = solid.vertices[[edge.start, edge.end]]
            if solid.semantics[wall] == WALL_SURFACE and not _falls_behind(ends, normals[wall]):
                found[wall].append(ends)
    return found


def _fold(ends: FloatArray, one: FloatArray, other: FloatArray) -> str:
    """Return the kind of the line between two faces of a roof, the first on its left; empty for none."""
    along = _unit(ends[1] - ends[0])
    turn = float(_cross(one, other) @ along)
    if abs(turn) < _LEAST_FOLD and float(one @ other) > 0.0:
        return ""
    if turn < 0.0:
        return VALLEY
    return RIDGE if _is_level(ends, one, other) else HIP


def _falls_behind(ends: FloatArray, wall: FloatArray) -> bool:
    """Whether the wall on the right of a roof's edge looks away from that roof, and so stands below it."""
    x, y, _ = ends[1] - ends[0]
    return float(wall[0] * y - wall[1] * x) > 0.0


def _is_level(ends: FloatArray, *normals: FloatArray) -> bool:
    x, y, z = np.abs(ends[1] - ends[0])
    steepest = max(float(np.hypot(n[0], n[1]) / max(n[2], 1e-9)) for n in normals)
    return bool(z < max(_LEVEL_SHARE * steepest, _FLAT) * np.hypot(x, y))


def _parted(ends: FloatArray, lower: list[FloatArray], outer: str) -> list[tuple[str, FloatArray]]:
    """Part a line above a wall into steps, where the wall's foot stands on roofs, and the outer rest."""
    start, along = ends[0], ends[1] - ends[0]
    length = float(np.hypot(along[0], along[1]))
    if length < _SHORTEST:
        return []
    spans = sorted(sorted(((low - start)[:, :2] @ along[:2] / length**2).clip(0, 1)) for low in lower)
    pieces, done = [], 0.0
    for low, high in [*spans, (1.0, 1.0)]:
        first = max(low, done)
        pieces += [(outer, done, first), (STEP, first, max(high, first))]
        done = max(high, done)
    return [
        (kind, start + np.outer([low, high], along))
        for kind, low, high in pieces
        if (high - low) * length >= _SHORTEST
    ]


def _joined(pieces: list[FloatArray]) -> list[FloatArray]:
    """Join pieces that go on straight where others end."""
    lines = [piece.tolist() for piece in pieces]
    for k in range(len(lines) - 1, -1, -1):
        for j, before in enumerate(lines):
            if j != k and _goes_on(before, lines[k]):
                lines[j] = [before[0], lines[k][1]]
                del lines[k]
                break
    return [np.array(line) for line in lines]


def _goes_on(before: list[list[float]], after: list[list[float]]) -> bool:
    if math.dist(before[1], after[0]) >= _SHORTEST:
        return False
    one, other = (_unit(np.subtract(end, start)) for start, end in (before, after))
    return math.hypot(*_cross(one, other)) < _LEAST_FOLD and float(one @ other) > 0.0


def _cross(one: FloatArray, other: FloatArray) -> tuple[float, float, float]:
    """Return the cross product of two vectors: a tenth of the time of `numpy.cross`."""
    (ax, ay, az), (bx, by, bz) = one.tolist(), other.tolist()
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def _unit(vector: Iterable[float]) -> FloatArray:
    """Return a vector of length 1, zeros if it has none."""
    found = np.asarray(vector, dtype=np.float64)
    return found / (math.hypot(*found) or 1.0)
