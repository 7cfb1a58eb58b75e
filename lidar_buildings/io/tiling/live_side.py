"""The side of a feed's tiles, by how densely its scanner covers what it leaves behind."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.placing import PlacedScan
from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES

#: Time of a feed whose points tell the side [s].
PERIOD = 2.0
#: A place is left behind when so long before the period's end no point fell into it [s]: an airborne scanner
#: passes over it once, one on the street comes back to it with each turn.
_LEFT = 0.5
#: Side of a place [m].
_PLACE = 5.0
#: Points that one strip is to bring into a tile with its buffer; further strips and those across bring more.
_STRIP_POINTS = 1_250_000
#: Sides to choose from are multiples of the step, between the smallest and the largest [m]. Smaller tiles are
#: mostly buffer, and a scanner on the street goes on measuring what it has measured.
_SMALLEST, _LARGEST, _STEP = 150.0, 1000.0, 25.0
_SECOND = 1e9


def side_for(scans: Sequence[PlacedScan], buffer: float, *, is_end: bool = False) -> float | None:
    """
    Choose the side of tiles [m], None as long as too little has come.

    Parameters
    ----------
    scans : sequence of PlacedScan
        All that have come; what is later than the first `PERIOD` does not count.
    buffer : float
        Width of the strip of neighbours east of a tile [m].
    is_end : bool
        Whether to wait for no more.
    """
    times = np.concatenate([scan.times for scan in scans])
    end = times[0] + round(PERIOD * _SECOND)
    if not is_end and times.max() < end:
        return None
    xy = np.concatenate([scan.points[:, :2] for scan in scans])[times <= end]
    density = _density_left_behind(xy, times[times <= end])
    if density is None:
        return _SMALLEST
    around = buffer * (BUFFER_SHARES[0] + BUFFER_SHARES[2])
    widest = math.sqrt(_STRIP_POINTS / density) - around
    return min(max(math.floor(widest / _STEP) * _STEP, _SMALLEST), _LARGEST)


def _density_left_behind(xy: NDArray[np.float64], times: NDArray[np.int64]) -> float | None:
    """Return the points per m² of the places left behind, None where these hold less than half of all."""
    places = np.floor(xy / _PLACE).astype(np.int64)
    _, place, counts = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    last = np.full(len(counts), np.iinfo(np.int64).min)
    np.maximum.at(last, place.ravel(), times)
    is_left = last < times.max() - round(_LEFT * _SECOND)
    if 2 * counts[is_left].sum() < len(xy):
        return None
    return float(counts[is_left].sum() / (np.count_nonzero(is_left) * _PLACE**2))
