"""
How precise walls and corners are, and how well points lie on them.

"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.regularisation.assembly import WalledRing
from lidar_buildings.core.regularisation.division import ARC, FREE
from lidar_buildings.core.regularisation.drawing import DrawnRing
from lidar_buildings.core.regularisation.result import OutlineWall
from lidar_buildings.core.regularisation.samples import RingSamples
from lidar_buildings.core.regularisation.walls import ANGLE, CENTRE_X, CENTRE_Y, RADIUS


def fit_quality(bearing: NDArray[np.float64], outline: Outline, n_unknowns: int) -> tuple[float, float]:
    """
    Return the standard deviation and the largest of the bearing points' distances from an outline [m].

    Parameters
    ----------
    bearing : ndarray of shape (n_points, 2)
        Traced points that bear the walls [m].
    outline : Outline
        The walls [m].
    n_unknowns : int
        What was adjusted to the points: see `unknowns_of`.

    """
    boundary = shapely.Polygon(outline.exterior, outline.holes).boundary
    offsets = shapely.distance(boundary, shapely.points(bearing))
    redundancy = max(len(bearing) - n_unknowns, 1)
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
    """
    Return a ring's walls and the steps between them, in order, in the map frame.

    """
    walls: list[OutlineWall] = []
    m = len(walled.first)
    for i in range(m):
        start, end = walled.joints[i - 1, 1] + centre, walled.joints[i, 0] + centre
        radius = float(walled.shape[i, RADIUS])
        count = _n_bearing(samples, walled, i)
        walls.append(
            OutlineWall(
                ring,
                "arc" if radius else "line",
                (float(start[0]), float(start[1])),
                (float(end[0]), float(end[1])),
                tuple(walled.shape[i, [CENTRE_X, CENTRE_Y]] + centre) if radius else None,  # type: ignore[arg-type]
                radius,
                sigma / np.sqrt(count) if count else float("nan"),
                count,
            )
        )
        if m > 1 and not np.array_equal(*walled.joints[i]):
            last = walled.joints[i, 1] + centre
            walls.append(
                OutlineWall(
                    ring, "step", walls[-1].end, (float(last[0]), float(last[1])), None, 0.0, float("nan"), 0
                )
            )
    return walls


def corner_sigmas(
    samples: RingSamples, walled: WalledRing, drawn: DrawnRing, sigma: float, direction_weight: float
) -> list[float]:
    """
    Return the standard deviation of every vertex of a ring, NaN where it is not the corner of two lines [m].

    The offset of a wall at the corner has the variance of its middle and that of its direction over the
    distance between the two; the corner's follow from those of its two walls and the angle between them.

    """
    variances = {}
    for i in range(len(walled.first)):
        k = (i + 1) % len(walled.first)
        corner = walled.joints[i, 0]
        is_corner = np.array_equal(*walled.joints[i]) and not walled.shape[[i, k], RADIUS].any()
        if is_corner and i != k:
            sine = np.sin(walled.shape[k, ANGLE] - walled.shape[i, ANGLE])
            both = sum(
                _variance_at(samples, walled, wall, corner, direction_weight) for wall in (i, k)
            )
            variances[corner.tobytes()] = both / sine**2
    return [
        sigma * float(np.sqrt(variances[vertex.tobytes()])) if vertex.tobytes() in variances else float("nan")
        for vertex in drawn.vertices
    ]


def _n_bearing(samples: RingSamples, walled: WalledRing, wall: int) -> int:
    """
    Count the traced points that bear a wall.

    """
    rows = np.arange(walled.first[wall], walled.last[wall]) % len(samples.points)
    return int(np.count_nonzero(samples.bears[rows]))


def _variance_at(
    samples: RingSamples, walled: WalledRing, wall: int, place: NDArray[np.float64], direction_weight: float
) -> float:
    """
    Return the variance of a wall's offset at a place of it, in units of a point's.

    """
    rows = np.arange(walled.first[wall], walled.last[wall]) % len(samples.points)
    bearing = samples.points[rows][samples.bears[rows]]
    if not len(bearing):
        return float("nan")
    angle = walled.shape[wall, ANGLE]
    along = np.array([-np.sin(angle), np.cos(angle)])
    positions = bearing @ along
    spread = float(((positions - positions.mean()) ** 2).sum()) * (1.0 + direction_weight)
    lever = float(place @ along - positions.mean()) ** 2 / spread if spread > 0 else 0.0
    return 1.0 / len(bearing) + lever

