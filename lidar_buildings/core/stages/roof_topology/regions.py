"""The borders between the regions of a roof's planes, seen from above on a raster."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.point_array import extent_of

#: Side of a cell in point spacings.
CELL = 0.5
#: Cells are enlarged until so many suffice.
_MAX_CELLS = 4_000_000
#: Where the outline reaches beyond the points by more than their extent and so much [m], it is cut.
_LEAST_MARGIN = 20.0


class Borders(NamedTuple):
    """Sides of cells between two regions, sorted by the pair of planes."""

    xy: FloatArray  #: middle of the side, about the building's centre [m], shape (n_sides, 2)
    upright: BoolArray  #: whether the side runs north-south, shape (n_sides,)
    #: Numbers of the two planes, ``first < second``, shape (n_sides,).
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    #: Rows of the two planes' points that are nearest to the cells on either side, shape (n_sides,).
    near_first: NDArray[np.int32]
    near_second: NDArray[np.int32]
    #: Distance of the farther of these two points from its cell's middle [m], shape (n_sides,).
    gap: FloatArray
    #: Pair k has the sides ``start[k]`` to ``start[k + 1]`` (exclusive), shape (n_pairs + 1,).
    start: IntArray
    cell: float  #: length of a side [m]


def find_borders(
    points: FloatArray, plane_id: NDArray[np.uint16], outline: Outline, centre: FloatArray, spacing: float
) -> Borders:
    """
    Collect the sides of cells between different planes inside an outline, with positions about a centre.

    Every cell has the plane of the nearest cell that holds a point of one; beside borders, of the nearest
    point of the cells around.
    """
    low, high = extent_of(points)[:, :2]
    reach = np.maximum(high - low, _LEAST_MARGIN)
    low, high = (
        np.maximum(np.minimum(low, outline.exterior.min(axis=0)), low - reach),
        np.minimum(np.maximum(high, outline.exterior.max(axis=0)), high + reach),
    )
    cell = CELL * spacing
    while np.prod((high - low) / cell + 5.0) > _MAX_CELLS:
        cell *= 2.0
    corner = np.floor(low / cell)
    n_columns, n_rows = (np.floor(high / cell) - corner + 1.0).astype(np.int64).tolist()
    nearest = _nearest_points(points[:, :2] / cell - corner, plane_id, (n_rows, n_columns))
    label = plane_id[nearest].astype(np.int32)
    level = np.flatnonzero(label[n_columns:] != label[:-n_columns])
    row, column = np.nonzero(np.diff(label.reshape(n_rows, n_columns), axis=1))
    east = row * n_columns + column
    one, other = np.concatenate([level, east]), np.concatenate([level + n_columns, east + 1])

    def middles(cells: IntArray) -> FloatArray:
        return np.column_stack([cells % n_columns, cells // n_columns]) + corner + 0.5

    xy = 0.5 * (middles(one) + middles(other)) * cell
    polygon = outline.polygon
    shapely.prepare(polygon)
    inside = np.flatnonzero(shapely.contains_xy(polygon, *xy.T))
    one, other = np.where(label[one] < label[other], (one, other), (other, one))[:, inside]
    order = np.lexsort((label[other], label[one]))
    one, other, inside = one[order], other[order], inside[order]
    changes = np.flatnonzero(np.diff(label[one]) | np.diff(label[other])) + 1
    gaps = [np.hypot(*(points[nearest[own], :2] - cell * middles(own)).T) for own in (one, other)]
    return Borders(
        xy[inside] - centre[:2],
        inside >= len(level),
        label[one],
        label[other],
        nearest[one],
        nearest[other],
        np.maximum(*gaps),
        np.unique(np.concatenate([[0], changes, [len(one)]])),
        cell,
    )


def _nearest_points(
    places: FloatArray, plane_id: NDArray[np.uint16], shape: tuple[int, int]
) -> NDArray[np.int32]:
    """Return the row of the nearest point of a plane for every cell, row by row; places are in cells."""
    nearest = _nearest_inside(places, plane_id, shape)
    at = ndimage.distance_transform_edt(nearest < 0, return_distances=False, return_indices=True)
    return _nearest_beside(places, plane_id, nearest[tuple(at)]).ravel()


@kernel
def _nearest_inside(places, plane_id, shape):  # type: ignore[no-untyped-def]
    """Return the point of a plane in each cell that is nearest to its middle, -1 in those without any."""
    nearest, least = np.full(shape, -1, np.int32), np.full(shape, np.inf)
    for i in range(len(places)):
        if plane_id[i] > 0:
            row, column = int(places[i, 1]), int(places[i, 0])
            square = (places[i, 0] - column - 0.5) ** 2 + (places[i, 1] - row - 0.5) ** 2
            if square <= least[row, column]:
                nearest[row, column], least[row, column] = i, square
    return nearest


@kernel
def _nearest_beside(places, plane_id, nearest):  # type: ignore[no-untyped-def]
    """Return each cell's nearest point; beside borders those of the cells around may be nearer."""
    found, (n_rows, n_columns) = nearest.copy(), nearest.shape
    for row in range(n_rows):
        for column in range(n_columns):
            label, is_beside, least = plane_id[nearest[row, column]], False, np.inf
            for r in range(max(row - 1, 0), min(row + 2, n_rows)):
                for c in range(max(column - 1, 0), min(column + 2, n_columns)):
                    is_beside |= plane_id[nearest[r, c]] != label
            if not is_beside:
                continue
            for r, c in (
                (row, column),
                (row, column - 1),
                (row, column + 1),
                (row - 1, column),
                (row + 1, column),
            ):
                if 0 <= r < n_rows and 0 <= c < n_columns:
                    i = nearest[r, c]
                    square = (places[i, 0] - column - 0.5) ** 2 + (places[i, 1] - row - 0.5) ** 2
                    if square < least:
                        found[row, column], least = i, square
    return found
