"""
Rings traced one after the other over the same points, with the cures for walks that fail.

"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.boundary_tracing.triangles import characteristic_ring, empty_discs
from lidar_buildings.core.boundary_tracing.walk import prepare_ground, walk_round
from lidar_buildings.core.outline import Outline, signed_area

#: Walks tried per ring before another method takes over.
_MAX_WALKS = 16
#: How the reach grows round the place where a walk failed.
_GROWTH = 1.5
#: Points closer to the ring than this lie on it [reaches].
_ON_RING = 1e-6


class RingTracer:
    """
    Traces a building's outer ring, then its courtyards, so that no two rings meet.

    Parameters
    ----------
    positions : ndarray of shape (n_positions, 2)
        Distinct, not all on a line [m].
    reach : float
        Radius of the neighbourhood that each step looks at [m].
    max_reach : float
        Radius that it may grow to where a walk fails [m].

    Attributes
    ----------
    reasons : list of str
        What was out of the ordinary.

    """

    def __init__(self, positions: NDArray[np.float64], reach: float, max_reach: float) -> None:
        """
        Sort the positions for walking.

        """
        self._ground = prepare_ground(positions, reach)
        self._reach = reach
        self._max_reach = max(reach, max_reach)
        self._follower = np.full(len(positions), -1, dtype=np.int64)
        self._exterior = np.zeros(0, dtype=np.int64)
        self._holes: list[NDArray[np.int64]] = []
        self.reasons: list[str] = []

    def outline(self) -> Outline:
        """
        Return what was traced so far; the rings start at their westernmost vertex.

        """
        rings = [_from_west(self._ground.xy[rows]) for rows in (self._exterior, *self._holes)]
        return Outline(rings[0], tuple(rings[1:])).oriented()

    def trace_exterior(self) -> None:
        """
        Trace the ring round all points from the westernmost one, or take it from a triangulation.

        """
        xy = self._ground.xy
        start = int(np.lexsort((xy[:, 1], xy[:, 0]))[0])
        ring = self._walk(start, -np.pi / 2, self._left_outside)
        if ring is None:
            self.reasons.append("no walk round all points was found: the ring comes from a triangulation")
            ring = self._ring_by_triangles()
            self._follower[ring] = np.roll(ring, -1)
        self._exterior = ring

    def trace_courtyards(self, min_radius: float, min_area: float) -> None:
        """
        Trace the rims of the empty places inside the outer ring that a disc fits into.

        Parameters
        ----------
        min_radius : float
            The disc's radius [m].
        min_area : float
            Smallest area of a courtyard [m²].

        """
        xy = self._ground.xy
        ring = shapely.polygons(xy[self._exterior])
        if not _may_hold_disc(xy, ring, min_radius):
            return
        centre, radius, corners = empty_discs(xy, min_radius)
        shapely.prepare(ring)
        remaining = shapely.contains_xy(ring, centre)
        while remaining.any():
            disc = int(np.argmax(remaining))
            remaining &= np.hypot(*(centre - centre[disc]).T) > radius[disc]
            hole = self._rim(corners[disc], centre[disc])
            if hole is None:
                self.reasons.append("the rim of an empty place could not be traced")
                continue
            polygon = shapely.polygons(xy[hole])
            remaining &= ~shapely.contains_xy(polygon, centre)
            if polygon.area >= min_area:
                self._holes.append(hole)
            else:
                self._follower[hole] = -1

    def _rim(self, corners: NDArray[np.int64], centre: NDArray[np.float64]) -> NDArray[np.int64] | None:
        """
        Walk round an empty disc from one of the points on its edge that no other ring has taken.

        """
        free = corners[self._follower[corners] == -1]
        for start in sorted(free.tolist()):
            heading = float(np.arctan2(*(centre - self._ground.xy[start])[::-1]))
            ring = self._walk(start, heading, lambda rows: self._inside_hole(rows, centre))
            if ring is not None:
                return ring
        return None

    def _walk(
        self,
        start: int,
        heading: float,
        trouble_with: Callable[[NDArray[np.int64]], NDArray[np.int64] | None],
    ) -> NDArray[np.int64] | None:
        """
        Walk until a ring gives no trouble; widen the reach where the last walk did.

        Parameters
        ----------
        trouble_with : callable
            Returns the rows at which a closed ring is wrong, or None if it is beyond cure.

        """
        reach = np.full(len(self._follower), self._reach)
        for _ in range(_MAX_WALKS):
            ring, closed = walk_round(self._ground, start, heading, reach, self._max_reach, self._follower)
            trouble = trouble_with(ring) if closed else ring[-1:]
            if closed and trouble is not None and not len(trouble):
                return ring
            if closed:
                self._follower[ring] = -1
            if trouble is None or not self._widen(reach, trouble):
                break
        return None

    def _widen(self, reach: NDArray[np.float64], trouble: NDArray[np.int64]) -> bool:
        """
        Widen the reach of the points about the trouble; False where it cannot grow any more.

        """
        xy = self._ground.xy
        widest = float(reach[trouble].max())
        near = np.unique(np.concatenate(cKDTree(xy).query_ball_point(xy[trouble], 2 * widest))).astype(
            np.int64
        )
        wider = np.minimum(reach[near] * _GROWTH, self._max_reach)
        if np.array_equal(wider, reach[near]):
            return False
        reach[near] = wider
        return True

    def _left_outside(self, rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """
        Return the points that lie outside an outer ring.

        """
        xy = self._ground.xy
        ring = shapely.polygons(xy[rows])
        if not ring.is_valid:
            return None
        shapely.prepare(ring)
        outside = np.flatnonzero(~shapely.intersects_xy(ring, xy))
        on_ring = shapely.dwithin(ring, shapely.points(xy[outside]), _ON_RING * self._reach)
        return outside[~on_ring]

    def _inside_hole(self, rows: NDArray[np.int64], centre: NDArray[np.float64]) -> NDArray[np.int64] | None:
        """
        Return the points that lie inside a courtyard's rim; None if it is no rim round the centre.

        """
        xy = self._ground.xy
        if signed_area(xy[rows]) <= 0:
            return None
        ring = shapely.polygons(xy[rows])
        if not ring.is_valid or not shapely.contains_xy(ring, *centre):
            return None
        rim = ring.exterior
        shapely.prepare([ring, rim])
        inside = np.flatnonzero(shapely.contains_xy(ring, xy))
        on_ring = shapely.dwithin(rim, shapely.points(xy[inside]), _ON_RING * self._reach)
        return inside[~on_ring]

    def _ring_by_triangles(self) -> NDArray[np.int64]:
        """
        Return a ring that is simple and holds all points, whatever they are.

        """
        xy = self._ground.xy
        for max_edge in (self._reach, self._max_reach, np.inf):
            ring = characteristic_ring(xy, max_edge)
            outside = self._left_outside(ring)
            if outside is not None and not len(outside):
                break
        return ring


def _may_hold_disc(xy: NDArray[np.float64], ring: shapely.Polygon, radius: float) -> bool:
    """
    Whether an empty disc may lie inside a ring; quick, and true when in doubt.

    A disc holds a whole cell of the map's grid whose side is radius / √2: without an empty cell whose centre
    is inside the ring, there is no disc.

    """
    side = radius / np.sqrt(2.0)
    first = np.floor(xy.min(axis=0) / side)
    n_columns, n_rows = (np.floor(xy.max(axis=0) / side) - first).astype(np.int64) + 1
    if n_columns * n_rows > 20 * len(xy):
        return True
    column, row = (np.floor(xy / side) - first).astype(np.int64).T
    empty = np.ones((n_rows, n_columns), dtype=bool)
    empty[row, column] = False
    row, column = np.nonzero(empty)
    middle = (first + np.column_stack([column, row]) + 0.5) * side
    shapely.prepare(ring)
    return bool(shapely.contains_xy(ring, middle).any())


def _from_west(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return a ring from its westernmost vertex on.

    """
    return np.roll(ring, -int(np.lexsort((ring[:, 1], ring[:, 0]))[0]), axis=0)
