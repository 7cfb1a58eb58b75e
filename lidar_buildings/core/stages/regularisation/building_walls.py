"""The walls of a whole building: its rings share their directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.directions import shared_directions, wall_scatters
from lidar_buildings.core.stages.regularisation.samples import RingSamples
from lidar_buildings.core.stages.regularisation.turns import along_nearest, divide_at_turns
from lidar_buildings.core.surfaces.ring_division.division import Costs, Division, divide_ring
from lidar_buildings.core.surfaces.ring_division.moments import running_sums

#: What a further pair of directions must save in squared offsets over noise²: a term of the information
#: criterion (Schwarz, 1978).
_DIRECTION_COST = 10.0
#: What a direction of its own and an arc must save in squared offsets over noise² beside the wall's cost.
_OWN_DIRECTION_COST, _ARC_COST = 15.0, 60.0
#: Length from which a wall helps to find the directions [spacings]; Sampath & Shan (2007) take 10 m.
_LONG_WALL = 8.0


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


def _costs(spacing: float, config: RegularisationConfig) -> Costs:
    """Return what walls cost at a point spacing [m]; a step between nearly parallel ones costs another."""
    return Costs(
        noise=config.noise * spacing,
        wall=config.wall_cost,
        own_direction=_OWN_DIRECTION_COST,
        step=config.wall_cost,
        arc=_ARC_COST if config.curved_walls else np.inf,
        parallel=float(np.sin(np.deg2rad(config.angle_tolerance_deg))),
    )


def _divided(
    samples: list[RingSamples], spacing: float, config: RegularisationConfig
) -> tuple[tuple[float, ...], list[Division]]:
    """
    Find the building's directions and the walls that follow them.

    The long walls of a division into free walls give the candidates. They are taken on one by one, as long as
    the squared offsets that they save are worth a further parameter; then the walls found adjust them again.
    """
    costs = _costs(spacing, config)

    def divided(directions: tuple[float, ...], near: list[Division] | None) -> list[Division]:
        starts = [None] * len(samples) if near is None else [_a_corner(one) for one in near]
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


def _a_corner(division: Division) -> int:
    """Return a sample at which a wall begins, as far as possible from where the division did."""
    return int(division.first[len(division.first) // 2])


def _total(divisions: list[Division]) -> float:
    """Return the cost of all rings."""
    return sum(division.cost for division in divisions)


def _long_directions(
    samples: list[RingSamples],
    divisions: list[Division],
    spacing: float,
    config: RegularisationConfig,
    max_directions: int,
) -> tuple[float, ...]:
    """Return the directions of the walls that are long enough."""
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
