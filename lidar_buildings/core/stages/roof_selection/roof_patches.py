"""The smooth patches of opaque surface that roofs start from; planes by votes where points are few."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.classes import Rejection
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.sectors import N_SECTORS, sector_of
from lidar_buildings.core.stages.roof_selection.candidates import (
    MAX_ANGLE_DEG,
    MAX_LINEARITY,
    MAX_SLOPE_DEG,
    Candidates,
)
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.facades import wall_areas
from lidar_buildings.core.surfaces.eigenfeatures import PLANE_CANDIDATES, eigen_features
from lidar_buildings.core.surfaces.surface_patches import smooth_patches

#: Radii among which the one of least entropy is taken, as multiples of the smallest one.
RADIUS_STEPS = np.array([1.0, 1.35, 1.8])
#: A plane through fewer points says nothing of its roughness.
MIN_PLANE_POINTS = 6
#: Smallest smooth patch that starts a roof: flat spots of crowns are smaller [m²].
MIN_PATCH_AREA = 2.0
#: Where large patches begin [m²]: no flat spot of foliage is as large.
LARGE_PATCH_AREA = 40.0
#: Largest mean roughness of large and of other patches that start a roof, in parts of `max_roughness`.
PATCH_ROUGHNESS = (0.85, 0.55)
#: Largest share of split pulses at the points of other patches: foliage has more.
MAX_SPLIT = 0.5
#: From here on points may be of walls, which look less steep in places: patches are judged as a whole [deg].
STEEP_DEG = 75.0
#: Noise of a point in plan as a multiple of that in height, which makes steep roofs rougher than level ones.
HORIZONTAL_NOISE = 1.5
#: Distance from the neighbour's tangent plane over which a patch goes on, a multiple of `max_roughness`.
PATCH_OFFSET = 1.5


@dataclass(frozen=True, eq=False)
class RoofSurface:
    """The points from which roofs are completed."""

    is_surface: NDArray[np.bool_]  #: point of an accepted patch, shape (n_points,)
    #: Point that no roof grows to: of a smooth surface steeper than one, or among more others than roofs.
    is_other: NDArray[np.bool_]
    #: Point of such a surface that is as large as a building's wall, shape (n_points,).
    is_wall: NDArray[np.bool_]
    rejection: NDArray[np.uint8]  #: why each other point starts no roof, see `Rejection`, shape (n_points,)
    normals: NDArray[np.float64]  #: their unit normals, shape (n_surface_points, 3)


def find_roof_surface(candidates: Candidates, config: RoofSelectionConfig) -> RoofSurface:
    """Find smooth patches among the last returns, and accept those that are smooth for their size."""
    columns, radius = candidates.columns, candidates.radius
    n = len(columns.points)
    rows = np.flatnonzero(candidates.is_last)
    features = eigen_features(
        columns.points.take(rows, axis=0),
        list(radius * RADIUS_STEPS),
        min_neighbours=MIN_PLANE_POINTS,
        max_candidates=PLANE_CANDIDATES,
    )
    upward = features.normals[:, 2]
    # As it would be if the surface lay level.
    noise = np.sqrt(upward**2 + HORIZONTAL_NOISE**2 * np.maximum(1.0 - upward**2, 0.0))
    roughness = features.roughness / noise
    smooth = (roughness <= config.max_roughness) & (features.linearity <= MAX_LINEARITY)
    smooth &= features.n_neighbours >= MIN_PLANE_POINTS
    level = upward >= math.cos(math.radians(MAX_SLOPE_DEG))
    upright = upward < math.cos(math.radians(STEEP_DEG))
    is_surface, is_other, is_wall = np.zeros((3, n), dtype=bool)
    is_other[rows[smooth & ~level]] = True
    rejection = np.full(n, Rejection.FOLIAGE, dtype=np.uint8)
    is_rough = (roughness > config.max_roughness) & (roughness <= 2.0 * config.max_roughness)
    rejection[rows[is_rough]] = Rejection.ROUGH
    rejection[is_other] = Rejection.STEEP
    is_sparse = features.n_neighbours * (radius / features.radius) ** 2 < MIN_PLANE_POINTS
    links = np.where(is_sparse, features.radius, radius)  # longer where few points lie: wet or dark roofs
    known = _Known(rows, features.normals, links, roughness / config.max_roughness)
    del features, upward, noise, roughness, links  # here and below: half of the memory
    offset = PATCH_OFFSET * config.max_roughness
    walls = _patches(columns, known, smooth & upright, offset)
    area = wall_areas(walls.columns.points, walls.label, config.min_building_width)
    large = (area > 0.0) & (area >= config.min_building_area) & _is_opaque(candidates, walls, area)
    is_wall[walls.columns.rows] = large[walls.label]
    del walls
    roofs = _patches(columns, known, smooth & level, offset)
    del known
    (accepted, decks), hangs = _accepted(candidates, roofs), _of_walls(roofs)
    is_other[roofs.columns.rows[hangs]] = True
    rejection[roofs.columns.rows[decks]] = Rejection.DECK
    rejection[roofs.columns.rows[hangs]] = Rejection.STEEP
    accepted &= ~hangs
    is_surface[roofs.columns.rows[accepted]] = True
    own = roofs.normals.take(np.flatnonzero(accepted), axis=0)
    return RoofSurface(is_surface, is_other, is_wall, rejection, own)


class _Known(NamedTuple):
    """What is known of the last returns: their rows, normals, longest links, and roughness as of patches."""

    rows: NDArray[np.intp]
    normals: NDArray[np.float64]
    reach: NDArray[np.float64]
    roughness: NDArray[np.float64]


class _Patches(NamedTuple):
    """Smooth points, the patch of each, its normal, and its roughness in parts of the largest."""

    columns: CellGrid
    label: NDArray[np.int64]
    normals: NDArray[np.float64]
    roughness: NDArray[np.float64]


def _patches(columns: CellGrid, known: _Known, chosen: NDArray[np.bool_], max_offset: float) -> _Patches:
    """Join some of the last returns to patches."""
    own, is_chosen = np.flatnonzero(chosen), np.zeros(len(columns.points), dtype=bool)
    is_chosen[known.rows[own]] = True
    points, normals = columns.select(is_chosen), known.normals.take(own, axis=0)
    label = smooth_patches(
        points, normals, known.reach[own], max_angle_deg=MAX_ANGLE_DEG, max_offset=max_offset
    )
    return _Patches(points, label, normals, known.roughness[own])


def _accepted(candidates: Candidates, patches: _Patches) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which smooth points are of patches that start a roof, and which are of decks."""
    points, label = patches.columns, patches.label
    patch = np.full(len(candidates.points), -1, dtype=np.int64)
    patch[points.rows] = label
    area = candidates.areas(patch, label.max(initial=-1) + 1)
    del patch
    accepted = (area >= MIN_PATCH_AREA) & _is_opaque(candidates, patches, area)
    asked = np.flatnonzero(accepted[label])
    decks = is_deck(
        points.points.take(asked, axis=0), label[asked], len(area), candidates.ground(), candidates.cell
    )
    return (accepted & ~decks)[label], decks[label]


def _is_opaque(candidates: Candidates, patches: _Patches, area: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which patches are smooth for their area [m²], and no foliage if it is small."""
    label, n_points = patches.label, np.bincount(patches.label)
    is_large = area >= LARGE_PATCH_AREA
    is_smooth = np.bincount(label, patches.roughness) <= n_points * np.where(is_large, *PATCH_ROUGHNESS)
    is_whole = np.bincount(label, ~candidates.is_only[patches.columns.rows]) <= MAX_SPLIT * n_points
    return np.asarray(is_smooth & (is_large | is_whole))


def _of_walls(patches: _Patches) -> NDArray[np.bool_]:
    """Tell which points are of patches, most of them steep, that as a whole are steeper than any roof."""
    points, label, upward = patches.columns.points, patches.label, patches.normals[:, 2]
    n_points = np.bincount(label)
    is_steep = upward < math.cos(math.radians(STEEP_DEG))
    asked = np.flatnonzero((2 * np.bincount(label, is_steep) > n_points)[label])
    part = label[asked]
    away = points[asked] - np.column_stack(
        [np.bincount(part, points[asked, k], len(n_points))[part] / n_points[part] for k in range(3)]
    )
    xx, yy, zz, xy = (
        np.bincount(part, away[:, a] * away[:, b], len(n_points)) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1))
    )
    across = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)  # the narrower way in plan
    found = np.zeros(len(label), dtype=bool)
    found[asked] = (across < zz * math.tan(math.radians(90.0 - MAX_SLOPE_DEG)) ** 2)[part]
    return found


#: Neighbours that vote: two rings around a point on an even surface.
N_VOTERS = 12
#: Least sine of the angle between the two neighbours that span a plane with the point.
MIN_SINE = 0.4
#: Largest distance from a plane, in the cells in which areas are counted, two spacings: neighbours in foliage
#: differ in height as they lie apart, and so as few come near a plane by chance at any density.
DISTANCE_CELLS = 1.0 / 32.0
#: Points, of all that came back, that say whether one of them is roof: three rings around it.
N_AROUND = 24
#: What ground counts for among them, in votes: less than roofs, which have 7 in the mean, like crowns,
#: which have 1 to 3 and let ground be seen; so what is narrow or stands alone has to be flatter.
GROUND_VOTES = 1.75
#: Mean votes around a point of a roof; and where returns are not known, so that nothing but planes tells of
#: foliage.
MIN_VOTES, MIN_VOTES_UNKNOWN = 3.5, 4.15
#: How many more a connected roof has somewhere: in crowns few points at a time lie on a plane by chance.
MORE_VOTES = 1.0


def find_voted_surface(candidates: Candidates, config: RoofSelectionConfig) -> RoofSurface:
    """
    Find the planes of roofs, and of no deck, that points around lie on, where points are few.

    One point's votes say little where faces hold few points; a crown has few votes as a whole. All that came
    back around it is asked: what others of its pulse came after has no votes, and foliage has many of those;
    it lets ground be seen, too. Connected roof is surer somewhere. Where more of what is raised around a
    point has no such planes than has, no roof grows to it. `max_roughness` is the largest distance from the
    plane, if that is not narrower still.
    """
    points, n, ground = candidates.points, len(candidates.points), candidates.ground()
    votes, normals = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
    distance = min(config.max_roughness, DISTANCE_CELLS * candidates.cell)
    votes[candidates.is_last], normals[candidates.is_last] = plane_votes(points[candidates.is_last], distance)
    least = MIN_VOTES_UNKNOWN if candidates.is_only.all() else MIN_VOTES
    mean = _mean_around(points[:, :2], votes, ground[:, :2], GROUND_VOTES)
    rows = np.flatnonzero(mean >= least)
    label, n_parts = candidates.parts(rows, candidates.radius)
    part, (is_surface, nothing) = label[rows], np.zeros((2, n), dtype=bool)
    rejection = np.full(n, Rejection.FOLIAGE, dtype=np.uint8)
    decks = is_deck(points[rows], part, n_parts, ground, candidates.cell)
    rejection[rows[decks[part]]] = Rejection.DECK
    most = np.zeros(n_parts)
    np.maximum.at(most, part, mean[rows])
    is_surface[rows] = (~decks & (most >= least + MORE_VOTES))[part] & (votes[rows] > 0)
    is_among_others = _mean_around(points, np.where(is_surface, 1, -1), ground, 0) <= 0.0
    return RoofSurface(is_surface, is_among_others & ~is_surface, nothing, rejection, normals[is_surface])


def plane_votes(
    points: NDArray[np.float64], max_distance: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """
    Return how many of each point's nearest neighbours lie on one plane through it: 0 to `N_VOTERS`.

    And the plane's unit normal, zero where there is none, shape (n_points, 3).
    """
    votes, normals = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3))
    if len(points) > N_VOTERS:
        near, least = cKDTree(points).query(points, N_VOTERS + 1)[1], math.cos(math.radians(MAX_SLOPE_DEG))
        for_row_blocks(
            lambda *run: _vote(points, near, max_distance, least, votes, normals, *run), len(points)
        )
    return votes, normals


def _mean_around(
    points: NDArray[np.float64], values: NDArray[np.int64], ground: NDArray[np.float64], of_ground: float
) -> NDArray[np.float64]:
    """Return the mean value of each point and its nearest neighbours, in plan or space, ground among them."""
    # In an order of their own: of neighbours as far away the first ones count.
    every = np.vstack([points, ground[np.lexsort(ground.T)]])
    value = np.append(values, np.full(len(ground), of_ground))
    if len(every) <= N_AROUND:
        return value[: len(points)]
    return np.asarray(value[cKDTree(every).query(points, N_AROUND + 1)[1]].mean(axis=1))


@kernel
def _vote(points, near, max_distance, min_upward, votes, normals, begin, end):  # type: ignore[no-untyped-def]
    away = np.empty((near.shape[1], 3))
    for i in range(begin, end):
        for k in range(near.shape[1]):
            for axis in range(3):
                away[k, axis] = points[near[i, k], axis] - points[i, axis]
        for a in range(1, len(away)):
            for b in range(a + 1, len(away)):
                (ax, ay, az), (bx, by, bz) = away[a], away[b]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                length = math.sqrt(x * x + y * y + z * z)
                spans = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
                if length <= MIN_SINE * math.sqrt(spans) or abs(z) < min_upward * length:
                    continue
                found = -1
                for k in range(len(away)):
                    off = x * away[k, 0] + y * away[k, 1] + z * away[k, 2]
                    found += abs(off) <= max_distance * length
                if found > votes[i]:
                    votes[i] = found
                    normals[i, 0], normals[i, 1], normals[i, 2] = x / length, y / length, z / length


#: Surfaces and ground are compared in cells of this side [m], or of the side in which areas are counted.
CELL = 1.0
#: How far beyond the end of a surface to look for ground: what is `min_height` above a slope of 1 : 2.5 [m].
REACH = 5.0
#: How far the ground there may lie above or below the end: a kerb, and a road of 5 % over the reach [m].
MAX_STEP = 0.5
#: Share of the cells at either end that have to meet the ground.
MIN_SHARE = 0.6
#: How many times as many cells the sides beside an end have where it is the end of a length: no house on a
#: slope is six times as long up the slope as it is wide.
MIN_LENGTH_TO_WIDTH = 6


def is_deck(
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    n_surfaces: int,
    ground: NDArray[np.float64],
    cell: float,
) -> NDArray[np.bool_]:
    """
    Tell which surfaces go on as ground at their own level, at two ends that face away from each other.

    A house on a slope meets ground at the level of its roof on one side at most. Of a long and narrow surface
    one end is enough, since the other may be hidden or beyond the data. Surfaces are `min_height` or more
    above the ground below them, and fill cells; the order of their points does not matter.
    """
    cell = max(CELL, cell)
    lowest = np.full(n_surfaces, np.inf)
    np.minimum.at(lowest, label, points[:, 2])
    # Most roofs are higher than all the ground, and most ground is lower than the others.
    lowest[lowest > ground[:, 2].max(initial=-np.inf) + MAX_STEP] = np.inf
    is_near = np.flatnonzero(np.isfinite(lowest)[label])
    ground = ground.take(np.flatnonzero(ground[:, 2] >= lowest.min(initial=np.inf) - MAX_STEP), axis=0)
    points, label = points.take(is_near, axis=0), label[is_near]
    columns = rows_by_cell(np.vstack([points, ground]), cell)
    owner = np.concatenate([label, np.full(len(ground), -1)])[columns.rows]
    steps = (REACH + cell) / columns.size
    ends, met = np.zeros((2, n_surfaces, N_SECTORS), dtype=np.int64)
    runs = columns.around(REACH + cell)
    _count_ends(columns.points, owner, columns.first, columns.places, runs, steps, ends, met)
    is_end = (met >= MIN_SHARE * ends) & (met > 0)
    opposite, beside = N_SECTORS // 2, N_SECTORS // 4
    sides = np.minimum(np.roll(ends, beside, axis=1), np.roll(ends, -beside, axis=1))
    is_lengthwise = MIN_LENGTH_TO_WIDTH * ends <= sides
    return np.asarray((is_end & (np.roll(is_end, opposite, axis=1) | is_lengthwise)).any(axis=1))


@kernel
def _count_ends(points, owner, first, places, runs, reach, ends, met):  # type: ignore[no-untyped-def]
    """Count, by surface and sector, the cells beyond which it does not go on, and those of them on ground."""
    # A surface is as high in a cell as its highest point there; ground fills all from lowest to highest.
    n = len(places)
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    start = np.zeros(n + 1, dtype=np.int64)
    own, top = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    entry = np.full(len(ends), -1, dtype=np.int64)
    total = 0
    for k in range(n):
        for i in range(first[k], first[k + 1]):
            z = points[i, 2]
            if owner[i] < 0:
                low[k], high[k] = min(low[k], z), max(high[k], z)
            elif entry[owner[i]] < start[k]:
                entry[owner[i]], own[total], top[total] = total, owner[i], z
                total += 1
            else:
                top[entry[owner[i]]] = max(top[entry[owner[i]]], z)
        start[k + 1] = total
    for k in range(n):
        for one in range(start[k], start[k + 1]):
            goes_on, is_met = 0, 0
            for row in range(runs.shape[1]):
                for c in range(runs[k, row, 0], runs[k, row, 1]):
                    dx, dy = places[c, 1] - places[k, 1], places[c, 0] - places[k, 0]
                    if c == k or dx * dx + dy * dy > reach * reach:
                        continue
                    bit = 1 << sector_of(float(dx), float(dy))
                    if low[c] - MAX_STEP <= top[one] <= high[c] + MAX_STEP:
                        is_met |= bit
                    for other in range(start[c], start[c + 1]):
                        if own[other] == own[one]:
                            goes_on |= bit
            for sector in range(N_SECTORS):
                if not goes_on >> sector & 1:
                    ends[own[one], sector] += 1
                    met[own[one], sector] += is_met >> sector & 1
