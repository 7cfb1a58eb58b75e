"""One wall where several lie one behind the other: the front that most points show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.stages.facades.judging import profile_of, stretches
from lidar_buildings.core.stages.facades.surroundings import PointsAbout
from lidar_buildings.core.stages.facades.walls import BIN, Wall

Floats = NDArray[np.float64]

#: Walls nearer to each other than this are one [m]: windows lie so deep, and frames stand out so far.
ONE_WALL = 0.4
#: What lies so far behind a front was seen through its glass [m], unless it is higher by this [m], and by so
#: much a metre of distance: rays rise that go in.
GLASS_REACH, HIGHER, RISE = 2.0, 0.5, 0.5
#: Walls that go in directions farther apart are two: cosine of 45°.
ALIKE = 0.7


def without_layers(walls: Sequence[Wall], around: PointsAbout, max_gap: float) -> Iterator[Wall]:
    """
    Yield the walls without what lies on or closely behind another.

    Those come first of which most was seen and which are the plainest: what is left of two layers is rough.
    """
    places, normals, tops = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    strengths = [_cells_of(one, around) / one.sigma for one in walls]
    for k in np.argsort([-one for one in strengths], kind="stable"):
        wall = walls[k]
        high = profile_of(wall, around).high
        seen = np.flatnonzero(wall.is_seen)
        own, turned = wall.curve.at(wall.middles), wall.curve.normals_at(wall.middles)
        hidden = _are_hidden(own[seen], turned[seen], high[seen], (places, normals, tops))
        free = seen[~hidden]
        yield from stretches(wall, free, max_gap)
        places, normals = np.concatenate([places, own[free]]), np.concatenate([normals, turned[free]])
        tops = np.concatenate([tops, high[free]])


def _cells_of(wall: Wall, around: PointsAbout) -> int:
    """Count the squares of a wall that were seen."""
    layer = np.floor(around.points[wall.rows, 2] / BIN).astype(np.int64)
    return len(np.unique(wall.bins * 100_003 + layer))


def _are_hidden(
    own: Floats, turned: Floats, high: Floats, others: tuple[Floats, Floats, Floats]
) -> NDArray[np.bool_]:
    """Tell which bins lie on those of other walls, or are seen through their glass."""
    places, normals, tops = others
    hidden = np.zeros(len(own), dtype=bool)
    if not len(places) or not len(own):
        return hidden
    for k, near in enumerate(cKDTree(places).query_ball_point(own, GLASS_REACH + BIN)):
        if not near:
            continue
        away, facing = own[k] - places[near], normals[near]
        offset = (away * facing).sum(axis=1)
        aside = np.abs(away[:, 0] * facing[:, 1] - away[:, 1] * facing[:, 0])
        is_beside = (aside <= BIN) & (np.abs(facing @ turned[k]) >= ALIKE)
        is_one = np.abs(offset) <= ONE_WALL
        is_behind = (offset < 0.0) & (offset >= -GLASS_REACH)
        is_behind &= high[k] <= tops[near] + HIGHER - RISE * offset
        hidden[k] = bool((is_beside & (is_one | is_behind)).any())
    return hidden
