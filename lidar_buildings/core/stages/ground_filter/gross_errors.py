"""Gross errors: points far below the surface (multipath) and alone far above it (birds, clouds)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.cell_grid import CellGrid, in_rows_order, rows_by_cell, sort_by_cell
from lidar_buildings.core.stages.ground_filter.closed_sheets import below_closed_sheets
from lidar_buildings.core.stages.ground_filter.error_layers import (
    Layers,
    columns_in_row,
    high_end,
    low_end,
    rise,
    split_into_layers,
)

# Chosen with `bench.ground.noise` and the scenes of the tests.
#: A low error lies further than this below what surrounds it, a high one than that from everything else [m].
LOW_GAP, HIGH_GAP = 1.0, 10.0
#: Within how many columns around a low error hardly anything else lies as low.
RADIUS = 20
#: Most layers of a group of errors.
MAX_GROUP = 60
#: Side of the blocks in which occupied cells are counted, in cells; doubled until they hold as many.
BLOCK_CELLS = 16
#: Most cells that a column of the search may be wide.
MAX_COLUMN = 64
#: High errors stand apart by at least this many columns: sparse points are far from each other anyway.
MIN_GAP_COLUMNS = 10


def find_noise(cloud: CellGrid) -> NDArray[np.uint8]:
    """
    Return the class of gross errors, 7 or 18, and 0 elsewhere, in the order of `cloud`.

    Points are looked at in columns about as wide as their spacing, and there in layers. Errors are small
    groups of layers that are connected and lie apart from everything else: low ones below all that
    surrounds them, high ones in the air.
    The cells of `cloud` may be no larger than the columns have to be.
    """
    step = _column_cells(cloud)
    columns = cloud if step == 1 else sort_by_cell(cloud.points, step * cloud.size)
    layers = split_into_layers(columns, LOW_GAP)
    low = find_low_layers(layers, below_closed_sheets(layers, LOW_GAP))
    high = find_cloud_layers(layers, low)
    high |= find_high_layers(layers, low, max(HIGH_GAP, MIN_GAP_COLUMNS * columns.size))
    noise = np.zeros(len(low), dtype=np.uint8)
    noise[high] = PointClass.HIGH_NOISE
    noise[low] = PointClass.LOW_NOISE
    of_points = np.repeat(noise, np.diff(layers.begin))
    return of_points if step == 1 else in_rows_order(columns, of_points)


def _column_cells(cloud: CellGrid) -> int:
    """Return how many whole cells wide a column is: as wide as points are apart where most are."""
    lowest = cloud.points[cloud.first[:-1]]
    side = BLOCK_CELLS
    while True:
        counts = np.diff(rows_by_cell(lowest, side * cloud.size).first)
        occupied = np.median(np.repeat(counts, counts))
        if occupied >= BLOCK_CELLS or side >= MAX_COLUMN * BLOCK_CELLS:
            return int(min(max(round(side / np.sqrt(occupied)), 1), MAX_COLUMN))
        side *= 2


# Chosen with `bench.ground.noise` and the scenes of the tests.
#: Columns between which layers still touch: ground seen through gaps is connected over so many.
GROUP_REACH = 3
#: Columns around that support the level of a group: fewer may be gross errors themselves ...
MIN_SUPPORT = 6
#: ... and most of these from one other small group.
MAX_OF_SMALL = 2
#: By what share the radius shrinks per unit of slope: the steeper, the less far terrain is plane.
SHRINKAGE = 1.0
#: A group has to be below the larger part of what is around: this many columns for each of its own.
MIN_SURROUNDINGS = 2
#: Gross errors below gross errors are found one after the other; wide margin.
MAX_PASSES = 10
#: What is known of a layer.
UNKNOWN, LARGE, ERROR = 0, 1, 2


def find_low_layers(layers: Layers, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """
    Return which layers are low gross errors, those known before among them.

    A group is what is connected: layers of columns at most three apart whose elevations, the terrain's
    slope allowed for, are within `LOW_GAP`. It is an error if it is small, if within the radius hardly
    anything else reaches down to its level, the slope again allowed for, and if it is no open pit.
    """
    n_layers, state = len(layers.column), np.where(known, np.uint8(ERROR), np.uint8(UNKNOWN))
    bottom, group_of = layers.first[:-1].copy(), np.full(n_layers, -1, dtype=np.int64)
    _raise_bottoms(layers, state, np.unique(layers.column[known]), bottom)
    seeds = bottom[bottom >= 0]
    for _ in range(MAX_PASSES):
        errors, open_cases = _judge_low(layers, bottom, seeds, state, group_of)
        if len(errors) == 0:
            break
        state[errors] = ERROR
        columns = np.unique(layers.column[errors])
        _raise_bottoms(layers, state, columns, bottom)
        raised = bottom[columns]
        seeds = np.append(open_cases, raised[raised >= 0])
        group_of[:] = -1
    return state == ERROR


@kernel
def _raise_bottoms(layers, state, columns, bottom):  # type: ignore[no-untyped-def]
    """Note the lowest layer above the errors of some columns; −1 where nothing is left."""
    for k in columns:
        bottom[k] = -1
        for j in range(layers.first[k + 1] - 1, layers.first[k] - 1, -1):
            if state[j] != ERROR:
                bottom[k] = j


@kernel
def _judge_low(layers, bottom, seeds, state, group_of):  # type: ignore[no-untyped-def]
    """Return the layers of groups that are errors, and the seeds of those that others may still hide."""
    members, begins = _gather_groups(layers, seeds, state, group_of)
    errors, open_cases = np.empty(len(members), np.int64), np.empty(len(begins), np.int64)
    n_errors, n_open = 0, 0
    # How many columns of a small group support the one under judgement, which is noted beside.
    counted, judged = np.zeros(len(state), dtype=np.int64), np.full(len(state), -1, dtype=np.int64)
    for i in range(len(begins) - 1):
        group = members[begins[i] : begins[i + 1]]
        if _is_supported(layers, bottom, group, state, group_of, counted, judged):
            open_cases[n_open] = group[0]
            n_open += 1
        elif not is_open_pit(layers, group):
            for layer in group:
                errors[n_errors] = layer
                n_errors += 1
    return errors[:n_errors], open_cases[:n_open]


@kernel
def _gather_groups(layers, seeds, state, group_of):  # type: ignore[no-untyped-def]
    """Return the layers of all small groups that a seed belongs to, and where each begins, and the end."""
    members, begins = np.empty(len(group_of), np.int64), np.zeros(len(seeds) + 1, np.int64)
    n_members, n_groups = 0, 0
    group = np.empty(MAX_GROUP, dtype=np.int64)
    for seed in seeds:
        if state[seed] == UNKNOWN and group_of[seed] < 0:
            n_more = _gather(layers, seed, np.int64(GROUP_REACH), LOW_GAP, state, group_of, group)
            for k in range(n_more):
                members[n_members + k] = group[k]
            if n_more > 0:
                n_members, n_groups = n_members + n_more, n_groups + 1
                begins[n_groups] = n_members
    return members[:n_members], begins[: n_groups + 1]


@kernel
def _gather(layers, seed, reach, gap, state, group_of, members):  # type: ignore[no-untyped-def]
    """Fill `members` with what is connected with a layer; return how many, or −1 if they do not fit."""
    # Layers of columns within `reach` are connected if they are within the `gap` [m], the slope allowed for.
    # `group_of` becomes the seed for each; all of a group that does not fit are marked as LARGE.
    n_members, done = 1, 0
    members[0], group_of[seed] = seed, seed
    while done < n_members:
        layer = members[done]
        done += 1
        k = layers.column[layer]
        for step in range(-reach, reach + 1):
            start, stop = columns_in_row(layers, k, step, reach)
            for other in range(start, stop):
                across = layers.numbers[other] - layers.numbers[k] - step * layers.width
                up = 0.5 * (rise(layers, k, across, step) - rise(layers, other, -across, -step))
                low, high = low_end(layers, layer) + up - gap, high_end(layers, layer) + up + gap
                for j in range(layers.first[other], layers.first[other + 1]):
                    if low_end(layers, j) > high:
                        break
                    if high_end(layers, j) < low or group_of[j] == seed or state[j] == ERROR:
                        continue
                    if group_of[j] >= 0 and state[j] != LARGE:
                        continue  # another group's: rounding connects one way alone
                    if state[j] == LARGE or n_members == len(members):
                        for i in range(n_members):
                            state[members[i]] = LARGE
                        return -1
                    members[n_members], group_of[j] = j, seed
                    n_members += 1
    return n_members


@kernel
def _is_supported(layers, bottom, group, state, group_of, counted, judged):  # type: ignore[no-untyped-def]
    """Whether enough columns around reach down to a group, two of any small group, or too few tell."""
    seed, k = group[0], layers.column[group[0]]
    top = -np.inf
    for layer in group:
        number = layers.numbers[layers.column[layer]]
        east = number % layers.width - layers.numbers[k] % layers.width
        north = number // layers.width - layers.numbers[k] // layers.width
        top = max(top, high_end(layers, layer) - rise(layers, k, east, north))
    slope = math.hypot(layers.gradient[k, 0], layers.gradient[k, 1])
    radius = math.ceil(RADIUS / (1.0 + SHRINKAGE * slope))
    n_level, n_above = 0, 0
    for step in range(-radius, radius + 1):
        start, stop = columns_in_row(layers, k, step, radius)
        for other in range(start, stop):
            b = bottom[other]
            across = layers.numbers[other] - layers.numbers[k] - step * layers.width
            if b < 0 or group_of[b] == seed or across * across + step * step > radius * radius:
                continue
            if low_end(layers, b) - rise(layers, k, across, step) > top + LOW_GAP:
                n_above += 1
            elif state[b] == LARGE or group_of[b] < 0:
                n_level += 1
            else:
                small = group_of[b]
                if judged[small] != seed:
                    judged[small], counted[small] = seed, 0
                counted[small] += 1
                n_level += counted[small] <= MAX_OF_SMALL
            if n_level >= MIN_SUPPORT:
                return True
    return n_above < max(MIN_SUPPORT, MIN_SURROUNDINGS * len(group))


# Chosen with `bench.ground.noise` and the courtyards, pits and shafts of the tests.
#: Points that are not enough to show a pit.
FEW = 3
#: Columns around that the density of points is taken from.
DENSITY_REACH = 6
#: Radius of the disc about each point within which the points above are counted, in point spacings.
DISC = 1.75
#: Share of points above, of all points in those discs, that covers a group.
MIN_COVER = 0.65
#: Over a hole, points above are fewer than a surface has by more than so many standard deviations ...
DEVIATIONS = 1.8
#: ... and are certainly enough at this share of them.
FULL_COVER = 0.8


@kernel
def is_open_pit(layers, group):  # type: ignore[no-untyped-def]
    """
    Whether a group of layers fills its place: hardly a point lies above it that is not at its rim.

    Errors lie scattered among the pulses that reached the surface, however dense they are themselves, so that
    no more of them are counted than the surface would have.
    What is farther above a point than `LOW_GAP` covers it.
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
            above, beside = _count_disc(layers, layers.column[layer], layers.points[i], radius)
            n_cover += above
            n_all += above + min(beside, usual)
    n_surface = usual + len(group) * (layers.size / spacing) ** 2
    enough = min(1.0 - DEVIATIONS / math.sqrt(n_surface), FULL_COVER)
    return n_cover < MIN_COVER * n_all and n_cover < enough * usual * n_points


@kernel
def _spacing_around(layers, group):  # type: ignore[no-untyped-def]
    """Return the spacing of points in the columns around a group, empty ones within rows too [m]."""
    k = layers.column[group[0]]
    n_points, n_columns = 0, 0
    for step in range(-DENSITY_REACH, DENSITY_REACH + 1):
        start, stop = columns_in_row(layers, k, step, DENSITY_REACH)
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
def _count_disc(layers, k, point, radius):  # type: ignore[no-untyped-def]
    """Return how many points of a disc about a point of column k lie above it by the gap, and the rest."""
    above, beside = 0, 0
    reach = math.ceil(radius / layers.size)
    for step in range(-reach, reach + 1):
        start, stop = columns_in_row(layers, k, step, reach)
        for i in range(layers.begin[layers.first[start]], layers.begin[layers.first[stop]]):
            dx, dy = layers.points[i, 0] - point[0], layers.points[i, 1] - point[1]
            if dx * dx + dy * dy > radius * radius:
                continue
            if layers.points[i, 2] > point[2] + LOW_GAP:
                above += 1
            else:
                beside += 1
    return above, beside


# Chosen with `bench.ground.noise` and the scenes of the tests.
#: Most layers of a group, and points of its first: crowns, masts and corners of roofs have more.
MAX_POINTS = 3
#: Columns around that have to be lower: with fewer there is nothing that a group could be above.
MIN_LOWER = 6
#: By what share of the gap those columns are lower.
LOWER_SHARE = 0.7


def find_high_layers(layers: Layers, errors: NDArray[np.bool_], gap: float) -> NDArray[np.bool_]:
    """
    Return which layers are high gross errors: few in the air, farther than the `gap` [m] from all others.

    Layers that are known as low gross errors do not count. The surface has to lie below within `RADIUS`.
    """
    state = np.where(errors, np.uint8(ERROR), np.uint8(UNKNOWN))
    # It starts from small top layers of columns that stand far above what is next to them.
    z = layers.points[:, 2]
    low, high = z[layers.begin[:-1]], z[layers.begin[1:] - 1]
    top = layers.first[1:] - 1
    above = low[top] - high[np.maximum(top - 1, 0)] > gap
    beside = np.zeros(len(top), dtype=np.bool_)
    beside[1:] |= low[top[1:]] - high[top[:-1]] > LOWER_SHARE * gap
    beside[:-1] |= low[top[:-1]] - high[top[1:]] > LOWER_SHARE * gap
    is_small = layers.begin[top + 1] - layers.begin[top] <= MAX_POINTS
    seeds = top[is_small & np.where(top > layers.first[:-1], above, beside)]
    return np.asarray(_judge_high(layers, seeds, state, gap))


@kernel
def _judge_high(layers, seeds, state, gap):  # type: ignore[no-untyped-def]
    """Return which layers are part of a group that is an error, starting from the seeds."""
    high, group_of = np.zeros(len(state), dtype=np.bool_), np.full(len(state), -1, dtype=np.int64)
    members = np.empty(MAX_POINTS, dtype=np.int64)
    reach = math.ceil(gap / layers.size)
    for seed in seeds:
        if state[seed] != UNKNOWN or group_of[seed] >= 0:
            continue
        group = members[: max(_gather(layers, seed, reach, gap, state, group_of, members), 0)]
        if len(group) > 0 and _is_in_the_air(layers, group, state, gap, group_of):
            for layer in group:
                high[layer] = True
    return high


@kernel
def _is_in_the_air(layers, group, state, gap, group_of):  # type: ignore[no-untyped-def]
    low, n_lower = np.inf, 0
    for layer in group:
        low = min(low, low_end(layers, layer))
    for step in range(-RADIUS, RADIUS + 1):
        start, stop = columns_in_row(layers, layers.column[group[0]], step, RADIUS)
        for other in range(start, stop):
            first, j = layers.first[other], layers.first[other + 1] - 1
            while j >= first and (state[j] == ERROR or group_of[j] == group[0]):
                j -= 1
            n_lower += j >= first and high_end(layers, j) < low - LOWER_SHARE * gap
    return n_lower >= max(MIN_LOWER, len(group))


# Chosen with the clouds and towers of `test_noise.py`.
#: Side of the blocks that are looked at, in columns.
BLOCK_COLUMNS = 24
#: Empty air between the surface and what is above it [m]; wide margin: no mast lacks points over so much.
CLOUD_GAP = 200.0
#: Share of a cloud's columns in which the surface is seen as well: towers hide what is below them.
TRANSPARENT = 0.5


def find_cloud_layers(layers: Layers, errors: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """
    Return which layers belong to clouds, block by block.

    In two divisions into blocks, one shifted against the other: the corner of a tower that one cuts off
    looks like a small cloud, but not in both. Layers known as low gross errors do not count.
    """
    if np.ptp(layers.points[:, 2]) <= CLOUD_GAP:
        return np.zeros(len(layers.column), dtype=np.bool_)
    side = BLOCK_COLUMNS * layers.size
    clouds = np.zeros((2, len(layers.column)), dtype=np.bool_)
    for shift, marked in zip((0.0, 0.5 * side), clouds, strict=True):
        blocks = sort_by_cell(layers.points[layers.begin[:-1]] + np.array([shift, shift, 0.0]), side)
        _mark_clouds(layers, errors, blocks.rows, blocks.first, marked)
    return np.asarray(clouds.all(axis=0))


@kernel
def _mark_clouds(layers, errors, rising, first, clouds):  # type: ignore[no-untyped-def]
    """Mark what lies above the lowest gap of each block; `rising` are its layers by lowest point."""
    for block in range(len(first) - 1):
        top = np.inf
        for i in range(first[block], first[block + 1]):
            layer = rising[i]
            if errors[layer]:
                continue
            if low_end(layers, layer) - top > CLOUD_GAP and _is_transparent(
                layers, errors, rising[first[block] : first[block + 1]], low_end(layers, layer)
            ):
                for j in range(i, first[block + 1]):
                    clouds[rising[j]] = True
                break
            top = high_end(layers, layer) if top == np.inf else max(top, high_end(layers, layer))


@kernel
def _is_transparent(layers, errors, block, split):  # type: ignore[no-untyped-def]
    n_upper, n_both = 0, 0
    for layer in block:
        if errors[layer] or low_end(layers, layer) < split:
            continue
        lowest = layers.first[layers.column[layer]]
        if layer == lowest or low_end(layers, layer - 1) < split:
            n_upper += 1
            n_both += layer > lowest and not errors[layer - 1]
    return n_both >= TRANSPARENT * n_upper
