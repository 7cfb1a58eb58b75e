"""Diagonals of a triangulation flipped until it is Delaunay's."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray

#: Sine of an angle that counts as nothing: flips that gain no more could go on for ever.
_NO_GAIN = 1e-9


@kernel
def flip_to_delaunay(
    flat: FloatArray, corners: IntArray, rows: IntArray, begin: int, end: int, across: IntArray
) -> None:
    """
    Flip the inner edges of triangles in place, as Lawson (1977), until all are locally Delaunay.

    `flat` are coordinates of corners (n_corners, 2) [m], `corners` the vertex of each: corners of one vertex
    are one place. `rows` are corners of triangles, counter-clockwise (n_triangles, 3); those from `begin` to
    `end` are looked at, and have only each other beside them. `across` is room for the triangles across each
    edge (from corner k to k + 1), −1 at the border.
    """
    n = end - begin
    for t in range(n):
        for k in range(3):
            across[t, k] = -1
    for t in range(n):
        for k in range(3):
            a, b = corners[rows[begin + t, k]], corners[rows[begin + t, k + 1 if k < 2 else 0]]
            for other in range(t + 1, n):
                for j in range(3):
                    if (
                        corners[rows[begin + other, j]] == b
                        and corners[rows[begin + other, j + 1 if j < 2 else 0]] == a
                    ):
                        across[t, k] = other
                        across[other, j] = t
    for _ in range(2 * n + 4):
        changed = False
        for t in range(n):
            for k in range(3):
                other = across[t, k]
                if other <= t:
                    continue
                j = _edge_towards(across, other, t)
                a, b = rows[begin + t, k], rows[begin + t, (k + 1) % 3]
                c, d = rows[begin + t, (k + 2) % 3], rows[begin + other, (j + 2) % 3]
                if corners[c] == corners[d] or not _should_flip(flat, a, b, c, d):
                    continue
                # replace the common edge ab of triangles abc and bad by cd
                changed = True
                beyond_bc, beyond_ca = across[t, (k + 1) % 3], across[t, (k + 2) % 3]
                beyond_ad, beyond_db = across[other, (j + 1) % 3], across[other, (j + 2) % 3]
                rows[begin + t, 0], rows[begin + t, 1], rows[begin + t, 2] = c, a, d
                across[t, 0], across[t, 1], across[t, 2] = beyond_ca, beyond_ad, other
                rows[begin + other, 0], rows[begin + other, 1], rows[begin + other, 2] = d, b, c
                across[other, 0], across[other, 1], across[other, 2] = beyond_db, beyond_bc, t
                if beyond_ad >= 0:
                    across[beyond_ad, _edge_towards(across, beyond_ad, other)] = t
                if beyond_bc >= 0:
                    across[beyond_bc, _edge_towards(across, beyond_bc, t)] = other
        if not changed:
            return


@kernel
def _edge_towards(across: IntArray, t: int, other: int) -> int:
    for k in range(3):
        if across[t, k] == other:
            return k
    return -1


@kernel
def _should_flip(flat: FloatArray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the angles opposite edge ab add up to more than 180° and the other diagonal lies inside."""
    if _angle(flat, c, a, d)[0] <= 0.0 or _angle(flat, d, b, c)[0] <= 0.0:
        return False
    sine_c, cosine_c = _angle(flat, c, a, b)
    sine_d, cosine_d = _angle(flat, d, b, a)
    return sine_c * cosine_d + cosine_c * sine_d < -_NO_GAIN


@kernel
def _angle(flat: FloatArray, p: int, q: int, r: int) -> tuple[float, float]:
    """Return sine and cosine of the angle at p from q to r; it is 0 if one coincides with it."""
    ux, uy = flat[q, 0] - flat[p, 0], flat[q, 1] - flat[p, 1]
    vx, vy = flat[r, 0] - flat[p, 0], flat[r, 1] - flat[p, 1]
    size = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    return ((ux * vy - uy * vx) / size, (ux * vx + uy * vy) / size) if size > 0.0 else (0.0, 1.0)
