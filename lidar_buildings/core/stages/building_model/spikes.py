"""Corners of roofs that no point explains, and what keeps roofs from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.array_types import FloatArray, IntArray
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, area_vector
from lidar_buildings.core.stages.building_model.cell_costs import AROUND, STEEP, by_square, heights_near
from lidar_buildings.core.stages.building_model.cells import Cells

#: A corner may lie so far above or below the points around, besides slope × spacing [m].
MARGIN = 0.5
#: Plan of a face that is upright [m²].
_LEAST_PLAN = 1e-9


class Spike(NamedTuple):
    """A vertex that no point explains."""

    xyz: tuple[float, float, float]
    excess: float  #: beyond what may be [m], below if negative


def spikes_of(solid: Solid, points: FloatArray, spacing: float) -> Iterator[Spike]:
    """
    Yield the corners of a solid's roof that lie too far above or below the points near (all if none is).

    `points` (n, 3), one at least, are on the roof, about `spacing` apart [m].
    """
    slopes: dict[int, float] = {}
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        if kind == ROOF_SURFACE:
            x, y, z = area_vector(solid.face_rings(face))
            slope = math.hypot(x, y) / max(abs(z), _LEAST_PLAN)
            for row in chain(*face):
                slopes[row] = min(slope, slopes.get(row, np.inf))
    near = by_square(points, AROUND * spacing)
    corners = solid.vertices[list(slopes)]
    ends = zip(*heights_near(corners, near, AROUND * spacing), strict=True)
    for slope, (x, y, z), (low, high) in zip(slopes.values(), corners.tolist(), ends, strict=True):
        low, high = (low, high) if low <= high else near[3]
        allowed = MARGIN + slope * spacing
        excess = max(z - high - allowed, 0.0) + min(z - low + allowed, 0.0)
        if excess:
            yield Spike((x, y, z), excess)


#: What is kept of the margin, as vertices are rounded, and of how far points are near, as they are drawn back
#: where walls would meet in them [m].
_ROUNDING, _MOVED = 0.02, 0.012
#: Corners of faces at one place and nearer in height are one [m].
ONE_HEIGHT = 0.01
#: Cuts run on so far behind the border of a cell, and are so far from what they part at least [m].
_PAST, _LEAST_GAP = 0.005, 0.05
#: A cell so near to a place has it as a corner [steps of the grid].
_NEAR = 2.0
#: Cuts are tried at these shares of the way, from the middle on.
_TRIED = np.array(sorted(np.linspace(0.0, 1.0, 33)[1:-1], key=lambda share: abs(share - 0.5)))


@kernel
def level_limits(places, near, spacing):  # type: ignore[no-untyped-def]
    """Return how low and how high a level roof may be at places (n, 2), by the points `near` [m]."""
    low, high = heights_near(places, near, AROUND * spacing - _MOVED)
    for i in range(len(places)):
        for moved in (0.0, _MOVED):
            if low[i] > high[i]:
                lowest, highest = heights_near(places[i : i + 1], near, AROUND * spacing + moved)
                low[i], high[i] = lowest[0], highest[0]
        if low[i] > high[i]:
            low[i], high[i] = near[3]
    return low - MARGIN + _ROUNDING, high + MARGIN - _ROUNDING


@inner_kernel
def is_left(z, slope, low, high, spacing, floor):  # type: ignore[no-untyped-def]
    """Tell whether no point explains a roof of a height and a slope; limits are those of `level_limits`."""
    rise = spacing * min(slope, STEEP)
    lowest = max(low - rise, floor) if low > floor else low - rise
    return z > high + rise or z < lowest


@kernel
def _are_left(z, slope, low, high, spacing, floor):  # type: ignore[no-untyped-def]
    found = np.empty(z.shape, np.bool_)
    for k in range(len(z)):
        for i in range(len(low)):
            found[k, i] = is_left(z[k, i], slope[k, i], low[i], high[i], spacing, floor)
    return found


class Limits(NamedTuple):
    """How high and how low corners of a roof may be; `limits_of` gives them."""

    near: tuple[Any, ...]  #: points on the roof, as `by_square` gives them
    spacing: float  #: [m]
    floor: float  #: no roof lies lower, but where points do [m]

    def are_left(self, places: FloatArray, z: FloatArray, slope: FloatArray) -> NDArray[np.bool_]:
        """Tell which roofs of a height and a slope no point explains at places, both (n,) or (n_roofs, n)."""
        low, high = level_limits(places, self.near, self.spacing)
        roofs = np.atleast_2d(z), np.atleast_2d(slope)
        return np.asarray(_are_left(*roofs, low, high, self.spacing, self.floor)).reshape(z.shape)

    def not_allowed(self, cells: Cells, planes: FloatArray, corners: FloatArray) -> NDArray[np.bool_]:
        """Tell which planes no point explains at a corner (x, y, slope) of a cell, (n_cells, n_planes)."""
        places, slope = corners[:, :2], np.hypot(planes[:, 0], planes[:, 1])[:, None]
        z = planes[:, :2] @ places.T + planes[:, 2:]
        left = self.are_left(places, z, np.minimum(slope, corners[:, 2]))
        found = np.zeros((len(cells), len(planes)), np.bool_)
        corner, cell = shapely.STRtree(cells.polygons).query(
            shapely.points(places / GRID), predicate="dwithin", distance=_NEAR
        )
        np.logical_or.at(found, cell, left.T[corner])
        return found

    def corners_left(
        self, cells: Cells, planes: FloatArray, vertices: IntArray
    ) -> tuple[IntArray, FloatArray]:
        """
        Return the cells at which corners of faces lie where no point explains them, and x, y and slope there.

        `planes` (n_cells, 3) are the cells' own, `vertices` the rows of those that faces have. Where planes
        cross on a border there is a corner, too; at one that faces share the least of their slopes counts.
        """
        vertex, cell = cells.borders[:, [0, 0, 1, 1]].ravel(), cells.sides[:, [0, 1, 0, 1]].ravel()
        is_corner = (cell >= 0) & np.isin(vertex, vertices)
        vertex, cell = np.divmod(np.unique((vertex * len(cells) + cell)[is_corner]), len(cells))
        places = cells.vertices[vertex]
        sides = cells.sides[(cells.sides >= 0).all(axis=1)]
        ends = cells.vertices[cells.borders[(cells.sides >= 0).all(axis=1)]]
        apart = planes[sides[:, 0]] - planes[sides[:, 1]]
        apart = np.einsum("ij,ikj->ik", apart[:, :2], ends) + apart[:, 2:]
        crosses = apart[:, 0] * apart[:, 1] < 0.0
        share = apart[crosses, :1] / (apart[crosses, :1] - apart[crosses, 1:])
        between = ends[crosses, 0] + share * (ends[crosses, 1] - ends[crosses, 0])
        vertex = np.append(vertex, np.repeat(len(cells.vertices) + np.arange(len(between)), 2))
        cell = np.append(cell, sides[crosses])
        places = np.concatenate([places, np.repeat(between, 2, axis=0)])
        own = planes[cell]
        z, slope = np.einsum("ij,ij->i", own[:, :2], places) + own[:, 2], np.hypot(own[:, 0], own[:, 1])
        order = np.lexsort((z, vertex))
        is_first = np.diff(vertex[order], prepend=-1) > 0
        is_first |= np.diff(z[order], prepend=-np.inf) > ONE_HEIGHT
        slope[order] = np.minimum.reduceat(slope[order], np.flatnonzero(is_first))[np.cumsum(is_first) - 1]
        left = self.are_left(places, z, slope)
        return cell[left], np.column_stack([places, slope])[left]

    def level(
        self, cell: shapely.Polygon, points: FloatArray, left: FloatArray
    ) -> tuple[list[FloatArray], list[float]]:
        """Return segments that cut a cell, or a height allowed at its corners, and those left [m]."""
        is_its = shapely.dwithin(cell, shapely.points(left[:, :2] / GRID), _NEAR)
        ring = np.concatenate([shapely.get_coordinates(cell) * GRID, left[is_its, :2]])
        lows, highs = level_limits(ring, self.near, self.spacing)
        low, high = float(lows.max()), float(highs.min())
        if low > high:
            return self.cut_off(cell, ring[[np.argmax(lows)]], ring[np.argmin(highs)]), []
        return [], [float(np.clip(np.median(points[:, 2]) if len(points) else 0.5 * (low + high), low, high))]

    def cut_off(self, cell: shapely.Polygon, seen: FloatArray, corner: FloatArray) -> list[FloatArray]:
        """
        Return segments (2, 2) that part a corner of a cell from places seen, along the edge that does best.

        They end where the heights of points near differ most: there a step may be. None if no edge does.
        """
        ring = shapely.get_coordinates(cell.exterior) * GRID
        along = np.diff(ring, axis=0)
        out = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
        out = np.concatenate([out, -out])
        last = (seen @ out.T).max(axis=0)
        gaps = out @ corner - last
        best = int(np.argmax(gaps))
        if gaps[best] < _LEAST_GAP:
            return []
        to, across = out[best], np.array([-out[best, 1], out[best, 0]])
        at = last[best] + gaps[best] * _TRIED
        size, middle = np.ptp(ring, axis=0).sum() * across, ring.mean(axis=0)
        middles = middle + (at - middle @ to)[:, None] * to
        lines = shapely.linestrings(np.stack([middles - size, middles + size], axis=1) / GRID)
        whole, number = shapely.get_parts(shapely.intersection(cell, lines), return_index=True)
        whole, number = whole[shapely.length(whole) > 1.0], number[shapely.length(whole) > 1.0]
        if not len(whole):
            return []
        parts = shapely.get_coordinates(whole).reshape(-1, 2, 2) * GRID
        low, high = level_limits(parts.reshape(-1, 2), self.near, self.spacing)
        apart = np.full(len(lines), np.inf)
        np.minimum.at(apart, np.repeat(number, 2), high - low)
        apart[np.isinf(apart)] = -np.inf
        found = parts[number == np.argmax(apart)]
        past = _PAST * np.array([-across, across])
        return [one + (past if (one[1] - one[0]) @ across > 0.0 else -past) for one in found]


def limits_of(points: FloatArray, spacing: float, floor: float) -> Limits:
    """Return the limits of corners of a roof by its points, shape (n_points, 3) [m]."""
    return Limits(by_square(points, AROUND * spacing), spacing, floor)
