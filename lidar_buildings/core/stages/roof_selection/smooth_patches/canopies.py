"""Canopies: what stands above a roof and lets pulses through to it, as crowns do and chimneys do not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.sectors import sector_of
from lidar_buildings.core.surfaces.surface_patches import connected_columns

#: Roof so far below other points is below a canopy and not beside it [m].
MIN_GAP = 0.8
#: How far around a roof point to look for the canopy in plan, in smallest radii of neighbourhoods.
REACH_RADII = 1.0
#: Sectors of eight that have to show canopy: a point at the foot of a straight wall sees it in five.
MIN_SECTORS = 6
#: Roof points below a part per point of it, from which on it is a canopy.
MAX_SEEN_THROUGH = 0.1
#: Thinner parts are no crowns but louvres, sails and solar panels [m].
MIN_THICKNESS = 2.5


def is_canopy(
    columns: Columns, roof: NDArray[np.bool_], above: NDArray[np.bool_], radius: float
) -> NDArray[np.bool_]:
    """
    Tell which of the points that may stand on roofs are of parts through which the roof below is seen.

    Parameters
    ----------
    columns : Columns
        The points [m].
    roof : ndarray of bool, shape (n_points,)
        Which points are roof.
    above : ndarray of bool, shape (n_points,)
        Which others may be canopy; parts are what steps of a radius connect among them.
    radius : float
        Radius of a neighbourhood [m].
    """
    canopy, others = np.zeros(len(roof), dtype=bool), columns.select(above)
    part = connected_columns(others, radius)
    low, high = np.full((2, part.max(initial=-1) + 1), [[np.inf], [-np.inf]])
    np.minimum.at(low, part, others.points[:, 2])
    np.maximum.at(high, part, others.points[:, 2])
    is_thick = (high - low >= MIN_THICKNESS)[part]
    if not is_thick.any():
        return canopy
    thick, roofs = others.select(is_thick), columns.select(roof)
    counts, reach = np.zeros(len(low), dtype=np.int64), REACH_RADII * radius
    runs = columns.around(reach)
    _count_seen(roofs.points, roofs.first, thick.points, thick.first, part[thick.rows], runs, reach, counts)
    is_seen_through = counts > MAX_SEEN_THROUGH * np.bincount(part)
    canopy[others.rows[thick.rows]] = is_seen_through[part[thick.rows]]
    return canopy


@kernel
def _count_seen(roofs, roofs_first, points, first, part, runs, reach, counts):  # type: ignore[no-untyped-def]
    """Count for each part the roof points that it hangs over, seen in most directions."""
    counted_last = np.full(len(counts), -1, dtype=np.int64)
    for k in range(len(first) - 1):
        for i in range(roofs_first[k], roofs_first[k + 1]):
            x, y, z = roofs[i]
            seen = 0
            for row in range(runs.shape[1]):
                for j in range(first[runs[k, row, 0]], first[runs[k, row, 1]]):
                    dx, dy = points[j, 0] - x, points[j, 1] - y
                    if points[j, 2] >= z + MIN_GAP and dx * dx + dy * dy <= reach * reach:
                        seen |= 1 << sector_of(dx, dy)
            n_seen = 0
            while seen:
                n_seen += seen & 1
                seen >>= 1
            if n_seen < MIN_SECTORS:
                continue
            for row in range(runs.shape[1]):
                for j in range(first[runs[k, row, 0]], first[runs[k, row, 1]]):
                    dx, dy = points[j, 0] - x, points[j, 1] - y
                    if (
                        points[j, 2] >= z + MIN_GAP
                        and dx * dx + dy * dy <= reach * reach
                        and counted_last[part[j]] != i
                    ):
                        counted_last[part[j]] = i
                        counts[part[j]] += 1
