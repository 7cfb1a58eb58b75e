"""Wet and dark flat roofs: nothing comes back from them but along their rims."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import mark_cells
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.morphology import square_distances

#: A void has so many empty cells of a spacing in a row, either way: by chance that is rare [cells].
MIN_VOID_CELLS = 5
#: Narrower ones, with their rims, are no building [m].
MIN_VOID_WIDTH = 1.5
#: Voids longer than this are gaps between strips, water, or what lies beyond the cloud [m].
MAX_LENGTH = 30.0
#: Cells are no finer, however dense the points are [m].
FINEST = 0.1
#: How far from a void its rim reaches, in spacings, since lines of a scan may be that far apart; and
#: how much farther along the plane, since square windows do not reach into the corners of turned roofs.
RIM_REACH = 2.5
#: How far from the plane a rim's points may lie [m].
RIM_DISTANCE = 0.15
#: Share of a void's perimeter that has to have rim beside it: a shadow has roof on one side.
MIN_PERIMETER = 0.75
#: Share of the raised points along it that have to lie on one plane: leaves are at any height.
MIN_COPLANAR = 0.6
#: Most rounds of least squares weighted by 1/residual, which end near the plane that most points lie on; and
#: how little residuals change when they have got there [m].
ROUNDS = 20
MIN_CHANGE = 1e-3
#: By what part of their trace the diagonal of normal equations is raised.
RIDGE = 1e-9
#: Residuals below this weigh alike [m].
MIN_RESIDUAL = 0.01
#: Cells along the side of the blocks in which voids are looked for, so that far points cost no memory.
BLOCK = 2048


def find_wet_roofs(
    points: NDArray[np.float64],
    height: NDArray[np.float64],
    is_open: NDArray[np.bool_],
    is_roof: NDArray[np.bool_],
    spacing: float,
    config: RoofSelectionConfig,
) -> NDArray[np.bool_]:
    """
    Tell which points are the rim of a roof that absorbs the pulses: water, wet or dark roofing, glass.

    No return of any class comes from an area of several spacings' width, and what lies next to it is raised
    and on one plane, along most of its perimeter. Around water it is ground, around gaps between crowns on no
    plane, beside shadows on one side only. Points, in any order, have shape (n, 3), heights are above ground
    [m]; `is_open` says which may become roof, `is_roof` which are: these count as rim. What is farther away
    than `MAX_LENGTH` does not matter.
    """
    spacing = max(spacing, FINEST)
    found = np.zeros(len(points), dtype=bool)
    raised = np.flatnonzero((is_open | is_roof) & (height >= config.min_height))
    open_rows = np.flatnonzero(is_open & ~is_roof & (height >= config.min_height))
    half = max(MIN_VOID_CELLS // 2, round(0.5 * MIN_VOID_WIDTH / spacing - 0.5))
    reach = half + 2 * math.ceil(RIM_REACH) + 1
    margin = math.ceil(MAX_LENGTH / spacing) + 2 * reach
    for x, y in _blocks(*(np.floor(points[open_rows, :2].T / spacing).astype(np.int64))):
        low = np.array([x.min(), y.min()]) - margin
        plan = np.zeros(np.array([x.max(), y.max()]) + margin + 1 - low, dtype=np.bool_)
        rim, zone = np.zeros_like(plan), np.zeros_like(plan)
        mark_cells(points, spacing, low[0], low[1], plan)
        rim[x - low[0], y - low[1]] = True
        places = [one for one in _voids(plan, half, reach, MAX_LENGTH / spacing) if rim[one[0]].any()]
        if not places:
            continue
        for window, _ in places:
            zone[window] = True
        near = raised[_is_marked(points, raised, spacing, low[0], low[1], zone)]
        cells = np.floor(points[near, :2] / spacing).astype(np.int64) - low
        column, row = np.ascontiguousarray(cells.T)
        for window, void in places:
            start = np.array([part.start for part in window])
            east, north = start + void.shape
            inside = (column >= start[0]) & (column < east) & (row >= start[1]) & (row < north)
            rows = near[inside]
            found[rows[_is_rim(points[rows], cells[inside] - start, void, spacing, config)]] = True
    return found & ~is_roof


def _blocks(
    x: NDArray[np.int64], y: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Go through the cells block by block, so that far points cost no memory."""
    east, north = x // BLOCK, y // BLOCK
    # Most points follow others of their block: few are left to be sorted.
    is_change = np.ones(len(x), dtype=bool)
    is_change[1:] = (east[1:] != east[:-1]) | (north[1:] != north[:-1])
    for one, other in np.unique(np.column_stack([east[is_change], north[is_change]]), axis=0):
        own = np.flatnonzero((east == one) & (north == other))
        yield x[own], y[own]


def _voids(
    plan: NDArray[np.bool_], half: int, reach: int, max_length: float
) -> Iterator[tuple[tuple[slice, ...], NDArray[np.bool_]]]:
    """Go through the voids up to a length: a window with a margin, and the cells in it."""
    # An opening: the middles of empty windows, connected, grown by the window again.
    labels, _ = ndimage.label(~_grown(plan, half), structure=np.ones((3, 3)))
    for number, window in enumerate(ndimage.find_objects(labels), start=1):
        if max(part.stop - part.start for part in window) <= max_length:
            wide = tuple(slice(max(part.start - reach, 0), part.stop + reach) for part in window)
            yield wide, _grown(labels[wide] == number, half)


def _grown(plan: NDArray[np.bool_], half: int) -> NDArray[np.bool_]:
    """Return a plan with every cell grown to a square window."""
    return np.asarray(ndimage.maximum_filter(plan.view(np.uint8), 2 * half + 1, mode="constant") > 0)


def _is_rim(
    points: NDArray[np.float64],
    places: NDArray[np.int64],
    void: NDArray[np.bool_],
    spacing: float,
    config: RoofSelectionConfig,
) -> NDArray[np.bool_]:
    """Tell which raised points, given with their cells, are the rim of the roof that the void is."""
    is_near = _is_beside(void)[tuple(places.T)]
    if is_near.sum() < 3:
        return np.zeros(len(points), dtype=bool)
    is_level = np.abs(_off_plane(points, is_near)) <= RIM_DISTANCE
    on_rim = is_near & is_level
    if on_rim.sum() < MIN_COPLANAR * is_near.sum() or not _frames(places[on_rim], void, spacing, config):
        return np.zeros(len(points), dtype=bool)
    roof = void.copy()
    roof[tuple(places[on_rim].T)] = True
    return is_level & _is_beside(roof)[tuple(places.T)]


def _is_beside(plan: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which cells lie within `RIM_REACH` of marked ones."""
    return np.asarray(square_distances(plan.view(np.uint8), 1, math.ceil(RIM_REACH)) <= RIM_REACH**2)


def _frames(
    places: NDArray[np.int64], void: NDArray[np.bool_], spacing: float, config: RoofSelectionConfig
) -> bool:
    """Tell whether cells lie along most of a void's perimeter, and it is a building's size with them."""
    rim = np.zeros_like(void)
    rim[tuple(places.T)] = True
    if not rim.any() or (void | rim).sum() * spacing**2 < config.min_building_area:
        return False
    edge = void & ~ndimage.binary_erosion(void)
    return bool(_is_beside(rim)[edge].mean() >= MIN_PERIMETER)


def _off_plane(points: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return distances from the plane of the chosen points by least absolute residuals [m]."""
    fitted = points[chosen]
    fitted = fitted[np.lexsort(fitted.T)]
    centre = fitted.mean(axis=0)
    offsets, residuals = fitted - centre, np.zeros(len(fitted))
    design = np.column_stack([offsets[:, :2], np.ones(len(offsets))])
    for _ in range(ROUNDS):
        weighted = design.T / np.maximum(np.abs(residuals), MIN_RESIDUAL)
        normal = weighted @ design
        # Solvable where all lie on a line, too.
        normal += RIDGE * np.trace(normal) * np.eye(3)
        plane = np.linalg.solve(normal, weighted @ offsets[:, 2])
        before, residuals = residuals, offsets[:, 2] - design @ plane
        if np.abs(residuals - before).max() < MIN_CHANGE:
            break
    return (points - centre) @ np.append(-plane[:2], 1.0) - plane[2]


@kernel
def _is_marked(points, rows, cell, low_x, low_y, plan):  # type: ignore[no-untyped-def]
    """Tell which rows' points lie in marked cells of a window."""
    marked = np.zeros(len(rows), dtype=np.bool_)
    for k in range(len(rows)):
        x, y = np.floor(points[rows[k], 0] / cell) - low_x, np.floor(points[rows[k], 1] / cell) - low_y
        if 0 <= x < plan.shape[0] and 0 <= y < plan.shape[1]:
            marked[k] = plan[int(x), int(y)]
    return marked
