"""
What can be wrong with faces that have holes: rings that meet, coincide, lie outside or within each other.
"""

from __future__ import annotations

from itertools import combinations, pairwise, permutations

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.validity.codes import TOUCHING
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays


def misplaced_holes(faces: FaceArrays, flat: FloatArray) -> set[int]:
    """Return the codes 201, 202 and 205 to 208 of all faces with holes."""
    codes: set[int] = set()
    for number in np.flatnonzero(np.diff(faces.face_starts) > 1).tolist():
        starts = faces.ring_starts[faces.face_starts[number] : faces.face_starts[number + 1] + 1]
        codes |= _hole_faults([flat[a:b] for a, b in pairwise(starts.tolist())])
    return codes


def _hole_faults(rings: list[FloatArray]) -> set[int]:
    """Return what is wrong with one face of sound rings, exterior first."""
    exterior, *holes = (shapely.Polygon(ring) for ring in rings)
    if any(hole.exterior.is_ccw for hole in holes):
        return {208}
    face = shapely.Polygon(rings[0], rings[1:])
    if face.is_valid:
        return {201} if _touches_an_edge(rings) else set()
    codes = {_hole_in_exterior(hole, exterior) for hole in holes}
    codes |= {_hole_beside_hole(a, b) for a, b in combinations(holes, 2)}
    return codes - {0} or {205}


def _touches_an_edge(rings: list[FloatArray]) -> bool:
    """Whether a vertex of one ring lies on an edge of another one, away from its ends."""
    for ring, other in permutations(rings, 2):
        near = shapely.dwithin(shapely.points(ring), shapely.LinearRing(other), TOUCHING)
        if (
            near.any()
            and (shapely.distance(shapely.points(ring[near]), shapely.MultiPoint(other)) > TOUCHING).any()
        ):
            return True
    return False


def _hole_in_exterior(hole: shapely.Polygon, exterior: shapely.Polygon) -> int:
    """Return 202, 206, 201, or 0 where the hole lies inside and touches at points at most."""
    if hole.equals(exterior):
        return 202
    if hole.disjoint(exterior) or hole.touches(exterior):
        return 206
    meeting = hole.boundary.intersection(exterior.boundary)
    return 0 if exterior.covers(hole) and meeting.length == 0 else 201


def _hole_beside_hole(first: shapely.Polygon, second: shapely.Polygon) -> int:
    """Return 202, 207, 201, or 0 where two holes touch at points at most."""
    if first.equals(second):
        return 202
    if first.contains(second) or second.contains(first):
        return 207
    return 201 if first.overlaps(second) or first.boundary.intersection(second.boundary).length > 0 else 0
