"""The faces of a roof, its walls and its ground, put together from the half-edges of its plan."""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.solids.half_edges import (
    CCW,
    CW,
    EDGE,
    LEFT,
    LEVEL,
    START,
    HalfEdges,
    X,
    Y,
    level_of,
)
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.planar_subdivision import OUTSIDE
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE
from lidar_buildings.core.solids.triangulation import FaceArrays

#: Edges of a plan farther than this from the ends of others, and corners of a wall farther from each other,
#: are clear of what the checks of solids take for one [steps of the grid].
CLEARANCE = 1.5


def assemble(plan: HalfEdges) -> tuple[FaceArrays, tuple[str, ...]]:
    """
    Return ground faces, roof faces, and a wall for each edge where elevations differ, and what each face is.

    Nothing is returned if a ring has different pieces to its left: its edges cross.
    """
    vertices, edges, order = plan.vertices, plan.edges, plan.order
    around, first, owner, area = (np.empty(len(edges) + 1, dtype=np.int64) for _ in range(4))
    n_rings = _trace_rings(vertices, edges, order, around, first, owner, area)
    first, owner, area = first[: n_rings + 1], owner[:n_rings], area[:n_rings]
    around = around[: first[-1]]
    faces = _faces(plan, around, first.tolist(), owner.tolist(), area.tolist())
    rings = np.array([ring for _, face in faces for ring in face], dtype=np.int64)
    if not len(rings):
        nothing = FaceArrays(np.empty((0, 3)), rings, np.zeros(1, np.int64), np.zeros(1, np.int64))
        return nothing, ()
    places = np.empty((len(edges), 3), dtype=np.int64)
    corners = np.empty(len(edges) + 2 * int((np.bincount(edges[:, START]) ** 2).sum()), dtype=np.int64)
    ring_starts = np.empty(len(rings) + len(edges) + 1, dtype=np.int64)
    n_places, n_walls = _raise(vertices, edges, order, around, first, rings, places, corners, ring_starts)
    n_all = len(rings) + n_walls
    sizes = [len(face) for _, face in faces]
    face_starts = np.concatenate([np.cumsum([0, *sizes]), np.arange(len(rings) + 1, n_all + 1)])
    kinds = [GROUND_SURFACE if piece == OUTSIDE else ROOF_SURFACE for piece, _ in faces]
    shell = FaceArrays(
        places[:n_places] / round(1 / GRID),
        corners[: ring_starts[n_all]],
        ring_starts[: n_all + 1],
        face_starts,
    )
    return shell, (*kinds, *[WALL_SURFACE] * n_walls)


def _faces(
    plan: HalfEdges, around: IntArray, first: list[int], owner: list[int], area: list[int]
) -> list[tuple[int, list[int]]]:
    """Return each exterior's piece, and its number with those of the holes inside it; the ground first."""
    faces: list[tuple[int, list[int]]] = []
    groups: dict[int, list[int]] = {}
    for ring, piece in enumerate(owner):
        groups.setdefault(piece, []).append(ring)
    for piece in sorted(groups):
        sign = -1 if piece == OUTSIDE else 1
        exteriors = [ring for ring in groups[piece] if sign * area[ring] > 0]
        holes = [ring for ring in groups[piece] if sign * area[ring] < 0]
        if len(exteriors) > 1 and holes:
            corners = plan.vertices[plan.edges[around, START], :2]
            around_holes = {k: shapely.Polygon(corners[first[k] : first[k + 1]]) for k in exteriors}
            own: dict[int, list[int]] = {exterior: [exterior] for exterior in exteriors}
            for hole in holes:  # each belongs to the smallest exterior around it
                inside = shapely.Polygon(corners[first[hole] : first[hole + 1]]).representative_point()
                owners = [k for k in exteriors if around_holes[k].contains(inside)]
                if owners:
                    own[min(owners, key=lambda k: around_holes[k].area)].append(hole)
            faces += [(piece, face) for face in own.values()]
        else:
            faces += [(piece, [ring, *holes]) for ring in exteriors]
    return faces


@kernel
def _trace_rings(vertices, edges, order, around, first, owner, area):  # type: ignore[no-untyped-def]
    """Write the half-edges of the rings, none of which passes a vertex twice; return the number of rings."""
    done = np.zeros(len(edges), dtype=np.bool_)
    place = np.full(len(vertices), -1)
    path = np.empty(len(edges), dtype=np.int64)
    n_rings, filled, first[0] = 0, 0, 0
    for start in order:
        piece, n, e = edges[start, LEFT], 0, start
        is_closed = done[start]
        while not is_closed:
            is_closed, at = done[e], 0
            if not is_closed:
                if edges[e, LEFT] != piece:
                    return 0
                done[e] = True
                v = edges[e, START]
                here, e = e, edges[e ^ 1, CW]
                at = place[v]
                if at < 0:
                    place[v], path[n] = n, here
                    n += 1
                    continue
            doubled, origin = 0, edges[path[at], START]
            for k in range(at, n):
                a, b = edges[path[k], START], edges[path[k + 1 if k + 1 < n else at], START]
                ax, ay = vertices[a, X] - vertices[origin, X], vertices[a, Y] - vertices[origin, Y]
                bx, by = vertices[b, X] - vertices[origin, X], vertices[b, Y] - vertices[origin, Y]
                doubled += ax * by - bx * ay
                around[filled] = path[k]
                filled += 1
                if is_closed or k > at:
                    place[a] = -1
            owner[n_rings], area[n_rings] = piece, doubled
            n_rings += 1
            first[n_rings] = filled
            n = at + 1
    return n_rings


@kernel
def _raise(vertices, edges, order, around, first, rings, places, corners, ring_starts):  # type: ignore[no-untyped-def]
    """Write the rings of roof, ground and walls; return the numbers of corners in space and of walls."""
    stack, levels = np.zeros(len(vertices) + 1, dtype=np.int64), np.empty(len(edges), dtype=np.int64)
    for v in range(len(vertices)):
        n = stack[v]
        e = vertices[v, EDGE]
        while e >= 0:
            level, k = edges[e, LEVEL], n
            while k > stack[v] and levels[k - 1] > level:
                k -= 1
            if k == stack[v] or levels[k - 1] != level:
                for j in range(n, k, -1):
                    levels[j] = levels[j - 1]
                levels[k] = level
                n += 1
            e = edges[e, CCW]
            if e == vertices[v, EDGE]:
                break
        stack[v + 1] = n
    rows = np.full(stack[-1], -1)
    n_places, filled, n_rings = np.int64(0), 0, 0
    ring_starts[0] = 0
    for ring in rings:
        for k in range(first[ring], first[ring + 1]):
            v = edges[around[k], START]
            slot = stack[v]
            while levels[slot] != edges[around[k], LEVEL]:
                slot += 1
            n_places = _place(vertices, v, levels, slot, rows, places, n_places)
            corners[filled] = rows[slot]
            filled += 1
        n_rings += 1
        ring_starts[n_rings] = filled
    for e in order:
        left, right = edges[e, LEFT], edges[e ^ 1, LEFT]
        a, b = edges[e, START], edges[e ^ 1, START]
        low_a, high_a = level_of(edges, e, right), edges[e, LEVEL]
        low_b, high_b = edges[e ^ 1, LEVEL], level_of(edges, e ^ 1, left)
        if low_a > high_a or low_b > high_b or (low_a == high_a and low_b == high_b):
            continue
        # from the foot at the start to the end, up there, back, and down
        for step in range(3):
            v, low, high = (b, low_b, high_b) if step == 1 else (a, low_a, high_a)
            n = stack[v + 1] - stack[v]
            for k in range(n):
                slot = stack[v] + k if step < 2 else stack[v + 1] - 1 - k
                if levels[slot] < low or levels[slot] > high:
                    continue
                if (step == 0 and levels[slot] != low) or (step == 2 and levels[slot] == low):
                    continue
                n_places = _place(vertices, v, levels, slot, rows, places, n_places)
                corners[filled] = rows[slot]
                filled += 1
        n_rings += 1
        ring_starts[n_rings] = filled
    return n_places, n_rings - len(rings)


@kernel
def _place(vertices, v, levels, slot, rows, places, n_places):  # type: ignore[no-untyped-def]
    """Number the corner at a level above a vertex if it is new; return how many there are."""
    if rows[slot] < 0:
        rows[slot] = n_places
        places[n_places, 0], places[n_places, 1] = vertices[v, X], vertices[v, Y]
        places[n_places, 2] = levels[slot]
        n_places += 1
    return n_places
