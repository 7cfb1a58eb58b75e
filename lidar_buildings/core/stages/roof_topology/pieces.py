"""Where along its border a pair of planes meets: pieces of the exact intersection line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.stages.roof_topology.borders import Borders
from lidar_buildings.core.stages.roof_topology.region_raster import RegionRaster

#: Planes whose slopes differ by less [m/m] have no line of intersection worth the name.
LEAST_BEND = 0.03
#: A border lies on the line if it is no farther from it than the gap between the points and so many spacings,
_TOLERANCE = 0.75
#: at the ends of a piece no farther than so many spacings more than the gap,
_END_TOLERANCE = 0.35
#: or than where the planes are so far apart [m]: points of either plane may be taken for the other's.
_NOISE = 0.06
#: Borders so near beside a piece of the line [spacings] are no steps.
_BESIDE = 2.5
#: Shortest piece, and longest gap within one, in spacings.
_LEAST_LENGTH, _LONGEST_GAP = 2.0, 4.0
#: Least share of a piece along which the regions do border on one another.
_LEAST_SUPPORT = 0.4
#: Regions are looked up so many cells off the line to tell which plane lies on which side.
_PROBES = (2, 3, 4)


class Pieces(NamedTuple):
    """
    Pieces of intersection lines.

    Attributes
    ----------
    pair : ndarray of shape (n,), int64
        Pair of the borders.
    first, second : ndarray of shape (n,), int32
        Numbers of the planes.
    t : ndarray of shape (n, 2)
        Ends as distances along the line from its foot, the position nearest to the centre [m].
    length : ndarray of shape (n,)
        Length of the border along it [m].
    convex : ndarray of shape (n,), bool
        Whether the planes descend away from the line.
    n_points : ndarray of shape (n,), int64
        Distinct points nearest to the border.
    on_line : ndarray of shape (n_sides,), bool
        Which sides of the borders are accounted for by a piece.
    """

    pair: IntArray
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    t: FloatArray
    length: FloatArray
    convex: BoolArray
    n_points: IntArray
    on_line: BoolArray


def find_pieces(
    borders: Borders, raster: RegionRaster, gradients: FloatArray, centre: FloatArray, spacing: float
) -> Pieces:
    """
    Find where pairs of planes meet.

    Parameters
    ----------
    borders : Borders
    raster : RegionRaster
    gradients : ndarray of shape (n_planes, 3)
        a, b [m/m] and c [m] of each plane z = a x + b y + c about the centre.
    centre : ndarray of shape (2 or more,)
        [m].
    spacing : float
        Point spacing [m].
    """
    n = len(borders.first)
    numbers = np.empty((n, 2), dtype=np.int64)
    values = np.empty((n, 4))
    on_line = np.zeros(n, dtype=np.bool_)
    origin = np.array([raster.west - centre[0], raster.south - centre[1]])
    n_pieces = _all_pieces(
        borders.xy, borders.upright, borders.first, borders.second, borders.near_first, borders.near_second,
        borders.gap, borders.start, borders.cell, gradients, spacing, raster.label, origin,
        numbers, values, on_line,
    )  # fmt: skip
    numbers, values = numbers[:n_pieces], values[:n_pieces]
    at = borders.start[numbers[:, 0]]
    return Pieces(
        numbers[:, 0],
        borders.first[at],
        borders.second[at],
        values[:, :2],
        values[:, 2],
        values[:, 3] > 0,
        numbers[:, 1],
        on_line,
    )


@njit(cache=True, nogil=True)
def intersection_line(p, q):  # type: ignore[no-untyped-def]
    """
    Return foot, direction and bend of the line in which two planes meet, seen from above.

    The direction is that of the cross product of the normals (Mancera-Taboada et al., 2012, eq. 5). The point
    is that nearest to the origin, which is in the building: one at z = 0 may be far off.

    Parameters
    ----------
    p, q : ndarray of shape (3,)
        a, b, c of z = a x + b y + c.

    Returns
    -------
    x, y, ux, uy, bend : float
        Position nearest to the origin, unit direction, and the difference of the planes' gradients; a bend
        less than `LEAST_BEND` means that there is no line.
    """
    gx, gy, d = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    bend = math.hypot(gx, gy)
    if bend < LEAST_BEND:
        return 0.0, 0.0, 1.0, 0.0, bend
    return -d * gx / bend**2, -d * gy / bend**2, -gy / bend, gx / bend, bend


@njit(cache=True, nogil=True)
def _all_pieces(  # type: ignore[no-untyped-def]
    xy, upright, first, second, near_first, near_second, gap, start, cell, gradients, spacing, label, origin,
    numbers, values, on_line
):  # fmt: skip
    """Write pair and number of points, ends, length and vote on convexity of each piece; return how many."""
    n_pieces = 0
    for pair in range(len(start) - 1):
        a, b = start[pair], start[pair + 1]
        p, q = gradients[first[a] - 1], gradients[second[a] - 1]
        fx, fy, ux, uy, bend = intersection_line(p, q)
        if bend < LEAST_BEND:
            continue
        rows, t, sure = _near_line(xy, gap, a, b, fx, fy, ux, uy, bend, spacing)
        begin, first_piece = 0, n_pieces
        for m in range(1, len(rows) + 1):
            if m < len(rows) and t[m] - t[m - 1] <= _LONGEST_GAP * spacing:
                continue
            low, high = _trimmed(sure, begin, m - 1)
            begin = m
            t0, t1, members = t[low], t[high], rows[low : high + 1]
            length = 0.0
            for k in members:
                length += cell * (abs(uy) if upright[k] else abs(ux))
            if length < _LEAST_LENGTH * spacing or length < _LEAST_SUPPORT * (t1 - t0):
                continue
            on_line[members] = True
            numbers[n_pieces, 0] = pair
            numbers[n_pieces, 1] = _distinct(near_first[members]) + _distinct(near_second[members])
            values[n_pieces, 0], values[n_pieces, 1], values[n_pieces, 2] = t0, t1, length
            values[n_pieces, 3] = _convexity(
                t[low : high + 1], fx, fy, ux, uy, first[a], second[a], label, origin, cell
            )
            n_pieces += 1
        for piece in range(first_piece, n_pieces):
            _mark_beside(xy, fx, fy, ux, uy, a, b, gap, values[piece, 0], values[piece, 1], spacing, on_line)
    return n_pieces


@njit(cache=True, nogil=True)
def _near_line(xy, gap, a, b, fx, fy, ux, uy, bend, spacing):  # type: ignore[no-untyped-def]
    """
    Return the sides a to b near a line, their places along it, and whether each is surely on it; in order.
    """
    least, strict = max(_TOLERANCE * spacing, _NOISE / bend), max(_END_TOLERANCE * spacing, _NOISE / bend)
    t = np.empty(b - a)
    rows = np.empty(b - a, dtype=np.int64)
    sure = np.empty(b - a, dtype=np.bool_)
    n = 0
    for k in range(a, b):
        off = abs((xy[k, 0] - fx) * uy - (xy[k, 1] - fy) * ux)
        if off <= least + gap[k]:
            t[n], rows[n], sure[n] = xy[k, 0] * ux + xy[k, 1] * uy, k, off <= strict + gap[k]
            n += 1
    order = np.argsort(t[:n])
    return rows[order], t[order], sure[order]


@njit(cache=True, nogil=True)
def _trimmed(sure, low, high):  # type: ignore[no-untyped-def]
    """Return the first and the last of a run that are surely on the line."""
    while low < high and not sure[low]:
        low += 1
    while low < high and not sure[high]:
        high -= 1
    return low, high


@njit(cache=True, nogil=True)
def _mark_beside(xy, fx, fy, ux, uy, a, b, gap, t0, t1, spacing, on_line):  # type: ignore[no-untyped-def]
    """Account for sides that run beside a piece: its planes' points are mixed there, but there is no step."""
    for k in range(a, b):
        t = xy[k, 0] * ux + xy[k, 1] * uy
        off = abs((xy[k, 0] - fx) * uy - (xy[k, 1] - fy) * ux)
        if off <= _BESIDE * spacing + gap[k] and t0 + spacing <= t <= t1 - spacing:
            on_line[k] = True


@njit(cache=True, nogil=True)
def _distinct(numbers):  # type: ignore[no-untyped-def]
    ordered = np.sort(numbers)
    n = 1
    for k in range(1, len(ordered)):
        if ordered[k] != ordered[k - 1]:
            n += 1
    return n


@njit(cache=True, nogil=True)
def _convexity(t, fx, fy, ux, uy, first, second, label, origin, cell):  # type: ignore[no-untyped-def]
    """
    Vote on whether each plane lies on the side of the line on which it is the lower one.

    The first plane is the higher one on the side of (uy, -ux): that is where its gradient less the other's
    points to.
    """
    votes = 0
    for k in range(len(t)):
        x, y = fx + t[k] * ux, fy + t[k] * uy
        for probe in _PROBES:
            for side in (-1, 1):
                c = math.floor((x + side * probe * cell * uy - origin[0]) / cell)
                r = math.floor((y - side * probe * cell * ux - origin[1]) / cell)
                if 0 <= r < label.shape[0] and 0 <= c < label.shape[1]:
                    if label[r, c] == first:
                        votes -= side
                    elif label[r, c] == second:
                        votes += side
    return votes
