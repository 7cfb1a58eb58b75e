"""
Insert vertices one by one into a Delaunay triangulation kept in arrays; compiled, O(1) each once located.

A mesh is a pair of int32 arrays with room for growth: `triangles` (rows of vertices, counter-clockwise) and
`neighbours` (the triangle across the side opposite each corner, −1 where there is none).
"""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import inner_kernel, kernel

#: A fourth point this little inside or outside the circle, relative to the sides to the fourth power, counts
#: as on it: far above rounding (1e-16), far below what matters to the shape.
ON_CIRCLE = 1e-12


@kernel
def insert_vertex(vertex, triangle, n_triangles, vertices, triangles, neighbours):  # type: ignore[no-untyped-def]
    """
    Insert a vertex into the triangle that holds it; flip sides until all are Delaunay again (Lawson 1977).

    `vertex` is a row of `vertices`, float64 (n, 2 or more) [m], at no other vertex's place; it lies in
    `triangle` (int32) or on its border, never beyond the hull. The mesh, `triangles` and `neighbours`, int32
    (m, 3), is changed in place and has room for two more than the `n_triangles` so far. Return their new
    number.
    """
    first, second = n_triangles, n_triangles + 1
    _split(vertex, triangle, first, second, triangles, neighbours)
    suspect = triangle
    while True:
        beyond = neighbours[suspect, 0]
        if beyond >= 0:
            k = _corner_facing(beyond, suspect, neighbours)
            if _has_to_flip(suspect, triangles[beyond, k], vertices, triangles):
                # The suspect keeps its number, and the other one comes after it round the vertex.
                _flip(suspect, beyond, k, triangles, neighbours)
                continue
        suspect = neighbours[suspect, 1]
        if suspect == triangle:
            return n_triangles + 2


@kernel
def _split(vertex, triangle, first, second, triangles, neighbours):  # type: ignore[no-untyped-def]
    """Replace a triangle by three that meet in the vertex; it is corner 0 of each."""
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    beyond_a, beyond_b, beyond_c = neighbours[triangle, 0], neighbours[triangle, 1], neighbours[triangle, 2]
    _set(triangle, vertex, b, c, beyond_a, first, second, triangles, neighbours)
    _set(first, vertex, c, a, beyond_b, second, triangle, triangles, neighbours)
    _set(second, vertex, a, b, beyond_c, triangle, first, triangles, neighbours)
    _redirect(beyond_b, triangle, first, neighbours)
    _redirect(beyond_c, triangle, second, neighbours)


@kernel
def _flip(near, far, k, triangles, neighbours):  # type: ignore[no-untyped-def]
    """Turn the side between two triangles; `near` faces it with corner 0, `far` with corner k."""
    # Both have the former's corner 0 as their corner 0 afterwards.
    a, b, c, d = triangles[near, 0], triangles[near, 1], triangles[near, 2], triangles[far, k]
    beyond_bd, beyond_dc = neighbours[far, (k + 1) % 3], neighbours[far, (k + 2) % 3]
    beyond_ca, beyond_ab = neighbours[near, 1], neighbours[near, 2]
    _set(near, a, b, d, beyond_bd, far, beyond_ab, triangles, neighbours)
    _set(far, a, d, c, beyond_dc, beyond_ca, near, triangles, neighbours)
    _redirect(beyond_bd, far, near, neighbours)
    _redirect(beyond_ca, near, far, neighbours)


@inner_kernel
def _set(triangle, a, b, c, beyond_a, beyond_b, beyond_c, triangles, neighbours):  # type: ignore[no-untyped-def]
    """Write a triangle's corners and the neighbours opposite them."""
    triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2] = a, b, c
    neighbours[triangle, 0], neighbours[triangle, 1], neighbours[triangle, 2] = beyond_a, beyond_b, beyond_c


@inner_kernel
def _redirect(triangle, old, new, neighbours):  # type: ignore[no-untyped-def]
    if triangle >= 0:
        neighbours[triangle, _corner_facing(triangle, old, neighbours)] = new


@inner_kernel
def _corner_facing(triangle, other, neighbours):  # type: ignore[no-untyped-def]
    """Return the corner of a triangle opposite the side that it shares with another."""
    if neighbours[triangle, 0] == other:
        return 0
    return 1 if neighbours[triangle, 1] == other else 2


@kernel
def _has_to_flip(triangle, vertex, vertices, triangles):  # type: ignore[no-untyped-def]
    """Whether a vertex d lies within the circle round a triangle abc and side bc may be turned into ad."""
    # Of four on one circle the first by x, then y, gets the side, as if it alone lay a little lower on the
    # paraboloid (Edelsbrunner and Mücke 1990): the triangles depend on neither order nor cut.
    a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
    dx, dy = vertices[vertex, 0], vertices[vertex, 1]
    ax, ay = vertices[a, 0] - dx, vertices[a, 1] - dy
    bx, by = vertices[b, 0] - dx, vertices[b, 1] - dy
    cx, cy = vertices[c, 0] - dx, vertices[c, 1] - dy
    # Twice the signed areas of abd, adc and bcd: both triangles after the turn have to be counter-clockwise.
    abd, adc, bcd = ax * by - ay * bx, cx * ay - cy * ax, bx * cy - by * cx
    if abd <= 0.0 or adc <= 0.0:
        return False
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    inside, rounding = aa * bcd + bb * adc + cc * abd, ON_CIRCLE * max(aa, bb, cc) ** 2
    if abs(inside) > rounding:
        return inside > 0.0
    west, south = min(ax, 0.0), ay if ax < 0.0 or (ax == 0.0 and ay < 0.0) else 0.0
    return (west, south) < (bx, by) and (west, south) < (cx, cy)


def with_room(mesh_array: np.ndarray, n_rows: int) -> np.ndarray:
    """Return an int32 copy of an array with room for `n_rows` rows, −1 where nothing stands yet."""
    roomy = np.full((n_rows, *mesh_array.shape[1:]), -1, dtype=np.int32)
    roomy[: len(mesh_array)] = mesh_array
    return roomy
