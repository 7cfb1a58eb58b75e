"""The side of tiles that suits a survey: few points are seen twice, and a tile fits into memory."""

from __future__ import annotations

import math
from collections.abc import Sequence

import shapely

from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES, Rectangle

#: Sides to choose from [m]; wider tiles bring nothing, and a survey that fills its bounds in parts would
#: surprise with them.
_SIZES = tuple(range(50, 1001, 25))
#: A side this much shorter than the largest one may cut a survey more luckily.
_SHORTEST = 0.5


def fitting_size(areas: Sequence[Rectangle], n_points: int, buffer: float, max_points: int) -> float:
    """
    Choose the side of a survey's tiles [m].

    Of the sides whose tiles, buffer included, are expected to hold at most `max_points` the one with which
    stages see the fewest points: the survey's bounds, cut at multiples of the side, with buffers.

    Parameters
    ----------
    areas : sequence of Rectangle
        The files' bounds [m].
    n_points : int
        Of all files.
    buffer : float
        Width of the strip of neighbours east of a tile [m].
    max_points : int
        Of a tile with its buffer.
    """
    if not areas:
        return float(_SIZES[0])
    whole = Rectangle.around(areas)
    density = n_points / max(shapely.union_all([shapely.box(*_corners(a)) for a in areas]).area, 1.0)
    west, south, east, north = (share * buffer for share in BUFFER_SHARES)
    spans = ((whole.x_min, whole.x_max, west, east), (whole.y_min, whole.y_max, south, north))

    def expected(size: float) -> float:
        return density * math.prod(
            min(size + before + after, high - low) for low, high, before, after in spans
        )

    fitting = [size for size in _SIZES if expected(size) <= max_points] or [_SIZES[0]]
    candidates = [size for size in fitting if size >= _SHORTEST * fitting[-1]]
    return float(min(candidates, key=lambda size: math.prod(_seen(*span, size) for span in spans)))


def _seen(low: float, high: float, before: float, after: float, size: float) -> float:
    """Return the length of a span that all its tiles see together, with buffers before and after them [m]."""
    first, last = math.floor(low / size), math.floor(high / size)
    return sum(
        min(high, (k + 1) * size + after) - max(low, k * size - before) + size * 1e-9
        for k in range(first, last + 1)
    )


def _corners(area: Rectangle) -> tuple[float, float, float, float]:
    return area.x_min, area.y_min, area.x_max, area.y_max
