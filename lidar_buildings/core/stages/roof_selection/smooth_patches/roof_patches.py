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
from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import mean_votes, plane_votes
from lidar_buildings.core.stages.roof_selection.surroundings import MAX_LINEARITY
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.core.surfaces.surface_patches import connected_columns, smooth_patches

#: Radii among which the one of least entropy is taken, as multiples of the smallest one.
RADIUS_STEPS = np.array([1.0, 1.35, 1.8])
#: A plane through fewer points says nothing of its roughness.
MIN_PLANE_POINTS = 6
#: Largest mean roughness of small, middling and large patches that start a roof, in parts of `max_roughness`:
#: flat spots of foliage are small, so the smaller a patch the smoother it has to be.
PATCH_ROUGHNESS = np.array([0.4, 0.55, 0.85])
#: Where middling and large patches begin, in multiples of `MIN_PATCH_AREA`.
PATCH_SIZES = np.array([2.0, 10.0])
#: Noise of a point in plan as a multiple of that in height, which makes steep roofs rougher than level ones.
HORIZONTAL_NOISE = 1.5
#: Distance from the neighbour's tangent plane over which a patch goes on, a multiple of `max_roughness`.
PATCH_OFFSET = 1.5
#: Wider neighbourhoods reach beyond the faces of houses and are hardly ever smooth [m]; then so many of a
#: point's nearest neighbours have to lie on one plane through it, of `N_VOTERS`.
FACE_WIDTH, MIN_VOTES = 4.0, 7


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
    normals : ndarray of shape (n_surface_points, 3)
        Their unit normals.
    is_deck : ndarray of bool, shape (n_points,)
        Point of a patch that is a deck.
    votes : ndarray of shape (n_points,) or None
        Mean votes around each point from `min_height` on; None where neighbourhoods are no wider than faces.
    """

    is_surface: NDArray[np.bool_]
    is_wall: NDArray[np.bool_]
    normals: NDArray[np.float64]
    is_deck: NDArray[np.bool_]
    votes: NDArray[np.float64] | None


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
    columns, radius = candidates.columns, candidates.radius
    n = len(columns.points)
    rows = np.flatnonzero(candidates.is_last & (candidates.height >= config.min_height))
    features = eigen_features(
        columns.points.take(rows, axis=0), list(radius * RADIUS_STEPS), min_neighbours=MIN_PLANE_POINTS
    )
    upward = features.normals[:, 2]
    # As it would be if the surface lay level.
    noise = np.sqrt(upward**2 + HORIZONTAL_NOISE**2 * np.maximum(1.0 - upward**2, 0.0))
    roughness = features.roughness / noise
    smooth = (roughness <= config.max_roughness) & (features.linearity <= MAX_LINEARITY)
    smooth &= features.n_neighbours >= MIN_PLANE_POINTS
    steep = upward < math.cos(math.radians(MAX_SLOPE_DEG))
    is_surface, is_wall = np.zeros((2, n), dtype=bool)
    is_wall[rows[smooth & steep]] = True
    level, normals = smooth & ~steep, features.normals
    around = None
    if 2.0 * radius > FACE_WIDTH:
        votes, voted = plane_votes(columns.points.take(rows, axis=0), config.max_roughness)
        is_voted = ~level & (votes >= MIN_VOTES)
        normals = np.where(is_voted[:, None], voted, normals)
        roughness[is_voted] = PATCH_ROUGHNESS[0] * config.max_roughness
        level |= is_voted
        own, high = np.zeros(n, dtype=np.int64), np.flatnonzero(candidates.height >= config.min_height)
        own[rows] = votes
        around = np.zeros(n)
        around[high] = mean_votes(columns.points.take(high, axis=0), own[high])
    is_surface[rows[level]] = True
    points, normals, roughness = columns.select(is_surface), normals[level], roughness[level]
    reach = _link_lengths(features.n_neighbours[level], features.radius[level], radius)
    del features, upward, noise, rows  # half of the memory
    label = smooth_patches(
        points,
        normals,
        reach,
        max_angle_deg=MAX_ANGLE_DEG,
        max_offset=PATCH_OFFSET * config.max_roughness,
    )
    patch = np.full(n, -1, dtype=np.int64)
    patch[points.rows] = label
    patches = Patches(points, label, candidates.areas(patch, label.max(initial=-1) + 1))
    del patch
    accepted, is_deck_point = _accepted(candidates, patches, roughness, config)
    is_surface[points.rows[~accepted]] = False
    on_deck = np.zeros(n, dtype=bool)
    on_deck[points.rows[is_deck_point]] = True
    return RoofSurface(is_surface, is_wall, normals[accepted], on_deck, around)


def _accepted(
    candidates: Candidates, patches: Patches, roughness: NDArray[np.float64], config: RoofSelectionConfig
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which smooth points are of patches that start a roof or touch one in plan, and which of decks."""
    relative = patches.mean(roughness) / config.max_roughness
    limit = PATCH_ROUGHNESS[np.digitize(patches.area, PATCH_SIZES * MIN_PATCH_AREA)]
    starts = relative <= limit
    accepted = (patches.area >= MIN_PATCH_AREA) & (starts | (relative <= PATCH_ROUGHNESS[1]))
    small_area = PATCH_SIZES[1] * MIN_PATCH_AREA
    accepted &= ~is_foliage(candidates, patches, small_area)
    points, label = patches.columns, patches.label
    asked = accepted[label]
    decks = is_deck(points.points[asked], label[asked], len(accepted), candidates.ground, candidates.cell)
    accepted &= ~decks
    touching = points.select(accepted[label])
    part = connected_columns(touching, candidates.radius, in_plan=True)
    is_roof = np.zeros(len(label), dtype=bool)
    is_roof[touching.rows] = (np.bincount(part, starts[label[touching.rows]]) > 0)[part]
    return is_roof, decks[label]


def _link_lengths(
    n_neighbours: NDArray[np.int64], chosen: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the longest link of each point: its own radius where few points lie, as on wet or dark roofs."""
    is_sparse = n_neighbours * (radius / chosen) ** 2 < MIN_PLANE_POINTS
    return np.where(is_sparse, chosen, radius)
