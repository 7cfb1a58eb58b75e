"""How precise walls and corners are, and how well points lie on them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.regularisation.assembly import WalledRing
from lidar_buildings.core.stages.regularisation.division import ARC, FREE
from lidar_buildings.core.stages.regularisation.drawing import DrawnRing
from lidar_buildings.core.stages.regularisation.moments import running_sums, scatter_of
from lidar_buildings.core.stages.regularisation.result import OutlineWall
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import ANGLE, CENTRE_X, CENTRE_Y, RADIUS


def fit_quality(points: NDArray[np.float64], outline: Outline, n_unknowns: int) -> tuple[float, float]:
    """
    Return the standard deviation and the largest of the points' distances from an outline [m].

    Parameters
    ----------
    points : ndarray of shape (n_points, 2)
        Traced points on walls [m].
    outline : Outline
        The walls [m].
    n_unknowns : int
        What was adjusted to the points: see `unknowns_of`.
    """
    offsets = shapely.distance(outline.polygon.boundary, shapely.points(points))
    redundancy = max(len(points) - n_unknowns, 1)
    return float(np.sqrt(np.sum(offsets**2) / redundancy)), float(offsets.max())


def unknowns_of(rings: Sequence[WalledRing], n_directions: int) -> int:
    """
    Count what the adjustment had to find: a direction each, and each wall's offset, own angle, or circle.
    """
    kinds = np.concatenate([ring.kind for ring in rings])
    return n_directions + int(np.select([kinds == FREE, kinds == ARC], [2, 3], 1).sum())


def outline_walls(
    ring: int, samples: RingSamples, walled: WalledRing, centre: NDArray[np.float64], sigma: float
) -> list[OutlineWall]:
    """Return a ring's walls and the steps between them, in order, in the map frame."""
    walls: list[OutlineWall] = []
    m = len(walled.first)
    joints = (walled.joints + centre).tolist()
    counts = _bearing_counts(samples.bears, walled.first, walled.last)
    for i, (shape, count) in enumerate(zip(walled.shape, counts.tolist(), strict=True)):
        start, end = joints[i - 1][1], joints[i][0]
        radius = float(shape[RADIUS])
        middle = (float(shape[CENTRE_X] + centre[0]), float(shape[CENTRE_Y] + centre[1])) if radius else None
        precision = sigma / math.sqrt(count) if count else math.nan
        kind = "arc" if radius else "line"
        walls.append(OutlineWall(ring, kind, _pair(start), _pair(end), middle, radius, precision, count))
        if m > 1 and joints[i][0] != joints[i][1]:
            walls.append(OutlineWall(ring, "step", _pair(end), _pair(joints[i][1]), None, 0.0, math.nan, 0))
    return walls


def corner_sigmas(
    samples: RingSamples, walled: WalledRing, drawn: DrawnRing, sigma: float, direction_weight: float
) -> list[float]:
    """
    Return the standard deviation of every vertex of a ring, NaN where it is not the corner of two lines [m].

    The offset of a wall at the corner has the variance of its middle and that of its direction over the
    distance between the two; the corner's follow from those of its two walls and the angle between them.
    """
    variances = _corner_variances(samples.points, samples.bears, *walled, direction_weight)
    at = dict(zip(map(tuple, walled.joints[:, 0].tolist()), variances.tolist(), strict=True))
    return [sigma * math.sqrt(at.get(tuple(vertex), math.nan)) for vertex in drawn.vertices.tolist()]


def _pair(place: list[float]) -> tuple[float, float]:
    """Return x and y as a tuple."""
    return place[0], place[1]


@kernel
def _bearing_counts(bears, first, last):  # type: ignore[no-untyped-def]
    """Count the traced points that bear each wall."""
    n = len(bears)
    counts = np.zeros(len(first), dtype=np.int64)
    for i in range(len(first)):
        for row in range(first[i], last[i]):
            counts[i] += bears[row % n]
    return counts


@kernel
def _corner_variances(points, bears, first, last, kind, shape, joints, direction_weight):  # type: ignore[no-untyped-def]
    """Return the variance of the corner behind each wall, in units of a point's; NaN where it is none."""
    sums = running_sums(points, bears.astype(np.float64))
    m = len(first)
    variances = np.full(m, np.nan)
    for i in range(m):
        k = (i + 1) % m
        x, y = joints[i, 0]
        is_corner = i != k and x == joints[i, 1, 0] and y == joints[i, 1, 1]
        if is_corner and shape[i, RADIUS] == 0 and shape[k, RADIUS] == 0:
            sine = np.sin(shape[k, ANGLE] - shape[i, ANGLE])
            one = _variance_at(sums, first[i], last[i], kind[i], shape[i, ANGLE], x, y, direction_weight)
            other = _variance_at(sums, first[k], last[k], kind[k], shape[k, ANGLE], x, y, direction_weight)
            variances[i] = (one + other) / (sine * sine)
    return variances


@inner_kernel
def _variance_at(sums, first, last, kind, angle, x, y, direction_weight):  # type: ignore[no-untyped-def]
    """Return the variance of a wall's offset at a place of it, in units of a point's."""
    if sums[last, 0] - sums[first, 0] < 2:
        return np.nan
    count, mx, my, xx, xy, yy = scatter_of(sums, first, last)
    c, s = np.cos(angle), np.sin(angle)
    spread = s * s * xx - 2.0 * c * s * xy + c * c * yy
    if kind != FREE:
        spread *= 1.0 + direction_weight
    lever = (y - my) * c - (x - mx) * s
    return 1.0 / count + (lever * lever / spread if spread > 0 else 0.0)
