"""The order in which files are read, so that neighbours follow each other and tiles are complete early."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lidar_buildings.io.tiling.tile_grid import Rectangle

_BITS = 16


def reading_order(areas: Sequence[Rectangle | None]) -> list[int]:
    """
    Order files along the Z-curve (Morton 1966) through the middles of their bounds.

    Parameters
    ----------
    areas : sequence of Rectangle or None
        None for a file without points; those come first.

    Returns
    -------
    list of int
        Positions in `areas`.
    """
    empty = [i for i, area in enumerate(areas) if area is None]
    filled = [(i, area) for i, area in enumerate(areas) if area is not None]
    if not filled:
        return empty
    middles = np.array([[a.x_min + a.x_max, a.y_min + a.y_max] for _, a in filled]) / 2.0
    low, extent = middles.min(axis=0), float(np.ptp(middles, axis=0).max()) or 1.0
    steps = np.minimum((middles - low) / extent * 2**_BITS, 2**_BITS - 1).astype(np.uint64)
    keys = [_interleaved(int(x), int(y)) for x, y in steps]
    return empty + [filled[k][0] for k in sorted(range(len(filled)), key=lambda k: (keys[k], filled[k][0]))]


def _interleaved(x: int, y: int) -> int:
    """Mix the bits of two numbers, those of `x` first."""
    return sum(((x >> bit & 1) << 1 | (y >> bit & 1)) << (2 * bit) for bit in range(_BITS))
