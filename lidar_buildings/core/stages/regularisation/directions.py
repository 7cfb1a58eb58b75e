"""The directions that a building's long walls share, and how many there are: hierarchical least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.surfaces.ring_division.division import ARC, Division
from lidar_buildings.core.surfaces.ring_division.moments import least_scatter, normal_angle, scatter_of

_RIGHT_ANGLE = np.pi / 2
#: Rounds in which walls may leave a group because they do not fit it.
_MAX_ROUNDS = 5


class WallScatter(NamedTuple):
    """What a straight wall says of its direction."""

    #: Weighted sums of squares and products about the wall's middle [m²].
    xx: float
    xy: float
    yy: float
    length: float  #: from its first to its last sample [m]

    @property
    def angle(self) -> float:
        """Direction of the wall's normal [rad]."""
        return float(normal_angle(self.xx, self.xy, self.yy))

    def misfit(self, angle: float) -> float:
        """By how much the squared offsets rise if the wall goes along or across a direction [m²]."""
        nearest = angle + _RIGHT_ANGLE * round((self.angle - angle) / _RIGHT_ANGLE)
        c, s = np.cos(nearest), np.sin(nearest)
        offsets = c * c * self.xx + 2 * c * s * self.xy + s * s * self.yy
        return float(offsets - least_scatter(self.xx, self.xy, self.yy))


def wall_scatters(
    points: NDArray[np.float64], sums: NDArray[np.float64], division: Division, min_samples: int
) -> list[WallScatter]:
    """Return the scatters of a ring's straight walls of at least `min_samples`."""
    n, walls = len(points), []
    for first, last, kind in zip(division.first, division.last, division.kind, strict=True):
        if kind != ARC and last - first >= min_samples:
            _, _, _, xx, xy, yy = scatter_of(sums, first, last)
            ends = points[(last - 1) % n] - points[first % n]
            walls.append(WallScatter(xx, xy, yy, float(np.hypot(*ends))))
    return walls


def shared_directions(
    walls: list[WallScatter], tolerance: float, noise: float, max_misfit: float, max_directions: int
) -> tuple[float, ...]:
    """
    Find the directions that long walls share, the one with most wall first.

    First step of Sampath & Shan (2007): walls that are parallel or perpendicular within a tolerance form a
    group and get one direction by a joint least squares adjustment in which they are exactly so. Beyond the
    paper, walls that do not fit their group's direction form groups of their own.

    Parameters
    ----------
    walls : list of WallScatter
        The long walls.
    tolerance : float
        Largest angle between a wall and its group [rad].
    noise : float
        Standard deviation of a sample across its wall [m].
    max_misfit : float
        How much the squared offsets of a wall may rise when it takes the group's direction [noise²].
    max_directions : int
        Largest number of groups.

    Returns
    -------
    tuple of float
        Angles of normals within 0 to π/2, each standing for itself and its perpendicular [rad].
    """
    remaining = sorted(walls, key=lambda wall: -wall.length)
    groups: list[tuple[float, float]] = []
    limit = max_misfit * noise**2
    while remaining and len(groups) < max_directions:
        angle, members = _group(remaining, tolerance, limit)
        groups.append((-sum(wall.length for wall in members), angle))
        chosen = set(map(id, members))
        remaining = [wall for wall in remaining if id(wall) not in chosen]
    groups.sort(key=lambda group: group[0])
    return tuple(angle for _, angle in groups)


def _group(
    candidates: list[WallScatter], tolerance: float, max_misfit: float
) -> tuple[float, list[WallScatter]]:
    """Return the direction of the longest candidate's group and its members."""
    angle = candidates[0].angle % _RIGHT_ANGLE
    members = [wall for wall in candidates if turn_between(wall.angle, angle) <= tolerance]
    for _ in range(_MAX_ROUNDS):
        angle = joint_angle(members, angle)
        fitting = [wall for wall in members if wall.misfit(angle) <= max_misfit]
        if len(fitting) in (0, len(members)):
            break
        members = fitting
    return angle, members


def joint_angle(walls: list[WallScatter], near: float) -> float:
    """
    Return the normal's angle, within 0 to π/2, that parallel and perpendicular walls have in common [rad].
    """
    xx = xy = yy = 0.0
    for wall in walls:
        if round((wall.angle - near) / _RIGHT_ANGLE) % 2:
            # A quarter turn of the scatter makes a perpendicular wall parallel.
            xx, xy, yy = xx + wall.yy, xy - wall.xy, yy + wall.xx
        else:
            xx, xy, yy = xx + wall.xx, xy + wall.xy, yy + wall.yy
    return float(normal_angle(xx, xy, yy)) % _RIGHT_ANGLE


def turn_between(one: float, other: float) -> float:
    """Return the angle between two directions when a right angle counts as none [rad]."""
    difference = (one - other) % _RIGHT_ANGLE
    return float(min(difference, _RIGHT_ANGLE - difference))
