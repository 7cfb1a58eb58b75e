"""Methods `progressive_tin` and `histogram_tin`: a coarse terrain grows, round by round."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.landforms import continues_terrain, find_landforms
from lidar_buildings.core.stages.ground_filter.tin_growth import GrowthLimits, start_growth
from lidar_buildings.core.surfaces.tin import Tin
from lidar_buildings.core.surfaces.triangulation import build_tin

# Chosen with `bench.ground.isprs` and `bench.ground.scenes`.
#: Iteration angle [deg] and its gain by the facet's slope while landforms are looked for.
LANDFORM_ANGLE, LANDFORM_SLOPE_GAIN = 20.0, 0.8
#: By how much the tolerance of ground grows per unit of slope [m], and up to which slope: walls have none.
GROUND_DISTANCE_SLOPE, MAX_SLOPE = 0.7, 3.0


def grown_ground(
    candidates: NDArray[np.float64], extent: NDArray[np.float64], spacing: float, config: GroundFilterConfig
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """
    Return which candidates lie on the terrain that they make up (Axelsson 2000, thresholds facet by facet).

    A candidate joins the TIN, see `tin_growth`, if its distance to its facet and the angles at which it is
    seen from the facet's corners stay within limits; the angle's limit grows with the facet's own slope.
    Limits that stop at every bush also stop at the foot of a bank. So a copy of the terrain grows on with
    wider ones, and what it gains is judged part by part: a part that meets the terrain around it as terrain
    does is a landform and stays, one with steps around it is an object and is excluded. Single candidates
    stay where they continue a plane of ground on one side, as at the edge of a cliff, which mirroring reaches
    from single corners.

    Candidates, at least one and at most one a place, have shape (n, 3) and a mean `spacing` [m]; gross errors
    are removed, and their order puts neighbours together. `extent`, shape (2, 2), is what the terrain has to
    cover [m]. The second mask tells what narrow limits do not reach and may be of landforms, none if these
    are not looked for. Only candidates whose facet changed are looked at again: the time is near linear.
    """
    # Of two grids, one shifted by half a cell, so that less depends on where a grid happens to lie.
    is_seed = np.zeros(len(candidates), dtype=np.bool_)
    for shift in (0.0, 0.5 * config.seed_cell):
        is_seed[lowest_per_cell(np.add(candidates, (shift, shift, 0.0)), config.seed_cell)] = True
    terrain = start_growth(candidates, is_seed, extent)
    limits = GrowthLimits(math.radians(config.iteration_angle), config.slope_gain, config.iteration_distance)
    terrain.grow(limits)
    ground = near_terrain(*terrain.height_and_slope(), config)
    if config.landform_distance <= config.iteration_distance:
        return ground, np.zeros_like(ground)
    trial = terrain.copy()
    trial.grow(GrowthLimits(math.radians(LANDFORM_ANGLE), LANDFORM_SLOPE_GAIN, config.landform_distance))
    gained = near_terrain(*trial.height_and_slope(), config) & ~ground
    landform, excluded = find_landforms(candidates, ground, gained, spacing, config)
    undecided = np.flatnonzero(gained & ~landform)
    landform[undecided] = continues_terrain(candidates, undecided, ground | landform, spacing)
    terrain.insert(landform)
    terrain.grow(limits, excluded & ~landform)
    return near_terrain(*terrain.height_and_slope(), config), ~ground


def near_terrain(
    height: NDArray[np.float64], slope: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """Return which points are ground, from their height above the terrain [m] and its slope there."""
    near = np.empty(len(height), dtype=np.bool_)

    def judge(begin: int, end: int) -> None:
        tolerance = config.ground_distance + GROUND_DISTANCE_SLOPE * np.minimum(slope[begin:end], MAX_SLOPE)
        near[begin:end] = np.abs(height[begin:end]) <= tolerance

    for_row_blocks(judge, len(near))
    return near


def histogram_ground(
    candidates: NDArray[np.float64], extent: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.bool_]:
    """
    Tell which candidates make up the terrain (Mancera-Taboada and others 2012, sections II.A and III).

    The lowest points of large cells are triangulated. In each iteration all candidates join whose distance to
    their facet and whose angle at its nearest corner are within limits: `iteration_distance` and
    `iteration_angle` first, then what the histograms of both, of the points that have joined, tell, but never
    more. It ends when none joins. Candidates and extent are those of `grown_ground`.
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
        limits = np.minimum(histogram_limits(joined), largest) if len(joined) else largest
        joins = (np.abs(offsets) <= limits).all(axis=1)
        if not joins.any():
            return in_tin
        joined = np.concatenate((joined, offsets[joins]))
        in_tin[waiting[joins]] = True


def histogram_limits(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the limit of each column: as far above the median as the minimum is below, or the maximum.

    How the study combines minimum, median and maximum it leaves open. Values are signed: terrain lies as far
    above the TIN as below, and of objects there are none below.
    """
    least, middle, most = values.min(axis=0), np.median(values, axis=0), values.max(axis=0)
    return np.asarray(np.minimum(2.0 * middle - least, most))


def facet_offsets(tin: Tin, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return each point's distance to its facet [m] and angle at the nearest corner [rad], shape (n, 2).

    Both are negative below the facet.
    """
    corners = tin.vertices[tin.triangles[tin.locate(points)]]
    local = points - [*tin.origin, 0.0]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal *= np.sign(normal[:, 2:])
    distance = np.einsum("ij,ij->i", local - corners[:, 0], normal) / np.linalg.norm(normal, axis=1)
    nearest = np.linalg.norm(local[:, None] - corners, axis=2).min(axis=1)
    sine = np.divide(distance, nearest, out=np.zeros_like(distance), where=nearest > 0.0)
    return np.column_stack((distance, np.arcsin(np.clip(sine, -1.0, 1.0))))
