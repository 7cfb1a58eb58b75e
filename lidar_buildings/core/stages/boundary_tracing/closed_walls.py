"""
The outline of a building of which walls were seen, but not the roof over all that they enclose.

A scanner on the street sees the walls that face it and the slope of a roof at most. Walls of one building
go in two directions at right angles; their lines divide the rectangle around all that was seen into boxes,
and a box is part of the building unless the ground in it was seen.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import Outline

#: Side of the cells in which walls count, however many points a cell has [m].
WALL_CELL = 0.1
#: Side of the cells in which ground and roofs count [m].
GROUND_CELL = 0.5
#: How far from a wall's line its points lie [m].
WALL_REACH = 0.3
#: Length of wall on a line, less of which is no corner of its own [m].
MIN_WALL = 1.5
#: Share of the cells on walls about which these go in one of the two directions; less is round or winding.
MIN_STRAIGHT = 0.75
#: A box of which a larger share is ground is not part of the building.
MAX_GROUND = 0.25
#: Smallest share within an outline of what was not seen at all: with less of it the roof tells the outline.
#: From the street one slope of a roof is seen at most, from above all but what a tree hides.
MIN_UNSEEN = 0.25
#: Length of an outline along which walls have to be bare: it is by these that the roof is known to go on [m].
MIN_BARE = 3.0
#: Narrower parts are no building: garden walls, and sides of which hardly anything was seen [m].
MIN_WIDTH = 3.0
#: How far from all that was seen of a building its outline may lie: what is deeper may be a yard [m].
MAX_DEPTH = 25.0
#: What is within this distance of an outermost wall does not reach beyond it: eaves [m].
_EAVES = 1.0
#: Side of the steps in which an outline is asked for what was seen of it [m].
_STEP = 0.25
#: Cells within which those of a far wall are taken for one piece.
_APART = 5
#: Cells that a piece of a line has at least: 1 m.
_RUN = 10
#: Cells within which there is one line, 1 m: set-backs that are less are not told from windows and cornices.
_AWAY = 10
#: How far about a cell its neighbours tell in which direction the wall goes: beyond its noise, and to the
#: next turn of a scanner that drives by [m].
_ABOUT = 0.6
#: Largest angle between a wall and the direction in which it goes [rad].
_ASLANT = np.deg2rad(15.0)
#: Cells of a wall that are asked for the direction, at most.
_MOST_ASKED = 5_000
_COARSE, _FINE = np.deg2rad(1.0), np.deg2rad(0.1)


def close_walls(
    walls: NDArray[np.float64],
    bare: NDArray[np.float64],
    roofs: NDArray[np.float64],
    ground: NDArray[np.float64],
) -> list[Outline]:
    """
    Close the outlines of buildings behind the walls that were seen.

    Cells are given by their middles, shape (n_cells, 2) [m]: those of `WALL_CELL` on connected `walls`, at
    least one, and the `bare` ones of them over which no roof was seen; those of `GROUND_CELL` on `roofs`, and
    those in which `ground` was seen, around the building and farther away. There is more than one outline
    where something narrow joins them; none where walls enclose nothing, those of one side alone and winding
    ones, or something deeper than `MAX_DEPTH`, and where the roof was seen.
    """
    angle = _direction(walls)
    # What rows of x and y are multiplied by to see this direction as the x axis.
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    walls, bare, roofs, ground = (cells @ turn for cells in (walls, bare, roofs, ground))
    lines = [_lines(walls[:, k], walls[:, 1 - k]) for k in (0, 1)]
    if not all(map(len, lines)) or _straight_share(walls) < MIN_STRAIGHT:
        return []
    seen = np.concatenate([walls, roofs])
    edges = [_with_ends(own, across) for own, across in zip(lines, seen.T, strict=True)]
    ground = _within_boxes(ground, edges)
    within = np.concatenate([roofs, ground])
    shapes = [one for one in _wide_parts(edges, ground) if _is_closed(one, seen, bare, within)]
    # Corners alone would be too few for what follows: it takes an outline for points along walls.
    walked = shapely.transform(shapely.segmentize(shapes, _STEP), lambda xy: xy @ turn.T)
    return [Outline.of(one) for one in walked]


def _is_closed(
    shape: shapely.Polygon, seen: NDArray[np.float64], bare: NDArray[np.float64], within: NDArray[np.float64]
) -> bool:
    n_seen = np.count_nonzero(shapely.contains_xy(shape, within))
    if n_seen * GROUND_CELL**2 > (1.0 - MIN_UNSEEN) * shape.area:
        return False
    by_bare = np.count_nonzero(_distances(shape, bare) <= GROUND_CELL) * _STEP
    return bool(_distances(shape, seen).max() <= MAX_DEPTH and by_bare >= MIN_BARE)


def _direction(walls: NDArray[np.float64]) -> float:
    """Return the angle along and across which most cells lie on lines [rad]."""
    x, y = walls[:: len(walls) // _MOST_ASKED + 1].T

    def on_lines(angle: float) -> float:
        c, s = np.cos(angle), np.sin(angle)
        counts = (np.bincount(_bins(across)) for across in (c * x + s * y, c * y - s * x))
        return float(sum(np.square(n, dtype=float).sum() for n in counts))

    coarse = max(np.arange(0.0, np.pi / 2, _COARSE), key=on_lines)
    return float(max(coarse + np.arange(-10, 11) * _FINE, key=on_lines))


def _bins(offset: NDArray[np.float64]) -> NDArray[np.int64]:
    return ((offset - offset.min()) / WALL_CELL).astype(np.int64)


def _lines(across: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offsets of the lines that hold enough of a wall, rising [m]."""
    half, lowest = round(WALL_REACH / WALL_CELL), across.min()
    place = (_bins(across), _bins(along))
    held = np.zeros([rows.max() + 1 for rows in place], dtype=np.uint8)
    held[place] = 1
    # Cells of far walls are apart, and what crosses a line is on it for little more than its own width.
    held = ndimage.maximum_filter1d(ndimage.maximum_filter1d(held, 2 * half - 1, axis=0), _APART, axis=1)
    length = ndimage.binary_opening(held, np.ones((1, _RUN))).sum(axis=1) * WALL_CELL
    found = []
    while length.max() >= MIN_WALL:
        top = int(length.argmax())
        middle = lowest + (top + 0.5) * WALL_CELL
        found.append(float(np.median(across[np.abs(across - middle) <= WALL_REACH])))
        length[max(0, top - _AWAY) : top + _AWAY + 1] = 0.0
    return np.sort(found)


def _straight_share(walls: NDArray[np.float64]) -> float:
    """Return the share of cells about which walls go along either axis, of those with others about them."""
    one, other = cKDTree(walls).query_pairs(_ABOUT, output_type="ndarray").T
    doubled = ((walls[other] - walls[one]) @ (1, 1j)) ** 2
    both = np.concatenate([one, other])
    along, aslant = (np.bincount(both, np.tile(part, 2), len(walls)) for part in (doubled.real, doubled.imag))
    has_others = np.bincount(both, minlength=len(walls)) > 0
    is_straight = has_others & (np.abs(aslant) <= np.tan(2.0 * _ASLANT) * np.abs(along))
    return float(np.mean(is_straight[has_others])) if has_others.any() else 0.0


def _with_ends(lines: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return lines with the limits of what was seen beyond the outermost ones, all across one axis."""
    low, high = seen.min(), seen.max()
    before = [low] if low < lines[0] - _EAVES else []
    return np.array([*before, *lines, *([high] if high > lines[-1] + _EAVES else [])])


def _within_boxes(cells: NDArray[np.float64], edges: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the cells that lie within one box alone, whatever the angle between cells and lines."""
    is_within = np.ones(len(cells), dtype=bool)
    for across, own in zip(cells.T, edges, strict=True):
        behind = np.searchsorted(own, across)
        is_within &= (behind > 0) & (behind < len(own))
        ends = own[np.clip([behind - 1, behind], 0, len(own) - 1)]
        is_within &= np.abs(ends - across).min(axis=0) > np.sqrt(0.5) * GROUND_CELL
    return cells[is_within]


def _wide_parts(edges: list[NDArray[np.float64]], ground: NDArray[np.float64]) -> list[shapely.Polygon]:
    """Return the wide parts of what the boxes between lines cover that are not ground, the largest first."""
    of_ground = np.histogram2d(ground[:, 0], ground[:, 1], bins=(edges[0], edges[1]))[0]
    most = MAX_GROUND / GROUND_CELL**2 * np.outer(*map(np.diff, edges))
    i, j = np.nonzero(of_ground <= most)
    boxes = shapely.box(edges[0][i], edges[1][j], edges[0][i + 1], edges[1][j + 1])
    half = 0.5 * MIN_WIDTH
    wide = shapely.buffer(shapely.union_all(boxes), -half, join_style="mitre")
    parts = shapely.get_parts(shapely.buffer(wide, half, join_style="mitre"))
    return sorted((one for one in parts if one.area > 0.0), key=lambda one: -one.area)


def _distances(shape: shapely.Polygon, cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far from the nearest of some cells each step along a shape's rings is [m]."""
    along = shapely.line_interpolate_point(shape.boundary, np.arange(0.0, shape.length, _STEP))
    return cKDTree(cells).query(shapely.get_coordinates(along))[0]
