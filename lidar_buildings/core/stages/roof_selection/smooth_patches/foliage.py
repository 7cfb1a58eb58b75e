"""Flat spots of foliage: clipped hedges and crowns that are as smooth as a roof over a few square metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.surroundings import share_around

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
    columns : Columns
        The smooth points; their `rows` are those of the candidates.
    label : ndarray of int64, shape (n_smooth,)
        The patch of each of them, from 0 on.
    normals : ndarray of shape (n_smooth, 3)
        Their unit normals.
    area : ndarray of shape (n_patches,)
        In plan [m²].
    """

    columns: Columns
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
    is_small = patches.area < small_area
    is_low = patches.mean(candidates.height[patches.columns.rows]) < config.min_height + LOW_HEIGHT
    is_split = np.zeros(len(is_small), dtype=bool)
    if not candidates.is_only.all():
        asks = is_small[patches.label]
        chosen = np.zeros(len(candidates.points), dtype=bool)
        chosen[patches.columns.rows[asks]] = True
        share = np.zeros(len(asks))
        reach = SPLIT_REACH * candidates.radius
        share[asks] = share_around(candidates.columns, chosen, ~candidates.is_only, reach)
        is_split = patches.mean(share) > MAX_SPLIT
    is_hedge = is_small & is_low & ~is_split
    if is_hedge.any():
        is_hedge &= _loose_per_point(candidates, patches, is_hedge, small_area, config) > MAX_OFF_SURFACE
    return is_small & (is_split | is_hedge)


def _loose_per_point(
    candidates: Candidates,
    patches: Patches,
    asked: NDArray[np.bool_],
    small_area: float,
    config: RoofSelectionConfig,
) -> NDArray[np.float64]:
    """
    Return how many points that continue no surface lie around each patch asked about, per point of it.
    """
    columns, smooth = candidates.columns, patches.columns
    label = np.full(len(columns.points), -1, dtype=np.int64)
    label[smooth.rows] = patches.label
    asking = smooth.select(asked[patches.label])
    surface = smooth.select((patches.area >= MIN_PATCH_AREA)[patches.label])
    counts = np.zeros(len(patches.area), dtype=np.int64)
    _count_loose(
        columns.points,
        columns.first,
        columns.around(max(OFF_SURFACE_REACH, candidates.radius, COVER_REACH)),
        label,
        asking.points,
        asking.first,
        patches.label[asking.rows],
        surface.points,
        surface.first,
        patches.normals[surface.rows],
        patches.area[patches.label[surface.rows]] >= small_area,
        candidates.radius,
        config.max_plane_distance,
        counts,
    )
    return counts / np.bincount(patches.label)


@kernel
def _count_loose(  # type: ignore[no-untyped-def]
    points,
    first,
    runs,
    label,
    asking,
    asking_first,
    asking_label,
    surface,
    surface_first,
    normals,
    is_large,
    radius,
    max_distance,
    counts,
):
    """Add each point off surfaces to the count of every patch that asks near it but its own, once."""
    counted_last = np.full(len(counts), -1, dtype=np.int64)
    for k in range(len(first) - 1):
        n_asking = 0
        for row in range(runs.shape[1]):
            n_asking += asking_first[runs[k, row, 1]] - asking_first[runs[k, row, 0]]
        if n_asking == 0:
            continue
        for i in range(first[k], first[k + 1]):
            x, y, z = points[i]
            is_loose = True
            for row in range(runs.shape[1]):
                for j in range(surface_first[runs[k, row, 0]], surface_first[runs[k, row, 1]]):
                    dx, dy, dz = surface[j, 0] - x, surface[j, 1] - y, surface[j, 2] - z
                    plan = dx * dx + dy * dy
                    off = normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz
                    continues = plan + dz * dz <= radius * radius and abs(off) <= max_distance
                    if continues or (is_large[j] and dz >= 0.0 and plan <= COVER_REACH * COVER_REACH):
                        is_loose = False
                        break
                if not is_loose:
                    break
            if not is_loose:
                continue
            for row in range(runs.shape[1]):
                for j in range(asking_first[runs[k, row, 0]], asking_first[runs[k, row, 1]]):
                    dx, dy, dz = asking[j, 0] - x, asking[j, 1] - y, asking[j, 2] - z
                    patch = asking_label[j]
                    if (
                        dx * dx + dy * dy + dz * dz <= OFF_SURFACE_REACH * OFF_SURFACE_REACH
                        and patch != label[i]
                        and counted_last[patch] != i
                    ):
                        counted_last[patch] = i
                        counts[patch] += 1
