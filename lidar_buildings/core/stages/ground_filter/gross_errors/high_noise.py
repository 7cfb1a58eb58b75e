"""High gross errors: birds and the like, alone in the air, and clouds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.ground_filter.gross_errors.noise_layers import (
    Layers,
    columns_in_row,
    high_end,
    low_end,
)

# Chosen with `bench.ground.noise` and the scenes of the tests.
#: Most points of a group: crowns, masts and the corners of roofs that a tile cuts off have more.
MAX_POINTS = 3
#: Columns around that have to be lower: with fewer there is nothing that a group could be above.
MIN_LOWER = 6
#: By what share of the gap those columns are lower.
LOWER_SHARE = 0.7
# Chosen with the clouds and towers of `test_noise.py`.
#: Side of the blocks that are looked at, in columns.
BLOCK_COLUMNS = 24
#: Empty air between the surface and what is above it [m]; wide margin: no mast lacks points over so much.
CLOUD_GAP = 200.0
#: Share of a cloud's columns in which the surface is seen as well: towers hide what is below them.
TRANSPARENT = 0.5


def find_high_layers(layers: Layers, errors: NDArray[np.bool_], gap: float, radius: int) -> NDArray[np.bool_]:
    """
    Return which layers are high gross errors: few points in the air, farther than a gap from everything.

    Layers, split at less than the `gap` [m], that are known as low gross errors do not count. The surface has
    to lie below within `radius` columns.
    """
    return _judge_groups(layers, _isolated(layers, gap), errors, gap, radius)


def _isolated(layers: Layers, gap: float) -> NDArray[np.int64]:
    """Return the columns' top layers that are small and stand far above what is next to them."""
    z = layers.points[:, 2]
    low, high = z[layers.begin[:-1]], z[layers.begin[1:] - 1]
    top = layers.first[1:] - 1
    above = low[top] - high[np.maximum(top - 1, 0)] > gap
    beside = np.zeros(len(top), dtype=np.bool_)
    beside[1:] |= low[top[1:]] - high[top[:-1]] > LOWER_SHARE * gap
    beside[:-1] |= low[top[:-1]] - high[top[1:]] > LOWER_SHARE * gap
    is_small = layers.begin[top + 1] - layers.begin[top] <= MAX_POINTS
    return top[is_small & np.where(top > layers.first[:-1], above, beside)]


@kernel
def _judge_groups(layers, seeds, errors, gap, radius):  # type: ignore[no-untyped-def]
    """Return which layers are part of a group that is an error, starting from the seeds."""
    high = np.zeros(len(layers.column), dtype=np.bool_)
    group_of = np.full(len(layers.column), -1, dtype=np.int64)
    is_large = np.zeros(len(layers.column), dtype=np.bool_)
    members = np.empty(MAX_POINTS, dtype=np.int64)
    for seed in seeds:
        if errors[seed] or is_large[seed] or group_of[seed] >= 0:
            continue
        n_members = _gather_group(layers, seed, errors, gap, group_of, is_large, members)
        group = members[: max(n_members, 0)]
        if n_members > 0 and _is_in_the_air(layers, group, errors, gap, radius, group_of):
            for layer in group:
                high[layer] = True
    return high


@kernel
def _gather_group(layers, seed, errors, gap, group_of, is_large, members):  # type: ignore[no-untyped-def]
    """
    Fill `members` with what is within the gap of a layer, and so on; return how many, −1 if it is too much.
    """
    n_members, done, n_points = 1, 0, layers.begin[seed + 1] - layers.begin[seed]
    members[0], group_of[seed] = seed, seed
    reach = math.ceil(gap / layers.size)
    while done < n_members:
        layer = members[done]
        done += 1
        k = layers.column[layer]
        for step in range(-reach, reach + 1):
            start, stop = columns_in_row(layers, k, step, reach)
            for other in range(start, stop):
                across = layers.numbers[other] - layers.numbers[k] - step * layers.width
                upright = gap * gap - layers.size * layers.size * (across * across + step * step)
                if upright < 0.0:
                    continue
                low = low_end(layers, layer) - math.sqrt(upright)
                high = high_end(layers, layer) + math.sqrt(upright)
                for j in range(layers.first[other], layers.first[other + 1]):
                    if low_end(layers, j) > high:
                        break
                    if high_end(layers, j) < low or group_of[j] == seed or errors[j]:
                        continue
                    n_points += layers.begin[j + 1] - layers.begin[j]
                    if is_large[j] or n_points > MAX_POINTS:
                        for i in range(n_members):
                            is_large[members[i]] = True
                        return -1
                    members[n_members], group_of[j] = j, seed
                    n_members += 1
    return n_members


@kernel
def _is_in_the_air(layers, group, errors, gap, radius, group_of):  # type: ignore[no-untyped-def]
    seed = group[0]
    low = np.inf
    for layer in group:
        low = min(low, low_end(layers, layer))
    k, n_lower = layers.column[seed], 0
    for step in range(-radius, radius + 1):
        start, stop = columns_in_row(layers, k, step, radius)
        for other in range(start, stop):
            first, j = layers.first[other], layers.first[other + 1] - 1
            while j >= first and (errors[j] or group_of[j] == seed):
                j -= 1
            n_lower += j >= first and high_end(layers, j) < low - LOWER_SHARE * gap
    return n_lower >= max(MIN_LOWER, len(group))


def find_cloud_layers(layers: Layers, errors: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """
    Return which layers belong to clouds, block by block.

    In two divisions into blocks, one shifted against the other: the corner of a tower that one cuts off
    looks like a small cloud, but not in both. Layers known as low gross errors do not count.
    """
    if np.ptp(layers.points[:, 2]) <= CLOUD_GAP:
        return np.zeros(len(layers.column), dtype=np.bool_)
    side = BLOCK_COLUMNS * layers.size
    lowest = layers.points[layers.begin[:-1]]
    shifted = lowest + np.array([0.5 * side, 0.5 * side, 0.0])
    clouds = _clouds_of_blocks(layers, errors, lowest, side)
    return clouds & _clouds_of_blocks(layers, errors, shifted, side)


def _clouds_of_blocks(
    layers: Layers, errors: NDArray[np.bool_], lowest: NDArray[np.float64], side: float
) -> NDArray[np.bool_]:
    clouds = np.zeros(len(layers.column), dtype=np.bool_)
    blocks = sort_by_cell(lowest, side)
    _mark_clouds(layers, errors, blocks.rows, blocks.first, clouds)
    return clouds


@kernel
def _mark_clouds(layers, errors, rising, first, clouds):  # type: ignore[no-untyped-def]
    """
    Mark what lies above the lowest gap of each block that divides surface and clouds.

    `rising` holds the layers block by block, in each by their lowest point.
    """
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
