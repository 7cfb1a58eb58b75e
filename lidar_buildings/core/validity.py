"""
Checks of solids by ISO 19107, named by the codes of val3dity.

"""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.shell import Face, Solid

#: Code → name. Not looked for: 103 (rings are open by definition here), 204 (203 is the stricter one for what
#: is built here), 304 and 306 (faces cannot cross in a prism whose plan is valid), 4xx and above (one shell).
CODES = {
    101: "TOO_FEW_POINTS",
    102: "CONSECUTIVE_POINTS_SAME",
    104: "RING_SELF_INTERSECTION",
    201: "INTERSECTION_RINGS",
    202: "DUPLICATED_RINGS",
    203: "NON_PLANAR_POLYGON_DISTANCE_PLANE",
    205: "POLYGON_INTERIOR_DISCONNECTED",
    206: "INNER_RING_OUTSIDE",
    207: "INNER_RINGS_NESTED",
    208: "ORIENTATION_RINGS_SAME",
    301: "TOO_FEW_POLYGONS",
    302: "SHELL_NOT_CLOSED",
    303: "NON_MANIFOLD_CASE",
    305: "MULTIPLE_CONNECTED_COMPONENTS",
    307: "POLYGON_WRONG_ORIENTATION",
    309: "VERTICES_NOT_USED",
}
#: Largest distance of a vertex to its face's plane, as val3dity's default [m].
MAX_PLANE_DISTANCE = 0.01

Edge = tuple[int, int]


def check_solid(solid: Solid) -> tuple[int, ...]:
    """
    Return the codes of everything that is wrong with a solid, rising; empty if it is valid.

    Rings are checked first, then polygons, then the shell; a level is looked at only if the one below it is
    sound, as errors there would follow from those below (Ledoux 2013). Vertices with equal
    coordinates count as one.

    Parameters
    ----------
    solid : Solid
        With the coordinates that will be written, that is already rounded.

    Notes
    -----
    Codes and names: `CODES`, which also says what is not looked for.

    """
    welded = _weld(solid)
    faces = [welded.face_rings(face) for face in welded.faces]
    codes = {code for rings in faces for ring in rings for code in check_ring(ring)}
    codes = codes or {code for rings in faces for code in check_polygon(rings)}
    return tuple(sorted(codes or check_shell(welded)))


def check_ring(ring: NDArray[np.float64]) -> set[int]:
    """
    Return what is wrong with one open ring, shape (n, 3): codes 101, 102, 104.

    """
    if len(np.unique(ring, axis=0)) < 3:
        return {101}
    if (ring == np.roll(ring, -1, axis=0)).all(axis=1).any():
        return {102}
    flat = _flatten((ring,))[0]
    return set() if shapely.LinearRing(flat).is_simple else {104}


def check_polygon(rings: tuple[NDArray[np.float64], ...]) -> set[int]:
    """
    Return what is wrong with a face of sound rings, exterior first: codes 201 to 208.

    """
    if _off_plane(np.concatenate(rings)) > MAX_PLANE_DISTANCE:
        return {203}
    flat = _flatten(rings)
    exterior, *holes = (shapely.Polygon(ring) for ring in flat)
    codes = {_hole_in_exterior(hole, exterior) for hole in holes}
    codes |= {_hole_beside_hole(a, b) for a, b in combinations(holes, 2)}
    if any(hole.exterior.is_ccw == exterior.exterior.is_ccw for hole in holes):
        codes.add(208)
    codes.discard(0)
    if not codes and "disconnected" in shapely.is_valid_reason(shapely.Polygon(flat[0], flat[1:])):
        codes.add(205)
    return codes


def check_shell(solid: Solid) -> set[int]:
    """
    Return what is wrong with a shell of sound faces: codes 301 to 309.

    """
    if len(solid.faces) < 4:
        return {301}
    edges = Counter(solid.edges())
    uses = {edge: edges[edge] + edges[edge[::-1]] for edge in edges}
    codes = set()
    if any(n == 1 for n in uses.values()):
        codes.add(302)
    if any(n > 2 for n in uses.values()):
        codes.add(303)
    if any(uses[edge] == 2 and n == 2 for edge, n in edges.items()):
        codes.add(307)
    if not codes and _has_double_vertex(solid):
        codes.add(303)
    if _n_components(solid) > 1:
        codes.add(305)
    if not codes and solid.volume <= 0.0:
        codes.add(307)
    if len({vertex for edge in edges for vertex in edge}) < len(solid.vertices):
        codes.add(309)
    return codes


def _weld(solid: Solid) -> Solid:
    """
    Return the solid with vertices of equal coordinates made one.

    """
    vertices, new_row = np.unique(solid.vertices, axis=0, return_inverse=True)
    rows = new_row.reshape(-1).tolist()
    faces = tuple(tuple(tuple(rows[i] for i in ring) for ring in face) for face in solid.faces)
    return Solid(vertices, faces, solid.semantics)


def _newell_normal(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return twice the area vector of a ring, zero for a line.

    """
    offsets = ring - ring[0]
    return np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0)


def _flatten(rings: tuple[NDArray[np.float64], ...]) -> list[NDArray[np.float64]]:
    """
    Return rings in two dimensions: without the axis that the first one's normal is closest to.

    Dropping an axis keeps what crosses, touches and contains what; and it keeps the coordinates exact.

    """
    normal = np.abs(_newell_normal(rings[0]))
    if not normal.any():
        # A line: drop the axis along which it extends least.
        normal = -np.ptp(rings[0], axis=0)
    kept = [axis for axis in range(3) if axis != int(np.argmax(normal))]
    return [ring[:, kept] for ring in rings]


def _off_plane(points: NDArray[np.float64]) -> float:
    """
    Return the largest distance of points to their least-squares plane [m].

    """
    offsets = points - points.mean(axis=0)
    normal = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
    return float(np.max(np.abs(offsets @ normal)))


def _hole_in_exterior(hole: shapely.Polygon, exterior: shapely.Polygon) -> int:
    """
    Return 202, 206, 201, or 0 where the hole lies inside and touches at points at most.

    """
    if hole.equals(exterior):
        return 202
    if hole.disjoint(exterior) or hole.touches(exterior):
        return 206
    meeting = hole.boundary.intersection(exterior.boundary)
    return 0 if exterior.covers(hole) and meeting.length == 0 else 201


def _hole_beside_hole(first: shapely.Polygon, second: shapely.Polygon) -> int:
    """
    Return 202, 207, 201, or 0 where two holes touch at points at most.

    """
    if first.equals(second):
        return 202
    if first.contains(second) or second.contains(first):
        return 207
    return 201 if first.overlaps(second) or first.boundary.intersection(second.boundary).length > 0 else 0


def _has_double_vertex(solid: Solid) -> bool:
    """
    Whether somewhere two parts of a closed shell meet in a single vertex.

    Around each vertex, going from face to face over shared edges has to visit all corners in one turn.

    """
    following: dict[int, dict[int, int]] = defaultdict(dict)
    for face in solid.faces:
        for ring in face:
            for before, here, after in zip(ring, ring[1:] + ring[:1], ring[2:] + ring[:2], strict=True):
                following[here][after] = before
    return any(_turn_length(links) < len(links) for links in following.values())


def _turn_length(links: dict[int, int]) -> int:
    """
    Return the number of steps until a chain is back at its start.

    """
    start = next(iter(links))
    at, steps = links[start], 1
    while at != start:
        at, steps = links[at], steps + 1
    return steps


def _n_components(solid: Solid) -> int:
    """
    Return the number of parts of a shell that share no edge.

    """
    faces_of = defaultdict(list)
    for number, face in enumerate(solid.faces):
        for a, b in _face_edges(face):
            faces_of[min(a, b), max(a, b)].append(number)
    leader = list(range(len(solid.faces)))
    for sharing in faces_of.values():
        for other in sharing[1:]:
            leader[_leader(leader, other)] = _leader(leader, sharing[0])
    return len({_leader(leader, number) for number in range(len(leader))})


def _leader(leader: list[int], member: int) -> int:
    """
    Return the face that stands for a face's part.

    """
    while leader[member] != member:
        leader[member] = leader[leader[member]]
        member = leader[member]
    return member


def _face_edges(face: Face) -> list[Edge]:
    """
    Return the directed edges of all rings of a face.

    """
    return [edge for ring in face for edge in zip(ring, ring[1:] + ring[:1], strict=True)]
