"""Relations between the planes of a roof: level, facing common directions, equally steep, one plane."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.surfaces.roof_planes.free_planes import FreePlanes

#: A relation may move a plane by this share of its own roughness at its points,
_SHARE_OF_RMS = 0.5
#: but by no less and no more than this [m].
LEAST_MOVE, _MOST_MOVE = 0.02, 0.04
#: Largest slope [m/m] that may become level, largest difference of slopes [m/m] and of azimuths [rad].
_MOST_LEVEL, _MOST_SLOPE, _MOST_AZIMUTH = 0.06, 0.08, math.radians(6.0)
#: Planes less steep [m/m] face nowhere in particular.
_LEAST_STEEP = 0.04
_RIGHT_ANGLE = math.pi / 2


class Relations(NamedTuple):
    """
    What planes share; -1 where a plane has its own.

    Attributes
    ----------
    level : ndarray of shape (n_planes,), bool
        Which planes are level.
    azimuth : ndarray of shape (n_planes,)
        Direction in which a plane rises, imposed [rad]; NaN if free.
    slope : ndarray of shape (n_planes,), int64
        Number of the group of planes with the same slope.
    surface : ndarray of shape (n_planes,), int64
        Number of the group of pieces of one plane.
    """

    level: BoolArray
    azimuth: FloatArray
    slope: IntArray
    surface: IntArray

    def without(self, planes: IntArray) -> Relations:
        """Return the relations without the latest one that each of these planes has."""
        level, azimuth = self.level.copy(), self.azimuth.copy()
        slope, surface = self.slope.copy(), self.surface.copy()
        for k in planes:
            if surface[k] >= 0:
                surface[k] = -1
            elif slope[k] >= 0:
                slope[k] = -1
            else:
                azimuth[k], level[k] = math.nan, False
        return Relations(level, azimuth, slope, surface)

    def loosened(self) -> Relations:
        """Return the relations of level planes and pieces of one plane alone."""
        alone = np.full(len(self.level), -1, dtype=np.int64)
        return Relations(self.level, np.full(len(self.level), math.nan), alone, self.surface)


def no_relations(n_planes: int) -> Relations:
    """Return relations of planes that share nothing."""
    alone = np.full(n_planes, -1, dtype=np.int64)
    return Relations(np.zeros(n_planes, dtype=np.bool_), np.full(n_planes, math.nan), alone, alone)


def allowed_move(rms: FloatArray) -> FloatArray:
    """By how much relations may move planes at their points, root mean square [m]."""
    return np.clip(_SHARE_OF_RMS * rms, LEAST_MOVE, _MOST_MOVE)


def find_relations(planes: FreePlanes, directions: FloatArray) -> Relations:
    """
    Find the relations that the points allow.

    Parameters
    ----------
    planes : FreePlanes
    directions : ndarray of shape (n_directions,)
        Directions of the outline, each standing for its perpendicular, too [rad].
    """
    n = len(planes.rms)
    related = Relations(
        np.zeros(n, dtype=np.bool_), np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64)
    )
    _relate(
        planes.mean, planes.scatter, planes.normals, planes.counts, planes.coefficients, planes.roof,
        allowed_move(planes.rms), directions, *related,
    )  # fmt: skip
    return related


@kernel
def _relate(  # type: ignore[no-untyped-def]
    mean, scatter, normals, counts, coefficients, roof, move, directions, level, azimuth, slope, surface
):  # fmt: skip
    """Write what planes share."""
    n = len(roof)
    facing = np.empty(n, np.bool_)
    reach, weight, rise, deep = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        a, b = coefficients[k, 0], coefficients[k, 1]
        steep = np.hypot(a, b)
        u, v = a / max(steep, 1e-12), b / max(steep, 1e-12)
        xx, xy, yy = scatter[k, 0, 0] / counts[k], scatter[k, 0, 1] / counts[k], scatter[k, 1, 1] / counts[k]
        deep[k] = math.sqrt(max(u * u * xx + 2.0 * u * v * xy + v * v * yy, 0.0)) * normals[k, 2]
        wide = math.sqrt(max(v * v * xx - 2.0 * u * v * xy + u * u * yy, 0.0)) * normals[k, 2]
        level[k] = roof[k] and steep * deep[k] <= move[k] and steep <= _MOST_LEVEL
        facing[k] = roof[k] and not level[k] and steep >= _LEAST_STEEP
        azimuth[k], slope[k], surface[k] = math.atan2(b, a), -1, -1
        reach[k] = min(move[k] / max(steep * wide, 1e-9), _MOST_AZIMUTH)
        weight[k] = counts[k] * (steep * wide) ** 2
    _face_together(azimuth, reach, weight, facing, directions)
    for k in range(n):
        rise[k] = coefficients[k, 0] * math.cos(azimuth[k]) + coefficients[k, 1] * math.sin(azimuth[k])
        reach[k] = min(move[k] / max(deep[k], 1e-9), _MOST_SLOPE)
        weight[k] = counts[k] * deep[k] ** 2
    _group(rise, reach, weight, facing, slope, 0)
    # Planes of one kind that look in one direction, to a hundredth of a degree, are parallel: level ones, and
    # those of one slope.
    parallel, height = np.full(n, -1, np.int64), np.empty(n)
    for k in range(n):
        height[k] = mean[k, 2]
        if level[k]:
            parallel[k] = 0
        elif slope[k] >= 0:
            turn = np.int64(np.rint(math.degrees(azimuth[k]) % 360.0 * 100.0)) % 36_000
            parallel[k] = (slope[k] + 1) * 36_000 + turn
            u, v = math.cos(azimuth[k]), math.sin(azimuth[k])
            height[k] -= rise[k] * (u * mean[k, 0] + v * mean[k, 1])
    n_groups = 0
    for first in range(n):
        if parallel[first] >= 0:
            key = parallel[first]
            for k in range(n):
                facing[k] = parallel[k] == key
                parallel[k] = -1 if facing[k] else parallel[k]
            n_groups = _group(height, move, counts, facing, surface, n_groups)


@inner_kernel
def _face_together(azimuth, reach, weight, pending, directions):  # type: ignore[no-untyped-def]
    """
    Turn pending planes into the directions that they may be made to face; all others face nowhere, NaN.

    Planes group round the best known of them; a group takes a direction of the outline if nearly all of it
    can.
    """
    left = pending.copy()
    for k in range(len(azimuth)):
        azimuth[k] = azimuth[k] if left[k] else math.nan
    while True:
        first = _heaviest(weight, left)
        if first < 0:
            return
        total, mass, all_mass = 0.0, 0.0, 0.0
        member = left.copy()
        for k in range(len(azimuth)):
            off = _to_right_angle(azimuth[k] - azimuth[first])
            member[k] = left[k] and abs(off) <= reach[k] + reach[first]
            if member[k]:
                total += max(weight[k], 1e-12) * off
                mass += max(weight[k], 1e-12)
                all_mass += weight[k]
        mean = azimuth[first] + total / mass
        nearest, least = math.nan, math.inf
        for direction in directions:
            off = abs(_to_right_angle(direction - mean))
            if off < least:
                nearest, least = direction, off
        fitting = 0.0
        for k in range(len(azimuth)):
            if member[k] and abs(_to_right_angle(azimuth[k] - nearest)) <= reach[k]:
                fitting += weight[k]
        if abs(_to_right_angle(azimuth[first] - nearest)) <= reach[first] and fitting >= 0.9 * all_mass:
            mean = nearest
        for k in range(len(azimuth)):
            off = _to_right_angle(azimuth[k] - mean)
            if member[k] and (k == first or abs(off) <= reach[k]):
                azimuth[k], left[k] = azimuth[k] - off, False


@inner_kernel
def _to_right_angle(angle):  # type: ignore[no-untyped-def]
    """Difference of an angle from the nearest multiple of a right angle [rad]."""
    return angle - _RIGHT_ANGLE * np.rint(angle / _RIGHT_ANGLE)


@inner_kernel
def _heaviest(weight, left):  # type: ignore[no-untyped-def]
    """Return the first of those left with the greatest weight, -1 if there are none."""
    first = -1
    for k in range(len(weight)):
        if left[k] and (first < 0 or weight[k] > weight[first]):
            first = k
    return first


@inner_kernel
def _group(values, reach, weight, candidates, group, n_groups):  # type: ignore[no-untyped-def]
    """
    Group values round the weightiest within their reach, those of several get their mean; return the groups.
    """
    left = candidates.copy()
    while True:
        first = _heaviest(weight, left)
        if first < 0:
            return n_groups
        centre, total, mass = values[first], 0.0, 0.0
        for k in range(len(values)):
            if left[k] and abs(values[k] - centre) <= reach[k] + reach[first]:
                total += max(weight[k], 1e-12) * (values[k] - centre)
                mass += max(weight[k], 1e-12)
        mean = centre + total / mass
        size = 0
        for turn in range(2):
            for k in range(len(values)):
                if left[k] and (k == first or abs(values[k] - mean) <= reach[k]):
                    if turn == 0:
                        size += 1
                    else:
                        left[k] = False
                        if size > 1:
                            group[k], values[k] = n_groups, mean
        n_groups += size > 1
