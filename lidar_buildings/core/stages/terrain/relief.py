"""The ground as few triangles: a raster's nodes, chosen until none of the others is far off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.surfaces.incremental_delaunay import with_room
from lidar_buildings.core.surfaces.tin import Tin, walk
from lidar_buildings.core.surfaces.triangulation import insert_all

#: A mesh of more triangles or rounds is refined no more; wide margins: towns need a quarter, and ten rounds.
_MOST_TRIANGLES, _MOST_ROUNDS = 40_000, 40
#: On a straight rim of the data every such node is a vertex.
_RIM_STEP = 16


def relief(
    elevation: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
    """
    Choose nodes of a raster whose triangulation is nowhere further from the others than the tolerance.

    Along the raster's four sides lines are simplified by themselves (Douglas and Peucker 1973), so that
    rasters that share a side have the same vertices there. Within, the worst node of each triangle becomes a
    vertex, round by round (Garland and Heckbert 1995).

    Elevations, shape (height, width), the northernmost row first, and the tolerance are in [m]; no triangle
    lies where they are NaN. Return rows and columns of the nodes that are vertices, row by row, and which of
    these make each triangle, shape (n, 3), counter-clockwise from above. Triangles that meet in a vertex are
    neighbours by edges around it, so that the surface is a manifold.
    """
    known = ~np.isnan(elevation)
    inner = np.zeros_like(known)
    inner[1:-1, 1:-1] = known[1:-1, 1:-1]
    chosen = _rim(known) & inner
    for side in ((0, slice(None)), (-1, slice(None)), (slice(None), 0), (slice(None), -1)):
        chosen[side] |= _simplified(elevation[side], tolerance)
    places = np.indices(known.shape).reshape(2, -1)
    nodes = np.column_stack([places[1], -places[0], np.where(known, elevation, 0.0).ravel()])
    first = np.flatnonzero(chosen)
    nothing = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int32)
    if len(first) < 3:
        return nothing
    try:
        mesh = _Mesh(nodes, first)
    except QhullError:  # all on a line
        return nothing
    tin = mesh.tin()
    within = _within_hull(tin, nodes)  # which no round changes: what lies beyond it has no error
    candidates = np.flatnonzero(within & inner.ravel())
    for _ in range(_MOST_ROUNDS):
        worst = _worst_nodes(candidates, nodes, tin.triangles, tin.neighbours, tolerance)
        if not len(worst) or mesh.n_triangles > _MOST_TRIANGLES:
            break
        mesh.insert(worst)
        tin = mesh.tin()
    kept = _manifold(_over_known(tin, nodes, within, known), nodes)
    used, triangles = np.unique(kept, return_inverse=True)
    rows, columns = np.divmod(used.astype(np.int64), known.shape[1])
    return rows, columns, triangles.reshape(-1, 3).astype(np.int32)


class _Mesh:
    """A Delaunay triangulation of nodes without any frame, as hulls have to fit those of neighbours."""

    def __init__(self, nodes: NDArray[np.float64], first: NDArray[np.intp]) -> None:
        found = Delaunay(nodes[first, :2])
        self._nodes, self.n_triangles = nodes, len(found.simplices)
        self._extent = extent_of(nodes[first, :2])
        self._triangles = with_room(first[found.simplices], 2 * len(nodes))
        self._neighbours = with_room(found.neighbors, 2 * len(nodes))

    def tin(self) -> Tin:
        """Return the mesh as it is, with all nodes as its vertices."""
        triangles, neighbours = (each[: self.n_triangles] for each in (self._triangles, self._neighbours))
        return Tin(self._nodes, triangles, neighbours, len(self._nodes), self._extent, np.zeros(2))

    def insert(self, rows: NDArray[np.intp]) -> None:
        """Make nodes within the hull vertices, in this order."""
        mesh = self._nodes, self._triangles, self._neighbours
        self.n_triangles = insert_all(rows, *mesh, self.n_triangles)


def _simplified(line: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
    """Return the nodes that stay of a line of equal steps, of each known run at least the ends."""
    kept = np.zeros(len(line), dtype=bool)
    known = np.concatenate([[False], ~np.isnan(line), [False]])
    starts, ends = np.flatnonzero(np.diff(known.astype(np.int8)) != 0).reshape(-1, 2).T
    spans = list(zip(starts.tolist(), (ends - 1).tolist(), strict=True))
    while spans:
        first, last = spans.pop()
        kept[[first, last]] = True
        if last - first < 2:
            continue
        chord = np.linspace(line[first], line[last], last - first + 1)
        away = np.abs(line[first : last + 1] - chord)
        middle = int(away.argmax())
        if away[middle] > tolerance:
            spans += [(first, first + middle), (first + middle, last)]
    return kept


def _rim(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return known nodes beside unknown ones; of straight rows of them the ends and some between."""
    around = np.pad(known, 1, mode="edge")
    rim = known & ~(around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:])
    beside = np.pad(rim, 1)
    straight = (beside[:-2, 1:-1] & beside[2:, 1:-1]) | (beside[1:-1, :-2] & beside[1:-1, 2:])
    rows, columns = np.indices(known.shape)
    return rim & (~straight | ((rows + columns) % _RIM_STEP == 0))


def _within_hull(tin: Tin, nodes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether nodes lie in the triangle that is nearest to them."""
    a, b, c = tin.vertices[tin.triangles[tin.locate(nodes)], :2].transpose(1, 2, 0)
    (ux, uy), (vx, vy), (px, py) = b - a, c - a, nodes[:, :2].T - a
    area = ux * vy - uy * vx
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (px * vy - py * vx) / area, (ux * py - uy * px) / area
    return np.asarray((one >= 0.0) & (other >= 0.0) & (one + other <= 1.0 + 1e-12))


@kernel
def _worst_nodes(candidates, nodes, triangles, neighbours, tolerance):  # type: ignore[no-untyped-def]
    """Return the node of each triangle that is furthest off, where it is by more than the tolerance."""
    worst, most = np.full(len(triangles), -1, dtype=np.int64), np.full(len(triangles), tolerance)
    triangle, last = np.int32(0), -1
    ax = ay = az = east = north = 0.0
    for row in candidates:
        x, y, z = nodes[row]
        triangle = walk(x, y, triangle, nodes, triangles, neighbours)
        if triangle != last:
            last = triangle
            a, b, c = triangles[triangle]
            ax, ay, az = nodes[a]
            ux, uy, uz = nodes[b, 0] - ax, nodes[b, 1] - ay, nodes[b, 2] - az
            vx, vy, vz = nodes[c, 0] - ax, nodes[c, 1] - ay, nodes[c, 2] - az
            area = ux * vy - uy * vx  # without any there is no distance
            east, north = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
        off = abs(east * (x - ax) + north * (y - ay) + az - z)
        if off > most[triangle]:
            worst[triangle], most[triangle] = row, off
    return worst[worst >= 0]


def _over_known(
    tin: Tin, nodes: NDArray[np.float64], within: NDArray[np.bool_], known: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Return the triangles over known ground: by most nodes in each, else by those round its middle."""
    triangle, n = tin.locate(nodes), len(tin.triangles)
    in_all = np.bincount(triangle[within], minlength=n)
    in_known = np.bincount(triangle[within & known.ravel()], minlength=n)
    corners = tin.vertices[tin.triangles]
    (ux, uy), (vx, vy) = ((corners[:, k, :2] - corners[:, 0, :2]).T for k in (1, 2))
    x, y = corners[:, :, :2].mean(axis=1).T
    low, high = ([up(-y).astype(np.intp), up(x).astype(np.intp)] for up in (np.floor, np.ceil))
    round_middle = (
        known[low[0], low[1]] & known[low[0], high[1]] & known[high[0], low[1]] & known[high[0], high[1]]
    )
    # every triangle holds its corners or shares them: three nodes say nothing
    kept = np.where(in_all > 3, 2 * in_known > in_all, round_middle) & (ux * vy - uy * vx > 0.0)
    return tin.triangles[kept]


def _manifold(triangles: NDArray[np.int32], nodes: NDArray[np.float64]) -> NDArray[np.int32]:
    """Leave out what hangs by a vertex alone: there the largest of the fans of triangles stays."""
    while len(triangles):
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        shared, n_sides = np.unique(edges, axis=0, return_counts=True)
        # an open fan has one shared edge fewer than triangles, a closed one as many
        at_vertex, n = triangles.ravel(), len(nodes)
        n_fans = np.bincount(at_vertex, minlength=n) - np.bincount(shared[n_sides == 2].ravel(), minlength=n)
        pinched = np.flatnonzero(n_fans > 1)
        if not len(pinched):
            break
        order = np.argsort(at_vertex, kind="stable")
        first, end = (np.searchsorted(at_vertex, pinched, side, sorter=order) for side in ("left", "right"))
        left_out = [
            _smaller_fans(order[low:high] // 3, int(vertex), triangles, nodes)
            for vertex, low, high in zip(pinched, first, end, strict=True)
        ]
        triangles = np.delete(triangles, np.concatenate(left_out), axis=0)
    return triangles


def _smaller_fans(
    rows: NDArray[np.intp], vertex: int, triangles: NDArray[np.int32], nodes: NDArray[np.float64]
) -> list[int]:
    """Return the triangles around a vertex, of rows, but for those of its largest fan."""
    turned = {}
    for row in rows.tolist():
        corners = triangles[row].tolist()
        at = corners.index(vertex)
        turned[corners[at - 2]] = corners[at - 1], row  # by the edge in which its fan comes to it
    comes_from = {leaves for leaves, _ in turned.values()}
    fans = []
    for corner in [corner for corner in turned if corner not in comes_from]:
        fan = []
        while corner in turned:
            corner, row = turned.pop(corner)
            fan.append(row)
        fans.append(fan)
    largest = int(np.argmax([_area(triangles[fan], nodes) for fan in fans]))
    return [row for number, fan in enumerate(fans) if number != largest for row in fan]


def _area(triangles: NDArray[np.int32], nodes: NDArray[np.float64]) -> float:
    a, b, c = nodes[triangles, :2].transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return float((ux * vy - uy * vx).sum()) / 2.0
