"""
Straight walls and right angles from a traced outline: hierarchical least squares.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.parameters import StageConfig, parameter
from lidar_buildings.core.regularisation.corners import Fit, corners_of
from lidar_buildings.core.regularisation.division import Costs, divide_ring
from lidar_buildings.core.regularisation.lines import shared_directions
from lidar_buildings.core.status import BuildingStatus

#: Length of the median edge of a traced ring [spacings], measured on virtual roofs at the default window.
_EDGE_LENGTH = 1.65
#: Fewest ring points that are worth fitting walls to.
_MIN_RING_POINTS = 8
#: Rounds in which the directions are found anew from the walls that the last ones led to.
_DIRECTION_ROUNDS = 2


@dataclass(frozen=True)
class RegularisationConfig(StageConfig):
    """
    Settings of the hierarchical least squares adjustment.

    """

    stage: ClassVar[str] = "regularisation"

    noise: float = parameter(
        0.3,
        "Scatter of ring points across their wall; raising it gives fewer, longer walls.",
        unit="spacings",
        minimum=0.01,
        maximum=5.0,
    )
    finest_spacing: float = parameter(
        0.2,
        "Spacing that points are worth at best, by their planimetric accuracy; raising it removes detail.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    wall_cost: float = parameter(
        10.0,
        "What a wall must save in squared offsets over noise²; raising it gives fewer walls.",
        minimum=0.0,
    )
    own_direction_cost: float = parameter(
        15.0,
        "What a direction of its own must save; raising it turns more walls into the building's directions.",
        minimum=0.0,
    )
    long_wall: float = parameter(
        8.0,
        "Length from which a wall helps to find the directions; raising it leaves that to fewer walls.",
        unit="spacings",
        minimum=1.0,
        maximum=1000.0,
    )
    max_directions: int = parameter(
        3,
        "Most pairs of perpendicular directions a building may have; raising it serves crooked blocks.",
        minimum=1,
        maximum=8,
    )
    angle_tolerance_deg: float = parameter(
        10.0,
        "Largest angle between long walls of one direction; raising it joins more of them.",
        unit="deg",
        minimum=0.0,
        maximum=45.0,
    )
    direction_weight: float = parameter(
        100.0,
        "Weight of the long walls' directions over a wall's own points; raising it makes angles more exact.",
        minimum=0.0,
    )
    min_step: float = parameter(
        1.2,
        "Smallest step or wall; raising it removes more detail.",
        unit="spacings",
        minimum=0.0,
        maximum=100.0,
    )
    min_overlap: float = parameter(
        0.85,
        "Smallest intersection over union with the traced outline; raising it keeps more outlines as traced.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, eq=False)
class RegularisedOutline:
    """
    An outline of straight walls and how well it fits.

    Attributes
    ----------
    outline : Outline
        Simple and valid; the traced outline where it could not be regularised.
    sigma : float
        Standard deviation of the traced points about the outline [m].
    max_offset : float
        Largest distance of a traced point from the outline [m].
    directions : tuple of float
        Directions of the long walls within 0 to π/2, each standing for itself and its perpendicular, the
        most frequent first [rad].
    status : BuildingStatus
        OK or TRACED_OUTLINE.
    reason : str
        Why it is the traced outline, or what else was out of the ordinary; else empty.

    """

    outline: Outline
    sigma: float
    max_offset: float
    directions: tuple[float, ...]
    status: BuildingStatus
    reason: str


@dataclass(frozen=True)
class OutlineQuality:
    """
    How well an outline fits the ring it was made from; members as in `RegularisedOutline`.

    """

    sigma: float
    max_offset: float
    status: BuildingStatus
    reason: str


def regularise_outline(traced: Outline, config: RegularisationConfig | None = None) -> RegularisedOutline:
    """
    Replace a traced outline by straight walls, parallel and perpendicular where the building is.

    The rings are divided into walls where they turn. The long walls are adjusted by least squares with their
    directions held parallel or perpendicular; then all walls are, with these directions as heavily weighted
    observations (Sampath & Shan, 2007). Beyond the paper, a building may have several pairs of directions,
    and a wall keeps its own where it clearly deviates. Lines go through the traced points: the outline lies
    about half a point spacing inside the roof's edge, as theirs does.

    Parameters
    ----------
    traced : Outline
        Outline whose vertices are lidar points [m].
    config : RegularisationConfig, optional
        Settings.

    Returns
    -------
    RegularisedOutline
        The traced outline with its reason where the walls give no valid ring or one that differs too much.

    Raises
    ------
    ValueError
        If a ring is not an array of finite x and y.

    Notes
    -----
    Some 50,000 ring points a second.

    """
    config = config or RegularisationConfig()
    _check(traced)
    if len(traced.exterior) < _MIN_RING_POINTS:
        return _as_traced(traced, (), f"only {len(traced.exterior)} ring points: too few to find walls in")
    centre = traced.exterior.mean(axis=0)
    rings = [ring - centre for ring in traced.rings]
    spacing = float(np.hypot(_ring_spacing(rings), config.finest_spacing))
    directions = _directions(rings, spacing, config)
    outline, notes = _walled(rings, traced, directions, spacing, config)
    problem = _problem(outline, traced, config)
    if problem:
        return _as_traced(traced, directions, problem)
    return RegularisedOutline(outline, *_fit_quality(traced, outline), directions, BuildingStatus.OK, notes)


def measure_outline(
    traced: Outline, outline: Outline, config: RegularisationConfig | None = None
) -> OutlineQuality:
    """
    Measure how well an outline fits the traced one, for when only the two are known.

    Parameters
    ----------
    traced, outline : Outline
        Before and after regularisation [m].
    config : RegularisationConfig, optional
        Settings that `outline` was made with; they tell why an outline was left as traced.

    """
    if outline.same_as(traced):
        reason = regularise_outline(traced, config).reason or "the outline is the traced ring"
        return OutlineQuality(0.0, 0.0, BuildingStatus.TRACED_OUTLINE, reason)
    return OutlineQuality(*_fit_quality(traced, outline), BuildingStatus.OK, "")


def _check(outline: Outline) -> None:
    """
    Refuse rings that are not arrays of finite x and y.

    """
    for number, ring in enumerate(outline.rings):
        if ring.ndim != 2 or ring.shape[1] != 2:
            raise ValueError(f"traced.rings[{number}] has shape {ring.shape}: must be (n_vertices, 2)")
        if not np.isfinite(ring).all():
            raise ValueError(f"traced.rings[{number}] has coordinates that are not finite: all must be")


def _ring_spacing(rings: list[NDArray[np.float64]]) -> float:
    """
    Return the point spacing that a traced ring's edges speak of [m].

    """
    edges = np.concatenate([np.hypot(*(np.roll(ring, -1, axis=0) - ring).T) for ring in rings])
    return float(np.median(edges)) / _EDGE_LENGTH


def _costs(spacing: float, config: RegularisationConfig) -> Costs:
    """
    Return the costs of walls at a point spacing; the step between two parallel ones costs another wall.

    """
    return Costs(config.noise * spacing, config.wall_cost, config.own_direction_cost, config.wall_cost)


def _both_ways(directions: tuple[float, ...]) -> NDArray[np.float64]:
    """
    Return the normals' angles of all walls that go along or across one of the directions [rad].

    """
    return np.array([angle + turn for angle in directions for turn in (0.0, np.pi / 2)])


def _directions(
    rings: list[NDArray[np.float64]], spacing: float, config: RegularisationConfig
) -> tuple[float, ...]:
    """
    Find the directions of the long walls: first from walls of any direction, then from those that follow.

    """
    costs = _costs(spacing, config)
    directions: tuple[float, ...] = ()
    for _ in range(_DIRECTION_ROUNDS):
        walls = [
            ring[wall.rows(len(ring))]
            for ring in rings
            for wall in divide_ring(ring, _both_ways(directions), costs)
        ]
        directions = shared_directions(
            _long_walls(walls, config.long_wall * spacing),
            np.deg2rad(config.angle_tolerance_deg),
            costs.noise,
            config.own_direction_cost,
            config.max_directions,
        )
    return directions


def _long_walls(walls: list[NDArray[np.float64]], min_length: float) -> list[NDArray[np.float64]]:
    """
    Return the walls that are long enough, or at least half as long as the longest.

    """
    lengths = np.array([np.hypot(*(wall[-1] - wall[0])) for wall in walls])
    return [
        wall
        for wall, length in zip(walls, lengths, strict=True)
        if len(wall) > 2 and length >= min(min_length, 0.5 * lengths.max())
    ]


def _walled(
    rings: list[NDArray[np.float64]],
    traced: Outline,
    directions: tuple[float, ...],
    spacing: float,
    config: RegularisationConfig,
) -> tuple[Outline, str]:
    """
    Return the outline of straight walls and what is out of the ordinary about it.

    """
    angles = _both_ways(directions)
    fit = Fit(angles, config.direction_weight, config.min_step * spacing)
    costs = _costs(spacing, config)
    centre = traced.exterior.mean(axis=0)
    walled = [corners_of(ring, divide_ring(ring, angles, costs), fit) for ring in rings]
    exterior = walled[0][0] + centre
    holes, n_kept = _fitting_holes(exterior, [hole + centre for hole, _ in walled[1:]], traced.holes)
    notes = {
        "walls drawn through traced points because straight ones would cross": sum(
            n_traced for _, n_traced in walled
        ),
        "courtyards left as traced because straight walls would meet other rings": n_kept,
    }
    reason = "; ".join(f"{note}: {number}" for note, number in notes.items() if number)
    return Outline(exterior, holes).oriented(), reason


def _fitting_holes(
    exterior: NDArray[np.float64], walled: list[NDArray[np.float64]], traced: tuple[NDArray[np.float64], ...]
) -> tuple[tuple[NDArray[np.float64], ...], int]:
    """
    Return the courtyards, those as traced whose walls do not fit into the outer ring or between the others.

    """
    holes: list[NDArray[np.float64]] = []
    n_kept = 0
    for straight, ring in zip(walled, traced, strict=True):
        fits = (
            min(len(straight), len(exterior)) >= 3 and shapely.Polygon(exterior, [*holes, straight]).is_valid
        )
        holes.append(straight if fits else ring)
        n_kept += not fits
    return tuple(holes), n_kept


def _problem(outline: Outline, traced: Outline, config: RegularisationConfig) -> str:
    """
    Say why an outline cannot stand for the traced one; empty if it can.

    """
    if len(outline.exterior) < 3:
        return "fewer than three walls were found"
    polygon, ring = (shapely.Polygon(one.exterior, one.holes) for one in (outline, traced))
    if not polygon.is_valid:
        return "the walls do not make up a valid polygon"
    if not ring.is_valid:
        return "the traced outline is not valid"
    overlap = polygon.intersection(ring).area / polygon.union(ring).area
    if overlap < config.min_overlap:
        return f"the walls overlap with only {overlap:.0%} of the traced outline"
    if sum(map(len, outline.rings)) >= sum(map(len, traced.rings)):
        return "the walls are no simpler than the traced outline"
    return ""


def _fit_quality(traced: Outline, outline: Outline) -> tuple[float, float]:
    """
    Return the standard deviation and the largest of the traced points' distances from the outline [m].

    Every wall takes one unknown, its offset, and the building one more, its direction.

    """
    boundary = shapely.Polygon(outline.exterior, outline.holes).boundary
    points = np.concatenate(traced.rings)
    offsets = shapely.distance(boundary, shapely.points(points))
    redundancy = max(len(points) - sum(map(len, outline.rings)) - 1, 1)
    return float(np.sqrt(np.sum(offsets**2) / redundancy)), float(offsets.max())


def _as_traced(traced: Outline, directions: tuple[float, ...], reason: str) -> RegularisedOutline:
    """
    Return the traced outline as the result.

    """
    return RegularisedOutline(traced, 0.0, 0.0, directions, BuildingStatus.TRACED_OUTLINE, reason)
