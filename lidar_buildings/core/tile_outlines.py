"""
A tile's outlines made regular, touching buildings with common walls.

"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.outline import BuildingOutline, Outline
from lidar_buildings.core.regularisation import (
    RegularisationConfig,
    regularise_outline,
    working_spacing,
)
from lidar_buildings.core.shared_walls import share_walls

_log = logging.getLogger(__name__)

#: Buildings whose traced rings come so near to each other were one block: different blocks are
#: farther apart, by half the window of the segmentation, 2.25 spacings [spacings].
_TOUCHING = 1.75
#: What rounding may leave of an overlap of buildings that share a wall [m²].
_MAX_OVERLAP = 1e-2


def regularise_outlines(
    outlines: tuple[BuildingOutline, ...], config: RegularisationConfig
) -> tuple[BuildingOutline, ...]:
    """
    Regularise every traced outline, and let touching ones share walls; one that cannot be keeps its rings.

    """
    traced = [one.outline for one in outlines]
    regular = [_regularised(one, config) for one in outlines]
    if config.max_wall_gap and len(outlines) > 1:
        spacings = [working_spacing(outline, config) if len(outline.exterior) else 0.0 for outline in traced]
        regular = with_common_walls(regular, traced, spacings, config.max_wall_gap)
    regular = _apart(
        [_sound(outline.as_carried(), ring) for outline, ring in zip(regular, traced, strict=True)], traced
    )
    return tuple(replace(one, outline=outline) for one, outline in zip(outlines, regular, strict=True))


def with_common_walls(
    outlines: Sequence[Outline], traced: Sequence[Outline], spacings: Sequence[float], max_gap: float
) -> list[Outline]:
    """
    Let buildings that were split from one block share their walls; all others stay as they are.

    Parameters
    ----------
    outlines, traced : sequence of Outline
        After and before regularisation [m].
    spacings : sequence of float
        Point spacing of each building [m].
    max_gap : float
        How far walls of touching buildings may be apart to become one [spacings].

    Returns
    -------
    list of Outline
        In the order given.

    """
    result = list(outlines)
    for members in _touching_groups(traced, np.asarray(spacings, dtype=np.float64)):
        shared = share_walls(
            [outlines[k] for k in members],
            [traced[k] for k in members],
            [max_gap * spacings[k] for k in members],
        )
        for k, outline, reason in zip(members, shared.outlines, shared.reasons, strict=True):
            result[k] = outline
            if reason:
                _log.info("building at (%.1f, %.1f): %s", *outlines[k].exterior[0], reason)
    return result


def _touching_groups(traced: Sequence[Outline], spacings: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """
    Return the rows of buildings that touch others, group by group.

    """
    if len(traced) < 2:
        return []
    rings = np.array([Outline(outline.exterior).polygon for outline in traced], dtype=object)
    reach = _TOUCHING * spacings
    one, other = shapely.STRtree(rings).query(rings, predicate="dwithin", distance=reach)
    distinct = one < other
    one, other = one[distinct], other[distinct]
    near = shapely.distance(rings[one], rings[other]) <= 0.5 * (reach[one] + reach[other])
    one, other = one[near], other[near]
    graph = coo_array((np.ones(len(one), dtype=np.int8), (one, other)), shape=(len(rings),) * 2)
    group = connected_components(graph, directed=False)[1]
    sizes = np.bincount(group)
    return [np.flatnonzero(group == k) for k in np.flatnonzero(sizes > 1)]


def _regularised(traced: BuildingOutline, config: RegularisationConfig) -> Outline:
    """
    Regularise one outline, or keep it as it is.

    """
    try:
        return regularise_outline(traced.outline, config).outline.as_carried()
    except Exception:
        _log.exception("building %d: regularisation failed, the traced ring is kept", traced.building_id)
        return traced.outline


def _sound(outline: Outline, traced: Outline) -> Outline:
    """
    Return an outline that rounding has left valid and without repeated vertices, else the traced one.

    """
    repeats = any((ring == np.roll(ring, -1, axis=0)).all(axis=1).any() for ring in outline.rings)
    if repeats or (len(outline.exterior) >= 3 and not outline.polygon.is_valid):
        return traced
    return outline


def _apart(outlines: list[Outline], traced: list[Outline]) -> list[Outline]:
    """
    Let a building whose walls lie over a neighbour's keep its traced outline, the smaller of the two first.

    """
    result = list(outlines)
    polygons = [outline.polygon for outline in outlines]
    one, other = shapely.STRtree(polygons).query(np.array(polygons, dtype=object), predicate="intersects")
    for i, k in zip(one[one < other].tolist(), other[one < other].tolist(), strict=True):
        for row in sorted((i, k), key=lambda row: (polygons[row].area, row)):
            if polygons[i].intersection(polygons[k]).area <= _MAX_OVERLAP:
                break
            result[row], polygons[row] = traced[row], traced[row].polygon
    return result
