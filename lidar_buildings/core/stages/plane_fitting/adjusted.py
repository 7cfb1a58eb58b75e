"""Planes adjusted to their points, and numbered by size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.plane_fitting.model_selection import plane_sums
from lidar_buildings.core.surfaces.roof_planes import RoofPlane

#: The largest number that `plane_id` can hold.
MAX_PLANES = 65535
#: Side of the cells in whose order points are summed [m].
_CELL = 1.0
#: Rows and columns of what a symmetric matrix has to tell.
_UPPER = np.triu_indices(3)
#: Points whose variance across a line is no larger than this, relative to that along, are on it.
_LINE = 1e-12


def why_degenerate(points: FloatArray) -> str:
    """Say in words why no plane can be fitted to points in any order, nothing if it can."""
    n_distinct = min(len(points), 1) + int(bool((points[1:] != points[:1]).any()))
    if n_distinct < 2 or len(points) < 3:
        return f"{n_distinct} distinct points: a plane needs 3"
    shifted = points - points[0]
    moments = plane_sums(shifted, np.ones(len(points), dtype=np.int32), 2)[1]
    mean, products = moments[1:4] / moments[0], np.empty((3, 3))
    products[_UPPER] = moments[4:] / moments[0]
    products.T[_UPPER] = moments[4:] / moments[0]
    spread = np.linalg.eigvalsh(products - np.outer(mean, mean))
    return f"all {len(points)} points lie on a line" if spread[1] <= _LINE * spread[2] else ""


def numbered_by_size(points: FloatArray, labels: NDArray[np.int32]) -> NDArray[np.uint16]:
    """
    Number planes from the largest on, equal ones by their westernmost, southernmost and lowest coordinates.
    """
    size = int(labels.max(initial=0)) + 1
    count = np.bincount(labels, minlength=size)
    count[0] = 0
    low = np.full((size, 3), np.inf)
    for axis in range(3):
        np.minimum.at(low[:, axis], labels, points[:, axis])
    order = np.lexsort((low[:, 2], low[:, 1], low[:, 0], -count))
    order = order[count[order] > 0][:MAX_PLANES]
    number = np.zeros(size, dtype=np.uint16)
    number[order] = np.arange(1, len(order) + 1)
    return number[labels]


def adjusted_planes(points: FloatArray, plane_id: NDArray[np.uint16]) -> tuple[RoofPlane, ...]:
    """Fit every plane to its points by orthogonal least squares, whatever the order of the points."""
    ordered = sort_by_cell(points, _CELL)
    points, plane_id = ordered.points, plane_id[ordered.rows]
    size = int(plane_id.max(initial=0)) + 1
    count = np.bincount(plane_id, minlength=size)
    divisor = np.maximum(count, 1)
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    shifted = points - middle
    centroid = np.column_stack([np.bincount(plane_id, axis, size) / divisor for axis in shifted.T])
    offsets = shifted - centroid[plane_id]
    scatter = np.empty((size, 3, 3))
    for a, b in zip(*_UPPER, strict=True):
        scatter[:, a, b] = scatter[:, b, a] = np.bincount(plane_id, offsets[:, a] * offsets[:, b], size)
    normal = np.linalg.eigh(scatter)[1][:, :, 0]
    normal[normal[:, 2] < 0] *= -1.0
    distance = np.einsum("ij,ij->i", offsets, normal[plane_id])
    rms = np.sqrt(np.bincount(plane_id, distance**2, size) / divisor)
    return tuple(
        RoofPlane(normal[k], centroid[k] + middle, float(rms[k]), int(count[k])) for k in range(1, size)
    )
