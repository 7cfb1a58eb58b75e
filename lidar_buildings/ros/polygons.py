"""
Rings to geometry_msgs/PolygonInstanceStamped and back.

One message is one ring, open, with the building's id: the outer ring first and counter-clockwise, its holes
after it and clockwise. A message with id −1 and no vertices closes the tile on its topic; one without
vertices and another id says that there is no such building any more.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from geometry_msgs.msg import Point32, Polygon, PolygonInstance, PolygonInstanceStamped
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import BEYOND, MAX_ID, are_held
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


def ring_message(stamp: int, building_id: int, ring: Ring) -> PolygonInstanceStamped:
    """Return one ring, shape (n_vertices, 3), as a message."""
    points = [Point32(x=x, y=y, z=z) for x, y, z in ring.tolist()]
    polygon = PolygonInstance(polygon=Polygon(points=points), id=building_id)
    return PolygonInstanceStamped(header=header_of(stamp), polygon=polygon)


def outline_rings(outlines: Iterable[BuildingOutline]) -> Rings:
    """Return the rings of a tile's outlines, at the elevation of the ground if it is known."""
    found = {}
    for one in outlines:
        ground = 0.0 if one.ground_elevation is None else one.ground_elevation or _NOT_ZERO
        found[one.building_id] = tuple(np.insert(ring, 2, ground, axis=1) for ring in one.outline.rings)
    return found


def ring_messages(stamp: int, rings: Rings) -> Iterator[PolygonInstanceStamped]:
    """Yield every ring of a tile, then the closing message."""
    for number, of_building in rings.items():
        for ring in of_building or (_NO_RING,):
            yield ring_message(stamp, number, ring)
    yield ring_message(stamp, CLOSING_ID, _NO_RING)


def ring_of(message: PolygonInstanceStamped) -> Ring:
    """Return a message's vertices, shape (n_vertices, 3); MessageError if its id or a vertex cannot be."""
    number = message.polygon.id
    if not (number == CLOSING_ID or 0 <= number <= MAX_ID):
        raise MessageError(f"polygon {number}: an id is within 0 to {MAX_ID}")
    corners = [(p.x, p.y, p.z) for p in message.polygon.polygon.points]
    ring = np.array(corners, dtype=np.float64).reshape(-1, 3)
    if not (held := are_held(ring)).all():
        vertex = ring[np.argmin(held)].tolist()
        raise MessageError(f"polygon {number} has the vertex {vertex}: not finite, or {BEYOND}")
    return ring


class RingCollector:
    """
    Gathers the rings of one topic by stamp.

    A tile may come again after it was closed, or half of it may come twice when its sender was restarted:
    a ring that equals its building's first ring starts that building anew. A building of which only a message
    without vertices came has no rings.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[int, dict[int, list[Ring]]] = OrderedDict()

    def add(self, message: PolygonInstanceStamped) -> Rings | None:
        """Take one message; return all rings of its tile if it closes the tile."""
        stamp, number, ring = to_stamp(message.header.stamp), message.polygon.id, ring_of(message)
        if number == CLOSING_ID and not len(ring):
            return {key: tuple(value) for key, value in self._open.pop(stamp, {}).items()}
        rings = self._open.setdefault(stamp, {}).setdefault(number, [])
        if rings and np.array_equal(rings[0], ring):
            rings.clear()
        if len(ring):
            rings.append(ring)
        while len(self._open) > _MAX_OPEN_TILES:
            self._open.popitem(last=False)
        return None


def outlines_of(rings: Rings) -> tuple[BuildingOutline, ...]:
    """
    Assemble the outlines of a tile, by rising building id.

    What was withdrawn is left out, and so are holes whose outer ring was lost. Of two outer rings the later
    one counts.
    """
    outlines = []
    for number in sorted(rings):
        of_building = [ring for ring in rings[number] if len(ring)]
        outer = [k for k, ring in enumerate(of_building) if signed_area(ring[:, :2]) >= 0]
        if outer:
            exterior, *holes = of_building[outer[-1] :]
            outline = Outline(exterior[:, :2], tuple(hole[:, :2] for hole in holes))
            outlines.append(BuildingOutline(number, outline, float(exterior[0, 2]) or None))
    return tuple(outlines)
