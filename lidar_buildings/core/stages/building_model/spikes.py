"""Corners of roofs that no point explains."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.grade import Cause, Doubt
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, area_vector
from lidar_buildings.core.stages.building_model.cell_costs import AROUND, heights_near

#: A corner may lie so far above or below the points around, besides slope × spacing [m].
MARGIN = 0.5
#: Plan of a face that is upright [m²].
_LEAST_PLAN = 1e-9


class Spike(NamedTuple):
    """A vertex that no point explains."""

    xyz: tuple[float, float, float]
    excess: float  #: beyond what may be [m], below if negative
    slope: float  #: of the least steep face there


def spikes_of(solid: Solid, points: FloatArray, spacing: float) -> Iterator[Spike]:
    """
    Yield the corners of a solid's roof that lie too far above or below the points near (all if none is).

    `points` (n, 3), one at least, are on the roof, about `spacing` apart [m], and rise by y.
    """
    slopes: dict[int, float] = {}
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        if kind == ROOF_SURFACE:
            x, y, z = area_vector(solid.face_rings(face))
            slope = math.hypot(x, y) / max(abs(z), _LEAST_PLAN)
            for row in face[0]:
                slopes[row] = min(slope, slopes.get(row, np.inf))
    lowest, highest = points[:, 2].min(), points[:, 2].max()
    corners = solid.vertices[list(slopes)]
    ends = zip(*heights_near(corners, points, AROUND * spacing), strict=True)
    for slope, (x, y, z), (low, high) in zip(slopes.values(), corners.tolist(), ends, strict=True):
        low, high = (low, high) if low <= high else (lowest, highest)
        allowed = MARGIN + slope * spacing
        excess = z - high - allowed if z > high else min(z - low + allowed, 0.0)
        if excess > 0.0 if z > high else excess < 0.0:
            yield Spike((x, y, z), excess, slope)


#: A corner that lies so much beyond that is wrong, also where little of the roof is [m]. Of virtual and drawn
#: roofs with such a corner (seeds 901, 903) 28 of 31 are off on more than 5 % of their plan.
_MOST_EXCESS = 1.0


def spike_doubts(solid: Solid, points: FloatArray, spacing: float) -> Iterator[Doubt]:
    """Yield a doubt where a corner of a roof rises above, or sinks below, all points near."""
    excess = max((spike.excess for spike in spikes_of(solid, points, spacing)), key=abs, default=0.0)
    if abs(excess) > _MOST_EXCESS:
        side, far = "above" if excess > 0.0 else "below", abs(excess) + MARGIN
        yield Doubt(Cause.SPIKE, f"a corner of the roof lies {far:.1f} m {side} all points near")
