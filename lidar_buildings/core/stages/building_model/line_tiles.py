"""Square tiles over lines in plan, and which lines each of them may touch."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel

#: An end that misses an obstacle by so little meets it: less than a line moves by rounding [m].
SLACK = 1e-3
#: What lies so near beside a tile may be met in it [m].
MARGIN = 2.0 * SLACK
#: Side of a tile, as a share of the side at which there are as many tiles as lines.
_SIDE = 0.35


@kernel
def tile_of(position, west, side, n):  # type: ignore[no-untyped-def]
    """Return which of n tiles from `west` on holds a position; the first or last one beyond them."""
    return min(max(int((position - west) / side), 0), n - 1)


@kernel
def rows_touched(line, column, tiles):  # type: ignore[no-untyped-def]
    """Return the first and the last tile that a line may touch in a column."""
    x0, y0, x1, y1 = line[0], line[1], line[2], line[3]
    west = tiles[0] + column * tiles[2] - MARGIN
    east = west + tiles[2] + 2.0 * MARGIN
    low, high = min(y0, y1), max(y0, y1)
    if abs(x1 - x0) > MARGIN:
        slope = (y1 - y0) / (x1 - x0)
        one, other = y0 + slope * (west - x0), y0 + slope * (east - x0)
        low, high = max(low, min(one, other)), min(high, max(one, other))
    n = int(tiles[4])
    return tile_of(low - MARGIN, tiles[1], tiles[2], n), tile_of(high + MARGIN, tiles[1], tiles[2], n)


@kernel
def columns_touched(line, tiles):  # type: ignore[no-untyped-def]
    """Return the first and the last column of tiles that a line may touch."""
    n = int(tiles[3])
    west = tile_of(min(line[0], line[2]) - MARGIN, tiles[0], tiles[2], n)
    return west, tile_of(max(line[0], line[2]) + MARGIN, tiles[0], tiles[2], n)


@kernel
def in_tiles(lines):  # type: ignore[no-untyped-def]
    """
    Return tiles over lines, and which lines touch each.

    The latter as where each tile, column by column, begins in the numbers of lines, and these.
    """
    west, south, width, height = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(lines)):
        west, south = min(west, lines[i, 0], lines[i, 2]), min(south, lines[i, 1], lines[i, 3])
        width, height = max(width, lines[i, 0], lines[i, 2]), max(height, lines[i, 1], lines[i, 3])
    width, height = width - west, height - south
    side = max(_SIDE * math.sqrt(width * height / len(lines)), max(width, height) / 1000.0, 10.0 * MARGIN)
    tiles = np.array([west, south, side, math.floor(width / side) + 1.0, math.floor(height / side) + 1.0])
    n_rows = int(tiles[4])
    start = np.zeros(int(tiles[3]) * n_rows + 1, np.int64)
    items = np.empty(0, np.int64)
    for turn in range(2):
        if turn == 1:
            for k in range(1, len(start)):
                start[k] += start[k - 1]
            items = np.empty(start[-1], np.int64)
        for i in range(len(lines) - 1, -1, -1):
            first, last = columns_touched(lines[i], tiles)
            for column in range(first, last + 1):
                low, high = rows_touched(lines[i], column, tiles)
                for k in range(column * n_rows + low, column * n_rows + high + 1):
                    if turn == 0:
                        start[k] += 1
                    else:
                        start[k] -= 1
                        items[start[k]] = i
    return tiles, start, items
