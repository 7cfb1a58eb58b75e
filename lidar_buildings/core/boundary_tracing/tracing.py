"""
The ring round a building's points, and the rims of its courtyards: modified convex hull.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.boundary_tracing.rings import RingTracer
from lidar_buildings.core.outline import Outline
from lidar_buildings.core.parameters import StageConfig, parameter
from lidar_buildings.core.point_array import checked_points
from lidar_buildings.core.point_spacing import measure_spacing
from lidar_buildings.core.status import BuildingStatus

#: Fewest distinct positions that a walk makes sense for.
_MIN_POSITIONS = 4
#: A cloud narrower than this counts as a line [spacings].
_MIN_WIDTH = 0.1


@dataclass(frozen=True)
class BoundaryTracingConfig(StageConfig):
    """
    Settings of the modified convex hull.

    """

    stage: ClassVar[str] = "boundary_tracing"

    window: float = parameter(
        5.0,
        "Diameter of the neighbourhood of each step; raising it smooths the ring and closes narrow gaps.",
        unit="spacings",
        minimum=2.0,
        maximum=40.0,
    )
    max_window: float = parameter(
        20.0,
        "Diameter up to which the neighbourhood grows where the walk fails; raising it falls back later.",
        unit="spacings",
        minimum=2.0,
        maximum=200.0,
    )
    min_courtyard_width: float = parameter(
        8.0,
        "Width of the disc that has to fit into a courtyard; raising it leaves more gaps inside unmarked.",
        unit="spacings",
        minimum=2.0,
        maximum=200.0,
    )
    min_courtyard_area: float = parameter(
        9.0,
        "Smallest area of a courtyard; raising it leaves more gaps inside the roof unmarked.",
        unit="m²",
        minimum=0.0,
    )


@dataclass(frozen=True, eq=False)
class TracedBoundary:
    """
    A building's traced outline.

    Attributes
    ----------
    outline : Outline
        The vertices are points of the building but for degenerate ones; simple and valid.
    point_spacing : float
        Spacing of the building's points [m].
    status : BuildingStatus
        OK, or DEGENERATE where there are too few points or all lie on a line.
    reason : str
        What was out of the ordinary, in words; else empty.

    """

    outline: Outline
    point_spacing: float
    status: BuildingStatus
    reason: str


def trace_boundary(points: ArrayLike, config: BoundaryTracingConfig | None = None) -> TracedBoundary:
    """
    Trace the ring round one building's points, and the rims of its courtyards.

    A convex hull's walk, from the leftmost point on, that looks for its next point only in a neighbourhood
    of the current one and never crosses its own way (Sampath & Shan, 2007). Where it ends in a dead end or
    leaves points outside, the neighbourhood is widened there and the walk begins anew; where that does not
    help, the ring comes from a triangulation. Courtyards are empty discs inside the ring that are wide
    enough; their rims are walked in the same way.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        The building's points, in any order [m].
    config : BoundaryTracingConfig, optional
        Settings.

    Returns
    -------
    TracedBoundary
        All points lie inside or on the ring.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite.

    Notes
    -----
    Heights have no influence; neither has the order of points. About 0.2 million points a second, and a ring
    of 100,000 points takes about a second.

    """
    config = config or BoundaryTracingConfig()
    cloud = checked_points(points)
    spacing = measure_spacing(cloud)
    positions = _distinct(cloud[:, :2])
    why_degenerate = _degeneracy(positions, spacing)
    if why_degenerate:
        outline = Outline(_simple_cover(positions, spacing))
        return TracedBoundary(outline, spacing, BuildingStatus.DEGENERATE, why_degenerate)
    tracer = RingTracer(positions, config.window * spacing / 2, config.max_window * spacing / 2)
    tracer.trace_exterior()
    tracer.trace_courtyards(config.min_courtyard_width * spacing / 2, config.min_courtyard_area)
    return TracedBoundary(tracer.outline(), spacing, BuildingStatus.OK, "; ".join(tracer.reasons))


def _distinct(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return every position once, by x, then y.

    """
    ordered = xy[np.lexsort((xy[:, 1], xy[:, 0]))]
    is_new = np.ones(len(xy), dtype=bool)
    is_new[1:] = (np.diff(ordered, axis=0) != 0).any(axis=1)
    return ordered[is_new]


def _degeneracy(positions: NDArray[np.float64], spacing: float) -> str:
    """
    Say why positions have no ring worth a walk; empty if they have.

    """
    if len(positions) < _MIN_POSITIONS:
        return f"only {len(positions)} distinct positions"
    if _width(positions) < _MIN_WIDTH * spacing:
        return "all points lie on a line"
    return ""


def _width(positions: NDArray[np.float64]) -> float:
    """
    Return the extent across the main direction of the positions [m].

    """
    centred = positions - positions.mean(axis=0)
    across = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    return float(np.ptp(centred @ across))


def _simple_cover(positions: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """
    Return a ring with an area round a few positions: their hull, or a strip or square one spacing wide.

    """
    if not len(positions):
        return np.zeros((0, 2))
    hull = shapely.convex_hull(shapely.multipoints(positions))
    if hull.geom_type != "Polygon" or _width(positions) < _MIN_WIDTH * spacing:
        middle = positions.mean(axis=0)
        centred = positions - middle
        axes = np.linalg.eigh(centred.T @ centred)[1]
        extent = np.abs(centred @ axes).max(axis=0) + spacing / 2
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * extent
        return Outline(middle + corners @ axes.T).oriented().exterior
    return Outline(shapely.get_coordinates(hull)[:-1]).oriented().exterior
