"""The directions that a building's walls share, and the division of its rings: hierarchical least squares."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.walls import about_direction
from lidar_buildings.core.surfaces.ring_division import (
    ARC,
    FREE,
    Costs,
    Division,
    divide_ring,
    least_scatter,
    normal_angle,
    running_sums,
    scatter_of,
)

_RIGHT_ANGLE = np.pi / 2
#: Rounds in which walls may leave a group because they do not fit it.
_MAX_ROUNDS = 5
#: What a further pair of directions must save in squared offsets over noise²: a term of the information
#: criterion (Schwarz, 1978).
_DIRECTION_COST = 10.0
#: What a direction of its own and an arc must save in squared offsets over noise² beside the wall's cost.
_OWN_DIRECTION_COST, _ARC_COST = 15.0, 60.0
#: Length from which a wall helps to find the directions [spacings]; Sampath & Shan (2007) take 10 m.
_LONG_WALL = 8.0


class WallScatter(NamedTuple):
    """Weighted sums of squares and products of a straight wall about its middle [m²], and its length [m]."""

    xx: float
    xy: float
    yy: float
    length: float

    @property
    def angle(self) -> float:
        """Direction of the wall's normal [rad]."""
        return float(normal_angle(self.xx, self.xy, self.yy))

    def misfit(self, angle: float) -> float:
        """By how much the squared offsets rise if the wall goes along or across a direction [m²]."""
        nearest = angle + _RIGHT_ANGLE * round((self.angle - angle) / _RIGHT_ANGLE)
        along, _ = about_direction(self.xx, self.xy, self.yy, nearest)
        return float(self.xx + self.yy - along - least_scatter(self.xx, self.xy, self.yy))


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

    A wall is within `tolerance` [rad] of its group, and its squared offsets, of standard deviation `noise`
    [m], rise by `max_misfit` [noise²] at most when it takes the group's direction. Angles are those of
    normals within 0 to π/2, each standing for itself and its perpendicular [rad].
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
    angle = candidates[0].angle % _RIGHT_ANGLE
    turns = [(wall.angle - angle) % _RIGHT_ANGLE for wall in candidates]
    pairs = zip(candidates, turns, strict=True)
    members = [wall for wall, turn in pairs if min(turn, _RIGHT_ANGLE - turn) <= tolerance]
    for _ in range(_MAX_ROUNDS):
        angle = joint_angle(members, angle)
        fitting = [wall for wall in members if wall.misfit(angle) <= max_misfit]
        if len(fitting) in (0, len(members)):
            break
        members = fitting
    return angle, members


def joint_angle(walls: list[WallScatter], near: float) -> float:
    """Return the normal's angle, 0 to π/2, that parallel and perpendicular walls have in common [rad]."""
    xx = xy = yy = 0.0
    for wall in walls:
        if round((wall.angle - near) / _RIGHT_ANGLE) % 2:
            # A quarter turn of the scatter makes a perpendicular wall parallel.
            xx, xy, yy = xx + wall.yy, xy - wall.xy, yy + wall.xx
        else:
            xx, xy, yy = xx + wall.xx, xy + wall.xy, yy + wall.yy
    return float(normal_angle(xx, xy, yy)) % _RIGHT_ANGLE


def divide_at_turns(ring: RingSamples, max_turn: float) -> tuple[RingSamples, Division]:
    """
    Divide a ring into segments of consecutive edges with similar slopes (Sampath & Shan, 2007).

    An edge that deviates from the edge before by more than the given angle [rad] begins the next segment. The
    point between two segments is of both, and twice among the samples returned. All walls are free, and the
    cost is 0: nothing was weighed.
    """
    n = len(ring.points)
    begins = _turns(ring.points, max_turn)
    times = np.ones(n, dtype=np.int64)
    times[begins % n] = 2
    every = np.repeat(np.arange(n), times)
    samples = replace(
        ring,
        points=ring.points[every],
        weights=ring.weights[every],
        bears=ring.bears[every],
        rows=ring.rows[every],
    )
    first = (np.cumsum(times) - 1)[begins % n] + begins // n * len(every)
    last = np.append(first[1:], first[0] + len(every))
    return samples, Division(first, last, np.full(len(first), FREE), 0.0)


def along_nearest(ring: RingSamples, division: Division, angles: NDArray[np.float64]) -> Division:
    """Let each segment go along the nearest of some directions, given by normals; its own without."""
    if not len(angles):
        return replace(division, kind=np.full(len(division.first), FREE))
    sums = running_sums(ring.points, ring.weights)
    scatters = [scatter_of(sums, *ends) for ends in zip(division.first, division.last, strict=True)]
    own = np.array([normal_angle(xx, xy, yy) for *_, xx, xy, yy in scatters])
    away = np.abs((own[:, None] - angles + _RIGHT_ANGLE) % np.pi - _RIGHT_ANGLE)
    return replace(division, kind=np.argmin(away, axis=1))


def _turns(points: NDArray[np.float64], max_turn: float) -> NDArray[np.int64]:
    """Return the first point of each segment, from the sharpest turn of the ring on."""
    n, after = len(points), np.roll(points, -1, axis=0) - points
    before = np.roll(after, 1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(cross, (before * after).sum(axis=1)))
    start = int(np.argmax(turn))
    later = np.arange(start + 1, start + n)
    return np.append(start, later[turn[later % n] > max_turn])


def divide_building(
    samples: list[RingSamples], spacing: float, config: RegularisationConfig
) -> tuple[list[RingSamples], tuple[float, ...], list[Division]]:
    """
    Find a building's directions and divide its rings into walls.

    Returned are the samples that the divisions are of, the directions, the most frequent first, each standing
    for itself and its perpendicular [rad], and the divisions, whose kinds number them as `both_ways` does.
    """
    if config.division == "optimal":
        return samples, *_divided(samples, spacing, config)
    return _divided_at_turns(samples, spacing, config)


def both_ways(directions: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the normals' angles of all walls that go along or across one of the directions [rad]."""
    return np.array([angle + turn for angle in directions for turn in (0.0, np.pi / 2)])


def _divided(
    samples: list[RingSamples], spacing: float, config: RegularisationConfig
) -> tuple[tuple[float, ...], list[Division]]:
    """Find the building's directions and the walls that follow them."""
    # The long walls of a free division are candidates, taken as long as they are worth a further parameter.
    costs = Costs(
        noise=config.noise * spacing,
        wall=config.wall_cost,
        own_direction=_OWN_DIRECTION_COST,
        step=config.wall_cost,
        arc=_ARC_COST if config.curved_walls else np.inf,
        parallel=float(np.sin(np.deg2rad(config.angle_tolerance_deg))),
    )

    def divided(directions: tuple[float, ...], near: list[Division] | None) -> list[Division]:
        starts: list[int | None] = [None] * len(samples)
        if near is not None:  # a corner, as far as possible from where the division began
            starts = [int(one.first[len(one.first) // 2]) for one in near]
        return [
            divide_ring(ring.points, both_ways(directions), costs, weights=ring.weights, start=start)
            for ring, start in zip(samples, starts, strict=True)
        ]

    free = divided((), None)
    candidates = _long_directions(samples, free, spacing, config, config.max_directions)
    directions: tuple[float, ...] = ()
    best, least = free, _total(free)
    for count in range(1, len(candidates) + 1):
        found = divided(candidates[:count], free)
        total = _total(found) + count * _DIRECTION_COST
        if total < least:
            best, directions, least = found, candidates[:count], total
        elif count > len(directions) + 1:
            break
    if directions:
        directions = _long_directions(samples, best, spacing, config, len(directions)) or directions
        best = divided(directions, best)
    return directions, best


def _divided_at_turns(
    samples: list[RingSamples], spacing: float, config: RegularisationConfig
) -> tuple[list[RingSamples], tuple[float, ...], list[Division]]:
    """Find the directions of the long walls, and all walls, as published."""
    max_turn = np.deg2rad(config.max_turn_deg)
    samples, divisions = map(list, zip(*(divide_at_turns(ring, max_turn) for ring in samples), strict=True))
    directions = _long_directions(samples, divisions, spacing, config, config.max_directions)
    angles = both_ways(directions)
    return samples, directions, [along_nearest(*one, angles) for one in zip(samples, divisions, strict=True)]


def _total(divisions: list[Division]) -> float:
    return sum(division.cost for division in divisions)


def _long_directions(
    samples: list[RingSamples],
    divisions: list[Division],
    spacing: float,
    config: RegularisationConfig,
    max_directions: int,
) -> tuple[float, ...]:
    least = 3 if config.division == "optimal" else 2
    walls = [
        wall
        for ring, division in zip(samples, divisions, strict=True)
        for wall in wall_scatters(ring.points, running_sums(ring.points, ring.weights), division, least)
    ]
    min_length = min_long_length([wall.length for wall in walls], spacing, config)
    return shared_directions(
        [wall for wall in walls if wall.length >= min_length],
        np.deg2rad(config.angle_tolerance_deg),
        config.noise * spacing,
        _OWN_DIRECTION_COST if config.adjustment == "robust" else np.inf,
        max_directions,
    )


def min_long_length(lengths: list[float], spacing: float, config: RegularisationConfig) -> float:
    """Return the length from which walls count as long: as set, or half of the longest if none is [m]."""
    longest = max(lengths, default=0.0)
    wanted = config.min_long_wall or _LONG_WALL * spacing
    return wanted if config.min_long_wall and longest >= wanted else min(wanted, 0.5 * longest)


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
    weight = config.stiffness(spacing)
    # What the long walls told of both directions together, when these were held perpendicular.
    of_long = weight * sum(length >= min_length for _, length, _, _ in walls)
    adjusted = angles.copy()
    for k in range(len(angles)):
        observed = [(turn, along * weight / (along + weight)) for kind, _, turn, along in walls if kind == k]
        total = of_long + sum(each for _, each in observed)
        if total > 0.0:
            adjusted[k] += sum(turn * each for turn, each in observed) / total
    return adjusted


def _length_and_turn(
    points: NDArray[np.float64], sums: NDArray[np.float64], first: int, last: int, angle: float
) -> tuple[float, float, float]:
    """Return a wall's length [m], the turn from a direction to its own [rad], and the turn's weight [m²]."""
    _, _, _, xx, xy, yy = scatter_of(sums, first, last)
    along, across = about_direction(xx, xy, yy, angle)
    ends = points[(last - 1) % len(points)] - points[first % len(points)]
    return float(np.hypot(*ends)), float(-across / along) if along > 0.0 else 0.0, float(along)
