"""Rings traced one after the other over the same points, with the recovery of walks that fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.boundary_tracing.courtyards import (
    CourtyardRules,
    EmptyDiscs,
    narrow_share,
    nearest_free,
)
from lidar_buildings.core.stages.boundary_tracing.open_ground import OpenGround
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid, holds, misplaced
from lidar_buildings.core.stages.boundary_tracing.walk import (
    ASTRAY,
    NO_ROOM,
    STUCK,
    add_edge,
    bridge_gap,
    empty_edge_cells,
    remove_edges,
    walk_round,
    widen_about,
    with_more_room,
)

#: Walks tried for the outer ring before another method takes over, and for a courtyard's before it is none.
_MAX_WALKS, _MAX_RIM_WALKS = 40, 8
#: A walk round a courtyard that takes more than so many times the steps of the outer ring has lost its way.
_MAX_RIM_STEPS = 2
#: Points that a walk round an empty place is begun from before the place is given up.
_MAX_STARTS = 4
#: Empty discs looked at, and those among them whose rims could not be traced: a cloud with more is no roof,
#: but has been given a spacing that is not its own.
_MAX_DISCS, _MAX_FAILURES = 2000, 20
#: Points in one cell that a walk can still look through, where cells had to be enlarged.
_MAX_CROWD = 2000
#: Among the reasons of a ring that was not walked.
NO_WALK = "no walk round all points was found: the ring comes from a triangulation"
_SHARED_RIM = "an empty place shares its rim with the outer ring: it is taken for roof"


def characteristic_ring(xy: NDArray[np.float64], max_edge: float) -> NDArray[np.int64]:
    """
    Return the rows of a simple ring round all points, distinct and not all on a line.

    The boundary of the Delaunay triangulation is worn away from outside, the longest boundary edge first,
    until none is longer than `max_edge` except where the ring would break in two: the characteristic shape of
    Duckham et al. (2008). Of points so close that they cannot be triangulated it is the convex hull.
    """
    points = shapely.multipoints(xy)
    try:
        edges = shapely.length(shapely.get_parts(shapely.delaunay_triangles(points, only_edges=True)))
        least, longest = edges.min(initial=np.inf), edges.max(initial=0.0)
        share = 1.0 if max_edge >= longest else max(max_edge - least, 0.0) / (longest - least)
        hull = shapely.concave_hull(points, ratio=share)
    except shapely.errors.GEOSException:  # points that lie closer than GEOS tells apart
        hull = shapely.convex_hull(points)
    return np.asarray(cKDTree(xy).query(shapely.get_coordinates(hull)[:-1])[1], dtype=np.int64)


class RingTracer:
    """
    Traces a building's outer ring, then its courtyards, so that no two rings meet.

    The grid has distinct positions that are not all on a line. Where a walk fails the neighbourhood may be
    enlarged `max_reach` times. Places of open ground are among the positions; no ring goes round them but a
    courtyard's. `reasons` tell what was out of the ordinary.
    """

    def __init__(self, grid: PointGrid, max_reach: float, ground: OpenGround | None = None) -> None:
        self._grid = grid
        self._max_reach = max(1.0, max_reach)
        self._follower = np.full(len(grid.x), -1, dtype=np.int64)
        self._edges = empty_edge_cells(grid)
        self._exterior = np.zeros(0, dtype=np.int64)
        self._holes: list[NDArray[np.int64]] = []
        self.reasons: list[str] = []
        self._is_own = np.ones(len(grid.x), dtype=bool)
        self._middles = np.zeros((0, 2)) if ground is None else ground.middles
        if ground is not None:
            self._fence(ground)

    def outline(self) -> Outline:
        """Return what was traced so far; the rings start at their westernmost vertex."""
        rings = [self._positions(rows) for rows in (self._exterior, *self._holes)]
        exterior, *holes = (np.roll(ring, -np.lexsort(ring.T[::-1])[0], axis=0) for ring in rings)
        return Outline(exterior, tuple(holes)).oriented()

    def trace_exterior(self) -> None:
        """Trace the ring round all points from the outermost one, or take it from triangles."""
        own = np.flatnonzero(self._is_own)
        x, y = self._grid.x[own], self._grid.y[own]
        dx, dy = x - x.mean(), y - y.mean()
        start = int(np.argmax(dx * dx + dy * dy))
        heading = float(dx[start]), float(dy[start])
        # Mirrored points are walked round the other way, so that their ring is the mirrored ring.
        across = heading[0] * dy - heading[1] * dx
        skew = float((across * across * across).sum())
        self._grid = self._grid._replace(orientation=1 if skew >= 0 else -1)
        ring = None
        if self._grid.cell == 1.0 or np.diff(self._grid.first).max() <= _MAX_CROWD:
            ring = self._walk(
                int(own[start]), heading, _MAX_WALKS, len(x), lambda rows: self._wrong(rows, False)
            )
        if ring is None:
            self._note(NO_WALK)
            ring = self._ring_by_triangles()
        self._exterior = ring

    def trace_courtyards(self, rules: CourtyardRules) -> None:
        """
        Trace the rims of the empty discs inside the outer ring that are courtyards.

        Where no walk round all points was found there are none: their gaps are wider than the windows.
        """
        if NO_WALK in self.reasons:
            return
        grid = self._grid
        unit = 1.0 / np.sqrt(abs(grid.ux * grid.vy - grid.uy * grid.vx))
        discs = EmptyDiscs(grid, self._exterior, rules.radius)
        exterior = shapely.Polygon(self._positions(self._exterior))
        for place in self._middles[shapely.contains_xy(exterior, self._middles)].tolist():
            if not any(holds(grid, hole, *place) for hole in self._holes):
                self._add_courtyard(place, rules, discs, 0.0)
        n_failures = 0
        for _ in range(_MAX_DISCS):
            centre = discs.next_centre()
            if centre is None or n_failures >= _MAX_FAILURES:
                break
            if not self._add_courtyard(centre, rules, discs, rules.min_band / unit):
                n_failures += 1
                discs.give_up()

    def _add_courtyard(
        self, centre: Sequence[float], rules: CourtyardRules, discs: EmptyDiscs, min_band: float
    ) -> bool:
        """Add the courtyard round a place, if it is one; False if there is no rim round the place."""
        before = int(self._edges.size[0])
        hole = self._rim(centre)
        if hole is None:
            self._note(_SHARED_RIM)
            return False
        discs.close(hole)
        narrow = narrow_share(self._grid, hole, self._exterior, min_band)
        refusal = rules.refusal(self._positions(hole), narrow)
        if refusal is None:
            self._holes.append(hole)
        else:
            self._note(refusal)
            self._give_up(hole, before)
        return True

    def _fence(self, ground: OpenGround) -> None:
        """Enter the fences between places of open ground, which no walk takes for its points."""
        away, place = cKDTree(ground.places).query(np.column_stack((self._grid.x, self._grid.y)))
        rows = np.flatnonzero(away == 0.0)
        self._is_own[rows] = False
        row_of = np.empty(len(ground.places), dtype=np.int64)
        row_of[place[rows]] = rows
        self._follower[row_of] = row_of[ground.other_end]
        self._enter(rows[self._follower[rows] != rows])

    def _enter(self, rows: NDArray[np.int64]) -> None:
        for row in rows.tolist():
            while not add_edge(self._grid, self._edges, row, self._follower[row]):
                self._edges = with_more_room(self._edges)

    def _rim(self, centre: Sequence[float]) -> NDArray[np.int64] | None:
        """Walk round an empty place from one of the points nearest to it that no other ring has taken."""
        max_steps = _MAX_RIM_STEPS * len(self._exterior)

        def inside(rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
            return self._wrong(rows, True) if holds(self._grid, rows, *centre) else None

        for start in nearest_free(self._grid, self._follower, centre, _MAX_STARTS).tolist():
            heading = centre[0] - float(self._grid.x[start]), centre[1] - float(self._grid.y[start])
            ring = self._walk(start, heading, _MAX_RIM_WALKS, max_steps, inside)
            if ring is not None:
                return ring
        return None

    def _walk(
        self,
        start: int,
        heading: tuple[float, float],
        max_walks: int,
        max_steps: int,
        points_on_wrong_side: Callable[[NDArray[np.int64]], NDArray[np.int64] | None],
    ) -> NDArray[np.int64] | None:
        """Walk from a row until a ring gives no trouble; widen the reach where the last walk did."""
        # The heading leads into the empty side; the callable returns the rows on a ring's wrong side, or
        # None.
        grid, before = self._grid, int(self._edges.size[0])
        reach = np.ones(len(self._follower))
        for _ in range(max_walks):
            ring, end = walk_round(
                grid, self._edges, self._follower, reach, self._max_reach, start, heading, max_steps
            )
            if end == NO_ROOM:
                self._edges = with_more_room(self._edges)
                continue
            if end == ASTRAY:
                break
            if end == STUCK:
                is_wider = widen_about(grid, reach, ring[-1], self._max_reach)
            else:
                wrong = points_on_wrong_side(ring)
                if wrong is not None and not len(wrong):
                    return ring
                self._give_up(ring, before)
                is_wider = wrong is not None and bridge_gap(grid, reach, wrong, ring, self._max_reach)
            if not is_wider:
                break
        return None

    def _wrong(self, ring: NDArray[np.int64], inside: bool) -> NDArray[np.int64]:
        rows = misplaced(self._grid, ring, inside)
        return rows[self._is_own[rows]]

    def _ring_by_triangles(self) -> NDArray[np.int64]:
        """Return a ring that is simple and holds all points, whatever they are; its edges are entered."""
        grid = self._grid
        xy = np.column_stack([grid.x, grid.y])
        unit = 1.0 / min(np.hypot(grid.ux, grid.uy), np.hypot(grid.vx, grid.vy))
        ring = characteristic_ring(xy, np.sqrt(self._max_reach) * unit)
        self._follower[ring] = np.roll(ring, -1)
        self._enter(ring)
        return ring

    def _give_up(self, ring: NDArray[np.int64], size: int) -> None:
        """Free a ring's points, and take out the edges entered after the first `size` entries."""
        self._follower[ring] = -1
        remove_edges(self._edges, size)

    def _note(self, reason: str) -> None:
        if reason and reason not in self.reasons:
            self.reasons.append(reason)

    def _positions(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.column_stack([self._grid.x[rows], self._grid.y[rows]])
