"""Flat spots of foliage: clipped hedges and crowns that are as smooth as a roof over a few square metres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.surroundings import share_around

#: Smallest smooth patch that starts a roof: flat spots of crowns are smaller [m²].
MIN_PATCH_AREA = 4.0
#: Foliage splits pulses: share of the returns at a small patch that belong to pulses with several, above
#: which it is no roof, and how far from its points to look, in radii. Edges of small roofs make it up to 0.5.
MAX_SPLIT = 0.55
SPLIT_REACH = 0.5


class Patches(NamedTuple):
    """
    Smooth patches of a cloud.

    Attributes
    ----------
    columns : Columns
        The smooth points; their `rows` are those of the candidates.
    label : ndarray of int64, shape (n_smooth,)
        The patch of each of them, from 0 on.
    area : ndarray of shape (n_patches,)
        In plan [m²].
    """

    columns: Columns
    label: NDArray[np.int64]
    area: NDArray[np.float64]

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean of the smooth points' values in each patch."""
        return np.bincount(self.label, values) / np.bincount(self.label)


def is_foliage(candidates: Candidates, patches: Patches, small_area: float) -> NDArray[np.bool_]:
    """
    Tell which patches smaller than an area [m²] are foliage: most of their pulses are split.

    Parameters
    ----------
    candidates : Candidates
        Everything that rises above ground.
    patches : Patches
        Of these points.
    small_area : float
        Larger patches are never foliage [m²].

    Returns
    -------
    ndarray of bool, shape (n_patches,)
        None without return numbers.
    """
    is_small = patches.area < small_area
    if candidates.is_only.all():
        return np.zeros(len(is_small), dtype=bool)
    asks = is_small[patches.label]
    chosen = np.zeros(len(candidates.points), dtype=bool)
    chosen[patches.columns.rows[asks]] = True
    share = np.zeros(len(asks))
    reach = SPLIT_REACH * candidates.radius
    share[asks] = share_around(candidates.columns, chosen, ~candidates.is_only, reach)
    return is_small & (patches.mean(share) > MAX_SPLIT)
