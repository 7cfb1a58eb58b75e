"""What of a result is drawn: coloured triangles, lines and points in the map frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE
from lidar_buildings.report.contents import FACADE, KINDS, UNKNOWN, Contents, ModelArrays, Relief, ShownPoints
from lidar_buildings.report.view import NOTHING


def _rgb(text: str) -> NDArray[np.float64]:
    return np.array([[int(one[k : k + 2], 16) for k in (0, 2, 4)] for one in text.split()]) / 255


WALL, FOOT, EDGE, NONE, TERRAIN, OUTLINE, EDGE_POINT = _rgb(
    "e8e3d8 a7a79c 30363e c3c8cd cfd2bd 1b1f6a d3261e"
)
SLOPES = _rgb("f6e6b4 f0b873 df7d50 b3453b 6e2440")
#: Slope that has the last of these.
STEEP_DEG = 60.0
HEIGHTS = _rgb("30408f 2f8fb3 5fc08a e0d65c d8653a")
GREYS = _rgb("202020 f4f4f4")
#: By ASPRS class.
CLASSES = np.tile(_rgb("b9b9b9"), (256, 1))
CLASSES[[2, 3, 4, 5, 6, 9, 10, 11, 17]] = _rgb(
    "a98a64 a8cf7a 74b35a 3f8a43 d1503f 3d85c6 7a6a8a 8d8f94 c79a3e"
)
_PALETTE = _rgb("4e79a7 f28e2b 59a14f b07aa1 76b7b2 edc948 e15759 9c755f ff9da7 86bcb6 d4a6c8 8cd17d")


def ramp(stops: NDArray[np.float64], shares: NDArray[Any]) -> NDArray[np.float64]:
    """Return the colours at places from 0 to 1 along a row of colours."""
    places = np.clip(shares, 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(places, np.arange(len(stops)), one) for one in stops.T], axis=-1)


def numbered(numbers: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return a colour for each number."""
    return _PALETTE[numbers % len(_PALETTE)]


_Array = NDArray[Any]
#: Where the light comes from, and how bright a face is that looks away from it.
_LIGHT, _SHADE = np.array([-0.45, -0.55, 0.70]), 0.4
#: Lines lie this far before what they run along [m].
_LIFT = 0.07
#: A triangle's corners need 16 bits for its face and 23 for each of two vertices to fit into one number.
_FACE_BITS, _VERTEX_BITS = 16, 23


class Coloured(NamedTuple):
    """Triangles, lines or points."""

    #: The three corners of triangles, two ends of lines, or single points, map frame [m], shape (n, k, 3).
    places: _Array
    colours: _Array  #: of each, from 0 to 1, shape (n, 3)


def parts_of(contents: Contents, roofs: str, points: str) -> list[Coloured]:
    """Return what is drawn: models and points, and where there are no points the terrain."""
    types = [str(one.attributes.get("roof_type") or "unknown") for one in contents.buildings]
    parts = [] if roofs == NOTHING else models_of(contents.models, types, roofs)
    if points != NOTHING:
        shown = contents.points
        places = shown.corner + shown.steps * shown.step
        parts.append(Coloured(places[:, None], _point_colours(shown, points)))
    elif contents.terrain is not None:
        parts.append(_terrain(contents.terrain))
    # at the foot points of roofs would hide them
    is_at_foot = roofs != NOTHING or points == NOTHING
    parts.append(_outlines(contents, "ground_elevation" if is_at_foot else "roof_elevation_50p"))
    return [one for one in parts if len(one.places)]


def models_of(arrays: ModelArrays, types: Sequence[str], by: str) -> list[Coloured]:
    """Return the finest solid of each building, and its edges."""
    triangles, rows = _finest(arrays)
    corners = (arrays.vertices * GRID)[arrays.triangles[triangles]]
    kinds, normals = arrays.kinds[triangles], _normals(corners)
    if by == "slope":
        slopes = np.degrees(np.arccos(np.clip(normals[:, 2], -1, 1)))
        roofs = ramp(SLOPES, slopes / STEEP_DEG)
    else:
        numbers = np.unique(types, return_inverse=True)[1] if types else np.empty(0, dtype=np.int64)
        roofs = numbered(numbers[rows])
    roofs[kinds != KINDS[ROOF_SURFACE]] = WALL
    roofs[kinds == KINDS[GROUND_SURFACE]] = FOOT
    edges = _borders(arrays, triangles, normals)
    return [_shaded(corners, roofs, normals), _plain(edges, EDGE)]


def _terrain(relief: Relief) -> Coloured:
    row, column = np.indices(relief.steps.shape)
    x = relief.west + (column + 0.5) * relief.cell[0]
    y = relief.north - (row + 0.5) * relief.cell[1]
    z = np.where(relief.steps == UNKNOWN, np.nan, relief.middle + relief.steps * relief.step)
    places = np.stack([x, y, z], axis=-1)
    a, b, c, d = places[:-1, :-1], places[:-1, 1:], places[1:, :-1], places[1:, 1:]
    corners = np.stack([a, c, b, b, c, d], axis=2).reshape(-1, 3, 3)
    corners = corners[~np.isnan(corners).any(axis=(1, 2))]
    return _shaded(corners, np.tile(TERRAIN, (len(corners), 1)), _normals(corners))


def _outlines(contents: Contents, attribute: str) -> Coloured:
    """Return the outlines at the elevation that an attribute tells, at the foot of all where it does not."""
    frame = contents.result.frame
    lowest = float(contents.models.vertices[:, 2].min(initial=0)) * GRID
    ends = [np.empty((0, 2, 3))]
    for building in contents.buildings:
        told = building.attributes.get(attribute)
        z = lowest if told is None else told * contents.result.unit - frame.origin[2]
        for ring in shapely.get_rings(building.shape) if building.shape is not None else ():
            places = np.insert(shapely.get_coordinates(ring), 2, z + _LIFT, axis=1)
            ends.append(np.stack([places[:-1], places[1:]], axis=1))
    return _plain(np.concatenate(ends), OUTLINE)


def _point_colours(shown: ShownPoints, by: str) -> _Array:
    if by == "class":
        return CLASSES[shown.classes & ~np.uint8(FACADE)]
    if by == "height":
        return ramp(HEIGHTS, shown.height / max(_most(shown.height), 1.0))
    if by == "intensity":
        return ramp(GREYS, shown.intensity / max(_most(shown.intensity), 1.0))
    if by == "edge":
        return np.where(shown.edge[:, None], EDGE_POINT, NONE)
    found = {"building": shown.building, "plane": shown.plane}[by]
    # neighbouring numbers get colours that lie apart
    return np.where(found[:, None] > 0, numbered(found.astype(np.int64) * 7), NONE)


def _most(values: _Array) -> float:
    return float(np.percentile(values, 99)) if len(values) else 0.0


def _finest(arrays: ModelArrays) -> tuple[_Array, _Array]:
    """Return the triangles of each building's finest solid, and their buildings' rows."""
    by_level = arrays.solids[np.argsort(arrays.solids[:, 1], kind="stable")]
    finest = {row: (first, n) for row, _, first, n in by_level.tolist()}
    parts = [np.arange(first, first + n) for first, n in finest.values()]
    lengths = [n for _, n in finest.values()]
    rows = np.repeat(np.array(list(finest), dtype=np.int64), lengths)
    return np.concatenate([*parts, np.empty(0, dtype=np.int64)]), rows


def _borders(arrays: ModelArrays, triangles: _Array, normals: _Array) -> _Array:
    """Return the ends of the lines between faces, shape (n, 2, 3), a little before both."""
    corners = arrays.triangles[triangles].astype(np.int64)
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    of_face = (sides[:, 0] << _VERTEX_BITS | sides[:, 1]) << _FACE_BITS | np.repeat(
        arrays.faces[triangles], 3
    )
    found, first, count = np.unique(of_face, return_index=True, return_counts=True)
    is_border = count == 1  # a cut through a face is a side of two of its triangles
    lines, line = np.unique(found[is_border] >> _FACE_BITS, return_inverse=True)
    outwards = np.zeros((len(lines), 3))
    np.add.at(outwards, line, normals[first[is_border] // 3])
    ends = np.stack([lines >> _VERTEX_BITS, lines & ((1 << _VERTEX_BITS) - 1)], axis=1)
    return arrays.vertices[ends] * GRID + _LIFT * outwards[:, None]


def _normals(corners: _Array) -> _Array:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)


def _shaded(corners: _Array, plain: _Array, normals: _Array) -> Coloured:
    brightness = _SHADE + (1 - _SHADE) * (1 + normals @ _LIGHT) / 2
    return Coloured(corners, plain * brightness[:, None])


def _plain(places: _Array, colour: Sequence[float]) -> Coloured:
    return Coloured(places, np.tile(colour, (len(places), 1)))
