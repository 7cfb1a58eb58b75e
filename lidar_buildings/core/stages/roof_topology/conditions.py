"""What the planes of a roof may have in common, as their lines and the outline's walls hint at."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.model.outline import across_walls, corner_moves, walls_before
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.stages.roof_topology.directions import main_directions, wall_directions
from lidar_buildings.core.stages.roof_topology.intersections import Pieces, piece_ends
from lidar_buildings.core.surfaces.plane_adjustment import (
    ALIKE,
    CORNER,
    EAVES,
    POINT,
    SLOPE,
    STRIKE,
    Adjustment,
    Condition,
    common_point,
)

#: How exactly roofs are built: a common point [m], where a hip meets the outline, in plan [m], directions of
#: eaves [rad], slopes [m/m].
_POINT_SIGMA, _HIP_SIGMA, _STRIKE_SIGMA, _SLOPE_SIGMA = 0.02, 0.03, 0.01, 0.01
#: Eaves are at one height to this [m].
_EAVES_SIGMA = 0.03
#: Dormers have no more than this share of the points of the plane that they stand on, and are in a row if
#: none is farther up than so many spacings.
_DORMER_SHARE, _IN_ROW = 0.33, 2.0
#: A plane reaches a wall that is no farther from its centroid than so many standard deviations of its points
#: and so many spacings.
_DEPTH, _BEFORE_WALL = 2.0, 3.0
#: Planes that fall farther off from across a wall do not [deg].
_ACROSS_DEG = 20.0
_ACROSS = math.cos(math.radians(_ACROSS_DEG))

#: A line passes through a corner if no farther off it and ending no farther from it, in spacings.
_BESIDE_CORNER, _BEFORE_CORNER = 1.0, 3.0
#: Ends of lines within so many spacings of one another, directly or by way of others, may be one point.
_SAME_POINT = 3.0
#: Three planes meet in a point anyway.
_LEAST_PLANES = 4


def find_conditions(
    adjustment: Adjustment, pieces: Pieces, walls: FloatArray, spacing: float
) -> list[Condition]:
    """
    Collect the conditions that lines and walls hint at; the adjustment finds out which the points allow.

    Walls, the outline's edges, are about the centre.
    """
    planes = adjustment.coefficients
    found: list[Condition] = []
    if len(pieces.pair):
        ends = piece_ends(pieces, planes)
        found += _common_points(pieces, ends, planes, spacing)
        if len(walls):
            found += _corners(pieces, ends, walls, planes, spacing)
        found += _equal_slopes(pieces, adjustment)
        if len(walls):
            met = {one.planes for one in found if one.kind == CORNER}
            eaves = _equal_eaves(pieces, adjustment, walls, spacing)
            found += [one for one in eaves if one.planes not in met]
        found += _alike(pieces, adjustment, spacing)
    return found + list(_strikes(adjustment, walls))


def _equal_slopes(pieces: Pieces, adjustment: Adjustment) -> Iterator[Condition]:
    """Planes that meet may be as steep."""
    unit = _units(adjustment.coefficients)
    for i, j in sorted(set(zip(pieces.first.tolist(), pieces.second.tolist(), strict=True))):
        if adjustment.surface[i - 1] < 0 and adjustment.surface[j - 1] < 0:
            factors = np.zeros((1, 2, 3))
            factors[0, :, :2] = unit[i - 1], -unit[j - 1]
            yield Condition(SLOPE, (i, j), _SLOPE_SIGMA, factors)


def _equal_eaves(
    pieces: Pieces, adjustment: Adjustment, walls: FloatArray, spacing: float
) -> Iterator[Condition]:
    """Planes that meet may be as high where they end at walls that they fall across."""
    places, wall = _eaves(adjustment, walls, spacing)
    unit, across = _units(adjustment.coefficients), across_walls(walls)
    for i, j in sorted(set(zip(pieces.first.tolist(), pieces.second.tolist(), strict=True))):
        if np.isfinite(places[[i - 1, j - 1]]).all():
            own, moves = wall[[i - 1, j - 1]], np.zeros((2, 2, 2))
            for n, k in enumerate((i - 1, j - 1)):
                moves[n, n] = unit[k] / (unit[k] @ across[own[n]])
            difference = _height_difference(places[i - 1], places[j - 1])
            yield Condition(EAVES, (i, j), _EAVES_SIGMA, difference, walls=tuple(own.tolist()), moves=moves)


def _height_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the factors of the height of one plane at one place less that of another at another."""
    return np.array([[[*first, 1.0], [*-second, -1.0]]])


def _eaves(adjustment: Adjustment, walls: FloatArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Return where planes end at walls that they fall across, NaN if nowhere, (n_planes, 2), and which."""
    unit, middle = _units(adjustment.coefficients), adjustment.free.mean[:, :2]
    variance = np.einsum("ki,kij,kj->k", unit, adjustment.free.scatter[:, :2, :2], unit)
    reach = _DEPTH * np.sqrt(variance / adjustment.free.counts) + _BEFORE_WALL * spacing
    (u, v), (x, y) = -unit[:, :, None].transpose(1, 0, 2), (walls[:, 1] - walls[:, 0]).T
    from_x, from_y = (walls[:, 0] - middle[:, None]).transpose(2, 0, 1)
    across = u * y - v * x  # of a wall that the plane falls across, its length
    is_eaves = across > _ACROSS * np.maximum(np.hypot(x, y), 1e-9)
    safe = np.where(is_eaves, across, 1.0)
    away, along = (from_x * y - from_y * x) / safe, (from_x * v - from_y * u) / safe
    is_eaves &= (away > 0.0) & (away < reach[:, None]) & (along > 0.0) & (along < 1.0)
    away = np.where(is_eaves, away, np.inf)
    nearest = away.min(axis=1)
    return middle - unit * np.where(np.isfinite(nearest), nearest, np.nan)[:, None], away.argmin(axis=1)


def _alike(pieces: Pieces, adjustment: Adjustment, spacing: float) -> Iterator[Condition]:
    """Dormers in a row, small planes that meet one larger plane in valleys, may be as steep and as high."""
    planes, middle = adjustment.coefficients, adjustment.free.mean[:, :2]
    unit = _units(planes)
    counts, spread = adjustment.free.counts, adjustment.free.scatter[:, :2, :2]
    both = np.column_stack([pieces.first, pieces.second])[~pieces.convex].astype(np.int64) - 1
    both = both[(adjustment.surface[both] < 0).all(axis=1)]
    both = np.take_along_axis(both, np.argsort(counts[both], axis=1), axis=1)
    both = np.unique(both[counts[both[:, 0]] <= _DORMER_SHARE * counts[both[:, 1]]], axis=0)
    for host in np.unique(both[:, 1]).tolist():
        fall, along = unit[host], np.array([-unit[host, 1], unit[host, 0]])
        row = sorted(both[both[:, 1] == host, 0].tolist(), key=lambda k: float(middle[k] @ along))
        for n, i in enumerate(row):
            for j in row[n + 1 :]:
                away = float((middle[j] - middle[i]) @ fall)
                if unit[i] @ unit[j] < _ACROSS or abs(away) > _IN_ROW * spacing:
                    continue
                pair = (min(i, j) + 1, max(i, j) + 1)
                slopes = np.zeros((2, 2, 3))
                slopes[:, 0, :2], slopes[:, 1, :2] = np.eye(2), -np.eye(2)
                yield Condition(ALIKE, pair, _SLOPE_SIGMA, slopes)
                # Where along the row a dormer is, is known no better than its centroid.
                off = along @ (spread[i] / counts[i] ** 2 + spread[j] / counts[j] ** 2) @ along
                sigma = math.sqrt(_EAVES_SIGMA**2 + float(off) * float(planes[i, :2] @ along) ** 2)
                centroids = middle[[i, j]] + 0.5 * away * np.outer((1.0, -1.0), fall)
                yield Condition(ALIKE, pair, sigma, _height_difference(*centroids)[:, :: 1 if i < j else -1])
                break


def _strikes(adjustment: Adjustment, walls: FloatArray) -> Iterator[Condition]:
    """Planes that fall nearly across a wall may do so."""
    axes = main_directions(*wall_directions(walls))
    if not len(axes):
        return
    unit = _units(adjustment.coefficients)
    steepness = np.hypot(*adjustment.coefficients[:, :2].T)
    azimuth = np.arctan2(unit[:, 1], unit[:, 0])
    off = (azimuth[:, None] - axes + math.pi / 4.0) % (math.pi / 2.0) - math.pi / 4.0
    best = np.abs(off).argmin(axis=1)
    off = off[np.arange(len(off)), best]
    is_near = (np.abs(off) <= math.radians(_ACROSS_DEG)) & (adjustment.surface < 0)
    for k in np.flatnonzero(is_near).tolist():
        along = azimuth[k] - off[k] + math.pi / 2.0
        factors = np.array([[[math.cos(along), math.sin(along), 0.0]]])
        yield Condition(STRIKE, (k + 1,), _STRIKE_SIGMA * float(steepness[k]), factors)


def _units(coefficients: FloatArray) -> FloatArray:
    """Return the directions in which planes rise, shape (n, 2)."""
    return coefficients[:, :2] / np.maximum(np.hypot(*coefficients[:, :2].T), 1e-12)[:, None]


def _corners(
    pieces: Pieces, ends: FloatArray, walls: FloatArray, planes: FloatArray, spacing: float
) -> Iterator[Condition]:
    """Pair the ends of lines with the outline's corners that they nearly pass through."""
    corners, before, moves = walls[:, 0], walls_before(walls), corner_moves(walls)
    (x, y), (u, v) = (ends[:, 1] - ends[:, 0]).T, np.moveaxis(corners - ends[:, :, None], -1, 0)
    beside = np.abs(u * y[:, None, None] - v * x[:, None, None])
    is_passed = beside <= _BESIDE_CORNER * spacing * np.maximum(np.hypot(x, y), 1e-12)[:, None, None]
    away = np.where(is_passed, np.hypot(u, v), np.inf)
    near = np.where(away.min(axis=2) < _BEFORE_CORNER * spacing, away.argmin(axis=2), -1)
    pairs = zip(pieces.first.tolist(), pieces.second.tolist(), near.tolist(), strict=True)
    for i, j, at in dict.fromkeys((i, j, at) for i, j, rows in pairs for at in rows if at >= 0):
        position = np.append(corners[at], 1.0)
        bend = float(np.hypot(*(planes[i - 1, :2] - planes[j - 1, :2])))
        factors, own = np.array([[position, -position]]), (int(before[at]), at)
        yield Condition(
            CORNER, (i, j), _HIP_SIGMA * bend, factors, walls=own, moves=np.stack([moves[at]] * 2)
        )


def _common_points(
    pieces: Pieces, ends: FloatArray, gradients: FloatArray, spacing: float
) -> Iterator[Condition]:
    """Find where the ends of lines between four or more planes come together."""
    if len({*pieces.first.tolist(), *pieces.second.tolist()}) < _LEAST_PLANES:
        return
    positions = ends.reshape(-1, 2)
    tree = cKDTree(positions, balanced_tree=False, compact_nodes=False)
    near = tree.query_pairs(_SAME_POINT * spacing, output_type="ndarray")
    cluster = sets_of_pairs(len(positions), *near.T).tolist()
    pairs = np.repeat(np.column_stack([pieces.first, pieces.second]), 2, axis=0)
    members: dict[int, list[int]] = {number: [] for number in cluster}
    for row, number in enumerate(cluster):
        members[number].append(row)
    for number in sorted(members):
        mine = members[number]
        if 2 * len(mine) < _LEAST_PLANES or len(met := _planes_of(pairs[mine])) < _LEAST_PLANES:
            continue
        planes = tuple(sorted(met))
        point = common_point(gradients[np.array(planes) - 1])
        if np.hypot(*(positions[mine] - point[:2]).T).min() <= _SAME_POINT * spacing:
            yield Condition(POINT, planes, _POINT_SIGMA)


def _planes_of(pairs: NDArray[np.int32]) -> set[int]:
    return set(pairs.ravel().tolist())
