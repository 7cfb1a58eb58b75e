"""Straight walls, right angles and arcs from a traced outline: hierarchical least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline, OutlineQuality, signed_area
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.directions import (
    adjusted_directions,
    both_ways,
    divide_building,
)
from lidar_buildings.core.stages.regularisation.drawing import (
    draw_ring,
    offset_outwards,
    through_all_points,
)
from lidar_buildings.core.stages.regularisation.samples import (
    RingSamples,
    concavity_limits,
    estimated_bias,
    ring_spacing,
    sample_ring,
    working_spacing,
)
from lidar_buildings.core.stages.regularisation.walls import Fit, WalledRing, assemble
from lidar_buildings.core.surfaces.ring_division import ARC, FREE, Division

#: Fewest ring points that walls are fitted to: a rectangle has as many unknowns.
_MIN_RING_POINTS = 5
#: Shortest wall and chord [finest spacings].
_SHORTEST_WALL = 4.0
#: Walls through the points lie so far inside the roof's edge, measured on virtual roofs [spacings].
_INSIDE = 0.29


@dataclass(frozen=True, eq=False)
class RegularisedOutline:
    """An outline of straight walls and arcs, and how well it fits."""

    outline: Outline  #: simple and valid; the traced outline, simplified, where walls make up none
    sigma: float  #: standard deviation of the points on walls about the lines and arcs through them [m]
    max_offset: float  #: largest distance of a point on a wall from the outline [m]
    #: Directions of the long walls within 0 to π/2, each standing for itself and its perpendicular, the most
    #: frequent first [rad].
    directions: tuple[float, ...]
    status: BuildingStatus  #: OK or TRACED_OUTLINE
    reason: str  #: why it is the traced outline, or what else was out of the ordinary; else empty
    bias: float = 0.0  #: by how much the roof's edge is thought to lie outside of it [m]


def fit_quality(points: NDArray[np.float64], outline: Outline, n_unknowns: int) -> tuple[float, float]:
    """
    Return the standard deviation and the largest of the points' distances from an outline [m].

    The points lie on walls; `n_unknowns` were adjusted to them, see `unknowns_of`.
    """
    offsets = shapely.distance(outline.polygon.boundary, shapely.points(points))
    redundancy = max(len(points) - n_unknowns, 1)
    return float(np.sqrt(np.sum(offsets**2) / redundancy)), float(offsets.max())


def unknowns_of(rings: Sequence[WalledRing], n_directions: int) -> int:
    """Count what the adjustment had to find: directions, and each line's offset, own angle, or circle."""
    kinds = np.concatenate([ring.kind for ring in rings])
    own = int(np.select([kinds == FREE, kinds == ARC], [2, 3], 0).sum())
    return n_directions + own + sum(len(np.unique(ring.shape[ring.kind >= 0], axis=0)) for ring in rings)


class _Fitted(NamedTuple):
    """A ring about the building's centre: `bearing` walls on the bearing points, `walled` as drawn."""

    samples: RingSamples
    bearing: WalledRing
    walled: WalledRing
    drawn: NDArray[np.float64]  #: shape (n_vertices, 2) [m]
    n_mended: int  #: places where walls cross, and the ring follows its points


def regularise_outline(traced: Outline, config: RegularisationConfig | None = None) -> RegularisedOutline:
    """
    Replace a traced outline by straight walls, parallel and perpendicular where the building is, and arcs.

    The rings are divided into walls, in the best of all ways for what walls cost. The long walls are adjusted
    by least squares with their directions held parallel or perpendicular; then all walls are, with these
    directions as heavily weighted observations (Sampath & Shan, 2007). Beyond the paper, a building may have
    several pairs of directions, as many as an information criterion finds worth their parameters (Schwarz,
    1978), a wall keeps its own direction or bends where it clearly does, and concavities that are gaps
    between points are bridged first.

    - `traced`: Outline whose vertices are lidar points [m].

    Returned: the traced outline with its reason where the walls give no valid ring. ValueError if a ring is
    not an array of finite x and y. Coordinates are metres: points are worth `finest_spacing` at best, so that
    much smaller things stay as traced. Some 500 buildings a second; a ring of 100,000 points takes seconds.
    """
    config = config or RegularisationConfig()
    checked = _checked(traced)
    if len(checked.exterior) < _MIN_RING_POINTS:
        return _as_traced(traced, (), f"only {len(checked.exterior)} ring points: too few to find walls in")
    if min(map(len, checked.rings)) < 3:
        return _as_traced(traced, (), "a courtyard of fewer than three vertices")
    centre = checked.exterior.mean(axis=0)
    spacing = working_spacing(checked, config)
    samples = [
        sample_ring(ring - centre, spacing, concavity_limits(config, spacing)) for ring in checked.rings
    ]
    samples, directions, divisions = divide_building(samples, spacing, config)
    angles = both_ways(directions)
    if config.adjustment == "joint":
        angles = adjusted_directions(samples, divisions, angles, spacing, config)
    fit = Fit(
        angles,
        config.stiffness(spacing),
        config.min_step * spacing,
        _SHORTEST_WALL * config.finest_spacing,
        config.chord_error * spacing,
        config.line_cost(spacing),
    )
    rings = [_fitted(ring, division, fit) for ring, division in zip(samples, divisions, strict=True)]
    result = _result(traced, rings, centre, directions, fit.min_step)
    result = replace(result, bias=_INSIDE * ring_spacing(checked))
    if not config.correct_bias or result.status is not BuildingStatus.OK:
        return result
    empty = estimated_bias(samples, ring_spacing(checked))
    corrected = []
    for ring in rings:
        walled = offset_outwards(ring.samples, ring.bearing, fit, empty)
        corrected.append(_Fitted(ring.samples, ring.bearing, walled, *draw_ring(ring.samples, walled, fit)))
    moved = _result(traced, corrected, centre, directions, fit.min_step)
    if moved.status is not BuildingStatus.OK:
        reason = f"walls are where the points are, since moved out to the edge: {moved.reason}"
        return replace(result, reason="; ".join(filter(None, (result.reason, reason))))
    # What was adjusted is the line through the points: its precision is that of the moved one, too.
    return replace(moved, sigma=result.sigma, max_offset=result.max_offset, bias=0.0)


def outline_quality(
    traced: Outline, outline: Outline, own: RegularisedOutline, config: RegularisationConfig
) -> OutlineQuality:
    """
    Return how well a building's final outline fits the traced one.

    `own` is the traced outline regularised alone: its precision holds where the final one, after shared walls
    and rounding, is still that.
    """
    if outline.same_as(own.outline) or outline.same_as(own.outline.as_carried()):
        return OutlineQuality(own.sigma, own.max_offset, own.status, own.reason, own.bias)
    if outline.same_as(traced):
        return OutlineQuality(
            0.0,
            0.0,
            BuildingStatus.TRACED_OUTLINE,
            "straight walls would lie over a neighbour's, or be spoilt by rounding",
        )
    spacing = working_spacing(traced, config)
    limits = concavity_limits(config, spacing)
    points = np.concatenate([sample_ring(ring, spacing, limits).on_walls for ring in traced.rings])
    quality = fit_quality(points, outline, sum(map(len, outline.rings)) + 1)
    return OutlineQuality(*quality, own.status, own.reason, own.bias)


def _checked(outline: Outline) -> Outline:
    """Return float64 rings, oriented, without repetitions; ValueError if not of finite x and y."""
    rings = []
    for number, given in enumerate(outline.rings):
        ring = np.asarray(given, dtype=np.float64)
        if ring.ndim != 2 or ring.shape[1] != 2:
            raise ValueError(f"traced.rings[{number}] has shape {ring.shape}: must be (n_vertices, 2)")
        if not np.isfinite(ring).all():
            raise ValueError(f"traced.rings[{number}] has coordinates that are not finite: all must be")
        goes_on = (ring != np.roll(ring, -1, axis=0)).any(axis=1)
        rings.append(ring[goes_on] if len(ring) > 1 else ring)
    return Outline(rings[0], tuple(rings[1:])).oriented()


def _fitted(samples: RingSamples, division: Division, fit: Fit) -> _Fitted:
    bearing = assemble(samples, division, fit)
    walled = through_all_points(samples, bearing, fit)
    return _Fitted(samples, bearing, walled, *draw_ring(samples, walled, fit))


def _result(
    traced: Outline,
    rings: list[_Fitted],
    centre: NDArray[np.float64],
    directions: tuple[float, ...],
    step: float,
) -> RegularisedOutline:
    """
    Put the rings together, measure them, and say what is out of the ordinary.

    Where they are no polygon, the traced rings remain, without what deviates by less than `step` [m].
    """
    exterior = rings[0].drawn + centre
    walled = [ring.drawn + centre for ring in rings[1:]]
    holes, kept, filled = _fitting_holes(exterior, walled, traced.holes)
    outline = Outline(exterior, holes)
    problem = _problem(outline, traced)
    if problem:
        return _as_traced(_simplified(traced, step), directions, problem)
    points = np.concatenate([ring.samples.on_walls for ring in rings]) + centre
    unknowns = unknowns_of([ring.walled for ring in rings], len(directions))
    sigma, max_offset = fit_quality(points, outline, unknowns)
    status, notes = BuildingStatus.OK, _notes(kept, filled, sum(ring.n_mended for ring in rings))
    return RegularisedOutline(outline, sigma, max_offset, directions, status, notes)


def _notes(kept: list[int], filled: list[int], n_mended: int) -> str:
    notes = {
        "places where walls would cross follow the points": n_mended,
        "courtyards left as traced because straight walls would meet other rings": len(kept),
        "courtyards left out because the outer walls meet them": len(filled),
    }
    return "; ".join(f"{note}: {number}" for note, number in notes.items() if number)


def _fitting_holes(
    exterior: NDArray[np.float64], walled: list[NDArray[np.float64]], traced: tuple[NDArray[np.float64], ...]
) -> tuple[tuple[NDArray[np.float64], ...], list[int], list[int]]:
    """Return the courtyards, and the numbers of those left as traced, and of those left out."""
    holes: list[NDArray[np.float64]] = []
    kept, filled = [], []
    for number, (straight, ring) in enumerate(zip(walled, traced, strict=True), start=1):
        forms = (one for one in (straight, ring) if min(len(one), len(exterior)) >= 3)
        chosen = next((one for one in forms if shapely.Polygon(exterior, [*holes, one]).is_valid), None)
        if chosen is None:
            filled.append(number)
            continue
        holes.append(chosen)
        if chosen is ring:
            kept.append(number)
    return tuple(holes), kept, filled


def _problem(outline: Outline, traced: Outline) -> str:
    if len(outline.exterior) < 3:
        return "fewer than three walls were found"
    # walls that pass each other are turned round
    if not outline.polygon.is_valid or signed_area(outline.exterior) <= 0.0:
        return "the walls do not make up a valid polygon"
    if not traced.polygon.is_valid:
        return "the traced outline is not valid"
    return ""


def _simplified(traced: Outline, step: float) -> Outline:
    """Return fewer vertices; all of them where that leaves nothing."""
    polygon = traced.polygon
    fewer = shapely.simplify(polygon, step) if polygon.is_valid else shapely.Polygon()
    return traced if fewer.is_empty or fewer.geom_type != "Polygon" else Outline.of(fewer)


def _as_traced(traced: Outline, directions: tuple[float, ...], reason: str) -> RegularisedOutline:
    return RegularisedOutline(traced, 0.0, 0.0, directions, BuildingStatus.TRACED_OUTLINE, reason)
