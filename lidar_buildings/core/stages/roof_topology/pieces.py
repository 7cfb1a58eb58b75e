"""Where along its border a pair of planes meets: pieces of the exact intersection line."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import BoolArray, FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import sort_rows
from lidar_buildings.core.stages.roof_topology.borders import Borders
from lidar_buildings.core.stages.roof_topology.region_raster import RegionRaster

#: Planes whose slopes differ by less [m/m] have no line of intersection worth the name.
LEAST_BEND = 0.01
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
#: Regions are looked up so many cells off the line to tell which plane lies on which side.
_PROBE = 2


class Pieces(NamedTuple):
    """Pieces of intersection lines."""

    pair: IntArray  #: pair of the borders, shape (n,)
    #: Numbers of the planes, shape (n,).
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    #: Ends as distances along the line from its foot, the position nearest to the centre [m], shape (n, 2).
    t: FloatArray
    length: FloatArray  #: length of the border along it [m], shape (n,)
    convex: BoolArray  #: whether the planes descend away from the line, shape (n,)
    on_line: BoolArray  #: which sides of the borders are accounted for by a piece, shape (n_sides,)


def find_pieces(
    borders: Borders, raster: RegionRaster, gradients: FloatArray, centre: FloatArray, spacing: float
) -> Pieces:
    """Find where pairs of planes z = a x + b y + c about the centre meet."""
    n = len(borders.first)
    pairs = np.empty(n, dtype=np.int64)
    values = np.empty((n, 4))
    on_line = np.zeros(n, dtype=np.bool_)
    lines = intersection_lines(
        borders.first[borders.start[:-1]], borders.second[borders.start[:-1]], gradients
    )
    n_pieces = _all_pieces(
        borders.upright, borders.first, borders.second, borders.gap, borders.start, borders.cell, lines,
        borders.xy, spacing, raster.label, raster.west - centre[0], raster.south - centre[1],
        pairs, values, on_line,
    )  # fmt: skip
    pairs, values = pairs[:n_pieces], values[:n_pieces]
    at = borders.start[pairs]
    return Pieces(
        pairs,
        borders.first[at],
        borders.second[at],
        np.ascontiguousarray(values[:, :2]),
        values[:, 2],
        values[:, 3] > 0,
        on_line,
    )


@kernel
def intersection_lines(first, second, gradients):  # type: ignore[no-untyped-def]
    """
    Return foot, direction and bend of the lines in which pairs of planes meet, seen from above.

    The direction is that of the cross product of the normals (Mancera-Taboada et al., 2012, eq. 5). The foot
    is the position nearest to the origin, which is in the building: one at z = 0 may be far off. The bend is
    the difference of the planes' gradients; less than `LEAST_BEND` means that there is no line.
    """
    lines = np.zeros((len(first), 5))
    for k in range(len(first)):
        i, j = first[k] - 1, second[k] - 1
        gx, gy = gradients[i, 0] - gradients[j, 0], gradients[i, 1] - gradients[j, 1]
        d = gradients[i, 2] - gradients[j, 2]
        bend = np.hypot(gx, gy)
        lines[k, 2], lines[k, 4] = 1.0, bend
        if bend >= LEAST_BEND:
            lines[k, 0], lines[k, 1] = -d * gx / bend**2, -d * gy / bend**2
            lines[k, 2], lines[k, 3] = -gy / bend, gx / bend
    return lines


@kernel
def _all_pieces(  # type: ignore[no-untyped-def]
    upright, first, second, gap, start, cell, lines, xy, spacing, label, west, south, pairs, values, on_line
):  # fmt: skip
    """
    Write pair, ends, length and vote on convexity of each piece; return how many. Sides are ordered by pair.
    """
    n_pieces = 0
    rows, t, off, along = np.empty(len(xy), np.int64), np.empty(len(xy)), np.empty(len(xy)), np.empty(len(xy))
    for pair in range(len(start) - 1):
        a, b = start[pair], start[pair + 1]
        fx, fy, ux, uy, bend = lines[pair, 0], lines[pair, 1], lines[pair, 2], lines[pair, 3], lines[pair, 4]
        if bend < LEAST_BEND:
            continue
        least, strict = max(_TOLERANCE * spacing, _NOISE / bend), max(_END_TOLERANCE * spacing, _NOISE / bend)
        n = 0
        for k in range(a, b):
            x, y = xy[k, 0], xy[k, 1]
            t[k], off[k] = x * ux + y * uy, abs((x - fx) * uy - (y - fy) * ux)
            if off[k] <= least + gap[k]:
                rows[n], along[n] = k, t[k]
                n += 1
        sort_rows(along, rows, n)
        begin, first_piece = 0, n_pieces
        for m in range(1, n + 1):
            if m < n and t[rows[m]] - t[rows[m - 1]] <= _LONGEST_GAP * spacing:
                continue
            # From the first to the last that are surely on the line.
            low, high = begin, m - 1
            while low < high and off[rows[low]] > strict + gap[rows[low]]:
                low += 1
            while low < high and off[rows[high]] > strict + gap[rows[high]]:
                high -= 1
            begin = m
            t0, t1 = t[rows[low]], t[rows[high]]
            length = 0.0
            for at in range(low, high + 1):
                length += cell * (abs(uy) if upright[rows[at]] else abs(ux))
            if length < _LEAST_LENGTH * spacing:
                continue
            votes = 0
            for at in range(low, high + 1):
                k = rows[at]
                on_line[k] = True
                votes += _convexity(fx + t[k] * ux, fy + t[k] * uy, ux, uy, first[a], second[a],
                                    label, west, south, cell)  # fmt: skip
            pairs[n_pieces] = pair
            values[n_pieces, 0], values[n_pieces, 1], values[n_pieces, 2] = t0, t1, length
            values[n_pieces, 3] = votes
            n_pieces += 1
        # Sides that run beside a piece are accounted for: points of its planes are mixed there, but there is
        # no step.
        for piece in range(first_piece, n_pieces):
            t0, t1 = values[piece, 0] + spacing, values[piece, 1] - spacing
            for k in range(a, b):
                if off[k] <= _BESIDE * spacing + gap[k] and t0 <= t[k] <= t1:
                    on_line[k] = True
    return n_pieces


@kernel
def _convexity(x, y, ux, uy, first, second, label, west, south, cell):  # type: ignore[no-untyped-def]
    """
    Vote on whether each plane lies on the side of the line on which it is the lower one, at one place.

    The first plane is the higher one on the side of (uy, -ux): that is where its gradient less the other's
    points to.
    """
    votes = 0
    for side in range(-1, 2, 2):
        c = math.floor((x + side * _PROBE * cell * uy - west) / cell)
        r = math.floor((y - side * _PROBE * cell * ux - south) / cell)
        if 0 <= r < label.shape[0] and 0 <= c < label.shape[1]:
            if label[r, c] == first:
                votes -= side
            elif label[r, c] == second:
                votes += side
    return votes
