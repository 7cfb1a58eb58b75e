"""
Pits and light wells, which low gross errors must be told from: all pulses reach their floor.

"""

from __future__ import annotations

import math

from numba import njit

from lidar_buildings.core.ground_filter.noise_layers import columns_in_row

#: Points that are not enough to show a pit.
FEW = 3
#: Columns around that the density of points is taken from.
REACH = 3
#: Radius of the disc about each point within which the points above are counted, in point spacings.
DISC = 1.5
#: Share of points above, of all points in those discs, that covers a group.
MIN_COVER = 0.4


@njit(cache=True, nogil=True)
def is_open_pit(layers, group, gap):  # type: ignore[no-untyped-def]
    """
    Whether a group of layers fills its place: hardly a point lies above it that is not at its rim.

    Errors lie scattered among the pulses that reached the surface, however dense they are themselves, so that
    no more of them are counted than the surface would have.

    Parameters
    ----------
    layers : Layers
        All of them.
    group : ndarray of int64
        The layers to judge.
    gap : float
        What is farther above than this covers a point [m].

    """
    n_points = 0
    for layer in group:
        n_points += layers.begin[layer + 1] - layers.begin[layer]
    if n_points <= FEW:
        return False
    radius = DISC * _spacing_around(layers, group, n_points)
    usual = math.pi * DISC * DISC
    n_cover, n_all = 0.0, 0.0
    for layer in group:
        for i in range(layers.begin[layer], layers.begin[layer + 1]):
            above, beside = _count_disc(layers, layers.column[layer], layers.points[i], radius, gap)
            n_cover += above
            n_all += above + min(beside, usual)
    return n_cover < MIN_COVER * n_all


@njit(cache=True, nogil=True)
def _spacing_around(layers, group, n_points):  # type: ignore[no-untyped-def]
    """
    Return the spacing of the points around a group, itself left out [m].

    """
    k = layers.column[group[0]]
    n_around, n_columns = -n_points, 0
    for step in range(-REACH, REACH + 1):
        start, stop = columns_in_row(layers, k, step, REACH)
        n_columns += stop - start
        n_around += layers.begin[layers.first[stop]] - layers.begin[layers.first[start]]
    return layers.size * math.sqrt(n_columns / max(n_around, n_columns))


@njit(cache=True, nogil=True)
def _count_disc(layers, k, point, radius, gap):  # type: ignore[no-untyped-def]
    """
    Return how many points of a disc about a point of column k lie above it by the gap, and how many not.

    """
    above, beside = 0, 0
    reach = math.ceil(radius / layers.size)
    for step in range(-reach, reach + 1):
        start, stop = columns_in_row(layers, k, step, reach)
        for i in range(layers.begin[layers.first[start]], layers.begin[layers.first[stop]]):
            dx, dy = layers.points[i, 0] - point[0], layers.points[i, 1] - point[1]
            if dx * dx + dy * dy > radius * radius:
                continue
            if layers.points[i, 2] > point[2] + gap:
                above += 1
            else:
                beside += 1
    return above, beside
