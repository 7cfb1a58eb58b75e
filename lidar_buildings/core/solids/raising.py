"""Solids raised from outlines or from roofs in pieces, and whether they are valid."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from itertools import accumulate, chain, pairwise

import numpy as np

from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.assembly import CLEARANCE, assemble
from lidar_buildings.core.solids.half_edges import HalfEdges
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.plan_graph import (
    RoofPiece,
    joined,
    matched_coverage,
    noded_coverage,
    with_minimum_height,
)
from lidar_buildings.core.solids.planar_subdivision import PlanGraph
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
    Face,
    Solid,
    ring_edges,
)
from lidar_buildings.core.solids.triangulation import face_arrays, fitted_planes, triangulate
from lidar_buildings.core.solids.validity import MAX_PLANE_DISTANCE, check_faces, check_solid, folds, n_joints

#: As `assembly.CLEARANCE` [m].
_CLEARANCE = CLEARANCE * GRID


def extrude(outline: Outline, z_bottom: float, z_top: float) -> Solid:
    """Raise an outline from one elevation to another: ground, roof, and a wall an edge, valid or not."""
    rings = outline.oriented().rings
    plan = np.concatenate(rings)
    n = len(plan)
    vertices = np.empty((2 * n, 3))
    vertices[:n, :2] = vertices[n:, :2] = plan
    vertices[:n, 2], vertices[n:, 2] = z_bottom, z_top
    bottoms = [tuple(range(a, b)) for a, b in pairwise(accumulate(map(len, rings), initial=0))]
    ground = tuple(ring[::-1] for ring in bottoms)
    roof = tuple(tuple(i + n for i in ring) for ring in bottoms)
    walls = tuple(((i, j, j + n, i + n),) for ring in bottoms for i, j in ring_edges(ring))
    semantics = (GROUND_SURFACE, ROOF_SURFACE, *(WALL_SURFACE for _ in walls))
    return Solid(vertices, (ground, roof, *walls), semantics)


def extrusion_codes(outline: Outline, solid: Solid, height: float) -> tuple[int, ...]:
    """
    Return what `check_solid` does of an outline raised by a height [m].

    If the rings keep clear of each other and holes lie inside, nothing can be wrong above them.
    """
    rings = outline.rings
    if height > _CLEARANCE and min(map(len, rings)) >= 3:
        edges = ring_walls(rings).reshape(-1, 4)
        if n_joints(edges, _CLEARANCE) == len(edges) and (len(rings) == 1 or outline.polygon.is_valid):
            return ()
    return check_solid(solid)


#: Codes of faces that are not flat.
_NON_PLANAR = {203, 204}
#: If a solid fails its checks, details narrower than this vanish, on a grid of half of it [grid steps].
_SIMPLER = (10.0, 20.0)


def roof_solid(pieces: Sequence[RoofPiece], ground_elevation: float) -> Solid:
    """
    Raise the pieces of a roof from the ground to their planes, on the output grid.

    Pieces cover the building's plan and share their edges; gaps and overlaps of some millimetres and vertices
    in the middle of a neighbour's edge are put right. If the solid is not valid, folded faces are cut into
    triangles, and if that does not help small details are left out. If it still is not, that of the plan as
    given is returned: `checked_roof_solid` says what is wrong with it. Empty if no piece has an area.
    """
    return checked_roof_solid(pieces, ground_elevation)[0]


def checked_roof_solid(
    pieces: Sequence[RoofPiece],
    ground_elevation: float,
    *,
    join_equal: bool = False,
    coverage: PlanGraph | None = None,
) -> tuple[Solid, tuple[int, ...]]:
    """
    Return what `roof_solid` does and the codes of what is wrong with it, as of `check_solid`.

    With `join_equal` pieces of one plane are one, without edges between them. `coverage` is the pieces' own,
    as `matched_coverage` numbers them, if it is known.
    """
    ground = round(ground_elevation / GRID)
    pieces, given = with_minimum_height(pieces, ground * GRID), pieces
    is_cut = len(pieces) != len(given) or any(map(operator.is_not, pieces, given))
    if coverage is None or is_cut:  # parts below the least height are pieces of their own
        coverage = matched_coverage(pieces, np.arange(len(pieces)))
    planes = np.array([piece.plane for piece in pieces], dtype=np.float64).reshape(-1, 3)
    numbers = np.arange(len(pieces))
    if join_equal and len(pieces):
        first: dict[tuple[float, ...], int] = {}
        numbers = np.array([first.setdefault(piece.plane, k) for k, piece in enumerate(pieces)])
    first_tried = None
    simpler = (noded_coverage(pieces, numbers, within, 0.5 * within) for within in _SIMPLER)
    for graph in chain([joined(coverage, numbers)], simpler):
        if not len(graph.ends):
            break
        faces, semantics = assemble(HalfEdges(graph, planes, ground))
        codes, solid = check_faces(faces), faces.solid(semantics)
        if not codes:
            return solid, ()
        if _NON_PLANAR.issuperset(codes) and not check_solid(cut := triangulate_non_planar(solid)):
            return cut, ()
        first_tried = first_tried or (solid, codes)
    if first_tried is None:
        nothing = Solid(np.empty((0, 3)), (), ())
        return nothing, check_solid(nothing)
    return first_tried


def triangulate_non_planar(solid: Solid) -> Solid:
    """Return a solid with the roof faces that are folded, or not planar, cut into triangles."""
    if not solid.faces:
        return solid
    arrays = face_arrays(solid)
    off_plane, flat = fitted_planes(arrays)
    triangles, face_of = triangulate(arrays, flat)
    is_roof = np.array([kind == ROOF_SURFACE for kind in solid.semantics])
    bent = is_roof & (folds(solid.vertices, triangles, face_of) | (off_plane > 0.5 * MAX_PLANE_DISTANCE))
    faces: list[Face] = []
    semantics: list[str] = []
    for number, (face, kind) in enumerate(zip(solid.faces, solid.semantics, strict=True)):
        parts = triangles[face_of == number].tolist() if bent[number] else []
        faces += [(tuple(part),) for part in parts] or [face]
        semantics += [kind] * (len(parts) or 1)
    return Solid(solid.vertices, tuple(faces), tuple(semantics))
