"""The lines of a roof, told from the faces of its solid: ridges, hips, valleys, eaves, verges and steps."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from operator import sub
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.shell import ROOF_SURFACE, WALL_SURFACE, Solid, cross

RIDGE, HIP, VALLEY, EAVE, VERGE, STEP = KINDS = ("ridge", "hip", "valley", "eave", "verge", "step")

#: Faces that meet at a smaller angle fold along no line: the sine of a degree.
_LEAST_FOLD = 0.0175
#: A line is level if it is less steep than this share of the steeper face, as in `roof_topology`.
_LEVEL_SHARE = 0.3
#: What is less steep is level beside flat roofs, too: 5° [m/m].
_FLAT = 0.0875
#: Pieces shorter than this are rounding [m].
_SHORTEST = 0.01


#: A line's two ends, x, y and z of each [m].
_Ends = list[list[float]]


class RoofLine(NamedTuple):
    """A straight line in which a roof's face ends."""

    #: ``ridge`` (two faces fall away from it, and it is nearly level), ``hip`` (the same, inclined),
    #: ``valley`` (two faces rise from it), ``eave`` (level, above an outer wall), ``verge`` (inclined, above
    #: an outer wall), ``step`` (above a wall that ends on a lower roof).
    kind: str
    ends: FloatArray  #: [m], shape (2, 3)
    faces: tuple[int, ...]  #: the roof's faces on it, numbered from 1 as they come in the solid; one or two


class _Edges(NamedTuple):
    """The edges of a solid's faces, one a row, and what lies on both sides."""

    #: The faces on the left and on the right; -1 for none, shape (n_edges,).
    face: IntArray
    other: IntArray
    ends: FloatArray  #: [m], shape (n_edges, 2, 3)
    normals: FloatArray  #: of length 1, shape (n_faces, 3)


def roof_lines(solid: Solid) -> list[RoofLine]:
    """
    Return the lines of a solid's roof, each once, face by face.

    What parts one plane into several faces is no line. Where a wall ends partly on a lower roof and partly on
    the ground, the line above it is parted there. Edges that go on straight are one.
    """
    edges = _edges(solid)
    kinds = np.array([*solid.semantics, ""])  # none for the face -1
    is_roof, is_wall = kinds == ROOF_SURFACE, kinds == WALL_SURFACE
    number_of = np.cumsum(is_roof)
    above_wall = is_roof[edges.face] & is_wall[edges.other]
    x, y, _ = (edges.ends[:, 1] - edges.ends[:, 0]).T
    wall = edges.normals[edges.other]
    falls_behind = wall[:, 0] * y - wall[:, 1] * x > 0.0  # the wall looks away from the roof: is below it
    ends: list[_Ends] = edges.ends.tolist()
    other, number = edges.other.tolist(), number_of[edges.face].tolist()
    lower: dict[int, list[_Ends]] = defaultdict(list)
    for k in np.flatnonzero(above_wall & ~falls_behind).tolist():
        lower[other[k]].append(ends[k])
    level = _are_level(edges, edges.face)
    found: dict[tuple[tuple[int, ...], str], list[_Ends]] = defaultdict(list)
    for k in np.flatnonzero(above_wall & falls_behind).tolist():
        outer = EAVE if level[k] else VERGE
        for kind, piece in _parted(ends[k], lower.get(other[k], []), outer):
            found[(number[k],), kind].append(piece)
    folds = _folds(edges, level).tolist()
    between = is_roof[edges.face] & is_roof[edges.other] & (edges.face < edges.other)
    for k in np.flatnonzero(between).tolist():
        if folds[k]:
            found[(number[k], int(number_of[other[k]])), folds[k]].append(ends[k])
    return [
        RoofLine(kind, np.array(line), faces)
        for (faces, kind), pieces in sorted(found.items())
        for line in _joined(pieces)
    ]


#: Kinds of corners: where a step, a valley, a ridge, a hip ends, in this order; else it is one of the eaves.
CORNER_KINDS = (STEP, VALLEY, RIDGE, HIP, EAVE)
#: Coordinates are written to this [m].
_GRID = 1e-3


def corner_kinds(solid: Solid, lines: Sequence[RoofLine]) -> dict[int, str]:
    """
    Return the kind of each corner of a roof, by the row of its vertex.

    A corner is where a line of the roof ends: ``step`` above a wall that ends on a lower roof; else
    ``valley`` at a valley, ``ridge`` at the end of a ridge, ``hip`` at a hip's lower end or where hips alone
    meet, and ``eave`` at the rest, the ends of eaves and verges.
    """
    kinds: dict[tuple[int, ...], set[str]] = defaultdict(set)
    for line in lines:
        for end in np.rint(line.ends / _GRID).astype(np.int64).tolist():
            kinds[tuple(end)].add(EAVE if line.kind == VERGE else line.kind)
    places = np.rint(solid.vertices / _GRID).astype(np.int64).tolist()
    found = {}
    for row, place in enumerate(places):
        own = kinds.get(tuple(place), set())
        if own:
            found[row] = next(kind for kind in CORNER_KINDS if kind in own)
    return found


def _edges(solid: Solid) -> _Edges:
    rings = [(number, ring) for number, face in enumerate(solid.faces) for ring in face]
    start = np.fromiter((k for _, ring in rings for k in ring), dtype=np.int64)
    end = np.fromiter((k for _, ring in rings for k in (*ring[1:], *ring[:1])), dtype=np.int64)
    face = np.repeat([number for number, _ in rings], [len(ring) for _, ring in rings])
    n_vertices = len(solid.vertices)
    way, back = start * n_vertices + end, end * n_vertices + start
    order = np.argsort(way, kind="stable")
    place = np.searchsorted(way[order], back, side="right") - 1
    other = np.where(way[order[place]] == back, face[order[place]], -1)
    # Newell's method (shell.area_vector) for all faces at once
    corners = solid.vertices - solid.vertices[0]
    areas = np.zeros((len(solid.faces), 3))
    np.add.at(areas, face, cross(corners[start], corners[end]))
    return _Edges(face, other, solid.vertices[np.column_stack([start, end])], _unit(areas))


def _folds(edges: _Edges, level: NDArray[np.bool_]) -> NDArray[np.str_]:
    """Return the kind of the line between the two faces of each edge; empty for none."""
    one, other = edges.normals[edges.face], edges.normals[edges.other]
    turn = np.einsum("ij,ij->i", cross(one, other), _unit(edges.ends[:, 1] - edges.ends[:, 0]))
    is_flat = (np.abs(turn) < _LEAST_FOLD) & (np.einsum("ij,ij->i", one, other) > 0.0)
    level = level | _are_level(edges, edges.other)
    return np.select([is_flat, turn < 0.0, level], ["", VALLEY, RIDGE], HIP)


def _are_level(edges: _Edges, faces: IntArray) -> NDArray[np.bool_]:
    x, y, z = np.abs(edges.ends[:, 1] - edges.ends[:, 0]).T
    normals = edges.normals[faces]
    steepness = np.hypot(normals[:, 0], normals[:, 1]) / np.maximum(normals[:, 2], 1e-9)
    return np.asarray(z < np.maximum(_LEVEL_SHARE * steepness, _FLAT) * np.hypot(x, y))


def _parted(ends: _Ends, lower: list[_Ends], outer: str) -> list[tuple[str, _Ends]]:
    """Part a line above a wall into steps, where the wall's foot stands on roofs, and the outer rest."""
    (x, y, z), end = ends
    along = (end[0] - x, end[1] - y, end[2] - z)
    length = math.hypot(along[0], along[1])
    if length < _SHORTEST:
        return []
    if not lower:
        return [(outer, ends)]
    spans = sorted(
        sorted(
            min(max(((px - x) * along[0] + (py - y) * along[1]) / length**2, 0.0), 1.0) for px, py, _ in foot
        )
        for foot in lower
    )
    pieces, done = [], 0.0
    for low, high in [*spans, (1.0, 1.0)]:
        first = max(low, done)
        pieces += [(outer, done, first), (STEP, first, max(high, first))]
        done = max(high, done)
    return [
        (kind, [[x + k * along[0], y + k * along[1], z + k * along[2]] for k in (low, high)])
        for kind, low, high in pieces
        if (high - low) * length >= _SHORTEST
    ]


def _joined(pieces: list[_Ends]) -> list[_Ends]:
    lines = list(pieces)
    for k in range(len(lines) - 1, -1, -1):
        for j, before in enumerate(lines):
            if j != k and _goes_on(before, lines[k]):
                lines[j] = [before[0], lines[k][1]]
                del lines[k]
                break
    return lines


def _goes_on(before: _Ends, after: _Ends) -> bool:
    if math.dist(before[1], after[0]) >= _SHORTEST:
        return False
    (ax, ay, az), (bx, by, bz) = (map(sub, end, start) for start, end in (before, after))
    straight = ax * bx + ay * by + az * bz
    turn = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return straight > 0.0 and turn < _LEAST_FOLD * math.hypot(straight, turn)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))
