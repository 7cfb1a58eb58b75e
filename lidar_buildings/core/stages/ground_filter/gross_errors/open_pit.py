"""Pits and light wells, which low gross errors must be told from: all pulses reach their floor."""

from __future__ import annotations

import math

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.ground_filter.gross_errors.noise_layers import columns_in_row

# Chosen with `bench.ground.noise` and the courtyards, pits and shafts of the tests.
#: Points that are not enough to show a pit.
FEW = 3
#: Columns around that the density of points is taken from.
REACH = 6
#: Radius of the disc about each point within which the points above are counted, in point spacings.
DISC = 1.75
#: Share of points above, of all points in those discs, that covers a group.
MIN_COVER = 0.65
#: Over a hole, points above are fewer than a surface has by more than so many standard deviations ...
DEVIATIONS = 1.8
#: ... and are certainly enough at this share of them.
FULL_COVER = 0.8


@kernel
def is_open_pit(layers, group, gap):  # type: ignore[no-untyped-def]
    """
    Whether a group of layers fills its place: hardly a point lies above it that is not at its rim.

    Errors lie scattered among the pulses that reached the surface, however dense they are themselves, so that
    no more of them are counted than the surface would have.
    What is farther above a point than the `gap` [m] covers it.
    """
    n_points = 0
    for layer in group:
        n_points += layers.begin[layer + 1] - layers.begin[layer]
    if n_points <= FEW:
        return False
    spacing = _spacing_around(layers, group)
    radius, usual = DISC * spacing, math.pi * DISC * DISC
    n_cover, n_all = 0.0, 0.0
    for layer in group:
        for i in range(layers.begin[layer], layers.begin[layer + 1]):
            above, beside = _count_disc(layers, layers.column[layer], layers.points[i], radius, gap)
            n_cover += above
            n_all += above + min(beside, usual)
    n_surface = usual + len(group) * (layers.size / spacing) ** 2
    enough = min(1.0 - DEVIATIONS / math.sqrt(n_surface), FULL_COVER)
    return n_cover < MIN_COVER * n_all and n_cover < enough * usual * n_points


@kernel
def _spacing_around(layers, group):  # type: ignore[no-untyped-def]
    """
    Return the spacing of the points in the columns around a group that hold none of it [m].

    In each row of columns, empty ones count from the first to the last that is not.
    """
    k = layers.column[group[0]]
    n_points, n_columns = 0, 0
    for step in range(-REACH, REACH + 1):
        start, stop = columns_in_row(layers, k, step, REACH)
        if start == stop:
            continue
        n_columns += layers.numbers[stop - 1] - layers.numbers[start] + 1
        for other in range(start, stop):
            is_own = False
            for layer in group:
                is_own = is_own or layers.column[layer] == other
            if is_own:
                n_columns -= 1
            else:
                n_points += layers.begin[layers.first[other + 1]] - layers.begin[layers.first[other]]
    return layers.size * math.sqrt(max(n_columns, 1) / max(n_points, 1))


@kernel
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
