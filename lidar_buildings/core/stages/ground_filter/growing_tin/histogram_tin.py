"""The TIN of the Villalba study: thresholds from histograms, renewed in each iteration."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.surfaces.tin import Tin
from lidar_buildings.core.surfaces.triangulation import build_tin


def label_candidates(
    candidates: NDArray[np.float64], extent: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """
    Tell which candidates make up the terrain (Mancera-Taboada and others 2012, sections II.A and III).

    The lowest points of large cells are triangulated. In each iteration all candidates join whose distance to
    their facet and whose angle at its nearest corner are within limits; these follow from the histograms of
    both, at first of all candidates, then of those that have joined. `iteration_distance` and
    `iteration_angle` are never exceeded. It ends when none joins.

    Parameters
    ----------
    candidates : ndarray of shape (n_candidates, 3)
        At least one; at most one per place, gross errors removed [m].
    extent : ndarray of shape (2, 2)
        Lower left and upper right corner of what the terrain has to cover [m].
    config : GroundFilterConfig
        `seed_cell`, `iteration_distance`, `iteration_angle`.
    """
    in_tin = np.zeros(len(candidates), dtype=np.bool_)
    in_tin[lowest_per_cell(candidates, config.seed_cell)] = True
    largest = np.array([config.iteration_distance, math.radians(config.iteration_angle)])
    joined = np.zeros((0, 2))
    while True:
        waiting = np.flatnonzero(~in_tin)
        if not len(waiting):
            return in_tin
        offsets = facet_offsets(build_tin(candidates[in_tin], extent), candidates[waiting])
        limits = np.minimum(histogram_limits(joined if len(joined) else offsets), largest)
        joins = (offsets <= limits).all(axis=1)
        if not joins.any():
            return in_tin
        joined = np.concatenate((joined, offsets[joins]))
        in_tin[waiting[joins]] = True


def histogram_limits(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the upper limit of each column: as far above the median as the minimum is below, or the maximum.

    The study names minimum, median and maximum and leaves open how they are combined. Here terrain is taken
    to be symmetrical about the median, and what lies in a longer tail above it for objects.
    """
    least, middle, most = values.min(axis=0), np.median(values, axis=0), values.max(axis=0)
    return np.minimum(2.0 * middle - least, most)


def facet_offsets(tin: Tin, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return each point's distance to its facet [m] and the largest angle at a corner of it [rad].

    Shape (n_points, 2); the angle is the largest at the nearest corner.
    """
    corners = tin.vertices[tin.triangles[tin.locate(points)]]
    local = points - [*tin.origin, 0.0]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    distance = np.abs(np.einsum("ij,ij->i", local - corners[:, 0], normal)) / np.linalg.norm(normal, axis=1)
    nearest = np.linalg.norm(local[:, None] - corners, axis=2).min(axis=1)
    sine = np.divide(distance, nearest, out=np.zeros_like(distance), where=nearest > 0.0)
    return np.column_stack((distance, np.arcsin(np.minimum(sine, 1.0))))
