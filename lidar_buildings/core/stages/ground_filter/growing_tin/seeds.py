"""The first, coarse terrain: the lowest points of large cells, less those that lie on buildings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell

# Chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: How far a seed may stand above its neighbours' plane, in parts of the cells' side.
MAX_RISE = 0.1
#: Neighbouring seeds that a seed is judged by: those of the cells around, roughly.
NEIGHBOURS = 8
#: With fewer seeds than this there is nothing to judge one by.
MIN_SEEDS = 5
#: A building of several cells is taken away from its sides; more often than this would wear down hills.
MAX_PASSES = 3
#: By what part of their trace the diagonal of normal equations is raised.
RIDGE = 1e-12


def choose_seeds(candidates: NDArray[np.float64], cell: float) -> NDArray[np.intp]:
    """
    Return the rows of the points that start the TIN, rising.

    They are the lowest points of the cells of two grids, one shifted by half a cell against the other, so
    that less depends on where a grid happens to lie.

    A cell that a building fills has no ground to give: its lowest point stands out above the plane through
    the seeds around it, weighted by their nearness, and is left out. A hilltop lost in the same way is found
    again by the densification. Only seeds with others all round are judged: at the edge of the data the plane
    would be an extrapolation, and a whole plateau could be lost to it.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one [m].
    cell : float
        Side of the cells [m].
    """
    shifted = candidates + np.array([0.5 * cell, 0.5 * cell, 0.0])
    seeds = np.union1d(lowest_per_cell(candidates, cell), lowest_per_cell(shifted, cell))
    for _ in range(MAX_PASSES):
        if len(seeds) < MIN_SEEDS:
            break
        stands_out = _stand_out(candidates[seeds], MAX_RISE * cell)
        if not stands_out.any():
            break
        seeds = seeds[~stands_out]
    return seeds


def _stand_out(seeds: NDArray[np.float64], max_rise: float) -> NDArray[np.bool_]:
    """Return which seeds stand above their neighbours' plane, half of the neighbours being lower."""
    distance, nearest = cKDTree(seeds[:, :2]).query(seeds[:, :2], min(NEIGHBOURS + 1, len(seeds)))
    around = seeds[nearest[:, 1:]] - seeds[:, None, :]
    design = np.stack((around[..., 0], around[..., 1], np.ones(around.shape[:2])))
    weighted = design / np.maximum(distance[:, 1:], 1.0) ** 2
    normal = np.einsum("ink,jnk->nij", weighted, design)
    # Solvable where all lie on a line, too.
    normal += RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    side = np.einsum("ink,nk->ni", weighted, around[..., 2])
    rise = -np.linalg.solve(normal, side[..., None])[:, 2, 0]
    mostly_lower = (around[..., 2] < 0.0).mean(axis=1) >= 0.5
    return (rise > max_rise) & mostly_lower & _surrounded(around)


def _surrounded(around: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where no half plane is free of neighbours; `around` holds their offsets, (n, k, 3)."""
    bearing = np.sort(np.arctan2(around[..., 1], around[..., 0]), axis=1)
    gap = np.diff(bearing, axis=1, append=bearing[:, :1] + 2.0 * np.pi)
    return gap.max(axis=1) < np.pi
