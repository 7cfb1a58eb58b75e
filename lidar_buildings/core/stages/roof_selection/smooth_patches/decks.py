"""Decks: bridges and viaducts, which meet the ground at their own level at two opposite ends."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of
from lidar_buildings.core.stages.roof_selection.sectors import N_SECTORS, sector_of

#: Surfaces and ground are compared in cells of this side [m], or of the side in which areas are counted.
CELL = 1.0
#: How far beyond the end of a surface to look for ground: what is `min_height` above a slope of 1 : 2.5 [m].
REACH = 5.0
#: How far the ground there may lie above or below the end: a kerb, and a road of 5 % over the reach [m].
MAX_STEP = 0.5
#: Share of the cells at either end that have to meet the ground.
MIN_SHARE = 0.6


def is_deck(
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    ground: NDArray[np.float64],
    cell: float,
) -> NDArray[np.bool_]:
    """
    Tell which surfaces go on as ground at their own level, at two ends that face away from each other.

    A house on a slope meets ground at the level of its roof on one side at most.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Of the surfaces, `min_height` or more above the ground below them [m].
    label : ndarray of int64, shape (n_points,)
        The surface of each of them, from 0 on.
    ground : ndarray of shape (n_ground, 3)
        Ground and what is low [m].
    cell : float
        Side of cells that a surface fills [m].

    Returns
    -------
    ndarray of bool, shape (n_surfaces,)
        The order of the points does not matter.
    """
    n = label.max(initial=-1) + 1
    cell = max(CELL, cell)
    surface, of = _top_of_cells(points, label, cell)
    nodes = np.vstack([surface, _voxels(ground, cell)])
    grid = build_grid(nodes, REACH + cell)
    owner = np.concatenate([of, np.full(len(nodes) - len(of), -1)])[grid.rows]
    ends, met = np.zeros((n, N_SECTORS), dtype=np.int64), np.zeros((n, N_SECTORS), dtype=np.int64)
    _count_ends(grid, owner, REACH + cell, ends, met)
    is_end = (met >= MIN_SHARE * ends) & (met > 0)
    half = N_SECTORS // 2
    return np.asarray((is_end[:, :half] & is_end[:, half:]).any(axis=1))


def _top_of_cells(
    points: NDArray[np.float64], label: NDArray[np.int64], cell: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """
    Return the middle of each cell that a surface occupies, as high as its highest point, and the surface.
    """
    cells = np.floor(points[:, :2] / cell)
    order = np.lexsort((points[:, 2], cells[:, 1], cells[:, 0], label))
    keys = np.column_stack([label, cells])[order]
    last = np.ones(len(keys), dtype=bool)
    last[:-1] = (keys[1:] != keys[:-1]).any(axis=1)
    top = order[last]
    return np.column_stack([(cells[top] + 0.5) * cell, points[top, 2]]), label[top]


def _voxels(points: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """Return the middles of occupied voxels, half a step high, so that ground is thin."""
    size = np.array([cell, cell, MAX_STEP / 2.0])
    voxels = np.floor(points / size)
    voxels = voxels[np.lexsort(voxels.T)]
    is_new = np.ones(len(voxels), dtype=bool)
    is_new[1:] = (voxels[1:] != voxels[:-1]).any(axis=1)
    return (voxels[is_new] + 0.5) * size


@njit(cache=True, nogil=True)
def _count_ends(grid, owner, reach, ends, met):  # type: ignore[no-untyped-def]
    """
    Count, by surface and sector, the cells beyond which it does not go on, and those of them with ground.
    """
    near = np.empty(len(grid.points), dtype=np.int64)
    goes_on, is_met = np.zeros(N_SECTORS, dtype=np.bool_), np.zeros(N_SECTORS, dtype=np.bool_)
    for i in range(len(grid.points)):
        if owner[i] < 0:
            continue
        x, y, z = grid.points[i]
        goes_on[:], is_met[:] = False, False
        for k in range(neighbours_of(grid, grid.cell[i], x, y, z, reach, True, near)):
            j = near[k]
            dx, dy = grid.points[j, 0] - x, grid.points[j, 1] - y
            if dx == 0.0 and dy == 0.0:
                continue
            sector = sector_of(dx, dy)
            if owner[j] == owner[i]:
                goes_on[sector] = True
            elif owner[j] < 0 and abs(grid.points[j, 2] - z) <= MAX_STEP:
                is_met[sector] = True
        for sector in range(N_SECTORS):
            if not goes_on[sector]:
                ends[owner[i], sector] += 1
                met[owner[i], sector] += is_met[sector]
