"""Spires, turrets and steep sides of mansards: what is steeper than other roofs, and no wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.roof_selection.candidates import (
    MAX_LINEARITY,
    Candidates,
    near_tangent_plane,
)
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.eigenfeatures import PLANE_CANDIDATES, eigen_features
from lidar_buildings.core.surfaces.roof_planes import STEEPEST_DEG
from lidar_buildings.core.surfaces.surface_patches import smooth_patches

#: By what part of themselves heights count where neighbours are looked for: on a roof of 83° those a metre
#: apart in plan are eight apart in height.
FLATTENING = 0.125
#: Least slope of what is looked for: less steep roofs have been found [deg].
MIN_SLOPE_DEG = 60.0
#: Largest angle between the normals of neighbours on one such roof, heights flattened: turrets are round
#: [deg].
MAX_ANGLE_DEG = 25.0
#: Least scatter across a patch in plan, in the cells of two spacings in which areas are counted, and at least
#: [m]: points of a wall lie within the error of a pulse's place of one another, those of a roof cover ground.
MIN_SCATTER_CELLS, MIN_SCATTER = 0.25, 0.2
#: Least number of points in a plane.
MIN_PLANE_POINTS = 8
#: How rough it may be by its slope [deg], in parts of `max_roughness`: a pulse's footprint covers metres of
#: height there, and what comes back of it is put where its axis passes.
ROUGHNESS = (80.0, 84.0), (1.5, 2.0)
#: Least area of a smooth patch and of others along the slope [m²], and how rough a smooth one is on average.
MIN_AREA, MAX_MEAN_ROUGHNESS = (12.0, 40.0), 0.8
#: Run over rise of the steepest roof.
LEAST_RUN = math.tan(math.radians(90.0 - STEEPEST_DEG))
#: Distance from the neighbour's tangent plane over which a patch goes on, a multiple of `max_roughness`.
PATCH_OFFSET = 1.5


def find_steep_roofs(
    candidates: Candidates, is_roof: NDArray[np.bool_], config: RoofSelectionConfig
) -> NDArray[np.bool_]:
    """
    Tell which points are of roofs too steep to be found as others are; `is_roof` are those found before.

    Neighbours in plan are far apart on them: they are looked for with heights flattened. What is smooth there
    is wall if its points scatter no farther across than pulses do about an upright plane, and roof if they
    cover ground.
    """
    radius, nothing = candidates.radius, np.zeros(len(is_roof), dtype=bool)
    rows = np.flatnonzero(~is_roof)
    flat = candidates.points[rows] * (1.0, 1.0, FLATTENING)
    features = eigen_features(
        flat, [radius], min_neighbours=MIN_PLANE_POINTS, max_candidates=PLANE_CANDIDATES
    )
    # Normals and distances as they are without the flattening.
    scaled = features.normals * (1.0, 1.0, FLATTENING)
    length = np.linalg.norm(scaled, axis=1)
    upward, roughness = scaled[:, 2] / length, features.roughness / length / config.max_roughness
    slope = np.degrees(np.arccos(upward))
    smooth = (roughness <= np.interp(slope, *ROUGHNESS)) & (features.linearity <= MAX_LINEARITY)
    smooth &= (features.n_neighbours >= MIN_PLANE_POINTS) & (slope > MIN_SLOPE_DEG) & (slope < STEEPEST_DEG)
    own = np.flatnonzero(smooth)
    if len(own) == 0:
        return nothing
    chosen = nothing.copy()
    chosen[rows[own]] = True
    surface, normals = candidates.columns.select(chosen)._replace(points=flat[own]), features.normals[own]
    limits = {"max_angle_deg": MAX_ANGLE_DEG, "max_offset": PATCH_OFFSET * config.max_roughness}
    label = smooth_patches(surface, normals, np.full(len(own), radius), **limits)
    n, count = int(label.max()) + 1, np.bincount(label)
    patch = np.full(len(is_roof), -1)
    patch[surface.rows] = label
    z = candidates.points[surface.rows, 2]
    area = candidates.areas(patch, n) * count / np.bincount(label, upward[own])
    is_smooth = np.bincount(label, roughness[own]) <= MAX_MEAN_ROUGHNESS * count
    accepted = area >= np.where(is_smooth, *MIN_AREA)
    # As a whole, too: walls with bays and balconies are less steep in places.
    rise = np.sqrt(np.maximum(_mean(z**2, label) - _mean(z, label) ** 2, 0.0))
    least = max(MIN_SCATTER_CELLS * candidates.cell, MIN_SCATTER)
    accepted &= _scatter_across(surface.points[:, :2], label) >= np.maximum(least, LEAST_RUN * rise)
    if not accepted.any():
        return nothing
    is_surface = nothing.copy()
    is_surface[surface.rows[accepted[label]]] = True
    columns = candidates.columns._replace(points=candidates.points * (1.0, 1.0, FLATTENING))
    grown = near_tangent_plane(
        columns, normals[accepted[label]], is_surface, radius, config.max_plane_distance
    )
    # A tower is as large as a building, with the roofs that it stands on.
    return grown & (candidates.buildings(grown | is_roof, config.min_building_area)[0] >= 0)


def _scatter_across(xy: NDArray[np.float64], label: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the standard deviation of each patch's points in plan, across the narrower way [m]."""
    x, y = (away - _mean(away, label)[label] for away in xy.T)
    xx, yy, both = (_mean(one, label) for one in (x * x, y * y, x * y))
    return np.sqrt(np.maximum(0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), both), 0.0))


def _mean(values: NDArray[np.float64], label: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean of each label's values."""
    return np.asarray(np.bincount(label, values) / np.bincount(label))
