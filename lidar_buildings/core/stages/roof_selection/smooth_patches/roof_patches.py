"""The smooth patches of opaque surface that roofs are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.roof_selection.candidates import MAX_ANGLE_DEG, MAX_SLOPE_DEG, Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.decks import is_deck
from lidar_buildings.core.stages.roof_selection.smooth_patches.foliage import (
    MIN_PATCH_AREA,
    Patches,
    is_foliage,
)
from lidar_buildings.core.stages.roof_selection.surroundings import MAX_LINEARITY, share_around
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.core.surfaces.surface_patches import connected_parts, plan_areas, smooth_patches

#: Radii among which the one of least entropy is taken, as multiples of the smallest one.
RADIUS_STEPS = np.array([1.0, 1.35, 1.8])
#: A plane through fewer points says nothing of its roughness.
MIN_PLANE_POINTS = 6
#: Largest mean roughness of small, middling and large patches that start a roof, in parts of `max_roughness`:
#: flat spots of foliage are small, so the smaller a patch the smoother it has to be.
PATCH_ROUGHNESS = np.array([0.4, 0.55, 0.85])
#: Where middling and large patches begin, in multiples of `MIN_PATCH_AREA`.
PATCH_SIZES = np.array([2.0, 10.0])
#: Patches beside a roof count down to this part of `MIN_PATCH_AREA`, if as smooth as middling ones.
TOUCHING_PATCH = 0.25
#: Noise of a point in plan as a multiple of that in height, which makes steep roofs rougher than level ones.
HORIZONTAL_NOISE = 1.5
#: Share of returns around a patch that are not the last of their pulse, from which on it is foliage.
MAX_PENETRATION = 0.25
#: Distance from the neighbour's tangent plane over which a patch goes on, a multiple of `max_roughness`.
PATCH_OFFSET = 1.5


@dataclass(frozen=True, eq=False)
class RoofSurface:
    """
    The points from which roofs are completed.

    Attributes
    ----------
    is_surface : ndarray of bool, shape (n_points,)
        Point of an accepted patch.
    is_wall : ndarray of bool, shape (n_points,)
        Point of a smooth surface steeper than a roof.
    normals : ndarray of shape (n_points, 3)
        Unit normals of the surface points, 0 elsewhere.
    """

    is_surface: NDArray[np.bool_]
    is_wall: NDArray[np.bool_]
    normals: NDArray[np.float64]


def find_roof_surface(candidates: Candidates, config: RoofSelectionConfig) -> RoofSurface:
    """
    Find smooth patches among the last returns, and accept those that are large, or touch a large one.

    Parameters
    ----------
    candidates : Candidates
        Smooth are last returns from `min_height` on; the others tell what foliage is, and the ground what
        decks are.
    config : RoofSelectionConfig
        The stage's parameters.
    """
    points, height, is_last, _, ground, radius, cell = candidates
    n = len(points)
    rows = np.flatnonzero(is_last & (height >= config.min_height))
    features = eigen_features(points[rows], list(radius * RADIUS_STEPS), min_neighbours=MIN_PLANE_POINTS)
    # As it would be if the surface lay level.
    roughness = features.roughness / np.hypot(
        features.normals[:, 2], HORIZONTAL_NOISE * _sine(features.normals)
    )
    smooth = (roughness <= config.max_roughness) & (features.linearity <= MAX_LINEARITY)
    smooth &= features.n_neighbours >= MIN_PLANE_POINTS
    steep = features.normals[:, 2] < math.cos(math.radians(MAX_SLOPE_DEG))
    surface = RoofSurface(np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.zeros((n, 3)))
    surface.is_wall[rows[smooth & steep]] = True
    roof = smooth & ~steep
    rows, normals, roughness = rows[roof], features.normals[roof], roughness[roof]
    patch = smooth_patches(
        points[rows],
        normals,
        _link_lengths(features.n_neighbours[roof], features.radius[roof], radius),
        max_angle_deg=MAX_ANGLE_DEG,
        max_offset=PATCH_OFFSET * config.max_roughness,
    )
    patches = Patches(rows, patch, normals, plan_areas(points[rows], patch, cell))
    penetration = share_around(points, ~is_last, radius)[rows]
    starts, touches = _judged(patches, roughness, penetration, height[rows], config)
    small_area = PATCH_SIZES[1] * MIN_PATCH_AREA
    is_other = is_foliage(candidates, patches, small_area, config)
    is_other |= is_deck(points[rows], patch, ground, cell)
    accepted = _touching(points[rows], patch, starts & ~is_other, touches & ~is_other, radius)
    surface.is_surface[rows[accepted]] = True
    surface.normals[rows[accepted]] = normals[accepted]
    return surface


def _link_lengths(
    n_neighbours: NDArray[np.int64], chosen: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the longest link of each point: its own radius where few points lie, as on wet or dark roofs."""
    is_sparse = n_neighbours * (radius / chosen) ** 2 < MIN_PLANE_POINTS
    return np.where(is_sparse, chosen, radius)


def _judged(
    patches: Patches,
    roughness: NDArray[np.float64],
    penetration: NDArray[np.float64],
    height: NDArray[np.float64],
    config: RoofSelectionConfig,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which patches start a roof, and which are part of one if they touch it."""
    relative = patches.mean(roughness) / config.max_roughness
    limit = PATCH_ROUGHNESS[np.digitize(patches.area, PATCH_SIZES * MIN_PATCH_AREA)]
    hard = (patches.mean(penetration) <= MAX_PENETRATION) & (patches.mean(height) >= config.min_height)
    starts = hard & (relative <= limit) & (patches.area >= MIN_PATCH_AREA)
    touches = hard & (relative <= np.maximum(limit, PATCH_ROUGHNESS[1]))
    return starts, touches & (patches.area >= TOUCHING_PATCH * MIN_PATCH_AREA)


def _touching(
    points: NDArray[np.float64],
    patch: NDArray[np.int64],
    starts: NDArray[np.bool_],
    touches: NDArray[np.bool_],
    radius: float,
) -> NDArray[np.bool_]:
    """Tell which points are of patches that start a roof, or are connected with one in plan."""
    accepted = (starts | touches)[patch]
    rows = np.flatnonzero(accepted)
    part = connected_parts(points[rows], radius, in_plan=True)
    accepted[rows] = (np.bincount(part, starts[patch[rows]]) > 0)[part]
    return accepted


def _sine(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(normals[:, 0], normals[:, 1])
