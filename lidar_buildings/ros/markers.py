"""Solids as markers for RViz."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.ros.stamps import header_of

#: With a building's id it names its marker.
_NAMESPACE = "buildings"
#: Width of the lines [m].
_WIDTH = 0.15
_COLOUR = ColorRGBA(r=1.0, g=0.6, b=0.1, a=1.0)


def model_markers(
    stamp: int, buildings: Mapping[int, Iterable[Solid]], withdrawn: Iterable[int] = ()
) -> MarkerArray:
    """
    Return the edges of each building's solids as a list of lines that replaces the one shown before.

    A building without solids is shown no more, nor are those withdrawn.
    """
    shown = {number: [edge for solid in of for edge in _edges(solid)] for number, of in buildings.items()}
    return MarkerArray(
        markers=[_marker(stamp, number, ()) for number in withdrawn]
        + [_marker(stamp, number, segments) for number, segments in shown.items()]
    )


def _marker(stamp: int, building_id: int, segments: Sequence[NDArray[np.float64]]) -> Marker:
    """Return a building's lines, or without any the message that deletes them."""
    marker = Marker(
        header=header_of(stamp),
        ns=_NAMESPACE,
        id=building_id - (building_id >> 31 << 32),  # a marker's id has a sign
        type=Marker.LINE_LIST,
        action=Marker.ADD if len(segments) else Marker.DELETE,
        scale=Vector3(x=_WIDTH),
        color=_COLOUR,
        points=[Point(x=x, y=y, z=z) for segment in segments for x, y, z in segment.tolist()],
    )
    marker.pose.orientation.w = 1.0
    return marker


def _edges(solid: Solid) -> list[NDArray[np.float64]]:
    """Return a solid's edges, each of shape (2, 3) and each once."""
    rings = [ring for face in solid.faces for ring in face]
    pairs = {
        (min(pair), max(pair)) for ring in rings for pair in zip(ring, (*ring[1:], ring[0]), strict=True)
    }
    return [solid.vertices[list(pair)] for pair in sorted(pairs)]
