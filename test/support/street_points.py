"""Points as they are seen from above and from the street."""

from __future__ import annotations

import laspy
import numpy as np
from numpy.typing import NDArray


def seen_from_above(density: float = 8.0, size: float = 60.0, seed: int = 0) -> NDArray[np.float64]:
    """Return points evenly strewn over level ground [m]."""
    n = round(density * size**2)
    return np.column_stack([np.random.default_rng(seed).uniform(0.0, size, (n, 2)), np.zeros(n)])


def seen_from_street(n: int = 40_000, size: float = 60.0, seed: int = 0) -> NDArray[np.float64]:
    """Return points on level ground about a track, of beams that are evenly inclined [m]."""
    draw = np.random.default_rng(seed)
    down, around = np.deg2rad(draw.uniform(2.0, 25.0, n)), draw.uniform(0.0, 2.0 * np.pi, n)
    reach = 2.0 / np.tan(down)
    x = draw.uniform(0.0, size, n) + reach * np.cos(around)
    return np.column_stack([x, size / 2 + reach * np.sin(around), np.zeros(n)])


def cloud_of(points: NDArray[np.float64], strip: int = 1, time: float = 1000.0) -> laspy.LasData:
    """Return points as a cloud of one strip."""
    cloud = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    cloud.header.scales, cloud.header.offsets = [0.001] * 3, [0.0] * 3
    cloud.xyz = points
    cloud.point_source_id = np.full(len(points), strip, dtype=np.uint16)
    cloud.gps_time = np.full(len(points), time)
    cloud.intensity = np.arange(len(points)) % 251
    return cloud
