"""
Wall lines in normal form, and the directions that a building's long walls share: hierarchical least squares.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RIGHT_ANGLE = np.pi / 2
#: Rounds in which walls may leave a group because they do not fit it.
_MAX_ROUNDS = 5


@dataclass(frozen=True)
class Line:
    """
    The line x cos θ + y sin θ = ρ about the building's centre.

    Attributes
    ----------
    angle : float
        Direction θ of the normal [rad].
    offset : float
        Distance ρ of the line from the centre, along the normal [m].

    """

    angle: float
    offset: float

    @property
    def normal(self) -> NDArray[np.float64]:
        """
        The unit normal (cos θ, sin θ).

        """
        return np.array([np.cos(self.angle), np.sin(self.angle)])

    def foot(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return the point of the line that is nearest to another.

        """
        return point - (point @ self.normal - self.offset) * self.normal

    def meeting(self, other: Line) -> NDArray[np.float64] | None:
        """
        Return the point where two lines meet, None if they are parallel.

        """
        sine = np.sin(other.angle - self.angle)
        if abs(sine) < 1e-9:
            return None
        x = self.offset * np.sin(other.angle) - other.offset * np.sin(self.angle)
        y = other.offset * np.cos(self.angle) - self.offset * np.cos(other.angle)
        return np.array([x, y]) / sine


def free_line(points: NDArray[np.float64]) -> Line:
    """
    Return the line with the least squared orthogonal offsets.

    """
    angle = _normal_angle(_scatter(points))
    return Line(angle, float(points.mean(axis=0) @ (np.cos(angle), np.sin(angle))))


def weighted_line(points: NDArray[np.float64], angle: float, weight: float) -> Line:
    """
    Return the least squares line, its direction being observed beside the points.

    Second step of Sampath & Shan (2007): one equation cos θ x + sin θ y − ρ = 0 per point and one θ = angle,
    the latter with `weight` times the weight that all points together have for the direction.

    Parameters
    ----------
    points : ndarray of shape (n_points, 2)
        The wall's points about the building's centre [m].
    angle : float
        Direction of the normal from the first step [rad].
    weight : float
        Zero fits the points alone, a large value keeps the direction.

    """
    normal, along = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    middle = points.mean(axis=0)
    centred = points - middle
    positions = centred @ along
    own = float(positions @ positions)
    # Turning the line by δ lowers its offset at position t by t δ: linear for the small turns that remain.
    turn = -float(positions @ (centred @ normal)) / (own * (1.0 + weight)) if own > 0 else 0.0
    turned = angle + turn
    return Line(turned, float(middle @ (np.cos(turned), np.sin(turned))))


def shared_directions(
    walls: list[NDArray[np.float64]], tolerance: float, noise: float, max_misfit: float, max_directions: int
) -> tuple[float, ...]:
    """
    Find the directions that long walls share, the one with most wall first.

    First step of Sampath & Shan (2007): walls that are parallel or perpendicular within a tolerance form a
    group and get one direction by a joint least squares adjustment in which they are exactly so. Beyond the
    paper, walls that do not fit their group's direction form groups of their own.

    Parameters
    ----------
    walls : list of ndarray of shape (n_points, 2)
        Points of each long wall [m].
    tolerance : float
        Largest angle between a wall and its group [rad].
    noise : float
        Standard deviation of a point across its wall [m].
    max_misfit : float
        How much the squared offsets of a wall may rise when it takes the group's direction [noise²].
    max_directions : int
        Largest number of groups.

    Returns
    -------
    tuple of float
        Angles of normals within 0 to π/2, each standing for itself and its perpendicular [rad].

    """
    scatters = [_scatter(wall) for wall in walls]
    lengths = [
        float(np.sqrt(np.trace(scatter) * 12 / len(wall)))
        for scatter, wall in zip(scatters, walls, strict=True)
    ]
    remaining = sorted(range(len(walls)), key=lambda i: -lengths[i])
    groups: list[tuple[float, float]] = []
    while remaining and len(groups) < max_directions:
        angle, members = _group(remaining, scatters, tolerance, max_misfit * noise**2)
        groups.append((-sum(lengths[i] for i in members), angle))
        remaining = [i for i in remaining if i not in members]
    return tuple(angle for _, angle in sorted(groups))


def _group(
    candidates: list[int], scatters: list[NDArray[np.float64]], tolerance: float, max_misfit: float
) -> tuple[float, list[int]]:
    """
    Return the direction of the longest candidate's group and its members.

    """
    angle = _normal_angle(scatters[candidates[0]]) % _RIGHT_ANGLE
    members = [i for i in candidates if _turn(_normal_angle(scatters[i]), angle) <= tolerance]
    for _ in range(_MAX_ROUNDS):
        angle = _joint_angle([scatters[i] for i in members], angle)
        fitting = [i for i in members if _misfit(scatters[i], angle) <= max_misfit]
        if len(fitting) in (0, len(members)):
            break
        members = fitting
    if candidates[0] not in members:
        # The longest wall was outvoted: it stands for itself, so that the search goes on without it.
        return _normal_angle(scatters[candidates[0]]) % _RIGHT_ANGLE, [candidates[0]]
    return angle, members


def _joint_angle(scatters: list[NDArray[np.float64]], near: float) -> float:
    """
    Return the normal's angle, within 0 to π/2, that parallel and perpendicular walls have in common.

    """
    total = np.zeros((2, 2))
    for scatter in scatters:
        if round((_normal_angle(scatter) - near) / _RIGHT_ANGLE) % 2:
            # A quarter turn of the scatter makes a perpendicular wall parallel.
            scatter = np.array([[scatter[1, 1], -scatter[0, 1]], [-scatter[0, 1], scatter[0, 0]]])
        total += scatter
    return _normal_angle(total) % _RIGHT_ANGLE


def _misfit(scatter: NDArray[np.float64], angle: float) -> float:
    """
    Return by how much a wall's squared offsets rise if it takes a group's direction [m²].

    """
    nearest = angle + _RIGHT_ANGLE * round((_normal_angle(scatter) - angle) / _RIGHT_ANGLE)
    normal = np.array([np.cos(nearest), np.sin(nearest)])
    return float(normal @ scatter @ normal - np.linalg.eigvalsh(scatter)[0])


def _turn(one: float, other: float) -> float:
    """
    Return the angle between two directions when a right angle counts as none [rad].

    """
    difference = (one - other) % _RIGHT_ANGLE
    return float(min(difference, _RIGHT_ANGLE - difference))


def _scatter(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the sums of squares and products about the mean [m²].

    """
    centred = points - points.mean(axis=0)
    return centred.T @ centred


def _normal_angle(scatter: NDArray[np.float64]) -> float:
    """
    Return the direction of the least scatter [rad].

    """
    return 0.5 * float(np.arctan2(2 * scatter[0, 1], scatter[0, 0] - scatter[1, 1])) + _RIGHT_ANGLE
