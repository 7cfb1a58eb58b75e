"""Diagonals of a triangulation flipped until it is Delaunay's."""

from __future__ import annotations

import numpy as np
from numba import njit

from lidar_buildings.core.model.array_types import FloatArray, IntArray

#: Sine of an angle that counts as nothing: flips that gain no more could go on for ever.
_NO_GAIN = 1e-9


@njit(cache=True, nogil=True)
def flip_to_delaunay(flat: FloatArray, corners: IntArray, rows: IntArray) -> None:
    """
    Flip the inner edges of triangles in place, as Lawson (1977), until all are locally Delaunay.

    Parameters
    ----------
    flat : ndarray of shape (n_corners, 2)
        Coordinates of corners [m].
    corners : ndarray of shape (n_corners,)
        The vertex of each corner: corners of one vertex are one place.
    rows : ndarray of shape (n_triangles, 3)
        Corners of the triangles, counter-clockwise.
    """
    n = len(rows)
    if n < 2:
        return
    across = _neighbours(corners, rows)
    for _ in range(2 * n + 4):
        changed = False
        for t in range(n):
            for k in range(3):
                if across[t, k] > t and _should_flip(flat, corners, rows, across, t, k):
                    _flip(corners, rows, across, t, k)
                    changed = True
        if not changed:
            return


@njit(cache=True, nogil=True)
def _neighbours(corners: IntArray, rows: IntArray) -> IntArray:
    """Return the triangle across each edge (from corner k to k + 1), −1 at the border."""
    n = len(rows)
    across = np.full((n, 3), -1)
    for t in range(n):
        for k in range(3):
            a, b = corners[rows[t, k]], corners[rows[t, (k + 1) % 3]]
            for other in range(t + 1, n):
                for j in range(3):
                    if corners[rows[other, j]] == b and corners[rows[other, (j + 1) % 3]] == a:
                        across[t, k] = other
                        across[other, j] = t
    return across


@njit(cache=True, nogil=True)
def _edge_towards(across: IntArray, t: int, other: int) -> int:
    for k in range(3):
        if across[t, k] == other:
            return k
    return -1


@njit(cache=True, nogil=True)
def _should_flip(
    flat: FloatArray, corners: IntArray, rows: IntArray, across: IntArray, t: int, k: int
) -> bool:
    """Whether the angles opposite an edge add up to more than 180° and the other diagonal lies inside."""
    other = across[t, k]
    j = _edge_towards(across, other, t)
    a, b, c = flat[rows[t, k]], flat[rows[t, (k + 1) % 3]], flat[rows[t, (k + 2) % 3]]
    d = flat[rows[other, (j + 2) % 3]]
    if corners[rows[t, (k + 2) % 3]] == corners[rows[other, (j + 2) % 3]]:
        return False
    if _sine(c, a, d) <= 0.0 or _sine(d, b, c) <= 0.0:
        return False
    return _sine(c, a, b) * _cosine(d, b, a) + _cosine(c, a, b) * _sine(d, b, a) < -_NO_GAIN


@njit(cache=True, nogil=True)
def _sine(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
    """Return the sine of the angle at p from q to r, 0 if one coincides with it."""
    ux, uy, vx, vy = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
    size = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    return (ux * vy - uy * vx) / size if size > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _cosine(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
    """Return the cosine of the angle at p from q to r, 1 if one coincides with it."""
    ux, uy, vx, vy = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
    size = np.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    return (ux * vx + uy * vy) / size if size > 0.0 else 1.0


@njit(cache=True, nogil=True)
def _flip(corners: IntArray, rows: IntArray, across: IntArray, t: int, k: int) -> None:
    """Replace the common edge ab of triangles abc and bad by cd."""
    other = across[t, k]
    j = _edge_towards(across, other, t)
    a, b, c = rows[t, k], rows[t, (k + 1) % 3], rows[t, (k + 2) % 3]
    d = rows[other, (j + 2) % 3]
    beyond_bc, beyond_ca = across[t, (k + 1) % 3], across[t, (k + 2) % 3]
    beyond_ad, beyond_db = across[other, (j + 1) % 3], across[other, (j + 2) % 3]
    rows[t, 0], rows[t, 1], rows[t, 2] = c, a, d
    across[t, 0], across[t, 1], across[t, 2] = beyond_ca, beyond_ad, other
    rows[other, 0], rows[other, 1], rows[other, 2] = d, b, c
    across[other, 0], across[other, 1], across[other, 2] = beyond_db, beyond_bc, t
    if beyond_ad >= 0:
        across[beyond_ad, _edge_towards(across, beyond_ad, other)] = t
    if beyond_bc >= 0:
        across[beyond_bc, _edge_towards(across, beyond_bc, t)] = other
