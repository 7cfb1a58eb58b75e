"""Checks of solids by ISO 19107, named by the codes of val3dity, with the tolerances of val3dity 2.6."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, pairwise, permutations

import numpy as np
import shapely
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.intersections import self_intersects
from lidar_buildings.core.solids.shell import Solid, cross
from lidar_buildings.core.solids.triangulation import FaceArrays, face_arrays, fitted_planes, triangulate

#: Code → name. Not looked for: 103 (rings are open by definition here), 300 and 304 (no longer in use), 401
#: to 404 (they concern voids, which are not built), 5xx to 7xx (they concern several solids).
CODES = {
    101: "TOO_FEW_POINTS",
    102: "CONSECUTIVE_POINTS_SAME",
    104: "RING_SELF_INTERSECTION",
    201: "INTERSECTION_RINGS",
    202: "DUPLICATED_RINGS",
    203: "NON_PLANAR_POLYGON_DISTANCE_PLANE",
    204: "NON_PLANAR_POLYGON_NORMALS_DEVIATION",
    205: "POLYGON_INTERIOR_DISCONNECTED",
    206: "INNER_RING_OUTSIDE",
    207: "INNER_RINGS_NESTED",
    208: "ORIENTATION_RINGS_SAME",
    301: "TOO_FEW_POLYGONS",
    302: "SHELL_NOT_CLOSED",
    303: "NON_MANIFOLD_CASE",
    305: "MULTIPLE_CONNECTED_COMPONENTS",
    306: "SHELL_SELF_INTERSECTION",
    307: "POLYGON_WRONG_ORIENTATION",
    309: "VERTICES_NOT_USED",
    405: "WRONG_ORIENTATION_SHELL",
    902: "EMPTY_PRIMITIVE",
}
#: Vertices nearer to each other than this count as one [m].
SNAP_TOLERANCE = 0.001
#: Largest distance of a vertex to its face's plane [m].
MAX_PLANE_DISTANCE = 0.01
#: Largest angle between the triangles of one face [deg].
MAX_NORMAL_DEVIATION_DEG = 20.0
#: Share of a tolerance by which what is judged here has to be better than it: others' rounding differs.
MARGIN = 1e-3
#: Distance below which a vertex of a face lies on an edge of it [m].
TOUCHING = 1e-6


def weld(vertices: FloatArray, tolerance: float) -> IntArray:
    """
    Return for each vertex, in space or in plan, the row of the one that it counts as.

    A vertex joins the earliest kept one within the tolerance, as val3dity does it.
    """
    leader = np.arange(len(vertices))
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    for first, second in sorted(map(tuple, np.sort(pairs, axis=1).tolist())):
        # Earlier pairs have decided whether the first one is kept.
        if leader[first] == first and leader[second] == second:
            leader[second] = first
    return leader


@kernel
def n_joints(edges, distance):  # type: ignore[no-untyped-def]
    """
    Return how many pairs of edges have a common end, −1 if edges do not keep clear of each other.

    They do if they meet in common ends only, and lie farther than a distance from the ends of others. Rings
    that pass no place twice have as many joints as edges. Edges are x and y of both ends, float64 (n, 4);
    they are swept from west to east, and sides of points are exact for whole numbers.
    """
    first, order = np.empty(len(edges)), np.arange(len(edges))
    for i in range(len(edges)):
        first[i] = min(edges[i, 0], edges[i, 2])
    sort_rows(first, order, len(order))
    square, n = distance * distance, 0
    for i in range(len(order)):
        ax, ay, bx, by = edges[order[i]]
        low, high = min(ay, by) - distance, max(ay, by) + distance
        ux, uy = bx - ax, by - ay
        if ux * ux + uy * uy <= square:
            return -1
        for j in range(i + 1, len(order)):
            cx, cy, dx, dy = edges[order[j]]
            if first[j] > max(ax, bx) + distance:
                break
            if (cy < low and dy < low) or (cy > high and dy > high):
                continue
            vx, vy = dx - cx, dy - cy
            if vx * vx + vy * vy <= square:
                return -1
            a_shared = (ax == cx and ay == cy) or (ax == dx and ay == dy)
            b_shared = (bx == cx and by == cy) or (bx == dx and by == dy)
            c_shared = (cx == ax and cy == ay) or (cx == bx and cy == by)
            d_shared = (dx == ax and dy == ay) or (dx == bx and dy == by)
            if not (
                (c_shared or _squared(cx - ax, cy - ay, ux, uy) > square)
                and (d_shared or _squared(dx - ax, dy - ay, ux, uy) > square)
                and (a_shared or _squared(ax - cx, ay - cy, vx, vy) > square)
                and (b_shared or _squared(bx - cx, by - cy, vx, vy) > square)
            ):
                return -1
            c_left, d_left = ux * (cy - ay) - uy * (cx - ax), ux * (dy - ay) - uy * (dx - ax)
            a_left, b_left = vx * (ay - cy) - vy * (ax - cx), vx * (by - cy) - vy * (bx - cx)
            if c_left * d_left < 0.0 and a_left * b_left < 0.0:
                return -1
            n += a_shared + b_shared
    return n


@inner_kernel
def _squared(x: float, y: float, ux: float, uy: float) -> float:
    share = min(1.0, max(0.0, (x * ux + y * uy) / (ux * ux + uy * uy)))
    return (x - share * ux) ** 2 + (y - share * uy) ** 2


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


def broken_edges(triangles: IntArray) -> set[int]:
    """
    Return the codes 302, 303, 305 and 307 of a shell whose faces are cut into triangles.

    Triangles, and not rings, because a hole may touch the exterior of its face at a vertex.
    """
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    keys = low * (high.max() + 1) + high
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    uses = np.diff(np.append(first, len(keys)))
    codes = set()
    if (uses == 1).any():
        codes.add(302)
    if (uses > 2).any():
        codes.add(303)
    pairs = order[first[uses == 2][:, None] + [0, 1]]
    if (starts[pairs[:, 0]] == starts[pairs[:, 1]]).any():
        codes.add(307)
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    if sets_of_pairs(len(triangles), order[same] // 3, order[same + 1] // 3).any():
        codes.add(305)
    if codes <= {305} and _n_umbrellas(pairs, len(keys)) > len(np.unique(starts)):
        codes.add(303)
    return codes


def _n_umbrellas(pairs: IntArray, n: int) -> int:
    """Return the number of closed fans of triangles: one a vertex unless parts meet in a vertex alone."""
    opposite = np.empty(n, dtype=np.int64)
    opposite[pairs] = pairs[:, ::-1]
    edges = np.arange(n)
    return len(np.unique(sets_of_pairs(n, edges, opposite[edges + np.where(edges % 3, -1, 2)])))


#: Largest angle allowed between two triangles of a face [rad].
_MAX_ANGLE = math.radians(MAX_NORMAL_DEVIATION_DEG * (1.0 - MARGIN))
_LEAST_COSINE = math.cos(_MAX_ANGLE)
_COSINE_OF_HALF = math.cos(0.5 * _MAX_ANGLE)


@kernel
def folds(vertices, triangles, face_of):  # type: ignore[no-untyped-def]
    """Return for each face whether it is folded, code 204; `face_of` names each triangle's face, rising."""
    unit, folded, n, first = np.zeros((len(triangles), 3)), np.zeros(len(triangles), np.bool_), 0, 0
    while first < len(triangles):
        last, x, y, z = first, 0.0, 0.0, 0.0
        while last < len(triangles) and face_of[last] == face_of[first]:
            a, b, c = triangles[last]
            ux, vx = vertices[b, 0] - vertices[a, 0], vertices[c, 0] - vertices[a, 0]
            uy, vy = vertices[b, 1] - vertices[a, 1], vertices[c, 1] - vertices[a, 1]
            uz, vz = vertices[b, 2] - vertices[a, 2], vertices[c, 2] - vertices[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            x, y, z = x + nx, y + ny, z + nz
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            # A triangle without area has no normal: what it is given deviates from all.
            if size > 0.0:
                unit[last, 0], unit[last, 1], unit[last, 2] = nx / size, ny / size, nz / size
            last += 1
        size, least = max(math.sqrt(x * x + y * y + z * z), 1e-300), 1.0
        for k in range(first, last):
            least = min(least, (unit[k, 0] * x + unit[k, 1] * y + unit[k, 2] * z) / size)
        # Within half the angle of the mean all lie within the angle of each other.
        if least < _COSINE_OF_HALF:
            for k in range(first, last):
                for m in range(first, k + 1):
                    cosine = unit[k, 0] * unit[m, 0] + unit[k, 1] * unit[m, 1] + unit[k, 2] * unit[m, 2]
                    folded[n] |= cosine < _LEAST_COSINE
        n, first = n + 1, last
    return folded[:n]


def check_solid(solid: Solid) -> tuple[int, ...]:
    """
    Return the codes of everything that is wrong with a solid, rising; empty if it is valid.

    Rings are checked first, then polygons, then the shell; a level is looked at only if the one below it is
    sound, as errors there would follow from those below (Ledoux 2013, 2018). Codes, names and tolerances:
    `CODES` and the constants after it.

    Coordinates have to be those that will be written, that is rounded. Vertices nearer to each other than the
    snap tolerance count as one; whether those exactly so far apart do depends on others' rounding: such
    solids have to be valid both ways.
    """
    if not all(face and all(face) for face in solid.faces):
        return (101,)
    return check_faces(face_arrays(solid))


def check_faces(faces: FaceArrays) -> tuple[int, ...]:
    """Return what `check_solid` does of a shell given as arrays."""
    if len(faces.face_starts) < 2 or not len(faces.vertices):
        return (902,)
    perhaps = weld(faces.vertices, SNAP_TOLERANCE * (1.0 + MARGIN))
    codes = _check_welded(faces, perhaps)
    if len(np.unique(perhaps)) < len(perhaps):
        surely = weld(faces.vertices, SNAP_TOLERANCE * (1.0 - MARGIN))
        codes |= set() if np.array_equal(surely, perhaps) else _check_welded(faces, surely)
    return tuple(sorted(codes))


def _check_welded(faces: FaceArrays, leader: IntArray) -> set[int]:
    """Return the codes of a shell whose vertices count as others."""
    faces = replace(faces, corners=leader[faces.corners])
    if found := int(_repetitions(faces.corners, faces.ring_starts)):
        return {code for bit, code in ((1, 101), (2, 102)) if found & bit}
    codes, triangles, face_of = _check_flatness(faces)
    is_all_used = len(np.unique(faces.corners)) == len(np.unique(leader))
    return codes or _check_shell(faces, triangles, face_of) | (set() if is_all_used else {309})


def _check_flatness(faces: FaceArrays) -> tuple[set[int], IntArray, IntArray]:
    """Return what is wrong with rings and planes of faces (104 and 201 to 208), and their triangles."""
    nothing = np.empty((0, 3), dtype=np.int64)
    off_plane, flat = fitted_planes(faces)
    crossings = {104} if _any_meets_itself(flat, faces.ring_starts) else set()
    if off_plane.max() > MAX_PLANE_DISTANCE * (1.0 - MARGIN):
        return {203} | crossings, nothing, nothing
    codes = crossings or misplaced_holes(faces, flat)
    if codes:
        return codes, nothing, nothing
    triangles, face_of = triangulate(faces, flat)
    return {204} if folds(faces.vertices, triangles, face_of).any() else set(), triangles, face_of


def _check_shell(faces: FaceArrays, triangles: IntArray, face_of: IntArray) -> set[int]:
    """Return what is wrong with a shell of sound faces: codes 301 to 307, and 405 if it is inside out."""
    if len(faces.face_starts) <= 4:
        return {301}
    if codes := broken_edges(triangles):
        return codes
    if self_intersects(faces.vertices, triangles, face_of):
        return {306}
    corners = faces.vertices[triangles] - faces.vertices.mean(axis=0)
    volume = np.einsum("ij,ij->", corners[:, 0], cross(corners[:, 1], corners[:, 2]))
    return {405} if volume <= 0.0 else set()
