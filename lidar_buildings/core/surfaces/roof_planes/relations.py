"""Relations between the planes of a roof: level, facing common directions, equally steep, one plane."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lidar_buildings.core.kernels import kernel
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
    move = allowed_move(planes.rms)
    slopes = planes.coefficients[:, :2]
    steepness = np.hypot(slopes[:, 0], slopes[:, 1])
    along = slopes / np.maximum(steepness, 1e-12)[:, None]
    spread = planes.scatter[:, :2, :2] / planes.counts[:, None, None]
    upright = planes.normals[:, 2]
    deep = np.sqrt(np.einsum("ki,kij,kj->k", along, spread, along)) * upright
    across = np.column_stack([-along[:, 1], along[:, 0]])
    wide = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", across, spread, across), 0.0)) * upright
    level = planes.roof & (steepness * deep <= move) & (steepness <= _MOST_LEVEL)
    facing = planes.roof & ~level & (steepness >= _LEAST_STEEP)
    azimuth = np.arctan2(slopes[:, 1], slopes[:, 0])
    reach = np.minimum(move / np.maximum(steepness * wide, 1e-9), _MOST_AZIMUTH)
    azimuth = _common_azimuths(azimuth, reach, planes.counts * (steepness * wide) ** 2, facing, directions)
    facing &= np.isfinite(azimuth)
    towards = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    rise = np.einsum("ki,ki->k", slopes, towards)
    reach = np.minimum(move / np.maximum(deep, 1e-9), _MOST_SLOPE)
    slope, mean_rise = _groups(rise, reach, planes.counts * deep**2, facing)
    rise = np.where(slope >= 0, mean_rise, rise)
    surface = _common_surfaces(planes, level, azimuth, slope, rise, move)
    return Relations(level, azimuth, slope, surface)


def _common_azimuths(
    azimuth: FloatArray, reach: FloatArray, weight: FloatArray, facing: BoolArray, directions: FloatArray
) -> FloatArray:
    """
    Return the directions that planes may be made to face, NaN where a plane goes its own way.

    Planes group round the best known of them; a group takes a direction of the outline if nearly all of it
    can.
    """
    common = np.full(len(azimuth), math.nan)
    remaining = np.flatnonzero(facing)
    remaining = remaining[np.argsort(-weight[remaining], kind="stable")]
    while len(remaining):
        off = _to_right_angle(azimuth[remaining] - azimuth[remaining[0]])
        members = np.abs(off) <= reach[remaining] + reach[remaining[0]]
        rows, off = remaining[members], off[members]
        mean = azimuth[rows[0]] + np.average(off, weights=np.maximum(weight[rows], 1e-12))
        mean = _outline_direction(azimuth[rows], reach[rows], weight[rows], mean, directions)
        off = _to_right_angle(azimuth[rows] - mean)
        kept = np.abs(off) <= reach[rows]
        kept[0] = True
        common[rows[kept]] = azimuth[rows[kept]] - off[kept]
        remaining = remaining[~np.isin(remaining, rows[kept])]
    return common


def _outline_direction(
    azimuth: FloatArray, reach: FloatArray, weight: FloatArray, mean: float, directions: FloatArray
) -> float:
    """
    Return the outline's direction nearest to a group's mean if all but a tenth of the group can take it.
    """
    if len(directions):
        nearest = directions[np.argmin(np.abs(_to_right_angle(directions - mean)))]
        fits = np.abs(_to_right_angle(azimuth - nearest)) <= reach
        if fits[0] and weight[fits].sum() >= 0.9 * weight.sum():
            return float(nearest)
    return mean


def _to_right_angle(angle: FloatArray) -> FloatArray:
    """Difference of angles from the nearest multiple of a right angle [rad]."""
    return np.asarray(angle - _RIGHT_ANGLE * np.rint(angle / _RIGHT_ANGLE))


@kernel
def _groups(values, reach, weight, candidates):  # type: ignore[no-untyped-def]
    """
    Group values round the weightiest within their reach; return each one's group of several, and its mean.
    """
    group = np.full(len(values), -1, dtype=np.int64)
    means = values.copy()
    pending, is_member = candidates.copy(), np.empty(len(values), dtype=np.bool_)
    n_groups = 0
    while True:
        first = -1
        for k in range(len(values)):
            if pending[k] and (first < 0 or weight[k] > weight[first]):
                first = k
        if first < 0:
            return group, means
        total, mass = 0.0, 0.0
        for k in range(len(values)):
            if pending[k] and abs(values[k] - values[first]) <= reach[k] + reach[first]:
                total += max(weight[k], 1e-12) * (values[k] - values[first])
                mass += max(weight[k], 1e-12)
        mean = values[first] + total / mass
        size = 0
        for k in range(len(values)):
            is_member[k] = pending[k] and (k == first or abs(values[k] - mean) <= reach[k])
            size += is_member[k]
            pending[k] = pending[k] and not is_member[k]
        for k in range(len(values)):
            if is_member[k] and size > 1:
                group[k], means[k] = n_groups, mean
        n_groups += size > 1


def _common_surfaces(
    planes: FreePlanes,
    level: BoolArray,
    azimuth: FloatArray,
    slope: IntArray,
    rise: FloatArray,
    move: FloatArray,
) -> IntArray:
    """Number the groups of level planes at one height, and of parallel planes that are pieces of one."""
    surface = np.full(len(level), -1, dtype=np.int64)
    kinds = np.where(level, 0, np.where(slope >= 0, slope + 1, -1))
    kept = np.where(level | (slope < 0), 0.0, azimuth)
    steep = np.where(level, 0.0, rise)
    slopes = steep[:, None] * np.column_stack([np.cos(kept), np.sin(kept)])
    heights = planes.mean[:, 2] - np.einsum("ki,ki->k", slopes, planes.mean[:, :2])
    # Planes of one kind that look in one direction, to a hundredth of a degree, are parallel.
    turns = np.rint(np.degrees(kept) % 360.0 * 100.0).astype(np.int64) % 36_000
    parallel = np.where(kinds >= 0, kinds * 36_000 + turns, -1)
    n_groups = 0
    for key in np.unique(parallel[parallel >= 0]):
        if np.count_nonzero(parallel == key) > 1:
            same, _ = _groups(heights, move, planes.counts, parallel == key)
            surface = np.where(same >= 0, same + n_groups, surface)
            n_groups += int(same.max()) + 1
    return surface
