"""Whatever a file calls a polygon, made into polygons that models can stand on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

#: Grid of the vertices [m]: finer than any survey, coarser than what another projection adds.
_GRID = 1e-3
#: Narrower or smaller pieces are left over from drawing, not buildings [m], [m²].
_MIN_WIDTH, _MIN_AREA = 0.05, 0.1
#: A piece that a repair splits off must have this share of the largest one to count as a building's part.
_MIN_PIECE = 0.01
#: Two footprints that share so much of what they cover together are the same one, drawn twice.
_SAME = 0.98
#: Vertices of the smallest ring, the first one again at its end.
_MIN_RING = 4
#: How often rounding may spoil a polygon and be tried again.
_MAX_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Repairs:
    """Polygons that were made of what was given."""

    polygons: NDArray[Any]  #: valid, in the plane, without repeated vertices
    row: NDArray[np.intp]  #: from which geometry each was made
    #: Reason → how many geometries or parts were left out.
    dropped: Mapping[str, int] = field(default_factory=dict)
    n_repaired: int = 0  #: geometries that had to be repaired


def repaired_polygons(geometries: NDArray[Any]) -> Repairs:
    """
    Make valid polygons of whatever geometries; the parts of a multi-polygon become polygons of their own.

    Rings that cross themselves are repaired by structure (GEOS `make_valid`): every area that an outer ring
    encloses counts, less its holes. Vertices, near the origin, are rounded to a millimetre.
    """
    dropped: Counter[str] = Counter()
    found: list[shapely.Polygon] = []
    rows: list[int] = []
    n_repaired = 0
    sound = _sound_as_they_are(geometries)
    for row, geometry in enumerate(geometries):
        if sound[row] is not None:
            found.append(sound[row])
            rows.append(row)
            continue
        pieces, is_repaired = _pieces(geometry, dropped)
        n_repaired += is_repaired and bool(pieces)
        found += pieces
        rows += [row] * len(pieces)
    polygons, row_of = _objects(found), np.array(rows, dtype=np.intp)
    first = _first_of_its_kind(polygons)
    dropped["drawn twice"] += int(np.count_nonzero(~first))
    return Repairs(polygons[first], row_of[first], _positive(dropped), n_repaired)


def _sound_as_they_are(geometries: NDArray[Any]) -> NDArray[Any]:
    """
    Return those polygons rounded that need nothing else, None for all others: of most files that is all.
    """
    sound = np.full(len(geometries), None, dtype=object)
    rows = np.flatnonzero(shapely.get_type_id(geometries) == shapely.GeometryType.POLYGON)
    rows = rows[shapely.is_valid(geometries[rows])]
    rounded = shapely.transform(shapely.force_2d(geometries[rows]), _carried)
    kept = shapely.is_valid(rounded) & (shapely.area(rounded) >= _MIN_AREA)
    kept &= 2.0 * shapely.area(rounded) >= _MIN_WIDTH * shapely.length(rounded)
    sound[rows[kept]] = shapely.remove_repeated_points(rounded[kept], 0.0)
    return sound


def _pieces(geometry: Any, dropped: Counter[str]) -> tuple[list[shapely.Polygon], bool]:
    """Return the polygons that one geometry becomes, and whether it had to be repaired."""
    if geometry is None or shapely.is_empty(geometry):
        dropped["empty"] += 1
        return [], False
    flat = shapely.force_2d(geometry)
    if not np.isfinite(shapely.get_coordinates(flat)).all():
        dropped["with coordinates that are no numbers"] += 1
        return [], False
    parts = _polygons_in(flat)
    if not parts:
        dropped["no polygon"] += 1
    is_valid = bool(parts) and bool(shapely.is_valid(flat))
    # parts that touch or overlap are buildings of their own, so each is repaired by itself
    pieces = [piece for part in parts for piece in _sound(part, dropped)]
    return pieces, not is_valid


def _sound(polygon: shapely.Polygon, dropped: Counter[str]) -> list[shapely.Polygon]:
    """Return a polygon as valid ones with vertices that messages and files can carry."""
    pieces = [polygon]
    for _ in range(_MAX_ROUNDS):
        pieces = [rounded for piece in pieces if not (rounded := _rounded(piece)).is_empty]
        if all(shapely.is_valid(piece) for piece in pieces):
            break
        pieces = [part for piece in pieces for part in _polygons_in(_made_valid(piece))]
    sound = [piece for piece in pieces if shapely.is_valid(piece) and not _is_sliver(piece)]
    largest = max((piece.area for piece in sound), default=0.0)
    sound = [piece for piece in sound if piece.area >= _MIN_PIECE * largest]
    if not sound:
        dropped["too small or too narrow"] += 1
    return sound


def _rounded(polygon: shapely.Polygon) -> shapely.Polygon:
    """Return a polygon with its vertices on the grid and in float32, none repeated."""

    shell, *holes = [_ring(one) for one in (polygon.exterior, *polygon.interiors)]
    if len(shell) < _MIN_RING:
        return shapely.Polygon()
    return shapely.Polygon(shell, [hole for hole in holes if len(hole) >= _MIN_RING])


def _ring(ring: shapely.LinearRing) -> NDArray[np.float64]:
    """Return a ring's vertices on the grid, closed."""
    xy = _carried(shapely.get_coordinates(ring))
    return xy[np.append(True, (xy[1:] != xy[:-1]).any(axis=1))]


def _carried(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions on the grid as messages carry them."""
    return (np.round(xy / _GRID) * _GRID).astype(np.float32).astype(np.float64)


def _made_valid(polygon: shapely.Polygon) -> Any:
    """Return what a polygon's rings enclose."""
    return shapely.make_valid(polygon, method="structure", keep_collapsed=False)


def _polygons_in(geometry: Any) -> list[shapely.Polygon]:
    """Return the polygons that are in a geometry, those in collections too."""
    kind = shapely.get_type_id(geometry)
    if kind == shapely.GeometryType.POLYGON:
        return [] if shapely.is_empty(geometry) else [geometry]
    if kind in (shapely.GeometryType.MULTIPOLYGON, shapely.GeometryType.GEOMETRYCOLLECTION):
        return [one for part in shapely.get_parts(geometry) for one in _polygons_in(part)]
    return []


def _is_sliver(polygon: shapely.Polygon) -> bool:
    """Whether a polygon is too small or too narrow to be a building."""
    width = 2.0 * polygon.area / polygon.length if polygon.length else 0.0
    return bool(polygon.area < _MIN_AREA or width < _MIN_WIDTH)


def _first_of_its_kind(polygons: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which polygons are not the same as an earlier one."""
    is_first = np.ones(len(polygons), dtype=bool)
    if len(polygons) < 2:
        return is_first
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    earlier = one < other
    one, other = one[earlier], other[earlier]
    area = shapely.area(polygons)
    alike = np.minimum(area[one], area[other]) >= _SAME * np.maximum(area[one], area[other])
    one, other = one[alike], other[alike]
    shared = shapely.area(shapely.intersection(polygons[one], polygons[other]))
    same = shared >= _SAME * (area[one] + area[other] - shared)
    is_first[other[same]] = False
    return is_first


def _objects(polygons: list[shapely.Polygon]) -> NDArray[Any]:
    """Put polygons into an array."""
    array = np.empty(len(polygons), dtype=object)
    array[:] = polygons
    return array


def _positive(counted: Counter[str]) -> dict[str, int]:
    """Return what was counted at all, by name."""
    return {name: number for name, number in sorted(counted.items()) if number}
