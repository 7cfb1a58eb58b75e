"""Checks of solids with voids: an exterior shell and interior ones within it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity.checking import check_solid
from lidar_buildings.core.solids.validity.codes import SNAP_TOLERANCE
from lidar_buildings.core.solids.validity.face_arrays import face_arrays, fitted_planes
from lidar_buildings.core.solids.validity.intersections import self_intersects
from lidar_buildings.core.solids.validity.triangulation import triangulate
from lidar_buildings.core.solids.validity.welding import weld


def check_solid_with_voids(exterior: Solid, voids: Sequence[Solid]) -> tuple[int, ...]:
    """
    Return the codes of everything that is wrong with a solid that has voids, rising; empty if it is valid.

    Each shell is checked by itself first, then how they lie to each other (Ledoux 2013, section 4.5).

    Parameters
    ----------
    exterior : Solid
        The outer shell, its faces seen counter-clockwise from outside it.
    voids : sequence of Solid
        The inner shells, their faces seen counter-clockwise from within them.

    Notes
    -----
    Shells may touch in common vertices and edges; any other touch counts as an intersection, which is
    stricter than the standard.
    """
    turned = [replace(void, faces=tuple(tuple(r[::-1] for r in f) for f in void.faces)) for void in voids]
    codes = {code for shell in (exterior, *turned) for code in check_solid(shell)}
    if codes:
        return tuple(sorted(codes))
    shells = _on_common_vertices([exterior, *turned])
    codes = {_void_in_exterior(shells[0], void) for void in shells[1:]}
    codes |= {_void_beside_void(a, b) for a, b in combinations(shells[1:], 2)}
    if codes <= {0} and any(_is_cut(void, shells) for void in shells[1:]):
        codes.add(404)
    return tuple(sorted(codes - {0}))


#: The vertices of all shells, and the triangles of one as rows of them.
_Shell = tuple[NDArray[np.float64], NDArray[np.int64]]


def _on_common_vertices(shells: list[Solid]) -> list[_Shell]:
    """Return the triangles of shells as rows of the vertices of all."""
    vertices = np.concatenate([shell.vertices for shell in shells])
    leader = weld(vertices, SNAP_TOLERANCE)
    found = []
    first = 0
    for shell in shells:
        faces = face_arrays(shell, np.arange(len(shell.vertices)))
        triangles = triangulate(faces, fitted_planes(faces)[1])[0]
        found.append((vertices, leader[triangles + first]))
        first += len(shell.vertices)
    return found


def _void_in_exterior(exterior: _Shell, void: _Shell) -> int:
    """Return 402 for the same shell, 401 where two meet, 403 for a void outside, else 0."""
    return _same(exterior, void) or _meeting(exterior, void) or (0 if _is_inside(void, exterior) else 403)


def _void_beside_void(first: _Shell, second: _Shell) -> int:
    """Return 402 for the same shell, 401 where two meet or one lies in the other, else 0."""
    nested = _is_inside(first, second) or _is_inside(second, first)
    return _same(first, second) or _meeting(first, second) or (401 if nested else 0)


def _same(first: _Shell, second: _Shell) -> int:
    """Return 402 if two shells have the same triangles, else 0."""
    sets = [{tuple(sorted(row)) for row in triangles.tolist()} for _, triangles in (first, second)]
    return 402 if sets[0] == sets[1] else 0


def _meeting(first: _Shell, second: _Shell) -> int:
    """Return 401 if triangles of two shells meet elsewhere than in common vertices and edges, else 0."""
    triangles = np.concatenate([first[1], second[1]])
    shell_of = np.repeat([0, 1], [len(first[1]), len(second[1])])
    return 401 if self_intersects(first[0], triangles, shell_of) else 0


def _is_inside(inner: _Shell, outer: _Shell) -> bool:
    """
    Whether a shell that does not meet another one lies in it, by the solid angle around one of its points.

    The sum of the triangles' solid angles (van Oosterom and Strackee 1983) is 4 π inside and 0 outside.
    """
    vertices, triangles = outer
    a, b, c = np.moveaxis(vertices[triangles] - vertices[inner[1][0]].mean(axis=0), 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
    angle = 2.0 * np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return bool(abs(angle.sum()) > 2.0 * np.pi)


def _is_cut(void: _Shell, shells: list[_Shell]) -> bool:
    """
    Whether edges that a void has in common with other shells divide its surface: what lies beside is cut off.
    """
    triangles = void[1]
    others = {edge for shell in shells if shell is not void for edge in _edges(shell[1])}
    by_edge: dict[tuple[int, int], list[int]] = {}
    for number, row in enumerate(triangles):
        for edge in _edges(row[None]):
            by_edge.setdefault(edge, []).append(number)
    links = np.array([pair for edge, pair in by_edge.items() if edge not in others]).reshape(-1, 2)
    size = len(triangles)
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(size, size))
    return bool(connected_components(graph, directed=False)[0] > 1)


def _edges(triangles: NDArray[np.int64]) -> set[tuple[int, int]]:
    """Return the undirected edges of triangles."""
    return {
        (min(a, b), max(a, b))
        for row in triangles.tolist()
        for a, b in zip(row, row[1:] + row[:1], strict=True)
    }
