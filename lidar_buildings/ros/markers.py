"""Solids as markers for RViz."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.ros.stamps import header_of

#: Width of the lines [m].
_WIDTH = 0.15
_COLOUR = ColorRGBA(r=1.0, g=0.6, b=0.1, a=1.0)


def model_markers(stamp: int, solids: Iterable[Solid]) -> MarkerArray:
    """Return the edges of a tile's solids as one list of lines; the tile's stamp is its namespace."""
    segments = [segment for solid in solids for segment in _edges(solid)]
    marker = Marker(
        header=header_of(stamp),
        ns=f"tile_{stamp}",
        type=Marker.LINE_LIST,
        action=Marker.ADD,
        scale=Vector3(x=_WIDTH),
        color=_COLOUR,
        points=[Point(x=x, y=y, z=z) for segment in segments for x, y, z in segment.tolist()],
    )
    marker.pose.orientation.w = 1.0
    return MarkerArray(markers=[marker])


def _edges(solid: Solid) -> list[NDArray[np.float64]]:
    """Return a solid's edges, each of shape (2, 3) and each once."""
    rings = [ring for face in solid.faces for ring in face]
    pairs = {
        (min(pair), max(pair)) for ring in rings for pair in zip(ring, (*ring[1:], ring[0]), strict=True)
    }
    return [solid.vertices[list(pair)] for pair in sorted(pairs)]
