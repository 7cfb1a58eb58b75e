"""
Rings to geometry_msgs/PolygonInstanceStamped and back.

One message is one ring, open, with the building's id: the outer ring first and counter-clockwise, its holes
after it and clockwise. A message with id −1 and no vertices closes the tile on its topic; one without
vertices and another id says that there is no such building any more.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from geometry_msgs.msg import Point32, Polygon, PolygonInstance, PolygonInstanceStamped
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.ros.stamps import header_of

Ring = NDArray[np.float64]
#: Building id → its rings as they are sent, each of shape (n_vertices, 3); none of one that is withdrawn.
Rings = Mapping[int, tuple[Ring, ...]]

#: The id of the message that closes a tile.
CLOSING_ID = -1
_NO_RING = np.zeros((0, 3))
#: An outline at z = 0 is one whose ground is not known; ground at 0 itself is sent as a micrometre [m].
_NOT_ZERO = 1e-6


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
