"""Lines extended to what stops them, and noded with snap rounding on the output grid."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.neighbours.few_rows import rows_by_group, sort_rows
from lidar_buildings.core.solids.output_grid import GRID

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


#: Units of the output grid per metre.
_SCALE = round(1.0 / GRID)
#: Segments go on so far behind what they pass: walls and segments that near are at one place [m].
_PAST = 0.01
#: So near behind what they pass segments run on to a wall [m]: the shortest walls are as long.
_NEAR_WALL = 1.0


def extend_segments(segments: FloatArray, walls: FloatArray, n_steps: int = 0) -> FloatArray:
    """
    Extend segments at both ends to the nearest other segment or wall, steps past it to the one behind.

    Whether a cut is used is decided later; a segment that ends too early would not cut at all. Where steps,
    the first `n_steps`, lie a little beside one another, each has to run on beside the other to be the one
    that is chosen. To a wall just behind what they pass all run on: where planes meet in a point near the
    eave, nothing else would part them beyond it.
    """
    if not len(segments):
        return segments
    obstacles = np.concatenate([segments, walls]).reshape(-1, 4)
    extended = np.empty((len(segments), 4))
    tiles, start, items = in_tiles(obstacles)
    _extend(obstacles, tiles, start, items, n_steps, extended)
    return extended.reshape(-1, 2, 2)


def node_segments(walls: FloatArray, segments: FloatArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """
    Cut segments at one another with snap rounding (Hobby 1999).

    Every end and every crossing is rounded to the grid, and each segment runs through all such positions
    whose square of the grid it passes.

    Parameters
    ----------
    walls : ndarray of shape (n_walls, 2, 2)
        Edges of the outline, what it encloses on their left [m].
    segments : ndarray of shape (n_segments, 2, 2)
        Further lines [m].

    Returns
    -------
    vertices : ndarray of shape (n_vertices, 2), int64
        In units of the grid, by rising x, then y.
    edges : ndarray of shape (n_edges, 2), int64
        Rows of both ends, the lower one first; in rising order, each once.
    enclosed : ndarray of shape (n_edges,), int64
        1 where the outline lies to the left of the edge, -1 to the right, 0 on both sides or on none.
    corners : ndarray of int64
        Rows of the outline's vertices, some of them repeated.
    """
    vertices, edges, enclosed, row = _node(np.concatenate([walls, segments]).reshape(-1, 4), len(walls))
    return vertices, edges, enclosed, row[: 2 * len(walls)]


@kernel
def _node(lines, n_walls):  # type: ignore[no-untyped-def]
    """Return vertices, edges, how the outline lies to them, and the vertices of the lines' ends."""
    tiles, start, items = in_tiles(lines)
    crossings = np.empty((8 * len(lines) + 16, 2), np.int64)
    n_crossings = _cross(lines, tiles, start, items, crossings)
    if n_crossings > len(crossings):
        crossings = np.empty((n_crossings, 2), np.int64)
        _cross(lines, tiles, start, items, crossings)
    n_ends = 2 * len(lines)
    size = n_ends + n_crossings
    x, y, keys, rows = (
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.arange(size),
    )
    for i in range(n_ends):
        x[i] = math.floor(lines[i >> 1, 2 * (i & 1)] * _SCALE + 0.5)
        y[i] = math.floor(lines[i >> 1, 2 * (i & 1) + 1] * _SCALE + 0.5)
    for k in range(n_crossings):
        x[n_ends + k], y[n_ends + k] = crossings[k, 0], crossings[k, 1]
    west, south = x[0], y[0]
    for k in range(size):
        west, south = min(west, x[k]), min(south, y[k])
    for k in range(size):
        keys[k] = ((x[k] - west) << 32) + (y[k] - south)
    sort_rows(keys, rows, size)
    vertices, row, n_vertices = np.empty((size, 2), np.int64), np.empty(size, np.int64), 0
    for k in range(size):
        if k == 0 or keys[k] != keys[k - 1]:
            vertices[n_vertices, 0], vertices[n_vertices, 1] = x[rows[k]], y[rows[k]]
            n_vertices += 1
        row[rows[k]] = n_vertices - 1
    vertices = vertices[:n_vertices]
    chains = np.empty(4 * size + 16, np.int64)
    n_links = _chain(lines, tiles, vertices, row, n_walls, chains)
    if n_links > len(chains):
        chains = np.empty(n_links, np.int64)
        _chain(lines, tiles, vertices, row, n_walls, chains)
    sort_rows(chains, np.arange(n_links), n_links)
    edges, enclosed, n_edges = np.empty((n_links, 2), np.int64), np.zeros(n_links, np.int64), 0
    for k in range(n_links):
        # A link is its edge's key, tripled, and 1 more or less along a wall.
        key = (chains[k] + 1) // 3
        if k == 0 or key != (chains[k - 1] + 1) // 3:
            edges[n_edges, 0], edges[n_edges, 1] = key // n_vertices, key % n_vertices
            n_edges += 1
        enclosed[n_edges - 1] += chains[k] - 3 * key
    for e in range(n_edges):
        enclosed[e] = min(max(enclosed[e], -1), 1)
    return vertices, edges[:n_edges], enclosed[:n_edges], row


@kernel
def _extend(obstacles, tiles, start, items, n_steps, extended):  # type: ignore[no-untyped-def]
    """Write the extended segments, the first of the obstacles; none is an obstacle to itself."""
    for i in range(len(extended)):
        for end in range(2):
            x, y = obstacles[i, 2 * end], obstacles[i, 2 * end + 1]
            dx, dy = x - obstacles[i, 2 - 2 * end], y - obstacles[i, 3 - 2 * end]
            length = np.hypot(dx, dy)
            if length > 0.0:
                dx, dy = dx / length, dy / length
                reach, is_wall = _reach(x, y, dx, dy, i, len(extended), obstacles, tiles, start, items)
                x, y = x + reach * dx, y + reach * dy
                if not is_wall:
                    fx, fy = x + _PAST * dx, y + _PAST * dy
                    reach, is_wall = _reach(fx, fy, dx, dy, i, len(extended), obstacles, tiles, start, items)
                    if i < n_steps or (is_wall and reach < _NEAR_WALL):
                        x, y = fx + reach * dx, fy + reach * dy
            extended[i, 2 * end], extended[i, 2 * end + 1] = x, y


@kernel
def _reach(x, y, dx, dy, own, n_segments, obstacles, tiles, start, items):  # type: ignore[no-untyped-def]
    """
    Return how far a ray runs to the nearest obstacle [m], and whether there is a wall; 0 where none is met.
    """
    side, n_columns, n_rows = tiles[2], int(tiles[3]), int(tiles[4])
    far = side * (n_columns + n_rows)
    ray = np.array([x - SLACK * dx, y - SLACK * dy, x + far * dx, y + far * dy])
    nearest, wall = np.inf, np.inf
    east, north = 1 if dx >= 0.0 else -1, 1 if dy >= 0.0 else -1
    first, last = columns_touched(ray, tiles)
    column = first if east > 0 else last
    while first <= column <= last:
        low, high = rows_touched(ray, column, tiles)
        row = low if north > 0 else high
        while low <= row <= high:
            for at in range(start[column * n_rows + row], start[column * n_rows + row + 1]):
                j = items[at]
                if j == own:
                    continue
                ax, ay = obstacles[j, 0], obstacles[j, 1]
                ex, ey = obstacles[j, 2] - ax, obstacles[j, 3] - ay
                cross = dx * ey - dy * ex
                length = np.hypot(ex, ey)
                if abs(cross) <= 1e-9 * length:
                    continue
                t = ((ax - x) * ey - (ay - y) * ex) / cross
                u = ((ax - x) * dy - (ay - y) * dx) / cross
                slack = SLACK / max(length, SLACK)
                if u < -slack or u > 1.0 + slack or t < -SLACK:
                    continue
                nearest = min(nearest, max(t, 0.0))
                if j >= n_segments:
                    wall = min(wall, max(t, 0.0))
            # What lies in tiles beyond is farther off.
            edge = tiles[1] + (row + (north > 0)) * side
            if (nearest + _PAST) * abs(dy) < (edge - y) * north - MARGIN:
                break
            row += north
        edge = tiles[0] + (column + (east > 0)) * side
        if (nearest + _PAST) * abs(dx) < (edge - x) * east - MARGIN:
            break
        column += east
    return (nearest, wall <= nearest + _PAST) if nearest < np.inf else (0.0, True)


@kernel
def _cross(lines, tiles, start, items, crossings):  # type: ignore[no-untyped-def]
    """Write the rounded crossings of lines as far as there is room; return how many there are."""
    n, n_columns, n_rows = 0, int(tiles[3]), int(tiles[4])
    for tile in range(len(start) - 1):
        for one in range(start[tile], start[tile + 1]):
            i = items[one]
            x, y = lines[i, 0], lines[i, 1]
            dx, dy = lines[i, 2] - x, lines[i, 3] - y
            for other in range(one + 1, start[tile + 1]):
                j = items[other]
                ax, ay = lines[j, 0], lines[j, 1]
                ex, ey = lines[j, 2] - ax, lines[j, 3] - ay
                cross = dx * ey - dy * ex
                # Lines on one another have their ends in common, not a place that rounding picks.
                if cross * cross <= 1e-18 * (dx * dx + dy * dy) * (ex * ex + ey * ey):
                    continue
                t = ((ax - x) * ey - (ay - y) * ex) / cross
                u = ((ax - x) * dy - (ay - y) * dx) / cross
                if not (0.0 <= t <= 1.0 and 0.0 <= u <= 1.0):
                    continue
                px, py = x + t * dx, y + t * dy
                column = tile_of(px, tiles[0], tiles[2], n_columns)
                if column * n_rows + tile_of(py, tiles[1], tiles[2], n_rows) != tile:
                    continue
                if n < len(crossings):
                    crossings[n, 0] = math.floor(px * _SCALE + 0.5)
                    crossings[n, 1] = math.floor(py * _SCALE + 0.5)
                n += 1
    return n


@kernel
def _chain(lines, tiles, vertices, row, n_walls, chains):  # type: ignore[no-untyped-def]
    """Write the links of all lines by way of the vertices whose squares they pass; return how many."""
    n_rows = int(tiles[4])
    tile = np.empty(len(vertices), np.int64)
    for v in range(len(vertices)):
        column = tile_of(vertices[v, 0] / _SCALE, tiles[0], tiles[2], int(tiles[3]))
        tile[v] = column * n_rows + tile_of(vertices[v, 1] / _SCALE, tiles[1], tiles[2], n_rows)
    items, start = rows_by_group(tile, int(tiles[3]) * n_rows)
    passed = np.empty(len(vertices), np.int64)
    along = np.empty(len(vertices))
    n = 0
    for i in range(len(lines)):
        x, y = lines[i, 0] * _SCALE, lines[i, 1] * _SCALE
        dx, dy = lines[i, 2] * _SCALE - x, lines[i, 3] * _SCALE - y
        begin, end = row[2 * i], row[2 * i + 1]
        if begin == end:
            continue
        west, east, south, north = min(0.0, dx), max(0.0, dx), min(0.0, dy), max(0.0, dy)
        half = 0.5 * (abs(dx) + abs(dy)) * (1.0 - 1e-9)
        count = 0
        first, last = columns_touched(lines[i], tiles)
        for column in range(first, last + 1):
            low, high = rows_touched(lines[i], column, tiles)
            for at in range(start[column * n_rows + low], start[column * n_rows + high + 1]):
                v = items[at]
                px, py = vertices[v, 0] - x, vertices[v, 1] - y
                if abs(dx * py - dy * px) >= half or v in (begin, end):
                    continue
                if px < west - 0.5 or px > east + 0.5 or py < south - 0.5 or py > north + 0.5:
                    continue
                t = px * dx + py * dy
                k = count
                while k > 0 and along[k - 1] > t:
                    along[k], passed[k] = along[k - 1], passed[k - 1]
                    k -= 1
                along[k], passed[k] = t, v
                count += 1
        passed[count] = end
        here = begin
        for k in range(count + 1):
            there = passed[k]
            if n < len(chains):
                chains[n] = 3 * (min(here, there) * len(vertices) + max(here, there))
                if i < n_walls:
                    chains[n] += 1 if here < there else -1
            n += 1
            here = there
    return n
