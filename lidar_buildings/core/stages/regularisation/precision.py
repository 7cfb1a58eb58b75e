"""The walls of an outline, and how well points lie on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.regularisation.assembly import WalledRing
from lidar_buildings.core.stages.regularisation.result import OutlineWall
from lidar_buildings.core.stages.regularisation.walls import CENTRE_X, CENTRE_Y, RADIUS
from lidar_buildings.core.surfaces.ring_division.division import ARC, FREE


def fit_quality(points: NDArray[np.float64], outline: Outline, n_unknowns: int) -> tuple[float, float]:
    """
    Return the standard deviation and the largest of the points' distances from an outline [m].

    The points lie on walls; `n_unknowns` were adjusted to them, see `unknowns_of`.
    """
    offsets = shapely.distance(outline.polygon.boundary, shapely.points(points))
    redundancy = max(len(points) - n_unknowns, 1)
    return float(np.sqrt(np.sum(offsets**2) / redundancy)), float(offsets.max())


def unknowns_of(rings: Sequence[WalledRing], n_directions: int) -> int:
    """
    Count what the adjustment had to find: a direction each, and each line's offset, own angle, or circle.
    """
    kinds = np.concatenate([ring.kind for ring in rings])
    own = int(np.select([kinds == FREE, kinds == ARC], [2, 3], 0).sum())
    return n_directions + own + sum(len(np.unique(ring.shape[ring.kind >= 0], axis=0)) for ring in rings)


def outline_walls(ring: int, walled: WalledRing, centre: NDArray[np.float64]) -> list[OutlineWall]:
    """Return a ring's walls and the steps between them, in order, in the map frame."""
    walls: list[OutlineWall] = []
    m = len(walled.first)
    joints = (walled.joints + centre).tolist()
    for i, shape in enumerate(walled.shape):
        start, end = joints[i - 1][1], joints[i][0]
        radius = float(shape[RADIUS])
        middle = (float(shape[CENTRE_X] + centre[0]), float(shape[CENTRE_Y] + centre[1])) if radius else None
        kind = "arc" if radius else "line"
        walls.append(OutlineWall(ring, kind, _pair(start), _pair(end), middle, radius))
        if m > 1 and joints[i][0] != joints[i][1]:
            walls.append(OutlineWall(ring, "step", _pair(end), _pair(joints[i][1]), None, 0.0))
    return walls


def _pair(place: list[float]) -> tuple[float, float]:
    """Return x and y as a tuple."""
    return place[0], place[1]
