"""A terrain that grows: candidates join a TIN round by round, as far as the limits given allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.stages.ground_filter.growing_tin.frame import edge_gradients
from lidar_buildings.core.stages.ground_filter.growing_tin.growth_rounds import Mesh, join_in_rounds
from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex, with_room
from lidar_buildings.core.surfaces.tin import corners_of, plane_elevation, plane_slope, walk
from lidar_buildings.core.surfaces.triangulation import build_tin


class GrowthLimits(NamedTuple):
    """How far from its facet a candidate may be to join."""

    angle: float  #: largest angle at which it may be seen from the corners of a level facet [rad]
    slope_gain: float  #: by how much of a facet's own slope that angle grows
    distance: float  #: largest distance above the facet [m]


@dataclass(eq=False)
class TerrainGrowth:
    """A TIN and the candidates that may join it."""

    #: Which candidates it began with; the others wait, in their order, shape (n_candidates,).
    is_seed: NDArray[np.bool_]
    #: The seeds, the frame and the waiting candidates, relative to the TIN's origin, with room for all.
    mesh: Mesh
    n_triangles: int  #: how many of the mesh's triangles are in use
    #: Of each waiting candidate whether it has joined and in which triangle it was seen last.
    joined: NDArray[np.bool_]
    home: NDArray[np.int32]

    def copy(self) -> TerrainGrowth:
        """Return a terrain that can grow on without changing this one."""
        mesh = self.mesh
        mesh = mesh._replace(
            vertices=mesh.vertices.copy(), triangles=mesh.triangles.copy(), neighbours=mesh.neighbours.copy()
        )
        return replace(self, mesh=mesh, joined=self.joined.copy(), home=self.home.copy())

    def grow(self, limits: GrowthLimits, excluded: NDArray[np.bool_] | None = None) -> None:
        """Let candidates join until none is left that may; those `excluded` never may."""
        waiting = ~self.joined if excluded is None else ~(self.joined | excluded[~self.is_seed])
        rows = np.flatnonzero(waiting).astype(np.int32)
        self.n_triangles = join_in_rounds(
            self.mesh, self.n_triangles, tuple(limits), rows, self.home, self.joined
        )

    def insert(self, chosen: NDArray[np.bool_]) -> None:
        """Let the chosen candidates join, whatever the limits."""
        rows = np.flatnonzero(chosen[~self.is_seed] & ~self.joined)
        self.n_triangles = _insert_all(rows, self.mesh, self.n_triangles, self.joined, self.home)

    def height_and_slope(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return every candidate's height above the terrain [m], and the terrain's slope there (rise over run).
        """
        height, slope = np.zeros(len(self.is_seed)), np.zeros(len(self.is_seed))
        rows = np.flatnonzero(~self.is_seed).astype(np.int32)
        for_row_blocks(lambda a, b: _heights(self.mesh, self.home, rows, height, slope, a, b), len(rows))
        return height, slope


def start_growth(
    candidates: NDArray[np.float64], is_seed: NDArray[np.bool_], extent: NDArray[np.float64]
) -> TerrainGrowth:
    """
    Triangulate the seeds, one at least; the other candidates wait.

    At most one candidate a place, in an order that puts neighbours together; `extent` is what the terrain has
    to cover.
    """
    start = build_tin(candidates[is_seed], extent)
    waiting = candidates[~is_seed] - [*start.origin, 0.0]
    vertices = np.vstack((start.vertices, waiting))
    room = len(start.triangles) + 2 * len(waiting)
    mesh = Mesh(
        vertices,
        with_room(start.triangles, room),
        with_room(start.neighbours, room),
        start.n_real,
        len(start.vertices),
        edge_gradients(start.vertices[: start.n_real], start.vertices[start.n_real :]),
    )
    joined, home = np.zeros(len(waiting), dtype=np.bool_), start.locate(candidates[~is_seed])
    return TerrainGrowth(is_seed, mesh, len(start.triangles), joined, home)


@kernel
def _insert_all(rows, mesh, n_triangles, joined, home):  # type: ignore[no-untyped-def]
    vertices, triangles, neighbours, _, n_start, _ = mesh
    for i in rows:
        p = n_start + i
        within = walk(vertices[p, 0], vertices[p, 1], home[i], vertices, triangles, neighbours)
        n_triangles = insert_vertex(p, within, n_triangles, vertices, triangles, neighbours)
        joined[i], home[i] = True, within
    return n_triangles


@kernel
def _heights(mesh, home, rows, height, slope, begin, end):  # type: ignore[no-untyped-def]
    vertices, triangles, neighbours, _, n_start, _ = mesh
    for i in range(begin, end):
        x, y, z = vertices[n_start + i, 0], vertices[n_start + i, 1], vertices[n_start + i, 2]
        here = walk(x, y, home[i], vertices, triangles, neighbours)
        a, b, c = corners_of(here, vertices, triangles)
        height[rows[i]] = z - plane_elevation(x, y, a, b, c)
        slope[rows[i]] = plane_slope(a, b, c)
