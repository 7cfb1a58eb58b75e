"""How an outline came about: walls and how far they are from the traced ring, holes, necks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.report.explain.finding import Finding, Limits
from lidar_buildings.report.result_folder import ReportedBuilding

_NOISE = ("regularisation.noise", "regularisation.wall_cost", "regularisation.min_step")
_JOINED = ("segmentation.window", "segmentation.min_neck", "segmentation.split_at_steps")
#: As many walls are told of.
_MOST_WALLS = 6
#: Walls shorter than so many spacings are detail that chance may have made, and so many of them are jagged.
_SHORT, _JAGGED = 3.0, 0.35
#: A traced corner so many times further from its wall than it may scatter may be a lost corner.
_FAR = 6.0
#: The widest neck that is looked for [m].
_WIDEST = 8.0


class Wall(NamedTuple):
    """A straight piece of an outline."""

    #: [m], 0 to 180 from north, clockwise.
    length: float
    direction_deg: float
    n_traced: int  #: corners of the traced ring that lie nearest to it
    #: Mean and greatest distance of these, positive outside [m].
    moved: float
    worst: float


def outline_findings(building: ReportedBuilding, spacing: float, limits: Limits) -> Iterator[Finding]:
    """Yield what there is to say of a building's outline."""
    outline, traced = building.outline, building.traced
    if outline is None or outline.is_empty:
        yield Finding("It has no outline: " + (building.attributes.get("reason") or "the run ended before"))
        return
    corners = shapely.get_coordinates(outline.exterior)[:-1]
    n_holes = len(outline.interiors)
    yield Finding(f"{len(corners)} walls, {outline.area:,.1f} m², {counted(n_holes, 'courtyard')}")
    if building.status == "traced_outline":
        yield Finding("The outline is the traced ring: it could not be regularised.", _NOISE)
    if traced is not None and not traced.is_empty:
        yield from _moves(outline, traced, limits)
    walls = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    n_short = int((walls < _SHORT * spacing).sum())
    if n_short > _JAGGED * len(walls):
        yield Finding(
            f"Jagged: {n_short} of {len(walls)} walls are shorter than {_SHORT * spacing:.1f} m "
            f"({_SHORT:g} spacings).",
            (*_NOISE, "regularisation.bridge_concavities", "boundary_tracing.window"),
        )
    yield from _necks(outline, limits)


def walls_of(outline: shapely.Polygon, traced: shapely.Polygon) -> list[Wall]:
    """Return the walls of an outline's outer ring with the corners of the traced ring that are theirs."""
    start = shapely.get_coordinates(outline.exterior)[:-1]
    end = np.roll(start, -1, axis=0)
    ring = shapely.points(shapely.get_coordinates(traced.exterior)[:-1])
    lines = shapely.linestrings(np.stack([start, end], axis=1))
    distance = shapely.distance(lines[None, :], ring[:, None])
    nearest = distance.argmin(axis=1)
    far = distance.min(axis=1) * np.where(shapely.contains(outline, ring), -1.0, 1.0)
    step = end - start
    direction = np.degrees(np.arctan2(step[:, 0], step[:, 1])) % 180.0
    found = []
    for wall, length in enumerate(np.linalg.norm(step, axis=1).tolist()):
        own = far[nearest == wall]
        worst = float(own[np.abs(own).argmax()]) if len(own) else 0.0
        mean = float(own.mean()) if len(own) else 0.0
        found.append(Wall(length, float(direction[wall]), len(own), mean, worst))
    return found


def _moves(outline: shapely.Polygon, traced: shapely.Polygon, limits: Limits) -> Iterator[Finding]:
    walls = walls_of(outline, traced)
    n_traced = len(traced.exterior.coords) - 1
    noise = limits.value("regularisation.noise")
    yield Finding(
        f"Traced with {n_traced} corners and {counted(len(traced.interiors), 'courtyard')}; "
        f"walls may leave out what scatters by {noise:.2f} m."
    )
    for wall in sorted(walls, key=lambda one: abs(one.worst), reverse=True)[:_MOST_WALLS]:
        if wall.n_traced and abs(wall.worst) > noise:
            side = "outside" if wall.worst > 0 else "inside"
            yield Finding(
                f"  wall of {wall.length:.1f} m, {wall.direction_deg:.0f}°: {wall.n_traced} traced corners, "
                f"{wall.moved:+.2f} m on average, at most {abs(wall.worst):.2f} m {side} of it",
                ("regularisation.noise", "regularisation.bridge_concavities")
                if abs(wall.worst) > _FAR * noise
                else (),
            )
    if len(traced.interiors) != len(outline.interiors):
        n_traced = counted(len(traced.interiors), "courtyard")
        yield Finding(
            f"Traced with {n_traced}, of which {len(outline.interiors)} kept.",
            ("boundary_tracing.min_courtyard_area",),
        )


def _necks(outline: shapely.Polygon, limits: Limits) -> Iterator[Finding]:
    """Say where an outline is narrow between two parts that could each be a building."""
    least = limits.value("roof_selection.min_building_area")
    for width in np.arange(0.5, _WIDEST + 0.1, 0.5):
        parts = shapely.get_parts(shapely.buffer(outline, -width / 2))
        # what was taken off all round is given back
        areas = shapely.area(shapely.buffer(parts, width / 2))
        large = np.sort(areas[areas >= least])[::-1]
        if len(large) > 1:
            told = ", ".join(f"{area:,.0f} m²" for area in large[:4])
            yield Finding(
                f"A neck narrower than {width:.1f} m joins parts of {told}: maybe several buildings; "
                f"necks are cut below {limits.value('segmentation.min_neck'):.2f} m.",
                _JOINED,
            )
            return


def shape_of(points: NDArray[np.float64], spacing: float) -> shapely.Geometry:
    """Return the area that points cover: discs of 1.5 spacings, drawn in again by one."""
    discs = shapely.buffer(shapely.points(points[:, :2]), 1.5 * spacing, quad_segs=2)
    return shapely.buffer(shapely.union_all(discs), -spacing)
