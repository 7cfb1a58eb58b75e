"""One wall where several lie one behind the other: at each place the front that most points show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
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
#: Bins over which it counts how much of a wall was seen: doors and windows are narrower than half of it.
ABOUT = 13


def without_layers(walls: Sequence[Wall], around: PointsAbout, max_gap: float) -> Iterator[Wall]:
    """
    Yield the walls without what lies on or closely behind another.

    Those places come first about which most points lie and whose walls are the plainest: what is left of two
    layers is rough.
    """
    if not walls:
        return
    seen = [np.flatnonzero(one.is_seen) for one in walls]
    places = np.concatenate([w.curve.at(w.middles)[k] for w, k in zip(walls, seen, strict=True)])
    normals = np.concatenate([w.curve.normals_at(w.middles)[k] for w, k in zip(walls, seen, strict=True)])
    tops = np.concatenate([profile_of(w, around).high[k] for w, k in zip(walls, seen, strict=True)])
    strength = np.concatenate([_strengths(w)[k] for w, k in zip(walls, seen, strict=True)])
    owner = np.repeat(np.arange(len(walls)), [len(k) for k in seen])
    hidden = _hidden(places, normals, tops, strength, owner)
    for k, (wall, bins) in enumerate(zip(walls, seen, strict=True)):
        yield from stretches(wall, bins[~hidden[owner == k]], max_gap)


def _strengths(wall: Wall) -> Floats:
    """Return how many points lie on a wall about each of its bins, by its σ."""
    n = np.bincount(wall.bins, minlength=len(wall.is_seen)).astype(np.float64)
    return np.asarray(uniform_filter1d(n, ABOUT, mode="constant") / wall.sigma)


def _hidden(
    places: Floats, normals: Floats, tops: Floats, strength: Floats, owner: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Tell which bins lie on stronger ones of other walls, or are seen through their glass."""
    hidden = np.zeros(len(places), dtype=bool)
    rank = np.empty(len(places), dtype=np.intp)
    order = np.argsort(-strength, kind="stable")
    rank[order] = np.arange(len(places))
    beside = cKDTree(places).query_ball_point(places, GLASS_REACH + BIN)
    for k in order:
        near = np.array(beside[k])
        near = near[(owner[near] != owner[k]) & (rank[near] < rank[k])]
        near = near[~hidden[near]]
        if not len(near):
            continue
        away, facing = places[k] - places[near], normals[near]
        offset = (away * facing).sum(axis=1)
        aside = np.abs(away[:, 0] * facing[:, 1] - away[:, 1] * facing[:, 0])
        is_beside = (aside <= BIN) & (np.abs(facing @ normals[k]) >= ALIKE)
        is_one = np.abs(offset) <= ONE_WALL
        is_behind = (offset < 0.0) & (offset >= -GLASS_REACH)
        is_behind &= tops[k] <= tops[near] + HIGHER - RISE * offset
        hidden[k] = bool((is_beside & (is_one | is_behind)).any())
    return hidden
