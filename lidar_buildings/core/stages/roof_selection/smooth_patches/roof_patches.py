"""The smooth patches of opaque surface that roofs and walls are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.candidates import MAX_ANGLE_DEG, MAX_SLOPE_DEG, Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.decks import is_deck
from lidar_buildings.core.stages.roof_selection.smooth_patches.walls import wall_areas
from lidar_buildings.core.stages.roof_selection.surroundings import MAX_LINEARITY
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
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
    normals: NDArray[np.float64]  #: their unit normals, shape (n_surface_points, 3)


def find_roof_surface(candidates: Candidates, config: RoofSelectionConfig) -> RoofSurface:
    """Find smooth patches among the last returns, and accept those that are smooth for their size."""
    columns, radius = candidates.columns, candidates.radius
    n = len(columns.points)
    rows = np.flatnonzero(candidates.is_last)
    features = eigen_features(
        columns.points.take(rows, axis=0), list(radius * RADIUS_STEPS), min_neighbours=MIN_PLANE_POINTS
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
    links = _link_lengths(features.n_neighbours, features.radius, radius)
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
    accepted, hangs = _accepted(candidates, roofs), _of_walls(roofs)
    is_other[roofs.columns.rows[hangs]] = True
    accepted &= ~hangs
    is_surface[roofs.columns.rows[accepted]] = True
    own = roofs.normals.take(np.flatnonzero(accepted), axis=0)
    return RoofSurface(is_surface, is_other, is_wall, own)


class _Known(NamedTuple):
    """What is known of the last returns: their rows, normals, longest links, and roughness as of patches."""

    rows: NDArray[np.intp]
    normals: NDArray[np.float64]
    reach: NDArray[np.float64]
    roughness: NDArray[np.float64]


class _Patches(NamedTuple):
    """Smooth points, the patch of each, its normal, and its roughness in parts of the largest."""

    columns: Columns
    label: NDArray[np.int64]
    normals: NDArray[np.float64]
    roughness: NDArray[np.float64]


def _patches(columns: Columns, known: _Known, chosen: NDArray[np.bool_], max_offset: float) -> _Patches:
    """Join some of the last returns to patches."""
    own, is_chosen = np.flatnonzero(chosen), np.zeros(len(columns.points), dtype=bool)
    is_chosen[known.rows[own]] = True
    points, normals = columns.select(is_chosen), known.normals.take(own, axis=0)
    label = smooth_patches(
        points, normals, known.reach[own], max_angle_deg=MAX_ANGLE_DEG, max_offset=max_offset
    )
    return _Patches(points, label, normals, known.roughness[own])


def _accepted(candidates: Candidates, patches: _Patches) -> NDArray[np.bool_]:
    """Tell which smooth points are of patches that start a roof."""
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
    return np.asarray((accepted & ~decks)[label])


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


def _link_lengths(
    n_neighbours: NDArray[np.int64], chosen: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the longest link of each point: its own radius where few points lie, as on wet or dark roofs."""
    is_sparse = n_neighbours * (radius / chosen) ** 2 < MIN_PLANE_POINTS
    return np.where(is_sparse, chosen, radius)
