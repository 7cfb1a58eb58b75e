"""Points on upright surfaces, and which way the surface goes about each of them in plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.core.surfaces.surface_patches import smooth_patches

Floats = NDArray[np.float64]

#: One point a voxel stands for all: no wall is told better by more, and passes count alike [m].
VOXEL = 0.1
#: Heights are multiplied by this: the beams of a spinning scanner lie farther apart than the points on one.
SQUASH = 0.35
#: Radii of neighbourhoods, of which the first counts that has enough points and is no rougher than a wall:
#: near the street, 40 m off, and where poses are noisy [m].
RADII = (0.3, 0.6, 1.2)
MIN_NEIGHBOURS = 12
#: Largest upward part of the normal of an upright surface, with squashed heights: a lean of 11°.
MAX_UPWARD = 0.5
#: Largest roughness of a neighbourhood of each radius: a wall's noise, and no foliage [m].
MAX_ROUGHNESS = (0.06, 0.09, 0.14)
#: Neighbours farther apart are not linked [m].
MAX_STEP = 0.6
#: Points of one wall: their directions differ at most by this, and each lies so near the other's plane [m].
MAX_ANGLE_DEG, MAX_OFFSET = 20.0, 0.1


@dataclass(frozen=True, eq=False)
class UprightPoints:
    """Points that stand for the upright surfaces of a cloud, patch by patch."""

    points: Floats  #: [m], shape (n_points, 3)
    normals: Floats  #: of the surface in plan, either way, shape (n_points, 2)
    roughness: Floats  #: root mean square distance of neighbours from their plane [m], shape (n_points,)
    first: NDArray[np.intp]  #: patch k holds the points first[k] to first[k + 1] (exclusive)


def thinned(points: Floats) -> Floats:
    """Return the lowest point of each voxel, the same ones whatever the order of the points."""
    grid = sort_by_cell(points, VOXEL)
    layer = np.floor(grid.points[:, 2] / grid.size)
    is_first = np.ones(len(layer), dtype=bool)
    is_first[1:] = layer[1:] != layer[:-1]
    is_first[grid.first[:-1]] = True
    return grid.points[is_first]


def upright_points(points: Floats) -> UprightPoints:
    """
    Find the points of a cloud on upright surfaces, and link them to smooth patches.

    The shape of each point's neighbourhood, in which heights are squashed, tells the direction of its
    surface.
    """
    squashed = thinned(points) * (1.0, 1.0, SQUASH)
    normals, roughness, radius = _shapes(squashed)
    rows = np.flatnonzero((np.abs(normals[:, 2]) <= MAX_UPWARD) & (radius > 0.0))
    normals = normals[rows] * (1.0, 1.0, 0.0)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    columns = sort_by_cell(squashed[rows], MAX_STEP / 2.0)
    rows, normals = rows[columns.rows], normals[columns.rows]
    reach = np.minimum(radius[rows], MAX_STEP)
    label = smooth_patches(columns, normals, reach, max_angle_deg=MAX_ANGLE_DEG, max_offset=MAX_OFFSET)
    order = np.argsort(label, kind="stable")
    first = np.append(0, np.cumsum(np.bincount(label)))
    rows = rows[order]
    return UprightPoints(squashed[rows] / (1.0, 1.0, SQUASH), normals[order, :2], roughness[rows], first)


def _shapes(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return normal, roughness and radius of the smallest neighbourhoods that may be of a surface, else 0."""
    normals, roughness, radius = np.zeros((len(points), 3)), np.zeros(len(points)), np.zeros(len(points))
    left = np.arange(len(points))
    for step, limit in zip(RADII, MAX_ROUGHNESS, strict=True):
        shape = eigen_features(points[left], [step])
        is_plain = (shape.n_neighbours >= MIN_NEIGHBOURS) & (shape.roughness <= limit)
        own = left[is_plain]
        normals[own], roughness[own] = shape.normals[is_plain], shape.roughness[is_plain]
        radius[own] = step
        left = left[~is_plain]
    return normals, roughness, radius
