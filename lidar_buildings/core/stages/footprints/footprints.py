"""Given footprints: polygons repaired until models can stand on them, their ids, and their points."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.model.classes import FacadeClass, PointClass
from lidar_buildings.core.model.ids import CELL, anchor_row, building_id
from lidar_buildings.core.model.outline import BuildingOutline, Outline, ring_walls
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.output_grid import made_valid, polygons_of
from lidar_buildings.core.stages.footprints.config import FootprintConfig

#: Grid of the vertices [m]: finer than any survey, coarser than what another projection adds.
_GRID = 1e-3
#: Narrower or smaller pieces are left over from drawing, not buildings [m], [m²].
_MIN_WIDTH, _MIN_AREA = 0.05, 0.1
#: A piece that a repair splits off must have this share of the largest one to count as a building's part.
_MIN_PIECE = 0.01
#: Two footprints that share so much of what they cover together are the same one, drawn twice.
_SAME = 0.98
#: Stands for a geometry that was left out.
_NOWHERE = shapely.Point()
#: Polygons of more vertices than this are simplified: what is built on one takes time as the square of them.
#: Of those that cannot be, or only in coarser steps than the last one, so many are the most.
_SIMPLE, _MOST_VERTICES = 1_000, 5_000
#: Steps of that [m]: finer than any survey, up to what outlines of surveys are off by.
_STEPS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
#: Rings of more vertices are not simplified further: GEOS takes time as the square of those that stay.
_MOST_SIMPLIFIED = 25_000
#: How often rounding may spoil a polygon and be tried again.
_MAX_ROUNDS = 4
#: A polygon whose walls meet in more places beside its corners is a scribble: each part between them would be
#: a building, and GEOS takes time as the square of them.
_MOST_CROSSINGS = 500
#: Walls of a block when crossings are counted.
_BLOCK = 256
#: Footprints whose centres lie in one square of this side are first compared with the first of them [m].
_PLACE = 0.1


@dataclass(frozen=True, eq=False)
class Repairs:
    """Polygons that were made of what was given."""

    polygons: NDArray[Any]  #: valid, in the plane, without repeated vertices
    row: NDArray[np.intp]  #: from which geometry each was made
    #: Reason → how many geometries or parts were left out.
    dropped: Mapping[str, int] = field(default_factory=dict)
    n_repaired: int = 0  #: geometries that had to be repaired
    n_simplified: int = 0  #: polygons that had more vertices than a model can have


def repaired_polygons(geometries: NDArray[Any]) -> Repairs:
    """
    Make valid polygons of whatever geometries; the parts of a multi-polygon become polygons of their own.

    Rings that cross themselves are repaired by structure (GEOS `make_valid`): every area that an outer ring
    encloses counts, less its holes. Vertices, near the origin, are rounded to a millimetre. Polygons of
    thousands of vertices are simplified (Douglas and Peucker, 1973) in steps as fine as suffice.
    """
    dropped: Counter[str] = Counter()
    geometries, n_simplified = _simplified(_that_can_be(geometries, dropped), dropped)
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
        if geometry is _NOWHERE:
            continue
        pieces, is_repaired = ([plain[row]], False) if plain[row] else _pieces(geometry, dropped)
        n_repaired += is_repaired and bool(pieces)
        found += pieces
        rows += [row] * len(pieces)
    polygons, row_of = np.empty(len(found), dtype=object), np.array(rows, dtype=np.intp)
    polygons[:] = found
    first = _first_of_its_kind(polygons)
    dropped["drawn twice"] += int(np.count_nonzero(~first))
    counted = {name: number for name, number in sorted(dropped.items()) if number}
    return Repairs(polygons[first], row_of[first], counted, n_repaired, n_simplified)


def _simplified(geometries: NDArray[Any], dropped: Counter[str]) -> tuple[NDArray[Any], int]:
    """Return geometries whose polygons have no more vertices than models can, and how many were changed."""
    large = np.flatnonzero(shapely.get_num_coordinates(geometries) > _SIMPLE)
    geometries, n_simplified = geometries.copy(), 0
    for row in large.tolist():
        parts = polygons_of(shapely.force_2d(geometries[row]))
        if not any(shapely.get_num_coordinates(part) > _SIMPLE for part in parts):
            continue
        pieces = [_simplified_polygon(part) for part in parts]
        kept = [piece for piece in pieces if piece is not None]
        n_simplified += sum(piece is not part for piece, part in zip(pieces, parts, strict=True))
        dropped["with too many vertices"] += len(pieces) - len(kept)
        geometries[row] = shapely.MultiPolygon(kept) if kept else _NOWHERE
    return geometries, n_simplified


def _simplified_polygon(polygon: shapely.Polygon) -> shapely.Polygon | None:
    """Return a polygon of fewer vertices, itself if it has few, None if there is none in the last step."""
    rings = [np.asarray(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    if sum(map(len, rings)) <= _SIMPLE:
        return polygon
    found = None
    for step in _STEPS:
        rings = [_thinned(ring, step) for ring in rings]
        if sum(map(len, rings)) > _MOST_SIMPLIFIED:
            continue
        simple = [shapely.simplify(shapely.LinearRing(ring), step, preserve_topology=False) for ring in rings]
        outer, *holes = (ring.coords if len(ring.coords) >= 4 else None for ring in simple)
        if outer is None:
            return found
        found = shapely.Polygon(outer, [hole for hole in holes if hole is not None])
        if shapely.get_num_coordinates(found) <= _SIMPLE:
            return found
    return found if found is not None and shapely.get_num_coordinates(found) <= _MOST_VERTICES else None


def _thinned(ring: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return a closed ring without the vertices that are no further than a step from the last one before."""
    kept = [0]
    (x, y), places = ring[0].tolist(), ring[:, :2].tolist()
    for row, (east, north) in enumerate(places):
        if math.hypot(east - x, north - y) > step:
            kept.append(row)
            x, y = east, north
    last = len(ring) - 1  # the first one again
    kept = [row for row in kept if row < last]
    if len(kept) < 3:  # all of it lies within a step
        kept = [0, last // 3, 2 * last // 3]
    return ring[[*kept, last]]


def _that_can_be(geometries: NDArray[Any], dropped: Counter[str]) -> NDArray[Any]:
    """Return geometries with `_NOWHERE` for those of which a coordinate can be none."""
    coordinates, row = shapely.get_coordinates(geometries, return_index=True)
    with np.errstate(invalid="ignore"):
        can_be = (np.abs(coordinates) <= MAX_COORDINATE).all(axis=1)
    impossible = np.unique(row[~can_be])
    dropped["with coordinates that cannot be"] += len(impossible)
    kept = geometries.copy()
    kept[impossible] = _NOWHERE
    return kept


def _pieces(geometry: Any, dropped: Counter[str]) -> tuple[list[shapely.Polygon], bool]:
    if geometry is None or shapely.is_empty(geometry):
        dropped["empty"] += 1
        return [], False
    flat = shapely.force_2d(geometry)
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
    if not shapely.is_valid(pieces[0]) and _is_scribble(pieces[0]):
        dropped[f"with walls that cross more than {_MOST_CROSSINGS} times"] += 1
        return []
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


def _is_scribble(polygon: shapely.Polygon) -> bool:
    """Tell whether walls meet in more than `_MOST_CROSSINGS` places beside the corners."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    rings = [ring[(ring != np.roll(ring, 1, axis=0)).any(axis=1)] for ring in rings]
    walls = shapely.linestrings(ring_walls(rings))
    tree, n_met = shapely.STRtree(walls), 0
    for begin in range(0, len(walls), _BLOCK):
        block = walls[begin : begin + _BLOCK]
        n_met += len(tree.query(block, predicate="intersects")[0]) - 3 * len(block)  # itself, both next to it
        if n_met > 2 * _MOST_CROSSINGS:
            return True
    return False


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
    area = shapely.area(polygons)
    is_wide = (area >= _MIN_AREA) & (2.0 * area >= _MIN_WIDTH * shapely.length(polygons))
    return np.asarray(shapely.is_valid(polygons) & is_wide)


def _first_of_its_kind(polygons: NDArray[Any]) -> NDArray[np.bool_]:
    is_first = np.ones(len(polygons), dtype=bool)
    if len(polygons) < 2:
        return is_first
    # Of many copies each is compared with the first, not with all others.
    place = np.floor(shapely.get_coordinates(shapely.centroid(polygons)) / _PLACE)
    _, first, group = np.unique(place, axis=0, return_index=True, return_inverse=True)
    leader = first[group.reshape(-1)]
    row = np.flatnonzero(leader < np.arange(len(polygons)))
    is_first[row[_are_same(polygons[leader[row]], polygons[row])]] = False
    left = np.flatnonzero(is_first)
    one, other = left[shapely.STRtree(polygons[left]).query(polygons[left], predicate="intersects")]
    earlier = one < other
    one, other = one[earlier], other[earlier]
    is_first[other[_are_same(polygons[one], polygons[other])]] = False
    return is_first


def _are_same(some: NDArray[Any], others: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which polygons share `_SAME` of what they cover together with their partner."""
    one, other = shapely.area(some), shapely.area(others)
    same: NDArray[np.bool_] = np.minimum(one, other) >= _SAME * np.maximum(one, other)
    shared = shapely.area(shapely.intersection(some[same], others[same]))
    same[same] = shared >= _SAME * (one[same] + other[same] - shared)
    return same


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
        """Return the footprints whose bounds reach into a box, the largest first, then by falling id."""
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


#: Classes of what may be a building that was not recognised as one.
_STANDING = (0, 1, PointClass.LOW_VEGETATION, PointClass.MEDIUM_VEGETATION, PointClass.HIGH_VEGETATION)
#: With a smaller share of roof points among those that stand within a footprint, all that stand are taken.
_MIN_ROOF_SHARE = 0.2
#: How near points must lie around a footprint that holds none for it to be inside the data [m].
_SEARCH_DISTANCE = 5.0
#: So many last returns are enough to do without the others.
_MIN_LAST = 3
#: Points so much farther away than the nearest one still tell of the ground at a footprint [m].
_GROUND_RING = 1.0
#: Smallest side of a cell [m], and its side for sparse points [spacings]: a roof leaves no such cell empty.
_CELL, _CELL_SPACINGS = 1.0, 2.0
_EIGHT = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True, eq=False)
class AssignedPoints:
    """The footprints of a tile and their points."""

    building_id: NDArray[np.uint32]  #: 0 for points of no footprint of this tile, shape (n_points,)
    outlines: tuple[BuildingOutline, ...]  #: the footprints of this tile as they are given, by rising id
    clipped: Sides  #: on which sides one of them reaches beyond the tile's `bounds`
    is_ground: NDArray[np.bool_]  #: points of the ground within one of them, shape (n_points,)


def assign_footprints(
    tile: PointTile, footprints: Footprints, config: FootprintConfig | None = None
) -> AssignedPoints:
    """
    Find a tile's footprints and give their points, classified and with heights, their building's id.

    A footprint's points are the roof points within it, and where these leave a gap what stands there: points
    undecided, of vegetation or façades. Where roof points are next to none, all that stands within it is
    taken, of last returns if there are any. Where footprints lie over each other, the smaller one has the
    points. A footprint belongs to the tile that holds the westernmost of all points within it as a core
    point, or of those around it if there are none within.
    """
    config = config or FootprintConfig()
    building_id = np.zeros(len(tile), dtype=np.uint32)
    if not len(tile) or not len(footprints):
        return AssignedPoints(building_id, (), NONE, np.zeros(len(tile), dtype=bool))
    (west, south), (east, north) = extent_of(tile.points)[:, :2].tolist()
    far = _SEARCH_DISTANCE
    places = footprints.touching((west - far, south - far, east + far, north + far))
    owner = last_polygon_around(tile.points[:, :2], [footprints.outlines[row].polygon for row in places])
    is_core, is_roof, stands = tile.is_core, tile.is_roof, _may_stand(tile, config.min_height)
    tile_spacing = tile.point_spacing
    outlines, clipped = [], NONE
    surroundings = _Surroundings(tile.points, _SEARCH_DISTANCE)
    order = np.argsort(owner, kind="stable")
    rows_of = np.split(order, np.searchsorted(owner[order], np.arange(len(places))))[1:]
    for place, rows in zip(places, rows_of, strict=True):
        outline, number = footprints.outlines[place], int(footprints.building_id[place])
        near = rows if len(rows) else surroundings.rows_around(outline.polygon)
        if not len(near) or not is_core[near[anchor_row(tile.points[near])]]:
            continue
        reach = 0.0 if len(rows) else _SEARCH_DISTANCE
        low, high = footprints.bounds[place].reshape(2, 2)
        clipped |= Sides.passed(low, high, tile.bounds, reach)
        chosen = _building_rows(tile, rows, is_roof[rows], stands[rows], tile_spacing, config)
        building_id[chosen] = number
        next_to_it = rows if len(rows) else surroundings.nearest(near, outline.polygon)
        ground = None  # as a message carries it
        if tile.height_above_ground is not None:
            above = tile.height_above_ground[next_to_it]
            ground = float(np.float32(np.min(tile.points[next_to_it, 2] - above)))
        outlines.append(BuildingOutline(number, outline, ground))
    outlines.sort(key=lambda one: one.building_id)
    is_ground = np.zeros(len(tile), dtype=bool)
    if tile.classification is not None:
        is_ground = (owner >= 0) & (tile.classification == PointClass.GROUND)
    return AssignedPoints(building_id, tuple(outlines), clipped, is_ground)


def remark_on_points(building: PointTile) -> str:
    """Say how many of a building's points are no roof points; nothing if all are."""
    n_others = int(np.count_nonzero(~building.is_roof))
    if not n_others:
        return ""
    return f"{n_others} of {len(building)} points are what stands in the footprint where no roof points are"


class _Surroundings:
    """Finds the points around a place, up to a distance."""

    def __init__(self, points: NDArray[np.float64], distance: float) -> None:
        self._points, self._distance = points, distance
        self._order: NDArray[np.intp] | None = None

    def rows_around(self, polygon: shapely.Polygon) -> NDArray[np.intp]:
        """Return the points near a polygon with some on all sides, none for one at the points' edge."""
        if self._order is None:
            self._order = np.argsort(self._points[:, 0], kind="stable")
            self._x = self._points[self._order, 0]
        west, south, east, north = polygon.buffer(self._distance).bounds
        rows = self._order[np.searchsorted(self._x, west) : np.searchsorted(self._x, east, side="right")]
        rows = rows[(self._points[rows, 1] >= south) & (self._points[rows, 1] <= north)]
        near = shapely.points(self._points[rows, :2])
        rows = np.sort(rows[shapely.dwithin(near, polygon, self._distance)])
        hull = shapely.convex_hull(shapely.multipoints(self._points[rows, :2]))
        return rows if hull.contains(polygon.centroid) else rows[:0]

    def nearest(self, rows: NDArray[np.intp], polygon: shapely.Polygon) -> NDArray[np.intp]:
        """Return those of some points that are next to a polygon."""
        distance = shapely.distance(shapely.points(self._points[rows, :2]), polygon)
        return rows[distance <= distance.min() + _GROUND_RING]


def _may_stand(tile: PointTile, min_height: float) -> NDArray[np.bool_]:
    """Tell which points may be a building that was not recognised: undecided, vegetation or façade."""
    if tile.classification is None or tile.height_above_ground is None:
        return np.zeros(len(tile), dtype=bool)
    is_facade = (tile.classification == PointClass.BUILDING) & ~tile.is_roof
    is_candidate = np.isin(tile.classification, _STANDING) | is_facade
    return is_candidate & (tile.height_above_ground >= min_height)


def _building_rows(
    tile: PointTile,
    rows: NDArray[np.intp],
    is_roof: NDArray[np.bool_],
    stands: NDArray[np.bool_],
    spacing: float | None,
    config: FootprintConfig,
) -> NDArray[np.intp]:
    n_roof, n_standing = int(np.count_nonzero(is_roof)), int(np.count_nonzero(stands))
    if not n_standing:
        return rows[is_roof]
    if n_roof < _MIN_ROOF_SHARE * (n_roof + n_standing):
        if tile.return_number is not None and tile.number_of_returns is not None:
            last = stands & (tile.return_number[rows] >= tile.number_of_returns[rows])
            stands = last if np.count_nonzero(last) >= _MIN_LAST else stands
        return rows[is_roof | stands]
    # walls and branches have roof points beside them, parts that were not recognised have none
    counted = np.flatnonzero(is_roof | stands)
    xy = tile.points[rows[counted], :2]
    is_gap = in_gaps(xy, is_roof[counted], spacing, config.min_gap_area)
    if tile.facade is not None:
        is_gap &= tile.facade[rows[counted]] != FacadeClass.BARE  # no part of a roof that was seen
    return rows[counted[is_roof[counted] | is_gap]]


def in_gaps(
    xy: NDArray[np.float64], is_roof: NDArray[np.bool_], spacing: float | None, min_area: float
) -> NDArray[np.bool_]:
    """
    Tell which points of a footprint lie where roof points are missing, in places of some extent.

    Cells that hold points, but neither roof points nor a neighbour with such, are gathered; where enough hang
    together, `min_area` without the rim, they and the cells without roof points around them are a gap. Cells
    are aligned to the map's origin.
    """
    side = max(_CELL, _CELL_SPACINGS * (spacing or 0.0))
    cells = np.floor(xy / side).astype(np.int64)
    cells -= cells.min(axis=0) - 1
    shape = tuple(cells.max(axis=0) + 2)
    column, row = cells.T
    roof, held = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    roof[column[is_roof], row[is_roof]] = True
    held[column, row] = True
    number, n_gaps = ndimage.label(held & ~ndimage.binary_dilation(roof, _EIGHT), _EIGHT)
    n_cells = np.bincount(number.ravel(), minlength=n_gaps + 1)
    is_large = n_cells * side**2 >= min_area
    is_large[0] = False
    gaps = ndimage.binary_dilation(is_large[number], _EIGHT) & ~roof
    inside: NDArray[np.bool_] = gaps[column, row]
    return inside
