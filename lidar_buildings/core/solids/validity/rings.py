"""What can be wrong with the rings of faces, one by one and beside each other in faces with holes."""

from __future__ import annotations

from itertools import combinations, pairwise, permutations

import numpy as np
import shapely

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.clearance import n_joints
from lidar_buildings.core.solids.validity.codes import TOUCHING
from lidar_buildings.core.solids.validity.face_arrays import FaceArrays


def repeated_points(faces: FaceArrays) -> set[int]:
    """Return 101 if a ring has fewer than three points, 102 if one follows upon itself."""
    found = int(_repetitions(faces.corners, faces.ring_starts))
    return {code for bit, code in ((1, 101), (2, 102)) if found & bit}


def self_intersections(faces: FaceArrays, flat: FloatArray) -> set[int]:
    """Return 104 if a ring, seen in its face's plane, crosses or touches itself or has no area."""
    return {104} if _any_meets_itself(flat, faces.ring_starts) else set()


@kernel
def _repetitions(corners: IntArray, ring_starts: IntArray) -> int:
    """Return 1 if a ring has fewer than three distinct corners, 2 if one of the others repeats one, or 3."""
    found = 0
    for number in range(len(ring_starts) - 1):
        begin, end = ring_starts[number], ring_starts[number + 1]
        second = begin
        while second < end and corners[second] == corners[begin]:
            second += 1
        third = second + 1
        while third < end and (corners[third] == corners[begin] or corners[third] == corners[second]):
            third += 1
        if third >= end:
            found |= 1
            continue
        for k in range(begin, end):
            if corners[k] == corners[k - 1 if k > begin else end - 1]:
                found |= 2
    return found


@kernel
def _any_meets_itself(flat: FloatArray, ring_starts: IntArray) -> bool:
    """Whether a ring has no area, folds back at a corner, or has edges that meet away from common corners."""
    for number in range(len(ring_starts) - 1):
        begin, end = ring_starts[number], ring_starts[number + 1]
        edges, doubled_area, length = np.empty((end - begin, 4)), 0.0, 0.0
        for k in range(begin, end):
            (ax, ay), (bx, by) = flat[k], flat[k + 1 if k + 1 < end else begin]
            edges[k - begin] = (ax, ay, bx, by)
            doubled_area += (ax - flat[begin, 0]) * (by - ay) - (ay - flat[begin, 1]) * (bx - ax)
            length += np.hypot(bx - ax, by - ay)
        if abs(doubled_area) <= TOUCHING * length or n_joints(edges, TOUCHING) != len(edges):
            return True
    return False


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
