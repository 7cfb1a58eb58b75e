"""Whether a wall is of a building: how high it was seen, and what was seen behind and over it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from lidar_buildings.core.stages.facades.walls import BIN, PointsAbout, Scenery, Wall

Floats = NDArray[np.float64]

#: Bins over which heights are smoothed: what is longer than half of it is told from what stands beside.
SMOOTHED = 7
#: The highest of some points at a wall's edge lies so many σ of their elevation too high, which is what a
#: wall's σ is without the noise of ranges [m].
HIGHEST, RANGE_NOISE = 2.0, 0.03
#: Top above ground of fences, hedges, garden walls and cars, at most, and from which a wall is none [m].
LOW, TALL = 1.6, 2.1
#: What is higher is a fence no more, or a vehicle, whatever is seen over or behind it [m].
MAX_FENCE, MAX_VEHICLE = 2.9, 4.0
#: How far before and behind a wall it is asked for [m].
BEFORE = np.arange(0.85, 12.0, 1.0)
CLOSE_BEHIND, BEHIND = -np.arange(0.85, 2.1, 0.4), -np.arange(1.75, 4.1, 0.5)
OVER = np.concatenate([[1.0], -np.arange(0.85, 6.1, 0.5)])
#: What is behind is seen over a wall if it is higher by so much, and by so much a metre of distance: the
#: beams of a scanner that sees no higher rise less [m].
HIGHER, RISE = 0.3, 0.1
#: Share of a wall's length with ground close behind, with things behind, or with something over it: up to
#: the first it says nothing, from the second on there is no building.
GROUND_SHARES, BEHIND_SHARES, OVER_SHARES = (0.2, 0.7), (0.6, 1.0), (0.1, 0.6)
#: Share of a wall's length at which a layer of it has points, and the widest gap between two layers [m]:
#: windows from wall to wall are lower.
MIN_FILLED, MAX_STOREY_GAP = 0.15, 2.0
#: A wall shorter than this that neither touches another one nor goes on elsewhere may be a pillar, a board
#: or a box, the shorter the likelier [m].
LONE_LENGTH = 3.0


@dataclass(frozen=True, eq=False)
class Profile:
    """The heights above ground [m] between which a wall was seen, bin by bin; NaN where it was not."""

    low: Floats
    high: Floats


def profile_of(wall: Wall, around: PointsAbout) -> Profile:
    """Return where the points of a wall begin and end in each bin."""
    n, height = len(wall.is_seen), around.height[wall.rows]
    bins = wall.bins
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(low, bins, height)
    np.maximum.at(high, bins, height)
    low[~wall.is_seen], high[~wall.is_seen] = np.nan, np.nan
    return Profile(low, high)


def tall_stretches(wall: Wall, around: PointsAbout, min_height: float, max_gap: float) -> Iterator[Wall]:
    """Yield the stretches of a wall of which enough height was seen, and which rise above cars and fences."""
    seen = np.flatnonzero(wall.is_seen)
    if not len(seen):
        return
    profile = profile_of(wall, around)
    low, high = (median_filter(one[seen], SMOOTHED, mode="nearest") for one in (profile.low, profile.high))
    tall = seen[(high - low >= min_height) & (high >= LOW)]
    yield from stretches(wall, tall, max_gap)


def stretches(wall: Wall, bins: NDArray[np.intp], max_gap: float) -> Iterator[Wall]:
    """Yield a wall's stretches that some of its bins are on, rising, with no wider gaps between these."""
    if not len(bins):
        return
    step = wall.length / len(wall.is_seen)
    for run in np.split(bins, np.flatnonzero((np.diff(bins) - 1) * step > max_gap) + 1):
        begin, end = run[0], run[-1] + 1
        own = (wall.bins >= begin) & (wall.bins < end)
        is_seen = np.zeros(end - begin, dtype=bool)
        is_seen[run - begin] = True
        first, last = wall.first + begin * step, wall.first + end * step
        yield replace(
            wall, first=first, last=last, rows=wall.rows[own], place=wall.place[own], is_seen=is_seen
        )


def faced(wall: Wall, scenery: Scenery) -> Wall:
    """
    Return the wall with its front, before which more ground was seen than behind, on the left of its curve.

    What is low counts as ground: what hides it stands on it. Roofs do not.
    """
    place = wall.middles
    shares = []
    for side in (1.0, -1.0):
        is_ground, highest = scenery.along(wall.curve, place, side * BEFORE)
        is_open = is_ground | (np.isfinite(highest) & (highest < LOW))
        shares.append(float((is_open / BEFORE).sum()))  # beyond a narrow house there is open ground, too
    return wall if shares[0] >= shares[1] else wall.reversed()


def confidence(wall: Wall, around: PointsAbout, scenery: Scenery) -> float:
    """
    Return how sure it is, 0 to 1, that a wall with its front on the left is of a building.

    A building hides what is behind it. Behind a vehicle, a fence or a hedge the ground or other things were
    seen, from another place or over the top.
    """
    profile = profile_of(wall, around)
    place = wall.middles[wall.is_seen]
    top = median_filter(profile.high[wall.is_seen], SMOOTHED, mode="nearest")
    is_ground, _ = scenery.along(wall.curve, place, CLOSE_BEHIND)
    _, highest = scenery.along(wall.curve, place, BEHIND)
    _, over = scenery.along(wall.curve, place, OVER)
    is_higher = over > (top + HIGHER)[:, None] + RISE * np.abs(OVER)
    is_over = is_higher.any(axis=1) & (top < MAX_FENCE)
    height = min(float(np.median(top)), _unbroken_top(wall, around))
    by_chance = HIGHEST * float(np.sqrt(max(wall.sigma**2 - RANGE_NOISE**2, 0.0)))
    is_vehicle = float(np.clip((MAX_VEHICLE - height) / (MAX_VEHICLE - MAX_FENCE), 0.0, 1.0))
    # its own roof is behind a wall as well, but over it
    is_beyond = np.isfinite(highest) & (highest <= (top + HIGHER)[:, None])
    is_behind = _unlikely(float(is_beyond.any(axis=1).mean()), BEHIND_SHARES)
    sure = [
        float(np.clip((height - by_chance - LOW) / (TALL - LOW), 0.0, 1.0)),
        1.0 - is_vehicle * (1.0 - _unlikely(float(is_ground.any(axis=1).mean()), GROUND_SHARES)),
        1.0 - is_vehicle * (1.0 - is_behind),
        _unlikely(float(is_over.mean()), OVER_SHARES),
    ]
    return float(np.prod(sure))


def _unbroken_top(wall: Wall, around: PointsAbout) -> float:
    """Return how high above ground a wall goes on without a wide gap; what is far above is something else."""
    layer = np.floor(around.height[wall.rows] / BIN).astype(np.int64)
    squares = np.unique(layer * len(wall.is_seen) + wall.bins)
    layers, counts = np.unique(squares // len(wall.is_seen), return_counts=True)
    held = layers[counts >= MIN_FILLED * len(wall.is_seen)]
    if not len(held):
        return 0.0
    ends = np.flatnonzero(np.diff(held) * BIN > MAX_STOREY_GAP)
    return float(held[ends[0] if len(ends) else -1] + 1) * BIN


def _unlikely(share: float, shares: tuple[float, float]) -> float:
    low, high = shares
    return float(np.clip((high - share) / (high - low), 0.0, 1.0))
