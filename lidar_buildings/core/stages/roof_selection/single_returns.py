"""Roofs by the rules of the Villalba study: single returns on planes, over a large enough area."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns
from lidar_buildings.core.stages.roof_selection.candidates import MAX_ANGLE_DEG, MAX_SLOPE_DEG, Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.surroundings import MAX_LINEARITY, near_tangent_plane
from lidar_buildings.core.surfaces.eigenfeatures import eigen_features
from lidar_buildings.core.surfaces.surface_patches import smooth_patches

#: A plane through fewer points says nothing of their deviation from it.
MIN_PLANE_POINTS = 4
#: Fewest points of a plane.
MIN_PATCH_POINTS = 6


def find_roofs(candidates: Candidates, config: RoofSelectionConfig) -> NDArray[np.bool_]:
    """
    Tell which of the points high enough are single returns on planes.

    Mancera-Taboada and others (2012) call building what has a single return, lies 0.65 m above ground, and
    covers 40 m²; roofs are smooth and regular, their planes are what is looked for. Height and area are
    `min_height` and `min_building_area`; `roof_returns` says which returns count. Others are never roof: the
    edges of roofs, where pulses are split, are lost as they were in the paper.

    Parameters
    ----------
    candidates : Candidates
        Everything that rises above ground.
    config : RoofSelectionConfig
        `roof_returns`, `max_roughness`, `max_plane_distance`.

    Returns
    -------
    ndarray of bool, shape (n_points,)
        Roofs.
    """
    counts = {
        "single": candidates.is_only,
        "last": candidates.is_last,
        "all": np.ones(len(candidates.points), dtype=bool),
    }
    counted = candidates.columns.select(counts[config.roof_returns])
    radius = candidates.radius
    normals, is_plane = _planes(counted, radius, config)
    found = np.zeros(len(candidates.points), dtype=bool)
    found[counted.rows] = near_tangent_plane(
        counted, normals[is_plane], is_plane, radius, config.max_plane_distance
    )
    return found


def _planes(
    columns: Columns, radius: float, config: RoofSelectionConfig
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the normals, and which points lie within a plane of some extent."""
    features = eigen_features(columns.points, [radius], min_neighbours=MIN_PLANE_POINTS)
    is_flat = (features.roughness <= config.max_roughness) & (features.n_neighbours >= MIN_PLANE_POINTS)
    is_flat &= (features.linearity <= MAX_LINEARITY) & (features.eigenvalues[:, 0] > 0)
    is_flat &= features.normals[:, 2] >= math.cos(math.radians(MAX_SLOPE_DEG))
    rows = np.flatnonzero(is_flat)
    patch = smooth_patches(
        columns.select(is_flat),
        features.normals[rows],
        np.full(len(rows), radius),
        max_angle_deg=MAX_ANGLE_DEG,
        max_offset=config.max_plane_distance,
    )
    is_flat[rows] = (np.bincount(patch) >= MIN_PATCH_POINTS)[patch]
    return features.normals, is_flat
