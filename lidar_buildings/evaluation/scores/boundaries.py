"""Distances between the boundaries of outlines that belong together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.evaluation.scores.statistics import mean, percentile, root_mean_square

#: Step between samples along a boundary: finer than any point spacing resolves [m].
STEP = 0.1
#: A sample so near to the edge of the area of interest lies on a cut, not on a boundary [m].
ON_CUT = 1e-3


@dataclass(frozen=True)
class BoundaryDistances:
    """
    How far boundaries lie apart, from each to the other, every metre of them with the same weight.

    `doc/scores.md` says what the figures are.
    """

    mean: float
    rms: float
    percentile_95: float
    hausdorff: float


def boundary_distances(
    result: NDArray[Any], reference: NDArray[Any], *, limits: shapely.Geometry | None = None
) -> BoundaryDistances:
    """
    Measure the distances between the boundaries of pairs of outlines, courtyards included.

    Along the edge of the limits that both were cut to nothing is measured.
    """
    cut = None if limits is None else shapely.boundary(limits)
    along, corners = [np.empty(0)], [np.empty(0)]
    for mine, theirs in zip(shapely.boundary(result), shapely.boundary(reference), strict=True):
        for one, other in ((mine, theirs), (theirs, mine)):
            shapely.prepare(other)
            along.append(shapely.distance(_off_cut(_samples(one), cut), other))
            corners.append(
                shapely.distance(_off_cut(shapely.points(shapely.get_coordinates(one)), cut), other)
            )
    distance, at_corner = np.concatenate(along), np.concatenate(corners)
    return BoundaryDistances(
        mean=mean(distance),
        rms=root_mean_square(distance),
        percentile_95=percentile(distance, 95),
        hausdorff=max(percentile(distance, 100), float(at_corner.max(initial=0.0))),
    )


def distances_of_unions(
    result: shapely.Geometry, reference: shapely.Geometry, *, limits: shapely.Geometry | None = None
) -> BoundaryDistances:
    """
    Measure the distances between the boundaries of what both sides cover; NaN if either covers nothing.

    Along the edge of the limits that both were cut to nothing is measured.
    """
    sides = [[] if side.is_empty else [side] for side in (result, reference)]
    if not all(sides):
        sides = [[], []]
    mine, theirs = (np.array(side, dtype=object) for side in sides)
    return boundary_distances(mine, theirs, limits=limits)


def _samples(boundary: shapely.Geometry) -> NDArray[Any]:
    samples = []
    for ring in shapely.get_parts(boundary):
        n_steps = max(1, math.ceil(ring.length / STEP))
        share = (np.arange(n_steps) + 0.5) / n_steps
        samples.append(shapely.line_interpolate_point(ring, share, normalized=True))
    return np.concatenate(samples)


def _off_cut(samples: NDArray[Any], cut: shapely.Geometry | None) -> NDArray[Any]:
    """Return the samples that do not lie on the edge of the area of interest."""
    return samples if cut is None else samples[~shapely.dwithin(samples, cut, ON_CUT)]
