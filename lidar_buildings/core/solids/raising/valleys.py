"""
Vertices at which four walls would meet: high and low pieces in turns around one vertex of the plan.

A shell must not touch itself (ISO 19107; val3dity's code 303). Around a vertex the elevations, taken in a
circle, may therefore rise once and fall once. Where they do so twice, the pieces of one valley are drawn
back by a centimetre, so that the higher ones beside it meet.
"""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.solids.raising.edge_columns import LEVEL, START, X, Y

#: How far a valley's tip is drawn back, in steps of the grid.
DRAWN_BACK = 10


@kernel
def valley_to_cut(edges: IntArray, fan: IntArray, n: int) -> tuple[int, int]:
    """Return the first and the last sector of the shallowest valley to cut, −1 if the vertex is sound."""
    chosen, chosen_last, shallowest = -1, -1, 0
    if n < 4:
        return chosen, chosen_last
    top = edges[fan[0], LEVEL]
    for k in range(n):
        top = max(top, edges[fan[k], LEVEL])
    while True:
        # the next lower elevation
        level, found = top, False
        for k in range(n):
            height = edges[fan[k], LEVEL]
            if height < top and (not found or height > level):
                level, found = height, True
        if not found:
            return -1, -1
        top = level
        n_valleys = 0
        for start in range(n):
            if not edges[fan[start], LEVEL] <= level < edges[fan[start - 1 if start else n - 1], LEVEL]:
                continue
            last, lowest = start, edges[fan[start], LEVEL]
            while edges[fan[(last + 1) % n], LEVEL] <= level:
                last = (last + 1) % n
                lowest = min(lowest, edges[fan[last], LEVEL])
            if n_valleys == 0 or lowest > shallowest:
                chosen, chosen_last, shallowest = start, last, lowest
            n_valleys += 1
        if n_valleys > 1:
            return chosen, chosen_last


@kernel
def find_apex(vertices: IntArray, edges: IntArray, v: int, first: int, last: int, new: int) -> None:
    """Put a vertex on the bisector between two half-edges, the first one clockwise of the second."""
    p, q = edges[first ^ 1, START], edges[last ^ 1, START]
    px, py = vertices[p, X] - vertices[v, X], vertices[p, Y] - vertices[v, Y]
    qx, qy = vertices[q, X] - vertices[v, X], vertices[q, Y] - vertices[v, Y]
    begin = math.atan2(py, px)
    opening = (math.atan2(qy, qx) - begin) % (2.0 * math.pi)
    half = 0.5 * (opening if opening != 0.0 else 2.0 * math.pi)
    vertices[new, X] = int(np.rint(vertices[v, X] + DRAWN_BACK * math.cos(begin + half)))
    vertices[new, Y] = int(np.rint(vertices[v, Y] + DRAWN_BACK * math.sin(begin + half)))
