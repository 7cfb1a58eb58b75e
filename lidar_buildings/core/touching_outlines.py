"""
Touching buildings of a tile get common walls.

"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.shared_walls import share_walls

_log = logging.getLogger(__name__)

#: Buildings whose traced rings come so near to each other were one block: different blocks are
#: farther apart, by half the window of the segmentation, 2.25 spacings [spacings].
_TOUCHING = 1.75


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
    rings = np.array([_polygon(outline) for outline in traced], dtype=object)
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


def _polygon(outline: Outline) -> shapely.Polygon:
    """
    Return an outline as a polygon, empty if it has no ring.

    """
    return shapely.Polygon(outline.exterior) if len(outline.exterior) >= 3 else shapely.Polygon()
