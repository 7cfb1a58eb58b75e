"""Whatever a file calls a polygon, made into polygons that models can stand on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.solids.output_grid import polygons_of

#: Grid of the vertices [m]: finer than any survey, coarser than what another projection adds.
_GRID = 1e-3
#: Narrower or smaller pieces are left over from drawing, not buildings [m], [m²].
_MIN_WIDTH, _MIN_AREA = 0.05, 0.1
#: A piece that a repair splits off must have this share of the largest one to count as a building's part.
_MIN_PIECE = 0.01
#: Two footprints that share so much of what they cover together are the same one, drawn twice.
_SAME = 0.98
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
    # Of most files all polygons need rounding alone.
    plain = np.full(len(geometries), None, dtype=object)
    whole = np.flatnonzero(shapely.get_type_id(geometries) == shapely.GeometryType.POLYGON)
    whole = whole[shapely.is_valid(geometries[whole])]
    rounded = _rounded(geometries[whole])
    is_sound = _is_sound(rounded)
    plain[whole[is_sound]] = rounded[is_sound]
    for row, geometry in enumerate(geometries):
        pieces, is_repaired = ([plain[row]], False) if plain[row] else _pieces(geometry, dropped)
        n_repaired += is_repaired and bool(pieces)
        found += pieces
        rows += [row] * len(pieces)
    polygons, row_of = np.empty(len(found), dtype=object), np.array(rows, dtype=np.intp)
    polygons[:] = found
    first = _first_of_its_kind(polygons)
    dropped["drawn twice"] += int(np.count_nonzero(~first))
    counted = {name: number for name, number in sorted(dropped.items()) if number}
    return Repairs(polygons[first], row_of[first], counted, n_repaired)


def _pieces(geometry: Any, dropped: Counter[str]) -> tuple[list[shapely.Polygon], bool]:
    """Return the polygons that one geometry becomes, and whether it had to be repaired."""
    if geometry is None or shapely.is_empty(geometry):
        dropped["empty"] += 1
        return [], False
    flat = shapely.force_2d(geometry)
    if not np.isfinite(shapely.get_coordinates(flat)).all():
        dropped["with coordinates that are no numbers"] += 1
        return [], False
    parts = polygons_of(flat)
    if not parts:
        dropped["no polygon"] += 1
    is_valid = bool(parts) and bool(shapely.is_valid(flat))
    # parts that touch or overlap are buildings of their own, so each is repaired by itself
    pieces = [piece for part in parts for piece in _repaired(part, dropped)]
    return pieces, not is_valid


def _repaired(polygon: shapely.Polygon, dropped: Counter[str]) -> list[shapely.Polygon]:
    """Return a polygon as valid ones with vertices that messages and files can carry."""
    pieces = _rounded(np.array([polygon]))
    for _ in range(_MAX_ROUNDS):
        if shapely.is_valid(pieces).all():
            break
        whole = shapely.make_valid(pieces, method="structure", keep_collapsed=False)
        pieces = _rounded(np.array([part for one in whole for part in polygons_of(one)], dtype=object))
    sound = pieces[_is_sound(pieces)].tolist()
    largest = max((piece.area for piece in sound), default=0.0)
    sound = [piece for piece in sound if piece.area >= _MIN_PIECE * largest]
    if not sound:
        dropped["too small or too narrow"] += 1
    return sound


def _rounded(polygons: NDArray[Any]) -> NDArray[Any]:
    """Return polygons in the plane with vertices on the grid and in float32, of valid ones none repeated."""
    rounded: NDArray[Any] = shapely.transform(
        shapely.force_2d(polygons),
        lambda xy: (np.round(xy / _GRID) * _GRID).astype(np.float32).astype(np.float64),
    )
    is_valid = shapely.is_valid(rounded)
    rounded[is_valid] = shapely.remove_repeated_points(rounded[is_valid], 0.0)
    return rounded


def _is_sound(polygons: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether polygons are valid, and large and wide enough to be buildings."""
    area = shapely.area(polygons)
    is_wide = (area >= _MIN_AREA) & (2.0 * area >= _MIN_WIDTH * shapely.length(polygons))
    return np.asarray(shapely.is_valid(polygons) & is_wide)


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
