"""Ground seen between a building's points: its rings do not go round it, and no step of a walk crosses it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError, cKDTree

from lidar_buildings.core.stages.boundary_tracing.closed_walls import GROUND_CELL
from lidar_buildings.core.stages.boundary_tracing.point_grid import inside

#: Ground is open beyond this distance from the building's points: what is nearer lies under eaves, or was
#: seen through the roof [spacings].
_CLEAR = 1.0
#: Open ground nearer to each other than this is one place [spacings of the ground].
_LINK = 2.0
#: Ground is looked at up to this distance from the building's points, as far as windows reach, whatever else
#: a tile has of it [spacings of the pulses].
GROUND_REACH = 4.5


class OpenGround(NamedTuple):
    """Places of open ground, joined by fences."""

    places: NDArray[np.float64]  #: shape (n, 2) [m]
    #: The row of the place at the other end of each place's fence; its own for one place of each part,
    #: shape (n,).
    other_end: NDArray[np.int64]
    middles: NDArray[np.float64]  #: the place of each part farthest from the building, shape (n_parts, 2) [m]


def ground_spacing(spacing: float) -> float:
    """Return how far apart the ground is that is known about points of a spacing: one a cell at most [m]."""
    return max(spacing, GROUND_CELL)


def clear_ground(
    ground: NDArray[np.float64], points: NDArray[np.float64], spacing: float, reach: float
) -> NDArray[np.float64]:
    """Return the ground within reach of points but not under eaves, shapes (n, 2), (m, 2) [m]."""
    if not len(ground):
        return ground
    return _clear_of(cKDTree(points, balanced_tree=False, compact_nodes=False), ground, spacing, reach)


def enclosed_ground(
    ground: NDArray[np.float64],
    points: NDArray[np.float64],
    ring: shapely.Polygon,
    spacing: float,
    reach: float,
    min_area: float,
) -> OpenGround | None:
    """
    Return the open ground of which a ring encloses as much as a courtyard has; None if there is none.

    Where the building is connected across ground alone, a ring has to cross it: that is not open. Fences are
    the minimum spanning trees of places that are near to each other with open ground between. Ground, one a
    cell of `GROUND_CELL` at most and looked at up to `reach` from the building [m], and the building's
    distinct positions have shape (n, 2) [m]. The ring was traced without regard to the ground; `min_area` is
    that of a courtyard [m²].
    """
    pitch = ground_spacing(spacing)
    if not _is_enough(inside(ground, ring), pitch, min_area):
        return None
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    places = np.unique(_clear_of(tree, ground, spacing, reach), axis=0)
    if not _is_enough(inside(places, ring), pitch, min_area):
        return None
    clearance = tree.query(places)[0]
    is_open = ~_is_crossed(places, points, spacing)
    places, clearance = places[is_open], clearance[is_open]
    if not len(places):
        return None
    pairs = cKDTree(places).query_pairs(_LINK * pitch, output_type="ndarray")
    between = tree.query(places[pairs].mean(axis=1))[0]
    fences = _spanning_forest(places, pairs[between > _CLEAR * spacing])
    n_parts, part = connected_components(fences, directed=False)
    size = np.bincount(part[inside(places, ring)], minlength=n_parts)
    kept = np.flatnonzero(size * pitch**2 >= min_area)
    if not len(kept):
        return None
    other_end, middles = np.arange(len(places)), []
    for number in kept:
        members = np.flatnonzero(part == number)
        nodes, before = breadth_first_order(fences, members[0], directed=False)
        other_end[nodes[1:]] = before[nodes[1:]]
        middles.append(places[members[np.argmax(clearance[members])]])
    is_kept = np.isin(part, kept)
    row = np.cumsum(is_kept) - 1
    return OpenGround(places[is_kept], row[other_end[is_kept]], np.array(middles))


def _clear_of(
    tree: cKDTree, ground: NDArray[np.float64], spacing: float, reach: float
) -> NDArray[np.float64]:
    clearance = tree.query(ground, distance_upper_bound=reach)[0]
    return ground[(clearance > _CLEAR * spacing) & np.isfinite(clearance)]


def _is_enough(held: NDArray[np.bool_], pitch: float, min_area: float) -> bool:
    return bool(np.count_nonzero(held) * pitch**2 >= min_area)


def _is_crossed(
    places: NDArray[np.float64], points: NDArray[np.float64], spacing: float
) -> NDArray[np.bool_]:
    """Tell which places lie where the building's points are connected by a link across ground alone."""
    crossed = np.zeros(len(places), dtype=bool)
    try:
        triangles = Delaunay(points - points.mean(axis=0)).simplices
    except QhullError:
        return crossed
    edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    links = _spanning_forest(points, edges).tocoo()
    is_long = links.data > 2.0 * _CLEAR * spacing
    ends = points[np.column_stack((links.row, links.col))[is_long]]
    reach = 0.5 * links.data[is_long] + _CLEAR * spacing
    for rows in cKDTree(places).query_ball_point(ends.mean(axis=1), reach):
        crossed[rows] = True
    return crossed


def _spanning_forest(places: NDArray[np.float64], pairs: NDArray[np.int64]):  # type: ignore[no-untyped-def]
    """Return the minimum spanning trees of places that some pairs join, as a sparse matrix of lengths [m]."""
    length = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T)
    joined = coo_array((length, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return minimum_spanning_tree(joined.tocsr())
