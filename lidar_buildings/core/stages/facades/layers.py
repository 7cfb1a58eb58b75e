"""Which of several walls one behind the other stays: the plainest front, and none that stands indoors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell
from lidar_buildings.core.stages.facades.judging import profile_of, stretches
from lidar_buildings.core.stages.facades.walls import BIN, PointsAbout, Scenery, Wall

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
#: Ground counts up to this far from a wall [m], one place of it in a cell of this side [m], and is looked at
#: from about the height of a scanner on a vehicle [m].
GROUND_REACH, GROUND_CELL, EYE = 60.0, 4.0, 2.0
#: A wall stands indoors if it has a smaller share of the ground about in sight before it.
MIN_SHARE = 0.02
#: Places of a wall that are looked at, as shares of its length, so far before it [m].
PLACES, LOOKED_FROM = np.array([0.2, 0.5, 0.8]), 0.45


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


def in_sight(walls: Sequence[Wall], around: PointsAbout, scenery: Scenery) -> list[Wall]:
    """
    Return the walls that open ground has in sight past others that are plainer and have more points.

    A scanner stood on ground. So what it saw only through others has hardly any ground in sight; what it saw
    over them is higher, and what it saw beside them has the ground there. A wall without ground about stays.
    """
    strength = np.array([len(one.rows) / (one.sigma * one.length) for one in walls])
    height = np.array([np.median(around.height[one.rows]) for one in walls])
    steps = [_steps(one, around) for one in walls]
    owner = np.repeat(np.arange(len(walls)), [len(one) for one in steps])
    blinds = np.concatenate(steps) if steps else np.empty((0, 6))
    ground = scenery.ground[:, :2]
    if len(ground):
        ground = ground[lowest_per_cell(scenery.ground, GROUND_CELL)]
    kept = []
    for k, one in enumerate(walls):
        others = blinds[(strength[owner] > strength[k]) & (owner != k)]
        place = one.first + PLACES * one.length
        normals = one.curve.normals_at(place)
        share = _share(one.curve.at(place) + LOOKED_FROM * normals, normals, ground, others, height[k])
        if share >= MIN_SHARE:
            kept.append(one)
    return kept


def _steps(wall: Wall, around: PointsAbout) -> Floats:
    """Return the ends of a wall's seen bins in plan, and the heights between which each was seen [m]."""
    bounds = wall.curve.at(np.linspace(wall.first, wall.last, len(wall.is_seen) + 1))
    profile = profile_of(wall, around)
    return np.column_stack([bounds[:-1], bounds[1:], profile.low, profile.high])[wall.is_seen]


@kernel
def _share(places, normals, ground, blinds, height):  # type: ignore[no-untyped-def]
    """Return the largest share of the ground about that one of the places has in sight, 1 without ground."""
    best = -1.0
    for i in range(len(places)):
        x, y, n, n_seen = places[i, 0], places[i, 1], 0, 0
        for g in range(len(ground)):
            dx, dy = ground[g, 0] - x, ground[g, 1] - y
            if dx * dx + dy * dy > GROUND_REACH * GROUND_REACH:
                continue
            n += 1
            if dx * normals[i, 0] + dy * normals[i, 1] <= 0.0:
                continue
            is_seen = True
            for b in range(len(blinds)):
                vx, vy = blinds[b, 2] - blinds[b, 0], blinds[b, 3] - blinds[b, 1]
                ax, ay = blinds[b, 0] - x, blinds[b, 1] - y
                cross = dx * vy - dy * vx
                if cross == 0.0:
                    continue
                way, along = (ax * vy - ay * vx) / cross, (ax * dy - ay * dx) / cross
                level = height + way * (EYE - height)
                if 0.0 < way < 1.0 and 0.0 <= along <= 1.0 and blinds[b, 4] < level < blinds[b, 5]:
                    is_seen = False
                    break
            n_seen += is_seen
        if n > 0:
            best = max(best, n_seen / n)
    return best if best >= 0.0 else 1.0
