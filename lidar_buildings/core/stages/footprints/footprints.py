"""Given footprints: polygons repaired until models can stand on them, and the ids of their buildings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import CELL, building_id
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.output_grid import made_valid, polygons_of

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
        whole = made_valid(pieces)
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


@dataclass(frozen=True, eq=False)
class Footprints:
    """Outlines that are given, each of one building."""

    outlines: tuple[Outline, ...]  #: as a message carries them, map frame [m]
    building_id: NDArray[np.uint32]  #: unique, shape (n_footprints,)
    bounds: NDArray[np.float64]  #: west, south, east and north limit of each [m], shape (n_footprints, 4)
    area: NDArray[np.float64]  #: without courtyards [m²], shape (n_footprints,)

    def __len__(self) -> int:
        """Return the number of footprints."""
        return len(self.outlines)

    def touching(self, box: tuple[float, float, float, float]) -> NDArray[np.intp]:
        """
        Return the footprints whose bounds reach into a box, the largest first, equal ones by falling id.
        """
        west, south, east, north = box
        low, high = self.bounds[:, :2], self.bounds[:, 2:]
        rows = np.flatnonzero((low <= (east, north)).all(axis=1) & (high >= (west, south)).all(axis=1))
        return rows[np.lexsort((self.building_id[rows], self.area[rows]))[::-1]]

    def near(self, box: tuple[float, float, float, float]) -> Footprints:
        """Return the footprints whose bounds reach into a box alone."""
        rows = np.sort(self.touching(box))
        outlines = tuple(self.outlines[row] for row in rows)
        return Footprints(outlines, self.building_id[rows], self.bounds[rows], self.area[rows])


def footprints_of(polygons: Sequence[shapely.Polygon]) -> Footprints:
    """
    Number polygons: each building's id is that of the cell in which a point inside its footprint lies.

    Where two have their points in one cell, the one further east by its limits takes the next free cell to
    the east. So the ids depend on the footprints, not on their order nor on how points are cut into tiles.
    The polygons are as `repaired_polygons` gives them.
    """
    shapes = np.array(list(polygons), dtype=object)
    outlines = tuple(Outline.of(polygon).as_carried() for polygon in shapes)
    bounds = shapely.bounds(shapes).reshape(-1, 4)
    area = shapely.area(shapes).reshape(-1)
    anchors = shapely.get_coordinates(shapely.point_on_surface(shapes)).reshape(-1, 2)
    order = np.lexsort((area, *anchors.T[::-1], *bounds.T[::-1]))
    return Footprints(outlines, _unique_ids(anchors, order), bounds, area)


def last_polygon_around(
    xy: NDArray[np.float64], polygons: Sequence[shapely.Geometry | None]
) -> NDArray[np.int32]:
    """Return for each point the last of the polygons that it lies in, or on the edge of, −1 for none."""
    found = np.full(len(xy), -1, dtype=np.int32)
    order = np.argsort(xy[:, 0], kind="stable")
    x, y = np.ascontiguousarray(xy.take(order, axis=0).T)
    for number, polygon in enumerate(polygons):
        west, south, east, north = shapely.bounds(polygon)
        begin, end = np.searchsorted(x, west), np.searchsorted(x, east, side="right")
        near = begin + np.flatnonzero((y[begin:end] >= south) & (y[begin:end] <= north))
        shapely.prepare(polygon)
        found[order[near[shapely.intersects_xy(polygon, x[near], y[near])]]] = number
    return found


def _unique_ids(anchors: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.uint32]:
    """Give every anchor its cell's id, or that of the next cell to the east that is free."""
    numbers = np.zeros(len(anchors), dtype=np.uint32)
    taken: set[int] = set()
    for row in order:
        anchor = anchors[row].copy()
        while (number := building_id(anchor)) in taken:
            anchor[0] += CELL
        taken.add(number)
        numbers[row] = number
    return numbers
