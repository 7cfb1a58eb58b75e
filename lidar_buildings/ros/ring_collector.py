"""Rings of one topic, gathered tile by tile until the closing message."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from geometry_msgs.msg import PolygonInstanceStamped

from lidar_buildings.core.model.outline import BuildingOutline, Outline, signed_area
from lidar_buildings.ros.polygons import CLOSING_ID, Ring, Rings, ring_of
from lidar_buildings.ros.stamps import to_stamp

#: How many tiles may be open at once; wide margin: at most 8 are in flight, more were sent again.
_MAX_OPEN_TILES = 64
#: How many vertices they may have, and for how many a ring counts beside its own: 0.5 GB. Wide margin: a
#: million buildings.
_MAX_VERTICES, _PER_RING = 20_000_000, 8


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
