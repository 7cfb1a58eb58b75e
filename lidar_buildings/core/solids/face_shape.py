"""Slope, direction and area of planar faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from lidar_buildings.core.model.array_types import FloatArray

#: A face less steep than this has no direction [deg]: at a millimetre's rounding there is nothing in it.
_LEVEL = 0.05


class FaceShape(NamedTuple):
    """How a face lies in space."""

    slope_deg: float  #: angle between the face and the horizontal plane, 0 to 180: above 90 it faces down
    #: Where the face looks, clockwise from the y axis (grid north), 0 to 360; None for level faces.
    azimuth_deg: float | None
    area: float  #: in the face's own plane [m²]


def face_shape(rings: Sequence[FloatArray]) -> FaceShape:
    """
    Measure a face: the exterior, counter-clockwise seen from the side that it looks to, then its holes [m].
    """
    x, y, z = area_vector(rings)
    plan = math.hypot(x, y)
    slope = math.degrees(math.atan2(plan, z))
    is_level = min(slope, 180.0 - slope) < _LEVEL
    azimuth = None if is_level else math.degrees(math.atan2(x, y)) % 360.0
    return FaceShape(slope, azimuth, math.hypot(plan, z))


def face_plane(rings: Sequence[FloatArray]) -> tuple[float, float, float] | None:
    """
    Return a, b and c of the plane z = a x + b y + c that a face lies in, None if it does not look up.

    It passes through the middle of the exterior's vertices, which are rounded [m/m], [m].
    """
    x, y, z = area_vector(rings)
    if z <= 0.0:
        return None
    east, north, up = rings[0].mean(axis=0).tolist()
    a, b = -x / z, -y / z
    return a, b, up - a * east - b * north


def area_vector(rings: Sequence[FloatArray]) -> tuple[float, float, float]:
    """
    Return the normal of a face, as long as its area is large (Newell's method) [m²]; holes run the other way.
    """
    x = y = z = 0.0
    for ring in rings:
        corners = (ring - ring[0]).tolist()
        for (ax, ay, az), (bx, by, bz) in zip(corners, [*corners[1:], corners[0]], strict=True):
            x += ay * bz - az * by
            y += az * bx - ax * bz
            z += ax * by - ay * bx
    return 0.5 * x, 0.5 * y, 0.5 * z
