"""
Rings to geometry_msgs/PolygonInstanceStamped and back.

One message is one ring, open, with the building's id: the outer ring first and counter-clockwise, its holes
after it and clockwise. A message with id −1 and no vertices closes the tile on its topic; one without
vertices and another id says that there is no such building any more.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from geometry_msgs.msg import Point32, Polygon, PolygonInstance, PolygonInstanceStamped
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.outline import BuildingOutline, Outline, signed_area
from lidar_buildings.ros.stamps import header_of, to_stamp

Ring = NDArray[np.float64]
#: Building id → its rings as they are sent, each of shape (n_vertices, 3); none of one that is withdrawn.
Rings = Mapping[int, tuple[Ring, ...]]

#: The id of the message that closes a tile.
CLOSING_ID = -1
_NO_RING = np.zeros((0, 3))
#: An outline at z = 0 is one whose ground is not known; ground at 0 itself is sent as a micrometre [m].
_NOT_ZERO = 1e-6
#: How many tiles may be open at once; wide margin: at most 8 are in flight, more were sent again.
_MAX_OPEN_TILES = 64
#: How many vertices they may have, and for how many a ring counts beside its own: 0.5 GB. Wide margin: a
#: million buildings.
_MAX_VERTICES, _PER_RING = 20_000_000, 8


def ring_message(stamp: int, building_id: int, ring: Ring) -> PolygonInstanceStamped:
    """Return one ring, shape (n_vertices, 3), as a message."""
    points = [Point32(x=x, y=y, z=z) for x, y, z in ring.tolist()]
    polygon = PolygonInstance(polygon=Polygon(points=points), id=building_id)
    return PolygonInstanceStamped(header=header_of(stamp), polygon=polygon)


def closing_message(stamp: int) -> PolygonInstanceStamped:
    """Return the message that says that a topic has no more rings of this tile."""
    return PolygonInstanceStamped(header=header_of(stamp), polygon=PolygonInstance(id=CLOSING_ID))


def outline_rings(outlines: Iterable[BuildingOutline]) -> Rings:
    """Return the rings of a tile's outlines, at the elevation of the ground if it is known."""
    return {one.building_id: tuple(_raised(ring, one) for ring in one.outline.rings) for one in outlines}


def roof_rings(faces: Iterable[tuple[int, Sequence[Ring]]]) -> Rings:
    """Return the rings of a tile's roof faces, given as (building id, rings of a face)."""
    found: dict[int, tuple[Ring, ...]] = {}
    for number, rings in faces:
        found[number] = found.get(number, ()) + tuple(map(_as_carried, rings))
    return found


def ring_messages(stamp: int, rings: Rings) -> Iterator[PolygonInstanceStamped]:
    """Yield every ring of a tile, then the closing message."""
    for number, of_building in rings.items():
        for ring in of_building or (_NO_RING,):
            yield ring_message(stamp, number, ring)
    yield closing_message(stamp)


def ring_of(message: PolygonInstanceStamped) -> NDArray[np.float64]:
    """Return a message's vertices, shape (n_vertices, 3); MessageError if a coordinate is not finite."""
    corners = [(p.x, p.y, p.z) for p in message.polygon.polygon.points]
    ring = np.array(corners, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(ring).all():
        raise MessageError(f"polygon {message.polygon.id} has a vertex that is not finite")
    return ring


def _raised(ring: Ring, outline: BuildingOutline) -> Ring:
    ground = outline.ground_elevation
    return _as_carried(np.insert(ring, 2, 0.0 if ground is None else ground or _NOT_ZERO, axis=1))


def _as_carried(ring: Ring) -> Ring:
    """Return a ring as a message carries it."""
    return ring.astype(np.float32).astype(np.float64)


class RingCollector:
    """
    Gathers the rings of one topic by stamp.

    A tile may come again after it was closed, or half of it may come twice when its sender was restarted:
    a ring that equals its building's first ring starts that building anew. A building of which only a message
    without vertices came, has no rings.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[int, dict[int, list[Ring]]] = OrderedDict()
        self._n_vertices: dict[int, int] = {}

    def add(self, message: PolygonInstanceStamped) -> Rings | None:
        """
        Take one message; return all rings of its tile if it closes the tile.

        MessageError if a vertex is not finite.
        """
        stamp = to_stamp(message.header.stamp)
        number = message.polygon.id
        if number == CLOSING_ID and not message.polygon.polygon.points:
            rings = self._open.pop(stamp, {})
            self._n_vertices.pop(stamp, None)
            return {key: tuple(value) for key, value in rings.items()}
        self._add_ring(stamp, number, ring_of(message))
        return None

    def _add_ring(self, stamp: int, number: int, ring: Ring) -> None:
        buildings = self._open.setdefault(stamp, {})
        rings = buildings.setdefault(number, [])
        if rings and np.array_equal(rings[0], ring):
            rings.clear()
        if len(ring):
            rings.append(ring)
        self._n_vertices[stamp] = self._n_vertices.get(stamp, 0) + len(ring) + _PER_RING
        while len(self._open) > _MAX_OPEN_TILES or sum(self._n_vertices.values()) > _MAX_VERTICES:
            oldest, _ = self._open.popitem(last=False)
            self._n_vertices.pop(oldest, None)


def outlines_of(rings: Rings) -> tuple[BuildingOutline, ...]:
    """
    Assemble the outlines of a tile, by rising building id.

    What was withdrawn is left out, and so are holes whose outer ring was lost.
    """
    outlines = []
    for number in sorted(rings):
        of_building = [ring for ring in rings[number] if len(ring)]
        polygons = _polygons([ring[:, :2] for ring in of_building])
        if polygons:
            exterior, *holes = polygons[-1]
            ground = float(of_building[-1][0, 2]) or None
            outlines.append(BuildingOutline(number, Outline(exterior, tuple(holes)), ground))
    return tuple(outlines)


def _polygons(rings: list[Ring]) -> list[list[Ring]]:
    """
    Split a building's rings where an outer one begins: the first, and each that turns counter-clockwise.
    """
    polygons: list[list[Ring]] = []
    for ring in rings:
        area = signed_area(ring)
        if area > 0 or (area == 0 and not polygons):
            polygons.append([ring])
        elif polygons:
            polygons[-1].append(ring)
    return polygons
