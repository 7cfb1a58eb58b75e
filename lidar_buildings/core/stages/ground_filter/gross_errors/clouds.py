"""Clouds and flocks: any number of points so far above the surface that nothing built reaches them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.ground_filter.gross_errors.noise_layers import Layers, high_end, low_end

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


@inner_kernel
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
