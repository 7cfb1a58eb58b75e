"""The last step as published: the two directions are unknowns beside the lines of all walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.regularisation.building_walls import min_long_length
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.surfaces.ring_division.division import Division
from lidar_buildings.core.surfaces.ring_division.moments import running_sums, scatter_of


def adjusted_directions(
    samples: list[RingSamples],
    divisions: list[Division],
    angles: NDArray[np.float64],
    spacing: float,
    config: RegularisationConfig,
) -> NDArray[np.float64]:
    """
    Return the directions M_u and M_v as all walls estimate them (Sampath & Shan 2007, last step).

    Long and short walls enter with their points and with their direction as an observation, the long walls'
    directions with a high weight; nothing holds the two perpendicular any more. The lines are eliminated, so
    that each direction is a weighted mean, and `fit_wall` gives the lines of the same joint solution.
    `angles` are approximate directions of the normals, which the kinds of the divisions number.
    """
    walls = [
        (int(kind), *_length_and_turn(ring.points, sums, first, last, angles[kind]))
        for ring, division in zip(samples, divisions, strict=True)
        for sums in [running_sums(ring.points, ring.weights)]
        for first, last, kind in zip(division.first, division.last, division.kind, strict=True)
        if kind >= 0 and last - first > 1
    ]
    min_length = min_long_length([length for _, length, _, _ in walls], spacing, config)
    weight = config.direction_weight
    # What the long walls told of both directions together, when these were held perpendicular.
    of_long = weight * sum(along for _, length, _, along in walls if length >= min_length)
    adjusted = angles.copy()
    for k in range(len(angles)):
        observed = [(turn, along * weight / (1.0 + weight)) for kind, _, turn, along in walls if kind == k]
        total = of_long + sum(each for _, each in observed)
        if total > 0.0:
            adjusted[k] += sum(turn * each for turn, each in observed) / total
    return adjusted


def _length_and_turn(
    points: NDArray[np.float64], sums: NDArray[np.float64], first: int, last: int, angle: float
) -> tuple[float, float, float]:
    """Return a wall's length [m], the turn from a direction to its own [rad], and the turn's weight [m²]."""
    _, _, _, xx, xy, yy = scatter_of(sums, first, last)
    c, s = np.cos(angle), np.sin(angle)
    along = s * s * xx - 2.0 * c * s * xy + c * c * yy
    across = c * s * (yy - xx) + (c * c - s * s) * xy
    ends = points[(last - 1) % len(points)] - points[first % len(points)]
    return float(np.hypot(*ends)), float(-across / along) if along > 0.0 else 0.0, float(along)
