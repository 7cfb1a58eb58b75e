"""Flat spots of foliage: clipped hedges and crowns that are as smooth as a roof over a few square metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.surroundings import (
    below_roof,
    near_tangent_plane,
    share_around,
)

#: Smallest smooth patch that starts a roof: flat spots of crowns are smaller [m²].
MIN_PATCH_AREA = 4.0
#: Foliage splits pulses: share of the returns at a small patch that belong to pulses with several, above
#: which it is no roof, and how far from its points to look, in radii. Edges of small roofs make it up to 0.5.
MAX_SPLIT = 0.55
SPLIT_REACH = 0.5
#: Foliage goes on beside and below its flat top: points off surfaces per point of the patch, from which on a
#: low and small one is a hedge, and how far from it they count [m].
MAX_OFF_SURFACE = 0.45
OFF_SURFACE_REACH = 1.0
#: Patches are low up to this height above `min_height` [m]; clipped hedges are hardly higher.
LOW_HEIGHT = 1.0
#: Points this near in plan below a large roof are its façade, and not off surfaces [m].
COVER_REACH = 0.6


class Patches(NamedTuple):
    """
    Smooth patches of a cloud.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_smooth,)
        The smooth points among all.
    label : ndarray of int64, shape (n_smooth,)
        The patch of each of them, from 0 on.
    normals : ndarray of shape (n_smooth, 3)
        Their unit normals.
    area : ndarray of shape (n_patches,)
        In plan [m²].
    """

    rows: NDArray[np.int64]
    label: NDArray[np.int64]
    normals: NDArray[np.float64]
    area: NDArray[np.float64]

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean of the smooth points' values in each patch."""
        return np.bincount(self.label, values) / np.bincount(self.label)


def is_foliage(
    candidates: Candidates, patches: Patches, small_area: float, config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """
    Tell which patches smaller than an area [m²] are foliage.

    Parameters
    ----------
    candidates : Candidates
        Everything that rises above ground.
    patches : Patches
        Of these points.
    small_area : float
        Larger patches are never foliage [m²].
    config : RoofSelectionConfig
        `min_height`, `max_plane_distance`.

    Returns
    -------
    ndarray of bool, shape (n_patches,)
        Without return numbers only the points off surfaces decide.
    """
    points, radius = candidates.points, candidates.radius
    split = patches.mean(share_around(points, ~candidates.is_only, SPLIT_REACH * radius)[patches.rows])
    is_low = patches.mean(candidates.height[patches.rows]) < config.min_height + LOW_HEIGHT
    is_hedge = is_low & (
        _off_surface_per_point(points, patches, small_area, radius, config) > MAX_OFF_SURFACE
    )
    return (patches.area < small_area) & ((split > MAX_SPLIT) | is_hedge)


def _off_surface_per_point(
    points: NDArray[np.float64],
    patches: Patches,
    small_area: float,
    radius: float,
    config: RoofSelectionConfig,
) -> NDArray[np.float64]:
    """Return how many points that continue no surface lie around each patch, per point of the patch."""
    area, normals = np.zeros(len(points)), np.zeros((len(points), 3))
    area[patches.rows], normals[patches.rows] = patches.area[patches.label], patches.normals
    is_surface = area >= MIN_PATCH_AREA
    is_off_surface = ~near_tangent_plane(points, normals, is_surface, radius, config.max_plane_distance)
    is_off_surface &= ~below_roof(points, area >= small_area, COVER_REACH)
    label = np.full(len(points), -1, dtype=np.int64)
    label[patches.rows] = patches.label
    counts = np.zeros(len(patches.area), dtype=np.int64)
    grid = build_grid(points, OFF_SURFACE_REACH)
    _count_off_surface(grid, label[grid.rows], is_off_surface[grid.rows], OFF_SURFACE_REACH, counts)
    return counts / np.bincount(patches.label)


@njit(cache=True, nogil=True)
def _count_off_surface(grid, label, is_off_surface, radius, counts):  # type: ignore[no-untyped-def]
    """Add each point off surfaces to the count of every patch near it but its own, once."""
    near = np.empty(len(grid.points), dtype=np.int64)
    counted_last = np.full(len(counts), -1, dtype=np.int64)
    for i in range(len(grid.points)):
        if not is_off_surface[i]:
            continue
        x, y, z = grid.points[i]
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, radius, False, near)):
            patch = label[near[k]]
            if patch >= 0 and patch != label[i] and counted_last[patch] != i:
                counted_last[patch] = i
                counts[patch] += 1
