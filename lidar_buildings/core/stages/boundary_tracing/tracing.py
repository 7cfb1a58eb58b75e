"""The ring round a building's points, and the rims of its courtyards."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.point_spacing import FEW_PROBES, given_or_measured, measure_spacing
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing.alpha_shape import alpha_rings
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.courtyards import CourtyardRules
from lidar_buildings.core.stages.boundary_tracing.open_ground import (
    GROUND_REACH,
    clear_ground,
    enclosed_ground,
    ground_spacing,
)
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, build_point_grid, inside
from lidar_buildings.core.stages.boundary_tracing.rings import NO_WALK, RingTracer

#: Places on the roof that are asked how far their nearest point is, and the share that are nearer than gaps
#: are wide: a tenth may be wet patches and shafts.
_PLACES, _SHARE = 500, 0.9
#: That distance in even patterns is at most 0.7, where points lie anywhere in their cells [spacings].
_EVEN = 0.75
#: Wider gaps are no pattern of points [spacings].
_WIDEST = 2.0
#: Fewest distinct positions that a walk makes sense for.
_MIN_POSITIONS = 4
#: A cloud narrower than this counts as a line [spacings].
_MIN_WIDTH = 0.1
#: Sides of the neighbourhood differ by this factor at most: in a narrower one rings follow every line.
_MAX_RATIO = 2.0
#: Sides up to which the neighbourhood grows where the walk fails; wide margin: gaps in roofs are narrower,
#: and beyond it the ring comes from a triangulation [spacings].
_MAX_WINDOW = 20.0
#: Width of the disc that has to fit into a courtyard: gaps left by chance or by wet patches are narrower
#: [spacings].
_MIN_COURTYARD_WIDTH = 8.0
#: Width of the roof round most of a courtyard: wet roofs return one to three rows along rims [spacings].
_MIN_COURTYARD_BAND = 3.0


def gap_spacing(positions: NDArray[np.float64], outline: shapely.Polygon, spacing: float) -> float:
    """
    Return the spacing that an even pattern with gaps as wide as a roof's has: up to twice the given one [m].

    How far it is from any place of the roof to the nearest point is the empty-space function of spatial
    statistics (Diggle, 1983, Statistical Analysis of Spatial Point Patterns). Turned and mirrored points have
    the same.
    """
    if outline.area == 0.0:
        return spacing
    middle = positions.mean(axis=0)
    corners = shapely.get_coordinates(outline) - middle
    angle = _main_direction(*(positions - middle).T)
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    width, height = np.abs(corners @ turned.T).max(axis=0)
    step = np.sqrt(outline.area / _PLACES)
    u, v = (step * np.arange(-(reach // step), reach // step + 1.0) for reach in (width, height))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) @ turned + middle
    shapely.prepare(outline)
    places = places[shapely.contains_xy(outline, *places.T)]
    nearest = cKDTree(positions, balanced_tree=False, compact_nodes=False).query(places)[0]
    return float(np.clip(np.quantile(nearest, _SHARE) / _EVEN, spacing, _WIDEST * spacing))


@dataclass(frozen=True, eq=False)
class TracedBoundary:
    """A building's traced outline."""

    outline: Outline  #: the vertices are points of the building but for degenerate ones; simple and valid
    point_spacing: float  #: spacing of the building's points [m]
    status: BuildingStatus  #: OK, or DEGENERATE where there are too few points or all lie on a line
    reason: str  #: what was out of the ordinary, in words; else empty


def trace_boundary(
    points: ArrayLike,
    config: BoundaryTracingConfig | None = None,
    *,
    pattern: ScanPattern | None = None,
    point_spacing: float | None = None,
    ground: NDArray[np.float64] | None = None,
) -> TracedBoundary:
    """
    Trace the ring round one building's points, and the rims of its courtyards.

    A convex hull's walk, from a point on the hull on, that looks for its next point only in a neighbourhood
    of the current one and never crosses its own way (Sampath & Shan, 2007). Where it ends in a dead end or
    leaves points outside, the neighbourhood is widened there and the walk begins anew; where that does not
    help, the ring comes from a triangulation. Courtyards are empty discs inside the ring that are wide
    enough and have roof all round; their rims are walked in the same way. Where the rings enclose ground that
    was seen, they are walked once more, and no step crosses it: what is open within is a courtyard, however
    narrow. With the method ``"alpha_shape"`` the ring is that of `alpha_rings`.

    - `points`, shape (n_points, 3): The building's points, in any order [m].
    - `pattern`, optional: Spacing along and across the scan lines: the neighbourhood is a rectangle with
      sides in these proportions, aligned with the lines. Without it, or where both are the same, it is a
      disc, since nothing tells how a square should be turned, unless `config.neighbourhood` wants one.
    - `point_spacing`, optional: The spacing of the building's points [m]; that of the pattern, or measured,
      if not given.
    - `ground`, shape (n_ground, 2 or more), optional: Ground about the building, a point each half metre at
      most [m].

    Returned: all points lie inside or on the ring. ValueError if `points` has another shape or is not finite,
    or `point_spacing` is not positive. Heights have no influence; neither has the order of points. The ring
    turns with the points if the pattern does.
    """
    config = config or BoundaryTracingConfig()
    cloud = checked_points(points)
    spacing = _spacing(cloud, pattern, point_spacing)
    known, is_rectangle = pattern or ScanPattern.isotropic(spacing), config.neighbourhood == "rectangle"
    if not is_rectangle:  # lines are never so straight and even
        least = max(known.along, known.across) / _MAX_RATIO
        known = replace(known, along=max(known.along, least), across=max(known.across, least))
    grid = build_point_grid(cloud, known, config.window, is_rectangle=is_rectangle)
    why_degenerate = ""
    if len(grid.x) < _MIN_POSITIONS:
        why_degenerate = f"only {len(grid.x)} distinct positions"
    elif _width(grid.x, grid.y) < _MIN_WIDTH * spacing:
        why_degenerate = "all points lie on a line"
    if why_degenerate:
        outline = Outline(_simple_cover(np.column_stack([grid.x, grid.y]), spacing))
        return TracedBoundary(outline, spacing, BuildingStatus.DEGENERATE, why_degenerate)
    if config.method == "alpha_shape":
        outline, reason = alpha_rings(np.column_stack([grid.x, grid.y]), config)
        return TracedBoundary(outline, spacing, BuildingStatus.OK, reason)
    yards = CourtyardRules(
        radius=_MIN_COURTYARD_WIDTH * spacing / 2,
        min_area=config.min_courtyard_area,
        min_band=_MIN_COURTYARD_BAND * spacing,
    )
    rules = yards if config.courtyards else None
    seen = ground[:, :2] if ground is not None and config.courtyards else np.zeros((0, 2))
    reach = GROUND_REACH * spacing
    outline, reasons = _traced(grid, known, seen, reach, config, rules)
    if not is_rectangle:
        positions = np.column_stack((grid.x, grid.y))
        wider = gap_spacing(positions, outline.polygon, known.spacing) / known.spacing
        across_gaps = replace(known, along=known.along * wider, across=known.across * wider)
        if across_gaps != known:
            clear = clear_ground(seen, positions, known.spacing, reach)
            grid = build_point_grid(cloud, across_gaps, config.window, is_rectangle=False)
            smoother, why = _traced(grid, across_gaps, seen, reach, config, rules)
            more = _n_within(smoother, clear) - _n_within(outline, clear)
            is_as_open = abs(more) * ground_spacing(known.spacing) ** 2 < config.min_courtyard_area
            if len(smoother.holes) == len(outline.holes) if is_as_open else more < 0:
                outline, reasons = smoother, why
    return TracedBoundary(outline, spacing, BuildingStatus.OK, "; ".join(reasons))


def rows_to_trace(
    rows: NDArray[np.intp], edge: NDArray[np.uint8] | None, config: BoundaryTracingConfig
) -> NDArray[np.intp]:
    """Return the rows of a building's points that its ring is traced from: all where too few are edges."""
    if config.source == "points" or edge is None:
        return rows
    edges = rows[edge[rows] > 0]
    return edges if len(edges) >= _MIN_POSITIONS else rows


def _traced(
    grid: PointGrid,
    pattern: ScanPattern,
    ground: NDArray[np.float64],
    reach: float,
    config: BoundaryTracingConfig,
    rules: CourtyardRules | None,
) -> tuple[Outline, list[str]]:
    outline, reasons = _rings(RingTracer(grid, _MAX_WINDOW / config.window), rules)
    if not len(ground):
        return outline, reasons
    points = np.column_stack((grid.x, grid.y))
    found = enclosed_ground(
        ground, points, outline.polygon, pattern.spacing, reach, config.min_courtyard_area
    )
    if found is None:
        return outline, reasons
    both = np.concatenate((points, found.places))
    fenced = build_point_grid(both, pattern, config.window, is_rectangle=not grid.is_disc)
    beside, why = _rings(RingTracer(fenced, _MAX_WINDOW / config.window, found), rules)
    is_worse = _n_within(beside, found.places) >= _n_within(outline, found.places)
    return (outline, reasons) if NO_WALK in why or is_worse else (beside, why)


def _n_within(outline: Outline, places: NDArray[np.float64]) -> int:
    return int(np.count_nonzero(inside(places, outline.polygon)))


def _rings(tracer: RingTracer, rules: CourtyardRules | None) -> tuple[Outline, list[str]]:
    tracer.trace_exterior()
    if rules is not None:
        tracer.trace_courtyards(rules)
    return tracer.outline(), tracer.reasons


def _spacing(cloud: NDArray[np.float64], pattern: ScanPattern | None, point_spacing: float | None) -> float:
    if point_spacing is not None:
        return given_or_measured(cloud, point_spacing)
    return measure_spacing(cloud, FEW_PROBES) if pattern is None else pattern.spacing


def _main_direction(dx: NDArray[np.float64], dy: NDArray[np.float64]) -> float:
    # No scalar products: the threads that BLAS starts for long ones take more time than all else.
    return float(0.5 * np.arctan2(2.0 * (dx * dy).sum(), (dx * dx - dy * dy).sum()))


def _width(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    dx, dy = x - x.mean(), y - y.mean()
    angle = _main_direction(dx, dy)
    return float(np.ptp(np.cos(angle) * dy - np.sin(angle) * dx))


def _simple_cover(positions: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return a ring with an area round a few positions: their hull, or a strip or square one spacing wide."""
    if not len(positions):
        return np.zeros((0, 2))
    hull = shapely.convex_hull(shapely.multipoints(positions))
    if hull.geom_type != "Polygon" or _width(*positions.T) < _MIN_WIDTH * spacing:
        strip = shapely.oriented_envelope(hull)
        hull = shapely.buffer(strip, spacing / 2, cap_style="square", join_style="mitre")
    return Outline(shapely.get_coordinates(hull)[:-1]).oriented().exterior
