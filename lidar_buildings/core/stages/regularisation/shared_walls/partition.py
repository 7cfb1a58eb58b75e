"""
The block as a partition: every face of the arrangement of all outlines belongs to one building or to none.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.solids.planar_subdivision import divide_plane, face_owners
from lidar_buildings.core.stages.regularisation.shared_walls.rings import merged_rings

#: Vertices of the arrangement lie on a grid of this side [m], which makes it exact; far below any noise.
GRID = 1e-3
#: Two buildings border on a place if they do so over this many gaps.
MIN_BORDER_GAPS = 0.5


def partitioned(
    polygons: NDArray[np.object_],
    traced: NDArray[np.object_],
    gaps: NDArray[np.float64],
    kept: NDArray[np.float64],
) -> NDArray[np.object_]:
    """
    Share out gaps and overlaps between buildings, and insert the vertices where one ends on another's wall.

    `gaps` is how wide gaps beside each may be to be filled [m]; vertices `kept` stay even where no wall
    bends. Touching buildings have the same vertices along their common walls; None for one that is nothing
    any more, or of several parts.
    """
    slots = _slots(polygons, gaps)
    rings = shapely.get_parts(shapely.boundary(np.concatenate([polygons, slots])))
    faces = divide_plane(rings, GRID)
    faces = faces[np.lexsort(shapely.bounds(faces).T)]
    owner = _owners(faces, polygons, traced)
    _drop_loose_parts(faces, owner, len(polygons))
    _fill(faces, owner, gaps)
    return merged_rings(faces, owner, polygons, kept, GRID)


def _slots(polygons: NDArray[np.object_], gaps: NDArray[np.float64]) -> NDArray[np.object_]:
    """
    Return the places between two buildings that are too narrow to stay open, though they are at one end.
    """
    reach = gaps.max() / 2.0
    if reach == 0.0:
        return np.zeros(0, dtype=object)
    filled = shapely.union_all(polygons)
    closed = shapely.buffer(shapely.buffer(filled, reach, join_style="mitre"), -reach, join_style="mitre")
    closed = shapely.make_valid(closed)  # GEOS lets mitred corners cross
    places = shapely.get_parts(shapely.difference(closed, filled))
    places = places[shapely.area(places) > GRID * reach]
    place, building = shapely.STRtree(polygons).query(places, predicate="dwithin", distance=GRID)
    beside = shapely.intersection(polygons[building], shapely.buffer(places[place], GRID))
    contact = shapely.area(beside) / GRID
    borders = contact >= MIN_BORDER_GAPS * gaps[building]
    n_borders = np.bincount(place[borders], minlength=len(places))
    widest = np.zeros(len(places))
    np.maximum.at(widest, place[borders], gaps[building[borders]])
    return places[(n_borders >= 2) & _narrow(places, widest)]


def _narrow(places: NDArray[np.object_], width: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which places are nowhere wider than this, but for the grid."""
    return np.asarray(shapely.is_empty(shapely.buffer(places, -(width / 2.0 + GRID), join_style="mitre")))


def _owners(
    faces: NDArray[np.object_], polygons: NDArray[np.object_], traced: NDArray[np.object_]
) -> NDArray[np.int64]:
    """Return the building of each face: of several the one whose points it is among, else the smallest."""
    area = shapely.area(polygons)
    return face_owners(
        faces,
        polygons,
        lambda face, building, inside: (~shapely.contains(traced[building], inside[face]), area[building]),
    )


def _drop_loose_parts(faces: NDArray[np.object_], owner: NDArray[np.int64], n_buildings: int) -> None:
    """Take from buildings what no longer hangs on their largest part."""
    for building in range(n_buildings):
        own = np.flatnonzero(owner == building)
        if len(own) < 2:
            continue
        parts = shapely.get_parts(shapely.coverage_union_all(faces[own]))
        if len(parts) > 1:
            largest = parts[np.argmax(shapely.area(parts))]
            owner[own[~shapely.contains(largest, shapely.point_on_surface(faces[own]))]] = -1


def _fill(faces: NDArray[np.object_], owner: NDArray[np.int64], gaps: NDArray[np.float64]) -> None:
    """Give narrow faces between two buildings to the one with the longer border, until nothing changes."""
    open_faces = np.flatnonzero(owner < 0)
    open_faces = open_faces[_narrow(faces[open_faces], np.full(len(open_faces), gaps.max()))]
    if len(open_faces) == 0:
        return
    which, other = shapely.STRtree(faces).query(faces[open_faces], predicate="intersects")
    which, other = which[open_faces[which] != other], other[open_faces[which] != other]
    rims = shapely.boundary(faces)
    border = shapely.length(shapely.intersection(rims[open_faces[which]], rims[other]))
    while True:
        given = 0
        for number, face in enumerate(open_faces):
            mine = (which == number) & (owner[other] >= 0)
            if owner[face] >= 0 or not mine.any():
                continue
            lengths = np.bincount(owner[other[mine]], border[mine], minlength=len(gaps))
            touching = np.flatnonzero(lengths > 0)
            if len(touching) > 1 and _narrow(faces[face : face + 1], gaps[touching].max(keepdims=True))[0]:
                owner[face] = np.argmax(lengths)
                given += 1
        if given == 0:
            return
