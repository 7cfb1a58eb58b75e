"""The public function, and what becomes of buildings that sharing would spoil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.regularisation.shared_walls.common_lines import on_common_lines
from lidar_buildings.core.stages.regularisation.shared_walls.partition import partitioned

#: A building keeps its outline if it would lose more than this share of its area, or gain more than that and
#: more than half the gap along all its walls.
MAX_CHANGE = 0.2


@dataclass(frozen=True, eq=False)
class SharedWalls:
    """The outlines of a block, walls shared."""

    outlines: tuple[Outline, ...]  #: in the order they were given
    #: For each, why it stayed as it was although it touches others; empty where there is nothing to say.
    reasons: tuple[str, ...]


def share_walls(
    outlines: Sequence[Outline], traced: Sequence[Outline], max_gap: Sequence[float] | float
) -> SharedWalls:
    """
    Give neighbours the same wall, vertex for vertex, where they are apart or overlap by a little.

    Walls of different buildings that face each other are laid on one line between them, which the longer one
    has the greater say in; corners follow along the next walls. What is then left of gaps and overlaps
    is a face of the arrangement of all outlines, and goes to one of its neighbours as a whole; corners that
    end on a neighbour's wall become vertices of it.

    Parameters
    ----------
    outlines : sequence of Outline
        Of the buildings of a block.
    traced : sequence of Outline
        The rings through their points, which decide whose a place is that several outlines cover.
    max_gap : float or sequence of float
        How far walls may be apart, or overlap, to be one, for all buildings or for each; the mean of the two
        counts [m].

    Returns
    -------
    SharedWalls
        Outlines that touch no other are the same objects as given. So is a building that sharing would make
        invalid, part, or change by much more than its half of the gaps: then the others share without it.

    Raises
    ------
    ValueError
        If there are not as many traced outlines or gaps as outlines, or a gap is negative or not finite.

    Notes
    -----
    Neither the order of the buildings nor the first vertex of a ring matters. Vertices closer than 1 mm
    become one. Shared vertices are equal numbers, so that they stay equal when rounded to float32.
    """
    gaps = _checked_gaps(outlines, traced, max_gap)
    order = np.array(sorted(range(len(outlines)), key=lambda k: _key(outlines[k])), dtype=np.int64)
    polygons = np.array([_polygon(outlines[k]) for k in order], dtype=object)
    hints = np.array([_polygon(traced[k]) for k in order], dtype=object)
    gaps = gaps[order]
    reasons = np.full(len(order), "", dtype=object)
    reasons[~(shapely.is_valid(polygons) & ~shapely.is_empty(polygons))] = "the outline is not valid"
    while True:
        members = np.flatnonzero(reasons == "")
        members = members[_touches(polygons[members], gaps[members])]
        shared = _shared(polygons[members], hints[members], gaps[members])
        faults = np.array(list(map(_fault, polygons[members], shared, gaps[members])), dtype=object)
        if (faults == "").all():
            break
        reasons[members] = faults
    result = list(outlines)
    for member, polygon in zip(members, shared, strict=True):
        result[order[member]] = _as_given(polygon, outlines[order[member]])
    return SharedWalls(tuple(result), tuple(reasons[np.argsort(order)]))


def _shared(
    polygons: NDArray[np.object_], hints: NDArray[np.object_], gaps: NDArray[np.float64]
) -> NDArray[np.object_]:
    """Return buildings that share their walls, None where one would be nothing or of several parts."""
    if len(polygons) == 0:
        return polygons
    laid = on_common_lines(polygons, gaps)
    is_laid = shapely.is_valid(laid)
    is_laid &= np.abs(shapely.area(laid) - shapely.area(polygons)) <= _most_gained(polygons, gaps)
    laid = np.where(is_laid, laid, polygons)
    return partitioned(laid, hints, gaps, shapely.get_coordinates(polygons))


def _touches(polygons: NDArray[np.object_], gaps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which buildings have another one within the gap."""
    touches = np.zeros(len(polygons), dtype=bool)
    if len(polygons) > 1:
        near = shapely.STRtree(polygons).query(polygons, predicate="dwithin", distance=gaps.max())
        first, second = near[:, near[0] < near[1]]
        is_near = shapely.distance(polygons[first], polygons[second]) <= (gaps[first] + gaps[second]) / 2.0
        touches[first[is_near]] = touches[second[is_near]] = True
    return touches


def _most_gained(
    polygons: NDArray[np.object_] | shapely.Polygon, gaps: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return by how much buildings may grow [m²]."""
    return np.maximum(MAX_CHANGE * shapely.area(polygons), 0.5 * gaps * shapely.length(polygons))


def _fault(before: shapely.Polygon, after: shapely.Polygon | None, gap: float) -> str:
    """Say what is wrong with a building's shared outline, nothing if it is sound."""
    if after is None:
        return "sharing walls would leave nothing of it or several parts"
    if not after.is_valid:
        return "sharing walls would make it invalid"
    lost, gained = before.difference(after).area, after.difference(before).area
    if lost > MAX_CHANGE * before.area or gained > float(_most_gained(before, gap)):
        lost, gained = lost / before.area, gained / before.area
        return f"sharing walls would take {lost:.0%} of its area and add {gained:.0%}"
    return ""


def _as_given(polygon: shapely.Polygon, before: Outline) -> Outline:
    """
    Return a polygon as an outline, each ring from the vertex on that the one before began with, if it can.
    """
    after = Outline.of(polygon)
    first = np.array([ring[0] for ring in before.rings])
    exterior, *holes = [_begun(ring, first) for ring in after.rings]
    holes.sort(key=lambda ring: (*_places(ring[:1], first), *ring.min(axis=0)))
    after = Outline(exterior, tuple(holes))
    return before if after.same_as(before) else after


def _begun(ring: NDArray[np.float64], first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn a ring so that it begins with one of these vertices, else with its westernmost."""
    known = np.flatnonzero(_places(ring, first) < len(first))
    return np.roll(ring, -(known[0] if len(known) else np.lexsort(ring.T[::-1])[0]), axis=0)


def _places(vertices: NDArray[np.float64], among: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return where among others equal vertices stand, the number of these for one that has no equal."""
    equal = (vertices[:, None] == among[None]).all(axis=2)
    return np.where(equal.any(axis=1), equal.argmax(axis=1), len(among))


def _polygon(outline: Outline) -> shapely.Polygon:
    """
    Return an outline as a polygon whose rings begin with their westernmost vertices, empty without a ring.
    """
    return outline.polygon.normalize()


def _key(outline: Outline) -> tuple[float, ...]:
    """Return by what buildings are put in order, whatever the order they come in."""
    ring = outline.exterior
    if len(ring) == 0:
        return ()
    return (*ring[np.lexsort(ring.T[::-1])[0]].tolist(), outline.area, len(ring))


def _checked_gaps(
    outlines: Sequence[Outline], traced: Sequence[Outline], max_gap: ArrayLike
) -> NDArray[np.float64]:
    """Return the gap of each building."""
    if len(traced) != len(outlines):
        raise ValueError(f"traced has {len(traced)} outlines: must be as many as outlines, {len(outlines)}")
    gaps = np.asarray(max_gap, dtype=np.float64)
    if gaps.ndim > 1 or (gaps.ndim == 1 and len(gaps) != len(outlines)):
        raise ValueError(f"max_gap has shape {gaps.shape}: must be one length or one for each outline")
    if not (np.isfinite(gaps) & (gaps >= 0)).all():
        raise ValueError(f"max_gap = {max_gap!r}: must be lengths of 0 or more [m]")
    return np.broadcast_to(gaps, len(outlines)).copy()
